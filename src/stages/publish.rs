//! From certified eigenpairs to files: those of `publish.formats`, `descriptors.npz`, `recipe.toml`, `run.json`, and last
//! `spectrum.json`.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use serde_json::json;

use super::Failure;
use super::candidates::{Grown, Origin};
use super::context::Context;
use super::ingest::Loaded;
use super::intake::Job;
use super::predict::Predicted;
use super::train::{TrainedBlock, named};
use super::verify::{Deviations, Verified};
use crate::descriptors::Basis;
use crate::flow::events::How;
use crate::mesh::Area;
use crate::operators::mass::row_sums;
use crate::operators::{Laplacian, MassKind, Operators};
use crate::pipeline::{ExportFormat, Method, Pages, Pipeline, Train};
use crate::publish::PublishError;
use crate::publish::atomic::{remove, write_if_changed};
use crate::publish::export;
use crate::publish::npz::EigenArrays;
use crate::publish::page::{self, Curve, MeshPage};
use crate::publish::report::{MeshReport, PairRecord, RunRecord, RunRecordSchema, StageRecord};
use crate::publish::result::{
    AgainstFormula, Eigenpair, Inheritance, MeshSummary, Provenance, Source, Spectrum, Verdict,
};
use crate::spectrum::Eigenpairs;
use crate::spectrum::certificate::PairCertificate;
use crate::spectrum::cluster::{CLUSTER_GAP, clusters, zero_below};

/// Writes the results of one mesh to its folder and reports them.
///
/// # Errors
/// When a file cannot be written.
pub fn publish(context: &Context, item: usize, verified: Verified) -> Result<MeshReport, Failure> {
    let spectrum = spectrum(context, &verified);
    let Verified { assembled, origin, vectors, order, certificate, judgement, refinement, .. } =
        verified;
    let learned = || Eigenpairs {
        values: certificate.pairs.iter().map(|pair| pair.lambda).collect(),
        vectors,
    };
    let results = Results {
        pairs: refinement.map_or_else(learned, |refined| refined.pairs),
        mass: row_sums(&assembled.operators.mass),
        mass_kind: assembled.operators.mass_kind,
        reason: (!judgement.is_verified()).then(|| judgement.reason()),
        recipe_file: origin.chosen().and_then(|chosen| chosen.recipe_file.clone()),
        curves: curves(&origin),
        spectrum,
        operators: Some(assembled.operators),
    };
    write(context, item, assembled.loaded, results, |stages| record(stages, &origin, &order))
}

/// Writes predictions that were not verified, and reports them.
///
/// # Errors
/// When a file cannot be written.
pub fn publish_predicted(
    context: &Context,
    item: usize,
    predicted: Predicted,
) -> Result<MeshReport, Failure> {
    let spectrum = predicted_spectrum(context, &predicted);
    let Predicted { loaded, pencil, vectors, how, refinement, .. } = predicted;
    let order: Vec<usize> = (0..vectors.ncols()).collect();
    // A prediction has no matrices of its own.
    let wanted = context.pipeline.publish.formats.iter().any(|format| format.takes_operators());
    let operators = match wanted {
        true => {
            Some(Operators::assemble(&loaded.ingested.mesh, context.pipeline.operators)?.into())
        }
        false => None,
    };
    let learned = || Eigenpairs {
        values: spectrum.eigenpairs.iter().map(|pair| pair.lambda).collect(),
        vectors,
    };
    let results = Results {
        pairs: refinement.map_or_else(learned, |refined| refined.pairs),
        mass: pencil.vertex_areas(),
        mass_kind: pencil.mass_kind(),
        reason: Some(NOT_VERIFIED.into()),
        recipe_file: None,
        curves: vec![],
        spectrum,
        operators,
    };
    write(context, item, loaded, results, |stages| solved_record(stages, how, order.len()))
}

/// How the trainings of the blocks went; those on one trunk have one.
fn curves(origin: &Origin) -> Vec<Curve> {
    let Origin::Learned { blocks, .. } = origin else { return vec![] };
    let trunks = blocks.chunk_by(|a, b| a.block.shares_trunk(&b.block));
    let curve = |blocks: &[TrainedBlock]| {
        let (first, last) = (blocks.first()?, blocks.last()?);
        let quotients = first.block.record.history.clone();
        Some(Curve { name: named(&(first.k..=last.k)), quotients })
    };
    trunks.filter_map(curve).collect()
}

/// Why predictions that nobody asked to verify are not verified.
pub const NOT_VERIFIED: &str = "a prediction, held against nothing; --verify certifies it, for the price of both reference solvers";

/// What is written of a mesh.
struct Results {
    /// The arrays.
    pairs: Eigenpairs,
    mass: Vec<f64>,
    mass_kind: MassKind,
    /// The document.
    spectrum: Spectrum,
    /// What it falls short of.
    reason: Option<String>,
    /// The recipe that a search has found.
    recipe_file: Option<String>,
    /// How trainings went.
    curves: Vec<Curve>,
    /// What the eigenpairs are of.
    operators: Option<Arc<Operators>>,
}

fn write(
    context: &Context,
    item: usize,
    mut loaded: Loaded,
    results: Results,
    record: impl FnOnce(Vec<StageRecord>) -> RunRecord,
) -> Result<MeshReport, Failure> {
    let started = Instant::now();
    let Results { pairs, mass, mass_kind, spectrum, reason, recipe_file, curves, operators } =
        results;
    let ingested = loaded.ingested.clone();
    let mesh = &ingested.mesh;
    let folder = context.out.join(&loaded.job.name);
    let descriptors = descriptors(context, &pairs, &mass, mesh.area())?;
    let document = spectrum.to_json();
    withdraw(&folder, Some(&document))?;
    let vertex_map = &ingested.vertex_map;
    let file_vertices = ingested.file_vertices.as_deref();
    let (pairs, mass) = (&pairs, &*mass);
    let arrays = EigenArrays { mesh, pairs, mass, mass_kind, vertex_map, file_vertices };
    let exported = export::Results { arrays, spectrum: &spectrum, operators: operators.as_deref() };
    for format in ExportFormat::ALL {
        match context.pipeline.publish.writes(format) {
            true => export::write(format, &exported, &folder)?,
            false => export::remove_files(format, &folder)?,
        }
    }
    let path = folder.join(export::descriptors::FILE);
    match descriptors {
        Some(bytes) => drop(write_if_changed(&path, &bytes)?),
        None => remove(&path)?,
    }
    loaded.spent(StageRecord::PUBLISH, How::Computed, started.elapsed());
    let record = RunRecord { work: context.ledger.take(item), ..record(loaded.stages) };
    let page = folder.join(PAGE);
    if context.pipeline.publish.report == Pages::Written {
        let (name, reason) = (&*loaded.job.name, reason.as_deref());
        let (spectrum, record, curves) = (&spectrum, &record, &*curves);
        let page_of_mesh = MeshPage { name, mesh, pairs, spectrum, record, reason, curves };
        write_if_changed(&page, page_of_mesh.to_html().as_bytes())?;
    } else {
        remove(&page)?;
    }
    // A recipe is there to be used by other runs: one that finds none leaves an earlier one where it is.
    if let Some(text) = recipe_file {
        write_if_changed(&folder.join(RECIPE), text.as_bytes())?;
    }
    write_if_changed(&folder.join(RUN), &record.to_json())?;
    // Whoever waits for results waits for this file: all others are there when it is.
    write_if_changed(&folder.join(SPECTRUM), &document)?;
    let folder = folder.display().to_string();
    Ok(MeshReport::finished(loaded.job.name, folder, &spectrum, reason, &record))
}

/// The bytes of `descriptors.npz`, if any are asked for.
fn descriptors(
    context: &Context,
    pairs: &Eigenpairs,
    mass: &[f64],
    area: Area,
) -> Result<Option<Vec<u8>>, Failure> {
    let asked = &context.pipeline.publish.descriptors;
    if asked.is_empty() {
        return Ok(None);
    }
    let basis = Basis::new(pairs, mass.iter().sum());
    Ok(Some(export::descriptors::to_npz(asked, &basis, area)?))
}

/// The report of a mesh whose results are not written.
pub fn unwritten(spectrum: &Spectrum, verified: Verified) -> MeshReport {
    let Verified { assembled, origin, order, judgement, .. } = verified;
    let record = record(assembled.loaded.stages, &origin, &order);
    let reason = (!judgement.is_verified()).then(|| judgement.reason());
    MeshReport {
        out: None,
        ..MeshReport::finished(assembled.loaded.job.name, String::new(), spectrum, reason, &record)
    }
}

/// The report of predictions that are neither verified nor written.
pub fn unwritten_predicted(spectrum: &Spectrum, predicted: Predicted) -> MeshReport {
    let k = predicted.vectors.ncols();
    let record = solved_record(predicted.loaded.stages, predicted.how, k);
    let (name, reason) = (predicted.loaded.job.name, Some(NOT_VERIFIED.into()));
    MeshReport { out: None, ..MeshReport::finished(name, String::new(), spectrum, reason, &record) }
}

const RECIPE: &str = "recipe.toml";
const PAGE: &str = page::FILE;

/// The file that tells what the work was.
pub const RUN: &str = "run.json";

/// The file whose presence says that the results beside it are whole and current.
const SPECTRUM: &str = "spectrum.json";

/// Takes back the results of an earlier run in `folder`, unless they are `current`: what no longer holds must not
/// stand as verified, and arrays must not change behind their certificate.
///
/// # Errors
/// When the system refuses.
pub fn withdraw(folder: &Path, current: Option<&[u8]>) -> Result<(), PublishError> {
    let path = folder.join(SPECTRUM);
    let earlier = std::fs::read(&path).ok();
    if earlier.is_none() || earlier.as_deref() == current {
        return Ok(());
    }
    remove(&path)?;
    remove(&folder.join(PAGE))
}

/// Takes back results of a time when the file of a mesh was cut otherwise: those of all of it where its objects are meshes of their own,
/// those of its objects where all of it is one.
///
/// # Errors
/// When the system refuses.
pub fn withdraw_otherwise_cut(context: &Context, job: &Job) -> Result<(), PublishError> {
    let folder = context.out.join(job.file_name());
    match job.object {
        Some(_) => withdraw(&folder, None),
        None => {
            let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
            let below = entries.filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_dir()));
            below.map(|entry| entry.path()).try_for_each(|object| withdraw(&object, None))
        }
    }
}

/// Removes the results of a mesh from the output folder `out`, and the folders that are empty then.
///
/// # Errors
/// When the system refuses.
pub fn remove_results(out: &Path, name: &str) -> Result<(), PublishError> {
    let folder = out.join(name);
    // First the one that says that the others are whole.
    for file in [SPECTRUM, RUN, export::descriptors::FILE, PAGE, RECIPE] {
        remove(&folder.join(file))?;
    }
    for format in ExportFormat::ALL {
        export::remove_files(format, &folder)?;
    }
    let folders = folder.ancestors().take_while(|folder| *folder != out);
    for folder in folders {
        // What somebody else has put there stays.
        if std::fs::remove_dir(folder).is_err() {
            break;
        }
    }
    Ok(())
}

/// Removes the results of a mesh that is called `to` now; the recipe that was found for it goes along.
///
/// # Errors
/// When the system refuses.
pub fn rename_results(out: &Path, from: &str, to: &str) -> Result<(), PublishError> {
    let [old, new] = [from, to].map(|name| out.join(name).join(RECIPE));
    // Where there is none, or there it cannot go, nothing is lost that was not computed for this name.
    if old.exists() && !new.exists() && std::fs::rename(&old, &new).is_err() {
        return Ok(());
    }
    remove_results(out, from)
}

/// The document of a verified mesh.
pub fn spectrum(context: &Context, verified: &Verified) -> Spectrum {
    let assembled = &verified.assembled;
    let certificate = &verified.certificate;
    let refined = verified.refinement.as_ref().map(|refined| &refined.pairs.values);
    let area = area_of(&context.pipeline, &assembled.loaded);
    let chosen = verified.origin.chosen();
    let train = chosen.map_or(&context.pipeline.train, |chosen| &chosen.train);
    let verdict = |fine: bool| if fine { Verdict::Verified } else { Verdict::Unverified };
    let judged = certificate.pairs.iter().zip(&verified.judgement.pairs);
    let eigenpairs = judged.enumerate().map(|(j, (pair, short))| {
        let source = source(&verified.origin, refined.is_some(), j);
        let pair = Eigenpair::new(j + 1, source, verdict(short.is_empty()), pair, area);
        let closed_form = verified.deviations.as_ref().and_then(|all| against_formula(all, j));
        Eigenpair { lambda_refined: refined.map(|values| values[j]), closed_form, ..pair }
    });
    Spectrum {
        schema: Default::default(),
        status: verdict(verified.judgement.is_verified()),
        mesh: MeshSummary::from(&*assembled.loaded.ingested),
        eigenpairs: eigenpairs.collect(),
        orthonormality: certificate.orthonormality,
        completeness: Some(certificate.completeness.into()),
        quality: Some(assembled.operators.quality.into()),
        repairs: assembled.loaded.ingested.repairs.counts(),
        provenance: Provenance {
            grown_from: verified.origin.ancestor(),
            ..Provenance::new(parameters(context, train))
        },
    }
}

/// The document of predictions that were not verified: λ, and no measure that takes a matrix.
pub fn predicted_spectrum(context: &Context, predicted: &Predicted) -> Spectrum {
    let area = area_of(&context.pipeline, &predicted.loaded);
    let refined = predicted.refinement.as_ref().map(|refined| &refined.pairs.values);
    let mut lambdas = predicted.pencil.rayleigh_quotients(&predicted.vectors);
    lambdas[..predicted.known].fill(0.0);
    let runs = clusters(&lambdas, CLUSTER_GAP, zero_below(area.0));
    let origin = Origin::Predicted { known: predicted.known, how: predicted.how };
    let eigenpairs = lambdas.iter().enumerate().map(|(j, &lambda)| {
        let cluster = runs.iter().position(|run| run.contains(&j)).unwrap_or(runs.len());
        let source = source(&origin, refined.is_some(), j);
        let unmeasured = PairCertificate::unmeasured(lambda, cluster);
        let pair = Eigenpair::new(j + 1, source, Verdict::Unverified, &unmeasured, area);
        Eigenpair { lambda_refined: refined.map(|values| values[j]), ..pair }
    });
    Spectrum {
        schema: Default::default(),
        status: Verdict::Unverified,
        mesh: MeshSummary::from(&*predicted.loaded.ingested),
        eigenpairs: eigenpairs.collect(),
        orthonormality: predicted.orthonormality(),
        completeness: None,
        quality: None,
        repairs: predicted.loaded.ingested.repairs.counts(),
        provenance: Provenance::new(parameters(context, &context.pipeline.train)),
    }
}

/// What a formula says of pair `j`, from 0.
fn against_formula(deviations: &Deviations, j: usize) -> Option<AgainstFormula> {
    let own = deviations.own.get(j)?;
    Some(AgainstFormula {
        lambda: own.lambda,
        own: own.into(),
        fem: deviations.fem.get(j).map(Into::into),
        mpgd: deviations.mpgd.get(j).map(Into::into),
    })
}

/// The area that makes λ unit-free. The graph Laplacian's eigenvalues have no unit that it could cancel.
fn area_of(pipeline: &Pipeline, loaded: &Loaded) -> Area {
    match pipeline.operators.laplacian {
        Laplacian::Graph => Area(f64::NAN),
        Laplacian::Cotangent | Laplacian::Fem => loaded.ingested.mesh.area(),
    }
}

/// All options that can change a number: not where meshes come from nor which files are written. A given model stands for
/// the options that it was trained with. `train`: those that were really used, which a search may have chosen.
fn parameters(context: &Context, train: &Train) -> serde_json::Value {
    let Pipeline { input: _, ingest: _, family, operators, features, train: _, verify, publish: _ } =
        &context.pipeline;
    match &context.model {
        Some(given) if train.method == Method::Predict => json!({
            "model": {
                "digest": given.digest.to_string(),
                "mesh": given.model.description.mesh.hash,
                "parameters": given.model.description.parameters,
            },
            "operators": operators,
            "train": { "method": train.method, "k": train.k, "refine": train.refine },
            "verify": verify,
        }),
        _ => json!({
            "family": family,
            "operators": operators,
            "features": features,
            "train": train,
            "verify": verify,
        }),
    }
}

/// Where pair `j`, from 0, comes from. The solver puts exact zeros where it knows the eigenfunction.
fn source(origin: &Origin, refined: bool, j: usize) -> Source {
    match origin {
        Origin::Learned { known, .. } | Origin::Predicted { known, .. } if j < *known => {
            Source::Constant
        }
        Origin::Learned { .. } | Origin::Predicted { .. } if refined => Source::Refined,
        Origin::Learned { grown: Some(Grown { how: Inheritance::AsTheyAre, .. }), .. } => {
            Source::Predicted
        }
        Origin::Learned { grown: Some(_), .. } => Source::Finetuned,
        Origin::Learned { grown: None, .. } => Source::Trained,
        Origin::Predicted { .. } => Source::Predicted,
        Origin::Fem { reference, .. } if reference.pairs.values[j] == 0.0 => Source::Constant,
        Origin::Fem { .. } => Source::Fem,
        Origin::Mpgd { opinion, .. } if opinion.pairs.values[j] == 0.0 => Source::Constant,
        Origin::Mpgd { .. } => Source::Mpgd,
    }
}

fn record(stages: Vec<StageRecord>, origin: &Origin, order: &[usize]) -> RunRecord {
    match origin {
        Origin::Learned { blocks, .. } => learned_record(stages, blocks, order),
        Origin::Predicted { how, .. } | Origin::Fem { how, .. } | Origin::Mpgd { how, .. } => {
            solved_record(stages, *how, order.len())
        }
    }
}

fn learned_record(stages: Vec<StageRecord>, blocks: &[TrainedBlock], order: &[usize]) -> RunRecord {
    let place = |k: usize| order.iter().position(|&column| column + 1 == k);
    let mut pairs: Vec<PairRecord> = blocks
        .iter()
        .map(|block| PairRecord {
            k: 1 + place(block.k).unwrap_or(block.k - 1),
            cached: block.how == How::Reused,
            seconds: block.seconds,
        })
        .collect();
    pairs.sort_by_key(|pair| pair.k);
    let reused = blocks.iter().filter(|block| block.how == How::Reused).count();
    let trained = blocks.len() - reused;
    let seconds = stages.iter().map(|stage| stage.seconds).sum();
    RunRecord {
        schema: RunRecordSchema::V1,
        seconds,
        pairs,
        trained,
        reused,
        stages,
        work: Vec::new(),
    }
}

/// The record of `k` pairs that are the work of one stage.
fn solved_record(stages: Vec<StageRecord>, how: How, k: usize) -> RunRecord {
    let cached = how == How::Reused;
    let pairs = (1..=k).map(|k| PairRecord { k, cached, seconds: f64::NAN }).collect();
    let seconds = stages.iter().map(|stage| stage.seconds).sum();
    let (trained, reused, work) = (0, 0, Vec::new());
    RunRecord { schema: RunRecordSchema::V1, seconds, pairs, trained, reused, stages, work }
}
