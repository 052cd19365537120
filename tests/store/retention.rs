//! What leaves a store, and what stays.

use std::fs;
use std::io::{self, Write};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use chladni::store::{KeyBuilder, Kind, Mode, Store};
use tempfile::TempDir;
use tracing_subscriber::fmt::MakeWriter;

use super::damage::{flip, tamper};
use super::{Bytes, BytesOfLater, COST, get, key, open, sample};

fn seconds(seconds: u64) -> Duration {
    Duration::from_secs(seconds)
}

const ALL: [Kind; 1] = [Kind::of::<Bytes>()];

#[test]
fn beyond_the_limit_the_cheapest_for_their_size_go_first_and_pinned_ones_never() {
    let dir = TempDir::new().unwrap();
    let store = open(dir.path());
    // Seconds a byte rise with the number.
    for n in 0..10 {
        store.put(&key(n), &sample(10_000, n as u8), seconds(1 + n)).unwrap();
    }
    drop(store);
    let store = open(dir.path());
    store.pin([key(0)]);
    let planned = store.sweep(&ALL, 60_000, Mode::DryRun).unwrap();
    assert_eq!(store.stat().unwrap().entries, 10, "a dry run changes nothing");
    let swept = store.sweep(&ALL, 60_000, Mode::Apply).unwrap();
    assert_eq!(swept, planned);
    assert_eq!(swept.evicted["bytes"].entries, 5);
    let left: Vec<u64> = (0..10).filter(|&n| get(&store, &key(n)).is_some()).collect();
    assert_eq!(left, [0, 6, 7, 8, 9]);
    assert_eq!(store.stat().unwrap().live_bytes, swept.live_bytes);
}

#[test]
fn a_limit_holds_after_every_write_and_spares_what_this_process_uses() {
    let dir = TempDir::new().unwrap();
    let store = open(dir.path());
    for n in 0..10 {
        store.put(&key(n), &sample(10_000, n as u8), seconds(100)).unwrap();
    }
    drop(store);
    let store = open(dir.path());
    store.limit(105_000).unwrap();
    assert_eq!(store.stat().unwrap().entries, 10);
    for n in 10..30 {
        // Cheap, but of now.
        store.put(&key(n), &sample(10_000, n as u8), seconds(1)).unwrap();
        assert!(get(&store, &key(n)).is_some());
        assert!(store.stat().unwrap().live_bytes <= 105_000);
    }
    assert!((0..10).all(|n| get(&store, &key(n)).is_none()));
    assert_eq!(get(&store, &key(29)), Some(sample(10_000, 29)));
    assert!(store.quarantined().unwrap().is_empty());
}

/// What is logged while `work` is done on this thread.
fn said(work: impl FnOnce()) -> String {
    let log = Log::default();
    let lines = tracing_subscriber::fmt().with_writer(log.clone()).with_ansi(false).finish();
    tracing::subscriber::with_default(lines, work);
    String::from_utf8(std::mem::take(&mut *log.0.lock().unwrap())).unwrap()
}

#[derive(Clone, Default)]
struct Log(Arc<Mutex<Vec<u8>>>);

impl Write for Log {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl MakeWriter<'_> for Log {
    type Writer = Self;

    fn make_writer(&self) -> Self {
        self.clone()
    }
}

#[test]
fn where_pinned_entries_alone_are_beyond_the_limit_it_is_said_once_and_a_tenth_beside_them_stays() {
    let dir = TempDir::new().unwrap();
    let store = open(dir.path());
    store.put(&key(0), &sample(200_000, 0), COST).unwrap();
    store.pin([key(0)]);
    let said = said(|| {
        store.limit(100_000).unwrap();
        for n in 1..50 {
            store.put(&key(n), &sample(1000, n as u8), COST).unwrap();
            let live = store.stat().unwrap().live_bytes;
            assert!((200_000..212_000).contains(&live), "{live}");
        }
    });
    assert_eq!(said.matches("models alone take more than the limit").count(), 1, "{said}");
    assert!(get(&store, &key(49)).is_some() && get(&store, &key(1)).is_none());
    assert!(get(&store, &key(0)).is_some());
}

#[test]
fn a_sweep_removes_what_no_code_can_use() {
    let dir = TempDir::new().unwrap();
    let store = open(dir.path());
    store.put(&key(0), &sample(10, 0), COST).unwrap();
    let later = BytesOfLater { bytes: vec![1], unit: "m".into() };
    let other = KeyBuilder::new("other", 1).finish(0, "f32");
    store.put(&key(1), &later, COST).unwrap();
    store.put(&other, &later, COST).unwrap();
    store.pin([other]);
    let swept = store.sweep(&ALL, u64::MAX, Mode::Apply).unwrap();
    assert_eq!(swept.outdated["bytes"].entries, 1);
    assert!(store.peek::<BytesOfLater>(&key(1)).is_none());
    assert!(store.peek::<BytesOfLater>(&other).is_some(), "pinned");
    assert!(get(&store, &key(0)).is_some());
}

#[test]
fn a_compacted_cache_holds_the_same_in_less_room() {
    let dir = TempDir::new().unwrap();
    let store = open(dir.path());
    for round in 0..4 {
        for n in 0..8 {
            store.put(&key(n), &sample(400_000, n as u8 + round), COST).unwrap();
        }
    }
    let before = store.stat().unwrap();
    drop(store);
    let compacted = Store::compact(dir.path()).unwrap();
    assert!(compacted.after < compacted.before, "{compacted:?}");
    let store = open(dir.path());
    let after = store.stat().unwrap();
    assert_eq!((after.entries, after.live_bytes), (before.entries, before.live_bytes));
    assert!((0..8).all(|n| get(&store, &key(n)) == Some(sample(400_000, n as u8 + 3))));
    assert!(!dir.path().join("chladni.sled").exists());
    drop(store);
    // Half a copy, as a crash leaves it, and the old database, had it not been removed.
    fs::create_dir(dir.path().join("chladni.sled-3")).unwrap();
    fs::create_dir(dir.path().join("chladni.sled")).unwrap();
    let store = open(dir.path());
    assert_eq!(store.stat().unwrap().entries, 8);
    assert!(
        !dir.path().join("chladni.sled-3").exists() && !dir.path().join("chladni.sled").exists()
    );
}

#[test]
fn a_damaged_entry_is_found_by_verification_and_dropped_unless_it_is_a_dry_run() {
    let dir = TempDir::new().unwrap();
    let store = open(dir.path());
    for n in 0..3 {
        store.put(&key(n), &sample(20_000, n as u8), COST).unwrap();
    }
    drop(store);
    let chunk = [&key(1).as_bytes()[..], &2_u32.to_be_bytes()].concat();
    tamper(dir.path(), "chunks", &chunk, flip(1000));
    let store = open(dir.path());
    for _ in 0..2 {
        let found = store.verify(Mode::DryRun).unwrap();
        assert_eq!((found.sound_entries, found.damaged.len()), (2, 1));
        assert_eq!(found.damaged[0].key, key(1).to_string());
        assert!(found.damaged[0].reason.contains("chunk 2 does not match"));
    }
    assert_eq!(store.verify(Mode::Apply).unwrap().damaged.len(), 1);
    assert_eq!(store.verify(Mode::Apply).unwrap().damaged, []);
    assert_eq!(store.quarantined().unwrap().len(), 1);
}

#[test]
fn a_cleared_cache_is_empty_and_can_be_used() {
    let dir = TempDir::new().unwrap();
    open(dir.path()).put(&key(0), &sample(10_000, 0), COST).unwrap();
    fs::create_dir(dir.path().join("quarantine-17")).unwrap();
    fs::write(dir.path().join("README.md"), "kept").unwrap();
    let bytes = Store::clear(dir.path(), Mode::DryRun).unwrap();
    assert!(bytes > 10_000 && get(&open(dir.path()), &key(0)).is_some());
    Store::clear(dir.path(), Mode::Apply).unwrap();
    assert!(!dir.path().join("quarantine-17").exists());
    let store = open(dir.path());
    assert_eq!(store.stat().unwrap().entries, 0);
    assert!(dir.path().join("README.md").exists());
    assert!(Store::clear(dir.path(), Mode::Apply).is_err(), "it is in use");
    store.put(&key(0), &sample(10, 0), COST).unwrap();
}
