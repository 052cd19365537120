//! What all stages of a run share, and how a stage's result is recalled from the store or computed.

use std::collections::{HashMap, HashSet};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tokio_util::sync::CancellationToken;

use super::Failure;
use super::board::Board;
use super::opened::LastOpened;
use super::predict::GivenModel;
use super::work::Keyed;
use crate::flow::events::{Event, EventSink, How, Unheard};
use crate::pipeline::Pipeline;
use crate::publish::report::WorkRecord;
use crate::store::{self, Artifact, CacheKey, Digest, Store};

/// What every stage of a run can see.
pub struct Context {
    /// What to compute.
    pub pipeline: Pipeline,
    /// What `train.method = "predict"` predicts with.
    pub model: Option<Arc<GivenModel>>,
    /// Where results go.
    pub out: PathBuf,
    /// The cache; without one everything is computed.
    pub store: Option<Store>,
    /// Who hears what was computed and what reused.
    pub events: Arc<dyn EventSink>,
    /// Set when the run is to stop.
    pub cancel: CancellationToken,
    /// The longest that one mesh may take, where there is a limit.
    pub time_limit: Option<Duration>,
    /// Whether a mesh begins with the blocks of its previous version.
    pub lineage: bool,
    /// How often a training leaves a checkpoint.
    pub checkpoint_every: Duration,
    /// Where every mesh stands.
    pub board: Board,
    /// What the work on every mesh has depended on.
    pub ledger: Ledger,
    /// Where nothing is to be done but to find out what would be: what would have been done so far.
    pub planned: Option<Planned>,
    /// One lock for every key that is being computed.
    pub flights: Flights,
    /// The file whose objects are meshes of their own.
    pub opened: LastOpened,
}

/// The work on every mesh that is under way, in its order.
#[derive(Debug, Default)]
pub struct Ledger {
    work: Mutex<HashMap<usize, Vec<WorkRecord>>>,
}

impl Ledger {
    fn note(&self, item: usize, record: WorkRecord) {
        self.all().entry(item).or_default().push(record);
    }

    /// The work on a mesh, which is forgotten here.
    pub fn take(&self, item: usize) -> Vec<WorkRecord> {
        self.all().remove(&item).unwrap_or_default()
    }

    fn all(&self) -> MutexGuard<'_, HashMap<usize, Vec<WorkRecord>>> {
        self.work.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The keys whose results a run would have computed by now.
#[derive(Debug, Default)]
pub struct Planned {
    keys: Mutex<HashSet<CacheKey>>,
}

impl Planned {
    /// Whether a run would compute this now, or have it: from the store, or from earlier in the run.
    fn how(&self, key: &CacheKey, is_stored: bool) -> How {
        let mut keys = self.keys.lock().unwrap_or_else(PoisonError::into_inner);
        if is_stored || !keys.insert(*key) { How::Reused } else { How::Computed }
    }
}

/// Keeps two workers from computing the same key at the same time: the second waits, and finds it in the store.
#[derive(Debug, Default)]
pub struct Flights {
    locks: Mutex<HashMap<CacheKey, Arc<Mutex<()>>>>,
}

impl Flights {
    /// Does `work` while nobody else in this run works on `key`.
    fn alone<T>(&self, key: CacheKey, work: impl FnOnce() -> T) -> T {
        let locks = || self.locks.lock().unwrap_or_else(PoisonError::into_inner);
        let lock = locks().entry(key).or_default().clone();
        let result = {
            let _guard = lock.lock().unwrap_or_else(PoisonError::into_inner);
            work()
        };
        // Ours and the map's: nobody waits for it.
        let mut locks = locks();
        if Arc::strong_count(&lock) == 2 {
            locks.remove(&key);
        }
        result
    }
}

/// A stage's result, wherever it came from.
#[derive(Debug, Clone)]
pub struct Recalled<A> {
    /// The result.
    pub artifact: A,
    /// Where the store has it.
    pub key: CacheKey,
    /// Of its encoding.
    pub digest: Digest,
    /// Where it came from.
    pub how: How,
    /// How long that took in this run.
    pub spent: Duration,
    /// It is not the result, which a plan does not compute.
    pub stands_in: bool,
}

impl<A: Artifact> Recalled<A> {
    fn new(artifact: A, work: &Keyed<A>, digest: Digest, how: How, started: Instant) -> Self {
        let (key, spent) = (*work.key(), started.elapsed());
        Self { artifact, key, digest, how, spent, stands_in: false }
    }
}

/// What may end the work on a mesh before it is done.
#[derive(Debug, Clone, Copy)]
pub struct Stop<'c> {
    cancel: &'c CancellationToken,
    board: &'c Board,
    item: usize,
    /// When it began, and how long it may take.
    limit: Option<(Instant, Duration)>,
}

impl Stop<'_> {
    /// Ends the work when the run is to stop, when it is no longer wanted, or when it has taken too long.
    ///
    /// # Errors
    /// [`Failure::Interrupted`], [`Failure::Superseded`], [`Failure::OutOfTime`].
    pub fn check(&self) -> Result<(), Failure> {
        if self.cancel.is_cancelled() {
            return Err(Failure::Interrupted);
        }
        if self.board.is_dropped(self.item) {
            return Err(Failure::Superseded);
        }
        match self.limit {
            Some((began, limit)) if began.elapsed() > limit => {
                Err(Failure::OutOfTime { limit: limit.as_secs_f64() })
            }
            _ => Ok(()),
        }
    }
}

/// What a plan takes for a result that the store does not have.
struct Planning<A> {
    artifact: A,
    digest: Digest,
    stands_in: bool,
}

impl Context {
    /// For a single piece of work without a store, of which nobody is told.
    pub fn alone(pipeline: Pipeline, model: Option<Arc<GivenModel>>, out: PathBuf) -> Self {
        Self {
            pipeline,
            model,
            out,
            store: None,
            events: Arc::new(Unheard),
            cancel: CancellationToken::new(),
            time_limit: None,
            lineage: false,
            checkpoint_every: Duration::MAX,
            board: Board::new(1),
            ledger: Ledger::default(),
            planned: None,
            flights: Flights::default(),
            opened: LastOpened::default(),
        }
    }

    /// The result of `work` for item `item`: from the store, or from `compute`, whose result is then stored. For work that is
    /// quick: a plan does it too, and stores nothing.
    ///
    /// A store that cannot be written costs a warning and nothing else.
    ///
    /// # Errors
    /// Those of `compute`, and of [`Stop::check`] when the result is not there.
    pub fn recall<A: Artifact>(
        &self,
        item: usize,
        work: Keyed<A>,
        compute: impl FnOnce() -> Result<A, Failure>,
    ) -> Result<Recalled<A>, Failure> {
        let Some(planned) = &self.planned else { return self.recall_or_do(item, work, compute) };
        self.plan(item, &work, planned, || {
            let artifact = compute()?;
            let digest = store::digest(&artifact)?;
            Ok(Planning { artifact, digest, stands_in: false })
        })
    }

    /// The same for work that takes long. A plan does not do it: what is not in the store has a `stand_in`, and a digest that
    /// no work has.
    ///
    /// # Errors
    /// As [`Self::recall`].
    pub fn recall_costly<A: Artifact>(
        &self,
        item: usize,
        work: Keyed<A>,
        stand_in: impl FnOnce() -> A,
        compute: impl FnOnce() -> Result<A, Failure>,
    ) -> Result<Recalled<A>, Failure> {
        let Some(planned) = &self.planned else { return self.recall_or_do(item, work, compute) };
        self.plan(item, &work, planned, || {
            let digest =
                Digest::of(&[b"the result of ", work.key().as_bytes().as_slice()].concat());
            Ok(Planning { artifact: stand_in(), digest, stands_in: true })
        })
    }

    /// What the store has of `work`, or what stands for it.
    fn plan<A: Artifact>(
        &self,
        item: usize,
        work: &Keyed<A>,
        planned: &Planned,
        otherwise: impl FnOnce() -> Result<Planning<A>, Failure>,
    ) -> Result<Recalled<A>, Failure> {
        let started = Instant::now();
        let found = self.find(work, started);
        let how = planned.how(work.key(), found.is_some());
        self.ledger.note(item, work.record(how == How::Reused));
        match found {
            Some(found) => Ok(found),
            None => {
                let Planning { artifact, digest, stands_in } = otherwise()?;
                let recalled = Recalled::new(artifact, work, digest, how, started);
                Ok(Recalled { stands_in, ..recalled })
            }
        }
    }

    fn recall_or_do<A: Artifact>(
        &self,
        item: usize,
        work: Keyed<A>,
        compute: impl FnOnce() -> Result<A, Failure>,
    ) -> Result<Recalled<A>, Failure> {
        self.board.enters(item, A::STAGE, work.part());
        let recalled = self.flights.alone(*work.key(), || {
            let started = Instant::now();
            if let Some(found) = self.find(&work, started) {
                return Ok(found);
            }
            self.stop(item).check()?;
            let artifact = compute()?;
            let digest = self.keep(work.key(), &artifact, started.elapsed())?;
            Ok::<_, Failure>(Recalled::new(artifact, &work, digest, How::Computed, started))
        })?;
        let hex = |(role, digest): &(String, Digest)| (role.clone(), digest.to_string());
        self.events.record(&Event {
            item,
            stage: A::STAGE.to_string(),
            part: work.part(),
            key: work.key().to_string(),
            inputs: work.inputs().iter().map(hex).collect(),
            output: recalled.digest.to_string(),
            how: recalled.how,
        });
        self.ledger.note(item, work.record(recalled.how == How::Reused));
        Ok(recalled)
    }

    fn find<A: Artifact>(&self, work: &Keyed<A>, started: Instant) -> Option<Recalled<A>> {
        let cached = self.store.as_ref()?.get::<A>(work.key())?;
        Some(Recalled::new(cached.artifact, work, cached.digest, How::Reused, started))
    }

    /// The cache, where it may be written: a plan leaves it as it is.
    pub fn writable(&self) -> Option<&Store> {
        self.store.as_ref().filter(|_| self.planned.is_none())
    }

    /// What may end the work on this mesh.
    pub fn stop(&self, item: usize) -> Stop<'_> {
        let limit = self.time_limit.and_then(|limit| Some((self.board.began(item)?, limit)));
        Stop { cancel: &self.cancel, board: &self.board, item, limit }
    }

    fn keep<A: Artifact>(
        &self,
        key: &CacheKey,
        artifact: &A,
        cost: Duration,
    ) -> Result<Digest, Failure> {
        Ok(match &self.store {
            Some(store) => store.keep(key, artifact, cost)?,
            None => store::digest(artifact)?,
        })
    }
}
