//! From certified eigenpairs to files: `eigen.npz`, `eigen.ply`, `run.json`, and last `spectrum.json`.

use std::path::Path;
use std::time::Instant;

use serde_json::json;

use super::Failure;
use super::candidates::Origin;
use super::context::Context;
use super::train::TrainedBlock;
use super::verify::Verified;
use crate::flow::events::How;
use crate::mesh::Area;
use crate::operators::Laplacian;
use crate::operators::mass::row_sums;
use crate::pipeline::Pipeline;
use crate::publish::PublishError;
use crate::publish::atomic::{remove, write_if_changed};
use crate::publish::npz::EigenArrays;
use crate::publish::ply::to_ply;
use crate::publish::report::{MeshReport, PairRecord, RunRecord, RunRecordSchema, StageRecord};
use crate::publish::result::{Eigenpair, MeshSummary, Provenance, Source, Spectrum, Verdict};
use crate::spectrum::Eigenpairs;

/// Writes the results of one mesh to its folder and reports them.
///
/// # Errors
/// When a file cannot be written.
pub fn publish(context: &Context, verified: Verified) -> Result<MeshReport, Failure> {
    let started = Instant::now();
    let spectrum = spectrum(&context.pipeline, &verified);
    let Verified { assembled, origin, vectors, order, certificate, judgement } = verified;
    let mut loaded = assembled.loaded;
    let mesh = &loaded.ingested.mesh;
    let folder = context.out.join(&loaded.job.name);
    let document = spectrum.to_json();
    withdraw(&folder, Some(&document))?;
    let pairs =
        Eigenpairs { values: certificate.pairs.iter().map(|pair| pair.lambda).collect(), vectors };
    let arrays = EigenArrays {
        mesh,
        pairs: &pairs,
        mass: &row_sums(&assembled.operators.mass),
        mass_kind: assembled.operators.mass_kind,
        vertex_map: &loaded.ingested.vertex_map,
    };
    write_if_changed(&folder.join("eigen.npz"), &arrays.to_npz())?;
    let ply = folder.join("eigen.ply");
    if context.pipeline.publish.ply {
        write_if_changed(&ply, &to_ply(mesh, &pairs))?;
    } else {
        remove(&ply)?;
    }
    loaded.spent("publish", How::Computed, started.elapsed());
    let record = record(loaded.stages, &origin, &order);
    write_if_changed(&folder.join("run.json"), &record.to_json())?;
    // Whoever waits for results waits for this file: all others are there when it is.
    write_if_changed(&folder.join(SPECTRUM), &document)?;
    let folder = folder.display().to_string();
    let reason = (!judgement.is_verified()).then(|| judgement.reason());
    Ok(MeshReport::finished(loaded.job.name, folder, &spectrum, reason, &record))
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
    if earlier.is_some() && earlier.as_deref() != current { remove(&path) } else { Ok(()) }
}

/// The document of a verified mesh.
pub fn spectrum(pipeline: &Pipeline, verified: &Verified) -> Spectrum {
    let assembled = &verified.assembled;
    let certificate = &verified.certificate;
    // The graph Laplacian's eigenvalues have no unit that an area could cancel.
    let area = match pipeline.operators.laplacian {
        Laplacian::Graph => Area(f64::NAN),
        Laplacian::Cotangent | Laplacian::Fem => assembled.loaded.ingested.mesh.area(),
    };
    let verdict = |fine: bool| if fine { Verdict::Verified } else { Verdict::Unverified };
    let judged = certificate.pairs.iter().zip(&verified.judgement.pairs);
    let eigenpairs = judged.enumerate().map(|(j, (pair, short))| {
        let source = source(&verified.origin, j);
        Eigenpair::new(j + 1, source, verdict(short.is_empty()), pair, area)
    });
    Spectrum {
        schema: Default::default(),
        status: verdict(verified.judgement.is_verified()),
        mesh: MeshSummary::from(&*assembled.loaded.ingested),
        eigenpairs: eigenpairs.collect(),
        orthonormality: certificate.orthonormality,
        completeness: certificate.completeness.into(),
        quality: assembled.operators.quality.into(),
        repairs: (&assembled.loaded.ingested.repairs).into(),
        provenance: Provenance::new(parameters(pipeline)),
    }
}

/// All options that can change a number: not where meshes come from nor which files are written.
fn parameters(pipeline: &Pipeline) -> serde_json::Value {
    let Pipeline { input: _, family, operators, features, train, verify, publish: _ } = pipeline;
    json!({
        "family": family,
        "operators": operators,
        "features": features,
        "train": train,
        "verify": verify,
    })
}

/// Where pair `j`, from 0, comes from. The solver puts exact zeros where it knows the eigenfunction.
fn source(origin: &Origin, j: usize) -> Source {
    match origin {
        Origin::Learned { known, .. } if j < *known => Source::Constant,
        Origin::Learned { .. } => Source::Trained,
        Origin::Fem { reference, .. } if reference.pairs.values[j] == 0.0 => Source::Constant,
        Origin::Fem { .. } => Source::Fem,
        Origin::Mpgd { opinion, .. } if opinion.pairs.values[j] == 0.0 => Source::Constant,
        Origin::Mpgd { .. } => Source::Mpgd,
    }
}

fn record(stages: Vec<StageRecord>, origin: &Origin, order: &[usize]) -> RunRecord {
    let mut pairs: Vec<PairRecord> = match origin {
        Origin::Learned { blocks, .. } => {
            let place = |k: usize| order.iter().position(|&column| column + 1 == k);
            let pair = |block: &TrainedBlock| PairRecord {
                k: 1 + place(block.k).unwrap_or(block.k - 1),
                cached: block.how == How::Reused,
                seconds: block.seconds,
            };
            blocks.iter().map(pair).collect()
        }
        // All pairs are the work of one stage.
        Origin::Fem { how, .. } | Origin::Mpgd { how, .. } => {
            let cached = *how == How::Reused;
            (1..=order.len()).map(|k| PairRecord { k, cached, seconds: f64::NAN }).collect()
        }
    };
    pairs.sort_by_key(|pair| pair.k);
    let (trained, reused) = match origin {
        Origin::Learned { blocks, .. } => {
            let reused = blocks.iter().filter(|block| block.how == How::Reused).count();
            (blocks.len() - reused, reused)
        }
        Origin::Fem { .. } | Origin::Mpgd { .. } => (0, 0),
    };
    let seconds = stages.iter().map(|stage| stage.seconds).sum();
    RunRecord { schema: RunRecordSchema::V1, seconds, pairs, trained, reused, stages }
}
