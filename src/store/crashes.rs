//! Is a store that was cut off anywhere still a map from keys to what was put there? Against a map in memory, with crashes
//! between any two operations on the database.

use std::collections::HashMap;
use std::path::Path;
use std::time::Duration;

use proptest::prelude::*;
use tempfile::TempDir;

use super::interruption::after;
use super::{Artifact, CacheKey, Kind, Mode, Store};

#[derive(rkyv::Archive, rkyv::Serialize, rkyv::Deserialize, Debug, Clone, PartialEq)]
struct Bytes(Vec<u8>);

impl Artifact for Bytes {
    const STAGE: &'static str = "bytes";
    const VERSION: u32 = 1;
    const SCHEMA: u32 = 1;
}

#[derive(Debug, Clone)]
enum Step {
    Put {
        key: u64,
        length: usize,
        salt: u8,
    },
    Get {
        key: u64,
    },
    /// Removes what is beyond so many bytes.
    Sweep {
        limit: u64,
    },
    Compact,
}

fn step() -> impl Strategy<Value = (Step, Option<usize>)> {
    let length = prop_oneof![0..40usize, 6000..6300usize, 20_000..60_000usize];
    let step = prop_oneof![
        5 => (0..5u64, length, any::<u8>())
            .prop_map(|(key, length, salt)| Step::Put { key, length, salt }),
        3 => (0..5u64).prop_map(|key| Step::Get { key }),
        1 => (0..120_000u64).prop_map(|limit| Step::Sweep { limit }),
        1 => Just(Step::Compact),
    ];
    // Half of the steps are cut off, most of them early: that is where the order of writes matters.
    (step, prop::option::of(prop_oneof![3 => 0..6usize, 1 => 0..25usize]))
}

fn key(n: u64) -> CacheKey {
    Bytes::key().finish(n, "")
}

fn sample(length: usize, salt: u8) -> Bytes {
    Bytes((0..length).map(|i| (i as u8).wrapping_mul(salt | 1).wrapping_add(salt)).collect())
}

fn get(store: &Store, n: u64) -> Option<Bytes> {
    store.get::<Bytes>(&key(n)).map(|cached| cached.artifact)
}

/// Does a step, or what comes of it before the crash.
fn take(dir: &Path, store: Store, step: &Step) -> Store {
    match step {
        Step::Put { key: n, length, salt } => {
            let _ = store.put(&key(*n), &sample(*length, *salt), Duration::from_secs(1));
        }
        Step::Get { key } => drop(get(&store, *key)),
        Step::Sweep { limit } => drop(store.sweep(&[Kind::of::<Bytes>()], *limit, Mode::Apply)),
        Step::Compact => {
            drop(store);
            let _ = Store::compact(dir);
            after(None);
            return Store::open(dir).unwrap();
        }
    }
    store
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn whatever_is_cut_off_a_store_stays_a_map(steps in prop::collection::vec(step(), 1..16)) {
        let dir = TempDir::new().unwrap();
        let mut store = Store::open(dir.path()).unwrap();
        let mut model: HashMap<u64, Bytes> = HashMap::new();
        for (step, crash) in steps {
            after(crash);
            store = take(dir.path(), store, &step);
            after(None);
            if crash.is_some() {
                drop(store);
                store = Store::open(dir.path()).unwrap();
            }
            for n in 0..5 {
                let found = get(&store, n);
                let allowed = match &step {
                    // Whole, or not there; the old value has left before the new one comes.
                    Step::Put { key, length, salt } if *key == n => {
                        let new = Some(sample(*length, *salt));
                        if crash.is_some() {
                            found.is_none() || found == new || found.as_ref() == model.get(&n)
                        } else {
                            found == new
                        }
                    }
                    Step::Sweep { .. } => found.is_none() || found.as_ref() == model.get(&n),
                    _ => found.as_ref() == model.get(&n),
                };
                prop_assert!(allowed, "key {n} after {step:?} cut off after {crash:?}");
                match found {
                    Some(found) => drop(model.insert(n, found)),
                    None => drop(model.remove(&n)),
                }
            }
        }
        prop_assert!(store.quarantined().unwrap().is_empty());
        // What crashes have left behind goes, and nothing else.
        store.sweep(&[Kind::of::<Bytes>()], u64::MAX, Mode::Apply).unwrap();
        prop_assert_eq!(store.stat().unwrap().entries, model.len() as u64);
        prop_assert!((0..5).all(|n| get(&store, n).as_ref() == model.get(&n)));
        let again = store.sweep(&[Kind::of::<Bytes>()], u64::MAX, Mode::DryRun).unwrap();
        prop_assert_eq!(again.orphaned_bytes, 0);
    }
}
