//! The bytes of entries in the database: written so that a crash leaves no half entry, read only when whole.
//!
//! In: a key, what the entry is, and bytes. Out: bytes that match every digest, or nothing. Whoever meets damage
//! (a read, a stat) quarantines that key: it leaves the live trees, the reason is recorded, and the key can be
//! written again.
//!
//! Threads: a key belongs to one of 64 locks. Reads of a key share it, a write or a quarantine has it alone, so a
//! reader never sees chunks of one write under the manifest of another.

use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};
use std::time::Duration;

use rkyv::util::AlignedVec;

use super::chunk;
use super::interruption::point;
use super::manifest::{Manifest, unix_now};
use super::quarantine::{Fault, Quarantined};
use super::recovery::{self, Trees};
use super::{CacheKey, Digest, StoreError, room, tally};

const LOCKS: usize = 64;

/// All entries of an open store.
pub(super) struct Blobs {
    dir: PathBuf,
    trees: Trees,
    locks: [RwLock<()>; LOCKS],
    /// The keys that this process has used, and in which order for the last time. In the manifest once each is enough.
    used: Mutex<HashMap<CacheKey, u64>>,
    /// Uses so far.
    uses: AtomicU64,
    /// The keys that no limit evicts.
    pinned: Mutex<HashSet<CacheKey>>,
    /// It was said that entries are not kept.
    complained: AtomicBool,
    /// How much the entries may take and do take, where there is a limit.
    budget: Mutex<Option<Budget>>,
}

/// Bytes of entries.
#[derive(Debug, Clone, Copy)]
struct Budget {
    limit: u64,
    live: u64,
    /// From here on an eviction is worth its while: the limit, or more where pinned entries alone are beyond it.
    ceiling: u64,
}

/// When a write reaches the disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum OnDisk {
    /// Before it returns.
    Now,
    /// Within the half second after which the database does so by itself. A crash before may lose the entry; one that is torn
    /// does not match its digest.
    Soon,
}

impl OnDisk {
    fn flush(self, database: &sled::Db) -> sled::Result<()> {
        match self {
            Self::Now => database.flush().map(drop),
            Self::Soon => Ok(()),
        }
    }
}

/// What an entry is, as its writer says.
#[derive(Debug, Clone, Copy)]
pub(super) struct Origin {
    pub stage: &'static str,
    pub version: u32,
    pub schema: u32,
    pub cost: Duration,
}

/// What a look at a key finds.
enum Found<T> {
    Nothing,
    Sound(T),
    Faulty(Fault),
}

impl Blobs {
    pub fn new(dir: PathBuf, trees: Trees) -> Self {
        Self {
            dir,
            trees,
            locks: [const { RwLock::new(()) }; LOCKS],
            used: Mutex::default(),
            uses: AtomicU64::default(),
            pinned: Mutex::default(),
            complained: AtomicBool::default(),
            budget: Mutex::default(),
        }
    }

    /// The cache directory.
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// Writes an entry, in place of any that the key has; gives the digest of `bytes`.
    pub fn write(
        &self,
        key: &CacheKey,
        origin: Origin,
        bytes: &[u8],
        on_disk: OnDisk,
    ) -> Result<Digest, StoreError> {
        let digest = Digest::of(bytes);
        let now = unix_now();
        let manifest = Manifest {
            length: bytes.len() as u64,
            digest: *digest.as_bytes(),
            stage: origin.stage.to_owned(),
            version: origin.version,
            schema: origin.schema,
            cost: origin.cost.as_secs_f64(),
            created: now,
            last_use: now,
        };
        let record = manifest
            .encode(key)
            .map_err(|source| StoreError::Encode { stage: origin.stage, source })?;
        room::check(&self.dir, manifest.length)?;
        let _alone = self.alone(key);
        let replaced = self.guarded("write an entry", || {
            let Trees { database, manifests, chunks, .. } = &self.trees;
            let replaced = manifests.remove(key.as_bytes())?;
            point()?;
            chunk::remove(chunks, key)?;
            chunk::write(chunks, key, bytes)?;
            point()?;
            on_disk.flush(database)?;
            manifests.insert(key.as_bytes(), record.as_slice())?;
            point()?;
            on_disk.flush(database)?;
            Ok(replaced)
        })?;
        let replaced = replaced.and_then(|record| Manifest::decode(key, &record));
        self.account(manifest.length, replaced.map_or(0, |manifest| manifest.length));
        self.first_use(key);
        Ok(digest)
    }

    /// Removes the entries of these keys; one that is being read or written is waited for.
    pub fn remove<'k>(
        &self,
        keys: impl IntoIterator<Item = &'k CacheKey>,
    ) -> Result<(), StoreError> {
        let Trees { database, manifests, chunks, .. } = &self.trees;
        for key in keys {
            let _alone = self.alone(key);
            let removed = self.guarded("remove an entry", || {
                let removed = manifests.remove(key.as_bytes())?;
                point()?;
                chunk::remove(chunks, key)?;
                Ok(removed)
            })?;
            let removed = removed.and_then(|record| Manifest::decode(key, &record));
            self.account(0, removed.map_or(0, |manifest| manifest.length));
        }
        self.guarded("remove entries", || database.flush().map(drop))
    }

    /// The bytes of chunks that no manifest speaks of, and whether to `remove` them. Nothing may be written meanwhile.
    pub fn orphans(&self, remove: bool) -> Result<u64, StoreError> {
        let Trees { database, manifests, chunks, .. } = &self.trees;
        self.guarded("look for chunks without an entry", || {
            let mut bytes = 0;
            for record in chunks {
                let (address, record) = record?;
                let is_orphan = match address.get(..32) {
                    Some(key) => !manifests.contains_key(key)?,
                    None => true,
                };
                if is_orphan {
                    bytes += record.len() as u64;
                    if remove {
                        chunks.remove(address)?;
                    }
                }
            }
            database.flush()?;
            Ok(bytes)
        })
    }

    /// The length of the entry of `key`, or what is wrong with it; nothing is changed.
    pub fn examine(&self, key: &CacheKey) -> Result<Option<Result<u64, String>>, StoreError> {
        let _shared = self.shared(key);
        self.guarded("examine an entry", || {
            Ok(match self.find(key, |_| true)? {
                Found::Nothing => None,
                Found::Sound((manifest, _)) => Some(Ok(manifest.length)),
                Found::Faulty(fault) => Some(Err(fault.to_string())),
            })
        })
    }

    /// Writes down how many entries there are.
    pub fn tally(&self) {
        if let Ok(entries) = self.guarded("count the entries", || Ok(self.trees.manifests.len())) {
            tally::write(&self.dir, entries);
        }
    }

    /// Whether this is the first time that it is asked.
    pub fn complains(&self) -> bool {
        !self.complained.swap(true, Ordering::Relaxed)
    }

    /// Keeps these keys whatever the limit.
    pub fn pin(&self, keys: impl IntoIterator<Item = CacheKey>) {
        unpoisoned(&self.pinned).extend(keys);
    }

    /// Keeps these keys, and no longer those that were kept before.
    pub fn pin_only(&self, keys: impl IntoIterator<Item = CacheKey>) {
        *unpoisoned(&self.pinned) = keys.into_iter().collect();
    }

    /// The keys that stay whatever the limit.
    pub fn pinned(&self) -> HashSet<CacheKey> {
        unpoisoned(&self.pinned).clone()
    }

    /// The keys that this process has read or written; a larger number was used later.
    pub fn used(&self) -> HashMap<CacheKey, u64> {
        unpoisoned(&self.used).clone()
    }

    /// The entries take `live` bytes and may take `limit`.
    pub fn limit(&self, limit: u64, live: u64) {
        *unpoisoned(&self.budget) = Some(Budget { limit, live, ceiling: limit });
    }

    /// The limit and what the entries were counted to take, where an eviction is due.
    pub fn exceeded(&self) -> Option<(u64, u64)> {
        let budget = unpoisoned(&self.budget);
        budget.filter(|budget| budget.live > budget.ceiling).map(|b| (b.limit, b.live))
    }

    /// After an eviction that found entries of `found` bytes where `counted` were expected. What came and went since is
    /// counted already: other threads go on writing. Where the rest is still beyond the limit, nothing more can go, and the next
    /// eviction is due when `worth` more have come in. Whether it is so for the first time.
    pub fn evicted(&self, found: u64, counted: u64, worth: u64) -> bool {
        let mut budget = unpoisoned(&self.budget);
        let Some(budget) = &mut *budget else { return false };
        budget.live = (budget.live + found).saturating_sub(counted);
        let (is_beyond, was_beyond) = (budget.live > budget.limit, budget.ceiling > budget.limit);
        budget.ceiling = if is_beyond { budget.live + worth } else { budget.limit };
        is_beyond && !was_beyond
    }

    /// So many bytes of entries came, and so many went.
    fn account(&self, came: u64, went: u64) {
        if let Some(budget) = &mut *unpoisoned(&self.budget) {
            budget.live = (budget.live + came).saturating_sub(went);
        }
    }

    /// The manifest and bytes of `key` if it has an entry that `wanted` accepts and that matches every digest.
    pub fn read(
        &self,
        key: &CacheKey,
        wanted: impl Fn(&Manifest) -> bool,
    ) -> Option<(Manifest, AlignedVec)> {
        let (manifest, bytes) = self.look(key, || self.find(key, &wanted))?;
        if self.first_use(key) {
            self.record_use(key, &manifest);
        }
        Some((manifest, bytes))
    }

    /// The manifest of `key`, if it has an entry. Its bytes are not looked at.
    pub fn manifest(&self, key: &CacheKey) -> Option<Manifest> {
        self.look(key, || self.find_manifest(key))
    }

    /// Quarantines the entry whose sound bytes, of this digest, turned out to be undecodable.
    pub fn quarantine_undecodable(&self, key: &CacheKey, digest: Digest, reason: String) {
        self.quarantine_if(key, || match self.find_manifest(key)? {
            Found::Sound(manifest) if manifest.digest() == digest => {
                Ok(Some(Fault::Undecodable(reason)))
            }
            _ => Ok(None),
        });
    }

    /// Every key that has a manifest, sound or not.
    pub fn keys(&self) -> Result<Vec<CacheKey>, StoreError> {
        self.guarded("list the entries", || {
            self.trees.records().map(|record| record.map(|(key, _)| key)).collect()
        })
    }

    /// Every manifest. One that is damaged is quarantined.
    pub fn manifests(&self) -> Result<Vec<(CacheKey, Manifest)>, StoreError> {
        let records: Vec<_> =
            self.guarded("list the entries", || self.trees.records().collect())?;
        let judged = records.into_iter().filter_map(|(key, record)| {
            // Looking at it again is what quarantines.
            Some((key, Manifest::decode(&key, &record).or_else(|| self.manifest(&key))?))
        });
        Ok(judged.collect())
    }

    /// The entries that were quarantined in this database, by key; the last reason of each.
    pub fn quarantined(&self) -> Result<Vec<Quarantined>, StoreError> {
        self.guarded("list the quarantined entries", || {
            let records = self.trees.quarantined.iter();
            records
                .filter_map(|record| match record {
                    Ok((key, record)) => Some(Ok(Quarantined::decode(&key, &record)?)),
                    Err(error) => Some(Err(error)),
                })
                .collect()
        })
    }

    fn find(
        &self,
        key: &CacheKey,
        wanted: impl Fn(&Manifest) -> bool,
    ) -> sled::Result<Found<(Manifest, AlignedVec)>> {
        let manifest = match self.find_manifest(key)? {
            Found::Nothing => return Ok(Found::Nothing),
            Found::Faulty(fault) => return Ok(Found::Faulty(fault)),
            Found::Sound(manifest) => manifest,
        };
        if !wanted(&manifest) {
            return Ok(Found::Nothing);
        }
        Ok(match chunk::read(&self.trees.chunks, key, manifest.length)? {
            Err(fault) => Found::Faulty(Fault::Chunk(fault)),
            Ok(bytes) if Digest::of(&bytes) != manifest.digest() => Found::Faulty(Fault::Whole),
            Ok(bytes) => Found::Sound((manifest, bytes)),
        })
    }

    fn find_manifest(&self, key: &CacheKey) -> sled::Result<Found<Manifest>> {
        let record = self.trees.manifests.get(key.as_bytes())?;
        Ok(match record {
            None => Found::Nothing,
            Some(record) => match Manifest::decode(key, &record) {
                None => Found::Faulty(Fault::Manifest),
                Some(manifest) => Found::Sound(manifest),
            },
        })
    }

    /// What `find` finds while nobody writes `key`. A fault is quarantined; a refusal of the database is a warning.
    fn look<T>(&self, key: &CacheKey, find: impl Fn() -> sled::Result<Found<T>>) -> Option<T> {
        let shared = self.shared(key);
        match self.guarded("read an entry", &find) {
            Ok(Found::Sound(value)) => Some(value),
            Ok(Found::Nothing) => None,
            Ok(Found::Faulty(_)) => {
                drop(shared);
                // Another thread may have replaced the entry meanwhile: judge what is there then.
                self.quarantine_if(key, || match find()? {
                    Found::Faulty(fault) => Ok(Some(fault)),
                    _ => Ok(None),
                });
                None
            }
            Err(error) => {
                tracing::warn!(%key, %error, "a cached result cannot be read; it is computed again");
                None
            }
        }
    }

    /// Removes the entry of `key` if `judge`, asked while nobody else can touch it, finds it at fault.
    fn quarantine_if(&self, key: &CacheKey, judge: impl FnOnce() -> sled::Result<Option<Fault>>) {
        let _alone = self.alone(key);
        let judged = self.guarded("quarantine an entry", || {
            let Some(fault) = judge()? else {
                return Ok(None);
            };
            let record = Quarantined::encode(unix_now(), &fault.to_string());
            self.trees.manifests.remove(key.as_bytes())?;
            point()?;
            chunk::remove(&self.trees.chunks, key)?;
            point()?;
            self.trees.quarantined.insert(key.as_bytes(), record)?;
            self.trees.database.flush()?;
            Ok(Some(fault))
        });
        match judged {
            Ok(None) => {}
            Ok(Some(fault)) => fault.warn(key),
            Err(error) => {
                tracing::warn!(%key, %error, "a damaged cached result cannot be dropped");
            }
        }
    }

    /// Takes note of a use of `key`; whether it is the first one in this process.
    fn first_use(&self, key: &CacheKey) -> bool {
        let mut used = unpoisoned(&self.used);
        let now = self.uses.fetch_add(1, Ordering::Relaxed);
        used.insert(*key, now).is_none()
    }

    /// Stamps the manifest with the present time, unless the entry was replaced meanwhile. It is not flushed: a lost
    /// stamp does no harm.
    fn record_use(&self, key: &CacheKey, manifest: &Manifest) {
        let stamped = Manifest { last_use: unix_now(), ..manifest.clone() };
        let (Ok(old), Ok(new)) = (manifest.encode(key), stamped.encode(key)) else {
            return;
        };
        let manifests = &self.trees.manifests;
        let swapped = self.guarded("record a use", || {
            manifests.compare_and_swap(key.as_bytes(), Some(&old[..]), Some(&new[..]))
        });
        if let Err(error) = swapped {
            tracing::debug!(%key, %error, "the use of a cached result is not recorded");
        }
    }

    /// Runs one operation of the database. Damage that it shows is noted for the next opening.
    fn guarded<T>(
        &self,
        doing: &'static str,
        operation: impl FnOnce() -> sled::Result<T>,
    ) -> Result<T, StoreError> {
        recovery::contained(&self.dir, doing, operation)
            .inspect_err(|error| recovery::suspect(&self.dir, error))
    }

    fn shared(&self, key: &CacheKey) -> RwLockReadGuard<'_, ()> {
        let lock = &self.locks[usize::from(key.as_bytes()[0]) % LOCKS];
        lock.read().unwrap_or_else(PoisonError::into_inner)
    }

    fn alone(&self, key: &CacheKey) -> RwLockWriteGuard<'_, ()> {
        let lock = &self.locks[usize::from(key.as_bytes()[0]) % LOCKS];
        lock.write().unwrap_or_else(PoisonError::into_inner)
    }
}

fn unpoisoned<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    const KEY: CacheKey = CacheKey::from_bytes([5; 32]);

    fn open(dir: &Path) -> Blobs {
        Blobs::new(dir.to_owned(), recovery::open_trees(dir).unwrap())
    }

    fn write(blobs: &Blobs, bytes: &[u8]) -> Digest {
        let origin = Origin { stage: "stage", version: 1, schema: 1, cost: Duration::from_secs(1) };
        blobs.write(&KEY, origin, bytes, OnDisk::Now).unwrap()
    }

    /// Sets the last use back to 1970 and tells what it is after a read.
    fn last_use_after_read(blobs: &Blobs) -> u64 {
        let old = Manifest { last_use: 0, ..blobs.manifest(&KEY).unwrap() };
        let record = old.encode(&KEY).unwrap();
        let manifests = &blobs.trees.manifests;
        manifests.insert(KEY.as_bytes(), record.as_slice()).unwrap();
        assert!(blobs.read(&KEY, |_| true).is_some());
        blobs.manifest(&KEY).unwrap().last_use
    }

    #[test]
    fn the_first_use_in_a_process_is_recorded_and_no_other() {
        let dir = tempfile::tempdir().unwrap();
        let blobs = open(dir.path());
        write(&blobs, b"bytes");
        assert_eq!(last_use_after_read(&blobs), 0, "the write was the first");
        drop(blobs);
        let blobs = open(dir.path());
        assert!(last_use_after_read(&blobs) > 0);
        assert_eq!(last_use_after_read(&blobs), 0);
    }

    #[test]
    fn a_shorter_entry_leaves_no_chunk_of_the_longer_one() {
        let dir = tempfile::tempdir().unwrap();
        let blobs = open(dir.path());
        write(&blobs, &[1; 5 * chunk::CHUNK]);
        let digest = write(&blobs, &[2; chunk::CHUNK + 1]);
        assert_eq!(blobs.trees.chunks.len(), 2);
        let (manifest, bytes) = blobs.read(&KEY, |_| true).unwrap();
        assert_eq!(manifest.digest(), digest);
        assert_eq!(bytes.as_slice(), [2; chunk::CHUNK + 1]);
    }

    #[test]
    fn where_nothing_more_can_go_an_eviction_waits_until_it_is_worth_its_while() {
        let dir = tempfile::tempdir().unwrap();
        let blobs = open(dir.path());
        blobs.limit(1000, 1200);
        assert_eq!(blobs.exceeded(), Some((1000, 1200)));
        assert!(blobs.evicted(1200, 1200, 100), "pinned entries are beyond the limit: said once");
        for length in [60, 100] {
            assert_eq!(blobs.exceeded(), None);
            write(&blobs, &vec![0; length]);
        }
        assert_eq!(blobs.exceeded(), None, "a write in place of another");
        blobs.account(1, 0);
        assert_eq!(blobs.exceeded(), Some((1000, 1301)));
        assert!(!blobs.evicted(1301, 1301, 100));
        blobs.account(0, 501);
        assert!(!blobs.evicted(1301, 1301, 100));
        blobs.account(201, 0);
        assert_eq!(blobs.exceeded(), Some((1000, 1001)), "the limit counts again");
    }

    #[test]
    fn what_comes_while_others_go_is_counted() {
        let dir = tempfile::tempdir().unwrap();
        let blobs = open(dir.path());
        blobs.limit(1000, 1100);
        let Some((_, counted)) = blobs.exceeded() else { panic!("it is beyond the limit") };
        // Another thread writes between the look at all entries, which finds 10 bytes less, and the end of the eviction.
        blobs.account(300, 0);
        blobs.account(0, 200);
        assert!(blobs.evicted(1090, counted, 100));
        assert_eq!(blobs.exceeded(), None);
        blobs.account(101, 0);
        assert_eq!(blobs.exceeded(), Some((1000, 1291)));
    }

    #[test]
    fn an_entry_without_manifest_is_none() {
        let dir = tempfile::tempdir().unwrap();
        let blobs = open(dir.path());
        chunk::write(&blobs.trees.chunks, &KEY, &[1; 100]).unwrap();
        assert!(blobs.read(&KEY, |_| true).is_none());
        assert!(blobs.quarantined().unwrap().is_empty());
        write(&blobs, b"bytes");
        assert!(blobs.read(&KEY, |_| true).is_some());
    }

    #[test]
    fn an_entry_that_was_replaced_meanwhile_is_not_quarantined() {
        let dir = tempfile::tempdir().unwrap();
        let blobs = open(dir.path());
        let old = write(&blobs, b"undecodable");
        write(&blobs, b"sound");
        blobs.quarantine_undecodable(&KEY, old, "it does not decode".to_owned());
        assert!(blobs.read(&KEY, |_| true).is_some());
        assert!(blobs.quarantined().unwrap().is_empty());
    }

    #[test]
    fn a_panic_of_the_database_is_an_error_and_leaves_a_note() {
        let dir = tempfile::tempdir().unwrap();
        let blobs = open(dir.path());
        let result = blobs.guarded::<()>("try", || panic!("a page is {}", "gone"));
        let message = result.unwrap_err().to_string();
        assert!(message.contains("the database panicked (a page is gone)"));
        write(&blobs, b"bytes");
        drop(blobs);
        let blobs = open(dir.path());
        assert!(blobs.keys().unwrap().is_empty(), "it was set aside");
        write(&blobs, b"bytes");
        drop(blobs);
        let blobs = open(dir.path());
        assert_eq!(blobs.keys().unwrap(), [KEY], "the note is gone");
    }
}
