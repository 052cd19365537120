//! Checkpoints of one training: where the store has them, when one is due, and when it has served.

use std::cell::Cell;
use std::time::{Duration, Instant};

use super::artifacts::CheckpointArtifact;
use crate::ggnn::checkpoint::Checkpoint;
use crate::store::{Artifact, CacheKey, Store};

/// The place for the checkpoints of one training.
pub struct Checkpoints<'s> {
    store: &'s Store,
    key: CacheKey,
    every: Duration,
    started: Instant,
    last: Cell<Instant>,
}

impl<'s> Checkpoints<'s> {
    /// Of the training whose result is stored under `result`.
    pub fn of(result: &CacheKey, store: &'s Store, every: Duration) -> Self {
        let now = Instant::now();
        Self { store, key: key_of(result), every, started: now, last: Cell::new(now) }
    }

    /// The last one that was kept.
    pub fn kept(&self) -> Option<Checkpoint> {
        Some(self.store.get::<CheckpointArtifact>(&self.key)?.artifact.into())
    }

    /// Whether the next one is due.
    pub fn is_due(&self) -> bool {
        self.last.get().elapsed() >= self.every
    }

    /// Keeps one, in the place of those before. A store that cannot be written costs a warning and nothing else.
    pub fn keep(&self, checkpoint: Checkpoint) {
        let artifact = CheckpointArtifact::from(checkpoint);
        if let Err(error) = self.store.keep(&self.key, &artifact, self.started.elapsed()) {
            tracing::warn!("no checkpoint was left: {error}");
        }
        self.last.set(Instant::now());
    }
}

/// Removes what was kept of a training that is done.
pub fn remove(result: &CacheKey, store: &Store) {
    let key = key_of(result);
    if store.peek::<CheckpointArtifact>(&key).is_some()
        && let Err(error) = store.remove(&key)
    {
        tracing::warn!("a checkpoint that has served stays in the cache: {error}");
    }
}

fn key_of(result: &CacheKey) -> CacheKey {
    CheckpointArtifact::key().param("of", result.as_bytes()).finish(0, "f32")
}
