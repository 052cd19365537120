//! What leaves a store, and in which order.
//!
//! Three things take room that nothing asks for: entries of stages whose code or schema has changed since, chunks whose
//! manifest a crash has kept from being written, and what sled has not given back (`generation`). They go in a [sweep](Store::sweep).
//! Beyond a limit entries go that could be asked for: first those that are quickest to compute again for the room that they
//! take, of equal ones those that were not used for longest. What this process itself has used goes last, in the order of its use, and
//! pinned entries never.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;

use super::lock::DirectoryLock;
use super::manifest::Manifest;
use super::stat::{self, StageStat};
use super::{Artifact, CacheKey, Store, StoreError, recovery};

/// Whether to do it, or only to say what would be done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    /// Do it.
    Apply,
    /// Change nothing.
    DryRun,
}

/// A type of entries that present code can use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Kind {
    stage: &'static str,
    version: u32,
    schema: u32,
}

impl Kind {
    /// Entries of this type.
    pub const fn of<A: Artifact>() -> Self {
        Self { stage: A::STAGE, version: A::VERSION, schema: A::SCHEMA }
    }

    fn is(self, manifest: &Manifest) -> bool {
        (self.stage, self.version, self.schema)
            == (manifest.stage.as_str(), manifest.version, manifest.schema)
    }
}

/// What left a store, or would.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Swept {
    /// Entries that no present code can use, by stage.
    pub outdated: BTreeMap<String, StageStat>,
    /// Entries that went to make room, by stage.
    pub evicted: BTreeMap<String, StageStat>,
    /// The bytes of chunks that belonged to no entry.
    pub orphaned_bytes: u64,
    /// The bytes of the entries that stay.
    pub live_bytes: u64,
}

/// What a look at every byte has found.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Verified {
    /// Entries that match every digest.
    pub sound_entries: u64,
    /// Their bytes.
    pub sound_bytes: u64,
    /// What is wrong with the others.
    pub damaged: Vec<Damaged>,
}

/// An entry that does not match its digests.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Damaged {
    /// Its key, in hex.
    pub key: String,
    /// What is wrong.
    pub reason: String,
}

/// The files of a cache directory before and after a compaction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Compacted {
    /// Bytes before.
    pub before: u64,
    /// Bytes after.
    pub after: u64,
}

/// After an eviction there is room for a tenth of the limit, so that not every entry evicts another.
const LEFT_FREE: u64 = 10;

impl Store {
    /// Keeps these entries whatever the limit.
    pub fn pin(&self, keys: impl IntoIterator<Item = CacheKey>) {
        self.blobs().pin(keys);
    }

    /// Keeps these entries whatever the limit, and no longer those that were kept before.
    pub fn pin_only(&self, keys: impl IntoIterator<Item = CacheKey>) {
        self.blobs().pin_only(keys);
    }

    /// From now on the entries take at most `bytes` in all: what is too much is evicted now and after every write.
    ///
    /// # Errors
    /// When the database cannot be read or written.
    pub fn limit(&self, bytes: u64) -> Result<(), StoreError> {
        let live = self.blobs().manifests()?.iter().map(|(_, manifest)| manifest.length).sum();
        self.blobs().limit(bytes, live);
        self.make_room()
    }

    /// Evicts entries until they take no more than the limit leaves, if they take more than the limit.
    pub(super) fn make_room(&self) -> Result<(), StoreError> {
        let Some((limit, counted)) = self.blobs().exceeded() else { return Ok(()) };
        let swept =
            self.evict(self.blobs().manifests()?, limit - limit / LEFT_FREE, Mode::Apply)?;
        let (entries, bytes) = swept.evicted.values().fold((0, 0), |(entries, bytes), stage| {
            (entries + stage.entries, bytes + stage.live_bytes)
        });
        tracing::debug!(entries, live = swept.live_bytes, "entries were evicted from the cache");
        if self.blobs().evicted(swept.live_bytes + bytes, counted, limit / LEFT_FREE) {
            tracing::warn!(
                limit,
                live = swept.live_bytes,
                "models alone take more than the limit of the cache; raise it (--cache-size), or export and remove models"
            );
        }
        Ok(())
    }

    /// Removes what is of none of these `kinds`, chunks without entry, and, beyond `limit` bytes, entries in the order of
    /// the module's first lines.
    ///
    /// # Errors
    /// When the database cannot be read or written.
    pub fn sweep(&self, kinds: &[Kind], limit: u64, mode: Mode) -> Result<Swept, StoreError> {
        let pinned = self.blobs().pinned();
        let (usable, outdated): (Vec<_>, Vec<_>) =
            self.blobs().manifests()?.into_iter().partition(|(key, manifest)| {
                pinned.contains(key) || kinds.iter().any(|kind| kind.is(manifest))
            });
        if mode == Mode::Apply {
            self.blobs().remove(outdated.iter().map(|(key, _)| key))?;
        }
        let swept = self.evict(usable, limit, mode)?;
        Ok(Swept {
            outdated: by_stage(&outdated),
            orphaned_bytes: self.blobs().orphans(mode == Mode::Apply)?,
            ..swept
        })
    }

    /// Removes entries, of those given, until they take no more than `limit`.
    fn evict(
        &self,
        mut entries: Vec<(CacheKey, Manifest)>,
        limit: u64,
        mode: Mode,
    ) -> Result<Swept, StoreError> {
        let mut live: u64 = entries.iter().map(|(_, manifest)| manifest.length).sum();
        let (pinned, used) = (self.blobs().pinned(), self.blobs().used());
        entries.retain(|(key, _)| !pinned.contains(key));
        entries.sort_by(|(a, x), (b, y)| {
            // `None`, not used by this process, comes first.
            used.get(a)
                .cmp(&used.get(b))
                .then(worth(x).total_cmp(&worth(y)))
                .then((x.last_use, a.as_bytes()).cmp(&(y.last_use, b.as_bytes())))
        });
        let mut evicted = Vec::new();
        for (key, manifest) in entries {
            if live <= limit {
                break;
            }
            live -= manifest.length;
            evicted.push((key, manifest));
        }
        if mode == Mode::Apply {
            self.blobs().remove(evicted.iter().map(|(key, _)| key))?;
        }
        Ok(Swept { evicted: by_stage(&evicted), live_bytes: live, ..Swept::default() })
    }

    /// Reads every entry and holds it against its digests. What does not match is quarantined, unless nothing is to change.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub fn verify(&self, mode: Mode) -> Result<Verified, StoreError> {
        let mut verified = Verified::default();
        for key in self.blobs().keys()? {
            match self.blobs().examine(&key)? {
                None => {}
                Some(Ok(length)) => {
                    verified.sound_entries += 1;
                    verified.sound_bytes += length;
                }
                Some(Err(reason)) => {
                    if mode == Mode::Apply {
                        // Reading is what quarantines.
                        self.blobs().read(&key, |_| true);
                    }
                    verified.damaged.push(Damaged { key: key.to_string(), reason });
                }
            }
        }
        Ok(verified)
    }

    /// Copies the entries of the cache at `dir` to a new database that takes no more room than they need.
    ///
    /// # Errors
    /// Those of [`Store::open`], or when there is no room for the copy beside what is there.
    pub fn compact(dir: impl AsRef<Path>) -> Result<Compacted, StoreError> {
        let dir = dir.as_ref();
        let _lock = DirectoryLock::take(dir)?;
        let before = stat::disk_bytes_of(dir)?;
        recovery::next_generation(dir, recovery::open_trees(dir)?)?;
        Ok(Compacted { before, after: stat::disk_bytes_of(dir)? })
    }

    /// Empties the cache at `dir`: entries, and databases that were set aside. Gives the bytes on disk before.
    ///
    /// # Errors
    /// When another process has it, or the system refuses.
    pub fn clear(dir: impl AsRef<Path>, mode: Mode) -> Result<u64, StoreError> {
        let dir = dir.as_ref();
        let _lock = DirectoryLock::take(dir)?;
        let bytes = stat::disk_bytes_of(dir)?;
        if mode == Mode::Apply {
            recovery::remove_all(dir)?;
        }
        Ok(bytes)
    }

    /// Removes the databases of the cache at `dir` that were set aside. Gives the bytes that they take.
    ///
    /// # Errors
    /// When another process has it, or the system refuses.
    pub fn remove_set_aside(dir: impl AsRef<Path>, mode: Mode) -> Result<u64, StoreError> {
        let dir = dir.as_ref();
        let _lock = DirectoryLock::take(dir)?;
        recovery::remove_set_aside(dir, mode == Mode::Apply)
    }
}

/// Seconds that it takes to compute an entry again, for each of its bytes.
fn worth(manifest: &Manifest) -> f64 {
    manifest.cost / manifest.length.max(1) as f64
}

fn by_stage(entries: &[(CacheKey, Manifest)]) -> BTreeMap<String, StageStat> {
    let mut stages = BTreeMap::<String, StageStat>::new();
    for (_, manifest) in entries {
        stages.entry(manifest.stage.clone()).or_default().count(manifest.length);
    }
    stages
}
