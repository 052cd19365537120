//! The whole chain over a list of meshes.

use std::io;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

use super::Failure;
use super::board::{self, Board};
use super::context::Context;
use super::intake::Job;
use super::line::{Entrance, Line, failed};
use super::predict::GivenModel;
use crate::flow::{EventSink, Outcome};
use crate::pipeline::Pipeline;
use crate::publish::report::{MeshReport, RunReport};
use crate::store::Store;

/// A run to be done.
pub struct Run {
    /// What to compute.
    pub pipeline: Pipeline,
    /// What `train.method = "predict"` predicts with.
    pub model: Option<Arc<GivenModel>>,
    /// For which meshes.
    pub jobs: Vec<Job>,
    /// Where results go: one folder a mesh.
    pub out: PathBuf,
    /// The cache; without one everything is computed.
    pub store: Option<Store>,
    /// Worker threads, and meshes under way at once.
    pub workers: NonZeroUsize,
    /// What the meshes under way may take of memory, in bytes, as far as that can be told before they are read.
    pub memory: u64,
    /// What a failed mesh means for the others.
    pub on_failure: OnFailure,
    /// How often a mesh is tried again whose failure may have been of the moment.
    pub retries: usize,
    /// Cancelled to stop the run: finished work is kept, the rest is reported as interrupted.
    pub cancel: CancellationToken,
    /// The longest that one mesh may take, where there is a limit.
    pub time_limit: Option<Duration>,
    /// Whether a mesh begins with the blocks of its previous version, where it has one.
    pub lineage: bool,
    /// How often a training leaves a checkpoint: a kill loses no more than that.
    pub checkpoint_every: Duration,
    /// Who hears what was computed and what reused.
    pub events: Arc<dyn EventSink>,
}

/// What a failed mesh means for the others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OnFailure {
    /// Nothing.
    GoOn,
    /// They are stopped.
    Stop,
}

/// What became of a run.
#[derive(Debug, Clone)]
pub struct Ended {
    /// What became of every mesh, in the order of the jobs.
    pub report: RunReport,
    /// Some failure was a defect of this program.
    pub defect: bool,
}

/// Processes every mesh and reports what became of each.
///
/// # Errors
/// When the system refuses the worker threads. All else is one mesh's failure.
pub async fn run(run: Run) -> io::Result<Ended> {
    let started = Instant::now();
    // A failure under `OnFailure::Stop` stops this run, not whoever else holds the caller's token.
    let cancel = run.cancel.child_token();
    let context = Arc::new(Context {
        pipeline: run.pipeline,
        model: run.model,
        out: run.out,
        store: run.store,
        events: run.events,
        cancel: cancel.clone(),
        time_limit: run.time_limit,
        lineage: run.lineage,
        checkpoint_every: run.checkpoint_every,
        board: Board::new(run.jobs.len()),
        ledger: Default::default(),
        planned: None,
        flights: Default::default(),
        opened: Default::default(),
    });
    let ended = CancellationToken::new();
    let teller = tokio::spawn(board::tell(context.clone(), ended.clone(), cancel.clone()));
    let (line, entrance, mut outcomes) = Line::start(&context, run.workers, run.memory)?;
    let (again, retries) = mpsc::unbounded_channel();
    let feeder = Feeder { jobs: run.jobs.clone(), entrance, cancel: cancel.clone() };
    let feeder = tokio::spawn(feeder.feed(retries));
    let mut again = Retries { left: vec![run.retries; run.jobs.len()], again: Some(again) };
    let mut open = run.jobs.len();
    if open == 0 {
        again.end();
    }
    let mut reports: Vec<Option<MeshReport>> = run.jobs.iter().map(|_| None).collect();
    let mut defect = false;
    while let Some(Outcome { item, result }) = outcomes.recv().await {
        let result = match result {
            Err(failure) if again.takes(item, &run.jobs[item], &failure) => continue,
            result => result,
        };
        open -= 1;
        if open == 0 {
            again.end();
        }
        let report = result.unwrap_or_else(|failure| {
            if run.on_failure == OnFailure::Stop {
                cancel.cancel();
            }
            defect |= failure.is_internal();
            failed(&context, &run.jobs[item], failure, run.cancel.is_cancelled())
        });
        context.board.ends(item, &report.path, Some(report.status));
        context.ledger.take(item);
        reports[item] = Some(report);
    }
    line.end().await;
    ended.cancel();
    drop(teller.await);
    // The feeder has ended: the outcomes end after it.
    drop(feeder.await);
    let interrupted = run.cancel.is_cancelled();
    let never_started = |job: &Job| failed(&context, job, Failure::Interrupted, interrupted);
    let meshes = reports
        .into_iter()
        .zip(&run.jobs)
        .map(|(report, job)| report.unwrap_or_else(|| never_started(job)));
    let report = RunReport::new(meshes.collect(), started.elapsed().as_secs_f64());
    Ok(Ended { report, defect })
}

/// Lets jobs in as earlier ones finish, and again those that are to be tried again.
struct Feeder {
    jobs: Vec<Job>,
    entrance: Entrance,
    cancel: CancellationToken,
}

impl Feeder {
    /// Until the run is stopped, or no job can come again.
    async fn feed(self, mut again: mpsc::UnboundedReceiver<usize>) {
        for item in 0..self.jobs.len() {
            if self.admit(item).await.is_none() {
                return;
            }
        }
        while let Some(Some(item)) = self.unless_stopped(again.recv()).await {
            // What was of the moment may need another one.
            let waited = self.unless_stopped(tokio::time::sleep(BEFORE_RETRY)).await;
            if waited.is_none() || self.admit(item).await.is_none() {
                return;
            }
        }
    }

    async fn admit(&self, item: usize) -> Option<()> {
        let place = self.unless_stopped(self.entrance.place()).await?;
        let job = self.jobs[item].clone();
        self.unless_stopped(self.entrance.enter(place, item, job)).await?
    }

    /// What comes of `work`; `None` when the run is stopped before.
    async fn unless_stopped<T>(&self, work: impl Future<Output = T>) -> Option<T> {
        tokio::select! {
            biased;
            () = self.cancel.cancelled() => None,
            done = work => Some(done),
        }
    }
}

/// Before a mesh is tried again.
const BEFORE_RETRY: Duration = Duration::from_millis(500);

/// Which meshes may be tried again.
struct Retries {
    /// How often, for every one.
    left: Vec<usize>,
    again: Option<mpsc::UnboundedSender<usize>>,
}

impl Retries {
    /// Whether a mesh that failed so is tried again; then it is on its way.
    fn takes(&mut self, item: usize, job: &Job, failure: &Failure) -> bool {
        let Some(left) = self.left[item].checked_sub(1).filter(|_| failure.is_of_the_moment())
        else {
            return false;
        };
        self.left[item] = left;
        let sent = self.again.as_ref().is_some_and(|again| again.send(item).is_ok());
        if sent {
            tracing::warn!("{}: {failure}; it is tried again", job.name);
        }
        sent
    }

    /// No mesh is left that could be.
    fn end(&mut self) {
        self.again = None;
    }
}
