//! What a run would do: its own stages, which say what they depend on and do only what is quick.
//!
//! Results that the store has are taken from there; meshes are read, their operators assembled and their variants made, as in a
//! run; all else has a stand-in. So the list is that of the run, as far as it can be known: where the blocks of a previous
//! version are tried, what follows depends on a certificate that is not there yet.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::context::{Context, Planned};
use super::inherit::{Way, inherit};
use super::intake::Job;
use super::predict::GivenModel;
use super::{
    Failure, assemble, candidates, family, ingest, publish, refine, remesh, train, tune, verify,
};
use crate::flow::workers::contained;
use crate::pipeline::{Method, Pipeline};
use crate::publish::plan::{PlannedMesh, PlannedWork, RunPlan};
use crate::publish::report::RunRecord;
use crate::store::Store;

/// A run that is to be planned.
pub struct Request {
    /// What to compute.
    pub pipeline: Pipeline,
    /// What `train.method = "predict"` predicts with.
    pub model: Option<Arc<GivenModel>>,
    /// For which meshes.
    pub jobs: Vec<Job>,
    /// Where the results of the last run are.
    pub out: PathBuf,
    /// The cache, which stays as it is.
    pub store: Option<Store>,
    /// Whether a mesh begins with the blocks of its previous version, where it has one.
    pub lineage: bool,
}

/// What a run would do for every mesh, and why it would have to.
pub fn plan(request: Request) -> RunPlan {
    let Request { pipeline, model, jobs, out, store, lineage } = request;
    let context = Context {
        store,
        lineage,
        planned: Some(Planned::default()),
        ..Context::alone(pipeline, model, out)
    };
    // One after the other: what an earlier mesh would compute a later one would find.
    RunPlan::new(jobs.into_iter().enumerate().map(|(item, job)| one(&context, item, job)).collect())
}

fn one(context: &Context, item: usize, job: Job) -> PlannedMesh {
    let path = job.name.clone();
    let last = last_run(&context.out.join(&path));
    let followed = contained(|| follow(context, item, job)).unwrap_or_else(|p| Err(p.into()));
    let work = PlannedWork::beside(context.ledger.take(item), last.as_ref());
    let (undecided, failure) = match followed {
        Ok(undecided) => (undecided, None),
        Err(failure) => (false, Some(failure.to_string())),
    };
    PlannedMesh { path, work, undecided, failure }
}

/// What the last run that has left results in `folder` depended on.
fn last_run(folder: &Path) -> Option<RunRecord> {
    let text = std::fs::read(folder.join(publish::RUN)).ok()?;
    serde_json::from_slice(&text).ok()
}

/// The way of a mesh through the stages, as [`super::line`] joins them; whether a certificate decides how it goes on.
fn follow(context: &Context, item: usize, job: Job) -> Result<bool, Failure> {
    let assembled = assemble::assemble(context, item, ingest::ingest(context, job)?)?;
    let made = match context.pipeline.train.method {
        Method::Fem | Method::Mpgd => candidates::solve(context, item, assembled)?,
        Method::Predict => {
            let made = candidates::apply(context, item, assembled)?;
            refine::refine(context, item, made)?
        }
        Method::LepDpinn => {
            let assembled = match inherit(context, item, assembled)? {
                Way::Settled(verified) => return Ok(verified.stands_in),
                Way::Open(assembled) => assembled,
            };
            let familied = remesh::remesh(context, item, assembled)?;
            let prepared = family::prepare(context, item, familied)?;
            let mut state = tune::tune(context, item, prepared)?;
            for k in 1..=state.assembled.loaded.k {
                state = train::train(context, item, k, state)?;
            }
            let made = candidates::predict(context, item, state)?;
            refine::refine(context, item, made)?
        }
    };
    verify::verify(context, item, made).map(|_| false)
}
