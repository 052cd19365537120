//! `chladni predict MESH --model MODEL`: eigenpairs by forward passes of a trained model, refined and certified on request.

use std::num::NonZeroUsize;
use std::sync::Arc;
use std::time::Instant;

use clap::ValueEnum;
use serde::Serialize;

use super::exit::Exit;
use super::model::given;
use super::single::{OneMesh, Written};
use super::{CacheLocation, Format, Refusal, logging, print, print_json};
use crate::mesh::MeshHash;
use crate::pipeline::{Method, Pipeline, Refine};
use crate::publish::report::{MeshReport, Status};
use crate::publish::result::{
    Completeness, Eigenpair, MeshSummary, RepairCounts, Spectrum, TriangleQuality, Verdict,
};
use crate::publish::table::mesh_table;
use crate::stages::assemble::Assembled;
use crate::stages::context::Context;
use crate::stages::intake::Job;
use crate::stages::predict::{GivenModel, Predicted};
use crate::stages::refine::{Refinement, by_rayleigh_ritz, in_full};
use crate::stages::verify::Verified;
use crate::stages::{Failure, assemble, ingest, predict, publish, verify};

#[derive(Debug, clap::Args)]
#[command(after_help = super::exit::help("\
  chladni predict finer.obj --model spot --out predicted
  chladni predict finer.obj --model spot.safetensors -k 4 --verify"))]
pub struct Arguments {
    #[command(flatten)]
    mesh: OneMesh,
    /// A file that `chladni model export` wrote, or a name of `chladni model list` or enough of its beginning
    #[arg(long)]
    model: String,
    /// How many eigenpairs; all that the model has unless given
    #[arg(short, value_name = "K", value_parser = super::at_least_one)]
    k: Option<NonZeroUsize>,
    /// What is made of the predictions; all but none is a second result beside them
    #[arg(long, value_enum, default_value = "none")]
    refine: Refining,
    /// Certify the pairs: assembles L and B, and runs both reference solvers
    #[arg(long)]
    verify: bool,
    #[command(flatten)]
    written: Written,
    #[command(flatten)]
    cache: CacheLocation,
    /// How the result is shown
    #[arg(long, value_enum, default_value = "human")]
    format: Format,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Refining {
    /// Nothing
    None,
    /// The best pairs on the span of the predictions, without a matrix
    RayleighRitz,
    /// The solver's iteration, started from the predictions: assembles and factorises
    Full,
}

/// The document of `predict --format json`.
#[derive(Debug, Serialize)]
struct Prediction<'a> {
    schema: &'static str,
    path: &'a str,
    status: Verdict,
    reason: Option<&'a str>,
    model: ModelSummary<'a>,
    /// What speaks against the predictions.
    warnings: &'a [String],
    mesh: &'a MeshSummary,
    /// The refined ones, where the pairs were refined.
    eigenvalues: Vec<f64>,
    refinement: Option<&'a RefinementSummary>,
    certificate: Checks<'a>,
    quality: Option<TriangleQuality>,
    repairs: &'a RepairCounts,
    out: Option<&'a str>,
    seconds: f64,
}

#[derive(Debug, Serialize)]
struct ModelSummary<'a> {
    name: &'a str,
    digest: String,
    k: usize,
    /// The name of the file of the mesh that it was trained for, and its hash.
    mesh: &'a str,
    mesh_hash: MeshHash,
}

#[derive(Debug, Serialize)]
struct RefinementSummary {
    method: &'static str,
    /// Of eight solves.
    blocks: usize,
    seconds: f64,
}

#[derive(Debug, Serialize)]
struct Checks<'a> {
    orthonormality: f64,
    completeness: Option<&'a Completeness>,
    eigenpairs: &'a [Eigenpair],
}

pub fn execute(arguments: &Arguments) -> Result<Exit, Refusal> {
    let started = Instant::now();
    let job = arguments.mesh.job();
    arguments.written.check(&job)?;
    let given = given(&arguments.model, &arguments.cache)?;
    let context = context(arguments, given.clone());
    given.model.check_count(k_of(arguments, &given)).map_err(Refusal::usage)?;
    let outcome = match predict(&context, job, arguments.verify) {
        Ok(outcome) => outcome,
        Err(failure) => {
            if asks_too_much(&failure) {
                return Err(Refusal::usage(failure));
            }
            logging::error(&failure);
            return Ok(if failure.is_internal() { Exit::Internal } else { Exit::MeshFailed });
        }
    };
    let Outcome { pairs, warnings, refinement } = outcome;
    let (spectrum, report) = published(&context, pairs, arguments.written.is_asked_for());
    let mut report = report.map_err(Refusal::usage)?;
    let path = arguments.mesh.title();
    report.path.clone_from(&path);
    report.seconds = started.elapsed().as_secs_f64();
    match arguments.format {
        Format::Json => {
            let refinement = refinement.as_ref();
            print_json(&document(&path, &given, &warnings, refinement, &spectrum, &report))?;
        }
        Format::Human => print(&text(&given, &warnings, refinement.as_ref(), &report))?,
    }
    Ok(match report.status {
        Status::Unverified if arguments.verify => Exit::Unverified,
        Status::Verified | Status::Unverified => Exit::Success,
        Status::Failed => Exit::MeshFailed,
    })
}

/// A run of one mesh without a cache, with the operators of the model.
fn k_of(arguments: &Arguments, given: &GivenModel) -> usize {
    arguments.k.map_or(given.model.k(), NonZeroUsize::get)
}

fn context(arguments: &Arguments, given: Arc<GivenModel>) -> Context {
    let mut pipeline = Pipeline::default();
    let description = &given.model.description;
    pipeline.train.method = Method::Predict;
    pipeline.train.model.clone_from(&given.name);
    pipeline.train.k = k_of(arguments, &given).into();
    pipeline.train.refine = match arguments.refine {
        Refining::None => Refine::None,
        Refining::RayleighRitz => Refine::RayleighRitz,
        Refining::Full => Refine::Full,
    };
    pipeline.operators = description.operators;
    pipeline.publish = arguments.written.options();
    Context::alone(pipeline, Some(given), arguments.written.folder())
}

/// What came of a mesh.
struct Outcome {
    pairs: Pairs,
    warnings: Vec<String>,
    refinement: Option<RefinementSummary>,
}

enum Pairs {
    Predicted(Box<Predicted>),
    Verified(Box<Verified>),
}

/// Nothing is assembled unless the refinement or the certificate needs it.
fn predict(context: &Context, job: Job, certify: bool) -> Result<Outcome, Failure> {
    let loaded = ingest::ingest(context, job)?;
    let mut predicted = predict::predict(context, 0, loaded)?;
    let mut operators = None;
    match context.pipeline.train.refine {
        Refine::None => {}
        Refine::RayleighRitz => {
            let Predicted { loaded, pencil, vectors, digest, .. } = &mut predicted;
            let refined = by_rayleigh_ritz(context, 0, loaded, pencil, vectors, *digest)?;
            predicted.refinement = Some(refined);
        }
        Refine::Full => {
            let mut assembled = assemble::assemble(context, 0, predicted.loaded)?;
            let (vectors, digest) = (&predicted.vectors, predicted.digest);
            predicted.refinement = Some(in_full(context, 0, &mut assembled, vectors, digest)?);
            predicted.loaded = assembled.loaded;
            operators = Some((assembled.operators, assembled.operators_digest));
        }
    }
    let warnings = predicted.doubts(context.pipeline.train.refine);
    let refinement = predicted.refinement.as_ref().map(summary);
    if !certify {
        return Ok(Outcome { pairs: Pairs::Predicted(Box::new(predicted)), warnings, refinement });
    }
    let (operators, digest) = match operators {
        Some(operators) => operators,
        None => {
            let assembled = assemble::assemble(context, 0, predicted.loaded)?;
            let Assembled { loaded, operators, operators_digest } = assembled;
            predicted.loaded = loaded;
            (operators, operators_digest)
        }
    };
    let verified = verify::verify(context, 0, predicted.with_operators(operators, digest))?;
    Ok(Outcome { pairs: Pairs::Verified(Box::new(verified)), warnings, refinement })
}

fn summary(refinement: &Refinement) -> RefinementSummary {
    let &Refinement { method, blocks, seconds, .. } = refinement;
    RefinementSummary { method: method.name(), blocks, seconds }
}

/// The document and the report, after writing the files if that was asked for.
fn published(
    context: &Context,
    pairs: Pairs,
    write: bool,
) -> (Spectrum, Result<MeshReport, Failure>) {
    match pairs {
        Pairs::Predicted(predicted) => {
            let spectrum = publish::predicted_spectrum(context, &predicted);
            let report = if write {
                publish::publish_predicted(context, 0, *predicted)
            } else {
                Ok(publish::unwritten_predicted(&spectrum, *predicted))
            };
            (spectrum, report)
        }
        Pairs::Verified(verified) => {
            let spectrum = publish::spectrum(context, &verified);
            let report = if write {
                publish::publish(context, 0, *verified)
            } else {
                Ok(publish::unwritten(&spectrum, *verified))
            };
            (spectrum, report)
        }
    }
}

/// Whether other arguments would have helped: the mesh is not to blame.
fn asks_too_much(failure: &Failure) -> bool {
    matches!(failure, Failure::TooSmall { .. } | Failure::Unfit(_)) || failure.is_no_object()
}

fn text(
    given: &GivenModel,
    warnings: &[String],
    refinement: Option<&RefinementSummary>,
    report: &MeshReport,
) -> String {
    let mut lines = vec![mesh_table(report).trim_end().to_string()];
    lines.extend(refinement.map(|done| match (done.method, done.blocks) {
        ("full", 0) => format!("refined by a dense solve, {:.2} s", done.seconds),
        ("full", blocks) => {
            format!("refined in {blocks} blocks of 8 solves, {:.2} s", done.seconds)
        }
        (method, _) => format!("refined by {method}, {:.2} s", done.seconds),
    }));
    let trained = &given.model.description.mesh;
    lines.push(format!(
        "model {}, trained for {} ({} vertices), {} eigenpairs",
        given.name,
        trained.name,
        trained.vertices,
        given.model.k()
    ));
    lines.extend(warnings.iter().map(|warning| format!("warning: {warning}")));
    lines.join("\n")
}

fn document<'a>(
    path: &'a str,
    given: &'a GivenModel,
    warnings: &'a [String],
    refinement: Option<&'a RefinementSummary>,
    spectrum: &'a Spectrum,
    report: &'a MeshReport,
) -> Prediction<'a> {
    let trained = &given.model.description.mesh;
    let best = |pair: &Eigenpair| pair.lambda_refined.unwrap_or(pair.lambda);
    Prediction {
        schema: "chladni-predict-1",
        path,
        status: spectrum.status,
        reason: report.reason.as_deref(),
        model: ModelSummary {
            name: &given.name,
            digest: given.digest.to_string(),
            k: given.model.k(),
            mesh: &trained.name,
            mesh_hash: trained.hash,
        },
        warnings,
        mesh: &spectrum.mesh,
        eigenvalues: spectrum.eigenpairs.iter().map(best).collect(),
        refinement,
        certificate: Checks {
            orthonormality: spectrum.orthonormality,
            completeness: spectrum.completeness.as_ref(),
            eigenpairs: &spectrum.eigenpairs,
        },
        quality: spectrum.quality,
        repairs: &spectrum.repairs,
        out: report.out.as_deref(),
        seconds: report.seconds,
    }
}
