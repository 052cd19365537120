//! How a store comes back from damage: to an entry, to the database, to its files.
//!
//! Damage is done as a disk does it: to a closed store, through the database's own trees or its files.

use std::fs;
use std::path::Path;
use std::thread;
use std::time::Duration;

use tempfile::TempDir;

use super::{Bytes, BytesByMistake, COST, database, get, key, open, quarantined_databases, sample};

#[test]
fn a_type_that_changed_without_its_schema_is_quarantined() {
    let dir = TempDir::new().unwrap();
    let store = open(dir.path());
    store.put(&key(0), &Bytes { bytes: vec![0xFF; 100] }, COST).unwrap();
    assert!(store.get::<BytesByMistake>(&key(0)).is_none());
    let reason = &store.quarantined().unwrap()[0].reason;
    assert!(reason.contains("without a new SCHEMA"), "{reason}");
}

/// Something that befalls the cache directory of a closed store.
type Damage<'a> = &'a dyn Fn(&Path);

/// Something that befalls the log of the database, at a place in it.
type LogDamage<'a> = &'a dyn Fn(&mut Vec<u8>, usize);

/// Opens the database behind the store's back. Its lock may outlive it for a moment, in a process that another test
/// is just starting.
fn raw(dir: &Path) -> sled::Db {
    for _ in 0..100 {
        if let Ok(database) = sled::open(database(dir)) {
            return database;
        }
        thread::sleep(Duration::from_millis(20));
    }
    panic!("the database stays locked");
}

/// Changes the record at `address` of a tree: `None` removes it.
pub fn tamper(
    dir: &Path,
    tree: &str,
    address: &[u8],
    change: impl FnOnce(Vec<u8>) -> Option<Vec<u8>>,
) {
    let tree = raw(dir).open_tree(tree).unwrap();
    let record = tree.get(address).unwrap().expect("there is such a record");
    match change(record.to_vec()) {
        Some(changed) => tree.insert(address, changed).unwrap(),
        None => tree.remove(address).unwrap(),
    };
    tree.flush().unwrap();
}

pub fn flip(at: usize) -> impl FnOnce(Vec<u8>) -> Option<Vec<u8>> {
    move |mut record| {
        record[at] ^= 0x10;
        Some(record)
    }
}

fn cut(to: usize) -> impl FnOnce(Vec<u8>) -> Option<Vec<u8>> {
    move |record| Some(record[..to].to_vec())
}

#[test]
fn a_damaged_entry_is_absent_then_quarantined_then_written_again() {
    let victim = key(0);
    let chunk = |index: u32| [&victim.as_bytes()[..], &index.to_be_bytes()].concat();
    let cases: [(&str, Damage); 8] = [
        ("chunk 2 does not match", &|dir| tamper(dir, "chunks", &chunk(2), flip(1000))),
        ("chunk 1 does not match", &|dir| tamper(dir, "chunks", &chunk(1), flip(5))),
        ("chunk 3 does not match", &|dir| tamper(dir, "chunks", &chunk(3), cut(500))),
        ("chunk 0 does not match", &|dir| tamper(dir, "chunks", &chunk(0), cut(0))),
        ("chunk 2 is missing", &|dir| tamper(dir, "chunks", &chunk(2), |_| None)),
        ("the manifest", &|dir| tamper(dir, "manifests", victim.as_bytes(), flip(8))),
        ("the manifest", &|dir| tamper(dir, "manifests", victim.as_bytes(), cut(20))),
        // A chunk of an older write of the same key: sound by itself.
        ("the whole", &|dir| {
            let mut current = None;
            tamper(dir, "chunks", &chunk(1), |record| {
                current = Some(record.clone());
                Some(record)
            });
            let store = open(dir);
            store.put(&victim, &sample(20_000, 9), COST).unwrap();
            drop(store);
            tamper(dir, "chunks", &chunk(1), |_| current);
        }),
    ];
    for (reason, damage) in cases {
        let dir = TempDir::new().unwrap();
        let store = open(dir.path());
        store.put(&victim, &sample(20_000, 0), COST).unwrap();
        store.put(&key(1), &sample(20_000, 1), COST).unwrap();
        drop(store);
        damage(dir.path());

        let store = open(dir.path());
        assert_eq!(get(&store, &victim), None, "{reason}");
        assert_eq!(get(&store, &victim), None, "{reason}");
        let dropped = store.quarantined().unwrap();
        assert_eq!(dropped.len(), 1);
        assert_eq!(dropped[0].key, victim);
        assert!(dropped[0].reason.contains(reason), "{}", dropped[0].reason);
        assert_eq!(get(&store, &key(1)), Some(sample(20_000, 1)));
        assert_eq!(store.stat().unwrap().entries, 1);

        store.put(&victim, &sample(30_000, 2), COST).unwrap();
        drop(store);
        assert_eq!(get(&open(dir.path()), &victim), Some(sample(30_000, 2)));
    }
}

#[test]
fn a_stat_quarantines_a_damaged_manifest() {
    let dir = TempDir::new().unwrap();
    open(dir.path()).put(&key(0), &sample(10, 0), COST).unwrap();
    tamper(dir.path(), "manifests", key(0).as_bytes(), flip(0));
    let stat = open(dir.path()).stat().unwrap();
    assert_eq!((stat.entries, stat.quarantined_entries), (0, 1));
}

#[test]
fn a_database_that_does_not_open_is_set_aside() {
    let garbage = |dir: &Path| {
        for item in fs::read_dir(database(dir)).unwrap() {
            let path = item.unwrap().path();
            if path.is_file() {
                fs::write(path, sample(200_000, 3).bytes).unwrap();
            }
        }
    };
    // From the second opening on there is a snapshot beside the log, which must agree with it.
    let half = |dir: &Path| {
        drop(open(dir));
        let log = fs::File::options().write(true).open(database(dir).join("db")).unwrap();
        log.set_len(log.metadata().unwrap().len() / 2).unwrap();
    };
    let no_folder = |dir: &Path| {
        fs::remove_dir_all(database(dir)).unwrap();
        fs::write(database(dir), "a file").unwrap();
    };
    let no_marker = |dir: &Path| fs::remove_file(dir.join("chladni.format")).unwrap();
    let bad_marker = |dir: &Path| fs::write(dir.join("chladni.format"), "?").unwrap();
    let old_marker = |dir: &Path| fs::write(dir.join("chladni.format"), "chladni store 0").unwrap();
    let cases: [(&str, Damage); 6] = [
        ("garbage", &garbage),
        ("half", &half),
        ("no folder", &no_folder),
        ("no marker", &no_marker),
        ("bad marker", &bad_marker),
        ("old marker", &old_marker),
    ];
    for (case, damage) in cases {
        let dir = TempDir::new().unwrap();
        let store = open(dir.path());
        for n in 0..10 {
            store.put(&key(n), &sample(100_000, n as u8), COST).unwrap();
        }
        drop(store);
        damage(dir.path());

        let store = open(dir.path());
        assert_eq!(quarantined_databases(dir.path()).len(), 1, "{case}");
        let stat = store.stat().unwrap();
        assert_eq!((stat.entries, stat.quarantined_databases), (0, 1), "{case}");
        assert_eq!(get(&store, &key(0)), None, "{case}");
        store.put(&key(0), &sample(10, 0), COST).unwrap();
        drop(store);
        assert_eq!(get(&open(dir.path()), &key(0)), Some(sample(10, 0)), "{case}");
        assert_eq!(quarantined_databases(dir.path()).len(), 1, "{case}");
    }
}

/// Zeros somewhere in the log, or its end cut off: sled may find it at opening, at a read, or never.
#[test]
fn damage_anywhere_in_the_database_never_gives_a_wrong_value() {
    let zeros = |log: &mut Vec<u8>, at: usize| {
        let end = log.len().min(at + 20_000);
        log[at..end].fill(0);
    };
    let cut = |log: &mut Vec<u8>, at: usize| log.truncate(at);
    let damages: [LogDamage; 2] = [&zeros, &cut];
    for (damage, tenth) in damages.iter().flat_map(|damage| (0..10).map(move |t| (damage, t))) {
        let dir = TempDir::new().unwrap();
        let store = open(dir.path());
        for n in 0..20 {
            store.put(&key(n), &sample(50_000, n as u8), COST).unwrap();
        }
        drop(store);
        // With and without a snapshot beside the log.
        if tenth % 2 == 0 {
            drop(open(dir.path()));
        }
        let file = database(dir.path()).join("db");
        let mut log = fs::read(&file).unwrap();
        let at = log.len() * tenth / 10;
        damage(&mut log, at);
        fs::write(&file, log).unwrap();

        let store = open(dir.path());
        for n in 0..20 {
            if let Some(found) = get(&store, &key(n)) {
                assert_eq!(found, sample(50_000, n as u8));
            }
        }
        drop(store);
        let store = open(dir.path());
        store.put(&key(0), &sample(10, 7), COST).unwrap();
        assert_eq!(get(&store, &key(0)), Some(sample(10, 7)));
    }
}
