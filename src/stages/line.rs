//! The stages as one line that meshes are sent down: what a run over a list and a watched folder have in common.

use std::io;
use std::num::NonZeroUsize;
use std::sync::Arc;

use tokio::sync::mpsc;
use tokio::task::JoinSet;

use super::context::Context;
use super::inherit::{Way, inherit};
use super::intake::Job;
use super::verify::Verified;
use super::weight::Weights;
use super::{
    Failure, assemble, candidates, family, ingest, publish, refine, remesh, train, tune, verify,
};
use crate::flow::stage::Outcomes;
use crate::flow::{Admission, Parcel, Place, Stage, Workers};
use crate::pipeline::{Count, Method};
use crate::publish::report::MeshReport;

/// The stages at work. They end when every [`Entrance`] is dropped and the last mesh has come out.
pub struct Line {
    tasks: JoinSet<()>,
}

/// Where meshes are let in, as earlier ones come out.
#[derive(Clone)]
pub struct Entrance {
    weights: Arc<Weights>,
    intake: mpsc::Sender<Parcel<Job>>,
    admission: Admission,
}

impl Line {
    /// Starts the stages that the pipeline asks for, with so many worker threads and so much `memory` for the meshes that are
    /// under way.
    ///
    /// # Errors
    /// When the system refuses the threads.
    pub fn start(
        context: &Arc<Context>,
        workers: NonZeroUsize,
        memory: u64,
    ) -> io::Result<(Self, Entrance, Outcomes<MeshReport, Failure>)> {
        let (intake, first, outcomes) = Stage::begin(Arc::new(Workers::start(workers)?));
        let weights = Arc::new(Weights::of(&context.pipeline));
        let entrance = Entrance { weights, intake, admission: Admission::new(workers, memory) };
        Ok((Self { tasks: chain(context, first) }, entrance, outcomes))
    }

    /// Waits until the last mesh has come out.
    pub async fn end(self) {
        self.tasks.join_all().await;
    }
}

impl Entrance {
    /// Waits until there is a place for a mesh: which one is best chosen only then.
    pub async fn place(&self) -> Place {
        self.admission.place().await
    }

    /// Waits until there is memory for this mesh too, and lets it in; `None` when the line has ended.
    pub async fn enter(&self, place: Place, item: usize, load: Job) -> Option<()> {
        // Asked for only now: a run over ten thousand meshes begins at once.
        let weight = self.weights.of_mesh(&load.source);
        let admission = place.weighing(weight).await;
        self.intake.send(Parcel { item, load, admission }).await.ok()
    }
}

/// ingest ─► assemble ─┬─► inherit ─┬─► remesh ─► family ─► tune ─► train φ₁ ─► … ─► train φ_K ─► predict ─► refine ─► verify ─┬─► publish
///                     │            └────────────── settled with what its previous version has ──────────────────────────┤
///                     ├─► predict with a given model ──────────────────────────────────────────────► refine ─► verify ─┤
///                     └─► solve ─────────────────────────────────────────────────────────────────────────────► verify ─┘
fn chain(
    context: &Arc<Context>,
    first: Stage<Job, MeshReport, Failure>,
) -> tokio::task::JoinSet<()> {
    let c = || context.clone();
    let (ingesting, assembling) = (c(), c());
    let assembled = first
        .then(move |item, job: Job| {
            ingesting.board.begins(item, &job.name);
            ingesting.stop(item).check()?;
            ingest::ingest(&ingesting, job)
        })
        .then(move |item, loaded| assemble::assemble(&assembling, item, loaded));
    let verifying = c();
    let verify = move |item, candidates| verify::verify(&verifying, item, candidates);
    let verified = match context.pipeline.train.method {
        Method::Fem | Method::Mpgd => {
            let solving = c();
            assembled
                .then(move |item, assembled| candidates::solve(&solving, item, assembled))
                .then(verify)
        }
        Method::Predict => {
            let (applying, refining) = (c(), c());
            assembled
                .then(move |item, assembled| candidates::apply(&applying, item, assembled))
                .then(move |item, candidates| refine::refine(&refining, item, candidates))
                .then(verify)
        }
        Method::LepDpinn => {
            let (inheriting, remeshing, preparing, tuning) = (c(), c(), c(), c());
            let mut training = assembled
                .then(move |item, assembled| inherit(&inheriting, item, assembled))
                .then(open(move |item, mesh| remesh::remesh(&remeshing, item, mesh)))
                .then(open(move |item, mesh| family::prepare(&preparing, item, mesh)))
                .then(open(move |item, mesh| tune::tune(&tuning, item, mesh)));
            match context.pipeline.train.k {
                Count::Number(most) => {
                    for k in 1..=most {
                        let trainer = c();
                        let train = move |item, state| train::train(&trainer, item, k, state);
                        training = training.then(open(train));
                    }
                }
                // Another K for every mesh: one stage goes through all.
                Count::Percent(_) => {
                    let trainer = c();
                    let train = move |item, state: train::InTraining| {
                        let ks = 1..=state.assembled.loaded.k;
                        ks.into_iter().try_fold(state, |s, k| train::train(&trainer, item, k, s))
                    };
                    training = training.then(open(train));
                }
            }
            let (predicting, refining) = (c(), c());
            training
                .then(open(move |item, trained| candidates::predict(&predicting, item, trained)))
                .then(open(move |item, made| refine::refine(&refining, item, made)))
                .then(open(verify))
                .then(|_, way| Ok(way.arrived()))
        }
    };
    let publishing = c();
    verified
        .then(move |item, verified: Verified| {
            publish::withdraw_otherwise_cut(&publishing, &verified.assembled.loaded.job)?;
            publish::publish(&publishing, item, verified)
        })
        .end()
}

/// A stage of training, which meshes go through untouched that are settled without one.
fn open<T, U>(
    work: impl Fn(usize, T) -> Result<U, Failure>,
) -> impl Fn(usize, Way<T>) -> Result<Way<U>, Failure> {
    move |item, way| way.and_then(|load| work(item, load))
}

/// The report of a failed mesh. Results of an earlier version of it are withdrawn; those of a mesh that was only
/// interrupted stay. `interrupted` tells whether the caller stopped the run, or a failed mesh did.
pub fn failed(context: &Context, job: &Job, failure: Failure, interrupted: bool) -> MeshReport {
    let failure = match failure {
        Failure::Interrupted if !interrupted => Failure::NotStarted,
        failure => failure,
    };
    if !matches!(failure, Failure::Interrupted | Failure::NotStarted)
        && let Err(error) = publish::withdraw(&context.out.join(&job.name), None)
            .and_then(|()| publish::withdraw_otherwise_cut(context, job))
    {
        tracing::warn!(mesh = job.name, "earlier results could not be withdrawn: {error}");
    }
    tracing::debug!(mesh = job.name, %failure, "failed");
    MeshReport::failed(job.name.clone(), None, failure.to_string(), 0.0)
}
