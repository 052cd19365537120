//! What all stages of a run share, and how a stage's result is recalled from the store or computed.

use std::collections::HashMap;
use std::marker::PhantomData;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use tokio_util::sync::CancellationToken;

use super::Failure;
use super::board::Board;
use super::predict::GivenModel;
use crate::flow::events::{Event, EventSink, How, Unheard};
use crate::pipeline::Pipeline;
use crate::store::{self, Artifact, CacheKey, Digest, KeyBuilder, Store};

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
    /// How often a training leaves a checkpoint.
    pub checkpoint_every: Duration,
    /// Where every mesh stands.
    pub board: Board,
    /// One lock for every key that is being computed.
    pub flights: Flights,
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
}

/// A piece of work: everything its result depends on, as a cache key and for the record.
pub struct Work<A> {
    key: KeyBuilder,
    inputs: Vec<(String, Digest)>,
    part: Option<usize>,
    artifact: PhantomData<A>,
}

impl<A: Artifact> Work<A> {
    /// Work of the stage that makes `A`.
    pub fn of_stage() -> Self {
        Self { key: A::key(), inputs: Vec::new(), part: None, artifact: PhantomData }
    }

    /// Work number `part` of the stage.
    pub fn part(mut self, part: usize) -> Self {
        self.key = self.key.param("part", part.to_string());
        self.part = Some(part);
        self
    }

    /// It depends on a parameter.
    pub fn param(mut self, name: &str, value: impl AsRef<[u8]>) -> Self {
        self.key = self.key.param(name, value);
        self
    }

    /// It depends on some content.
    pub fn input(mut self, role: impl Into<String>, content: &Digest) -> Self {
        let role = role.into();
        self.key = self.key.input(&role, content);
        self.inputs.push((role, *content));
        self
    }

    /// It depends on a seed and on the precision it is done in; this completes the key.
    pub fn seeded(self, seed: u64, precision: &str) -> Keyed<A> {
        Keyed {
            key: self.key.finish(seed, precision),
            inputs: self.inputs,
            part: self.part,
            artifact: PhantomData,
        }
    }
}

/// Options as the bytes that stand for them in a key.
///
/// # Panics
/// When they are no JSON, which options made of numbers and names always are: an empty text instead would make
/// keys collide.
pub fn canonical(options: &impl serde::Serialize) -> Vec<u8> {
    serde_json::to_vec(options).expect("options are numbers and names")
}

impl<A> Keyed<A> {
    /// Where the store has its result, once there is one.
    pub fn key(&self) -> &CacheKey {
        &self.key
    }
}

/// What may end the work on a mesh before it is done.
#[derive(Debug, Clone, Copy)]
pub struct Stop<'c> {
    cancel: &'c CancellationToken,
    /// When it began, and how long it may take.
    limit: Option<(Instant, Duration)>,
}

impl Stop<'_> {
    /// Ends the work when the run is to stop, or when it has taken too long.
    ///
    /// # Errors
    /// [`Failure::Interrupted`], [`Failure::OutOfTime`].
    pub fn check(&self) -> Result<(), Failure> {
        if self.cancel.is_cancelled() {
            return Err(Failure::Interrupted);
        }
        match self.limit {
            Some((began, limit)) if began.elapsed() > limit => {
                Err(Failure::OutOfTime { limit: limit.as_secs_f64() })
            }
            _ => Ok(()),
        }
    }
}

/// Work with its key.
pub struct Keyed<A> {
    key: CacheKey,
    inputs: Vec<(String, Digest)>,
    part: Option<usize>,
    artifact: PhantomData<A>,
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
            checkpoint_every: Duration::MAX,
            board: Board::new(1),
            flights: Flights::default(),
        }
    }

    /// The result of `work` for item `item`: from the store, or from `compute`, whose result is then stored.
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
        self.board.enters(item, A::STAGE, work.part);
        let recalled = self.flights.alone(work.key, || self.find_or(item, &work.key, compute))?;
        let hex = |(role, digest): (String, Digest)| (role, digest.to_string());
        self.events.record(&Event {
            item,
            stage: A::STAGE.to_string(),
            part: work.part,
            key: work.key.to_string(),
            inputs: work.inputs.into_iter().map(hex).collect(),
            output: recalled.digest.to_string(),
            how: recalled.how,
        });
        Ok(recalled)
    }

    fn find_or<A: Artifact>(
        &self,
        item: usize,
        key: &CacheKey,
        compute: impl FnOnce() -> Result<A, Failure>,
    ) -> Result<Recalled<A>, Failure> {
        let started = Instant::now();
        if let Some(cached) = self.store.as_ref().and_then(|store| store.get::<A>(key)) {
            return Ok(Recalled {
                artifact: cached.artifact,
                key: *key,
                digest: cached.digest,
                how: How::Reused,
                spent: started.elapsed(),
            });
        }
        self.stop(item).check()?;
        let artifact = compute()?;
        let digest = self.keep(key, &artifact, started.elapsed())?;
        Ok(Recalled { artifact, key: *key, digest, how: How::Computed, spent: started.elapsed() })
    }

    /// What may end the work on this mesh.
    pub fn stop(&self, item: usize) -> Stop<'_> {
        let limit = self.time_limit.and_then(|limit| Some((self.board.began(item)?, limit)));
        Stop { cancel: &self.cancel, limit }
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
