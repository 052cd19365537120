//! The store through its public interface: what it keeps and what it refuses. Beside it: how it comes back from
//! damage, and what other processes see of it.

mod damage;
mod processes;
mod retention;

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use chladni::store::{self, Artifact, CacheKey, Digest, KeyBuilder, Store, StoreError};
use proptest::prelude::*;
use tempfile::TempDir;

const COST: Duration = Duration::from_millis(1500);

macro_rules! artifact {
    ($name:ident { $($field:ident: $type:ty),+ $(,)? }, $stage:literal, schema $schema:literal) => {
        #[derive(rkyv::Archive, rkyv::Serialize, rkyv::Deserialize, Debug, Clone, PartialEq)]
        struct $name { $($field: $type),+ }
        impl Artifact for $name {
            const STAGE: &'static str = $stage;
            const VERSION: u32 = 1;
            const SCHEMA: u32 = $schema;
        }
    };
}

artifact!(Bytes { bytes: Vec<u8> }, "bytes", schema 1);
artifact!(BytesOfLater { bytes: Vec<u8>, unit: String }, "bytes", schema 2);
artifact!(BytesByMistake { bytes: String }, "bytes", schema 1);
artifact!(Golden {
    name: String,
    evals: Vec<f64>,
    faces: Vec<[u32; 3]>,
    seed: Option<u64>,
    weights: Vec<f32>,
}, "golden", schema 7);

fn sample(length: usize, salt: u8) -> Bytes {
    let mut bytes = vec![0; length];
    blake3::Hasher::new().update(&[salt]).finalize_xof().fill(&mut bytes);
    Bytes { bytes }
}

fn key(n: u64) -> CacheKey {
    Bytes::key().finish(n, "f64")
}

fn open(dir: &Path) -> Store {
    Store::open(dir).unwrap()
}

fn get(store: &Store, key: &CacheKey) -> Option<Bytes> {
    Some(store.get::<Bytes>(key)?.artifact)
}

fn database(dir: &Path) -> PathBuf {
    dir.join("chladni.sled")
}

fn quarantined_databases(dir: &Path) -> Vec<PathBuf> {
    let items = fs::read_dir(dir).unwrap().map(|item| item.unwrap().path());
    items
        .filter(|path| path.file_name().unwrap().to_string_lossy().starts_with("quarantine-"))
        .collect()
}

#[test]
fn a_store_is_shared_between_threads() {
    fn shared<T: Send + Sync + Clone + 'static>() {}
    shared::<Store>();
}

#[test]
fn artifacts_of_every_size_come_back_after_reopening() {
    let dir = TempDir::new().unwrap();
    let lengths = [0, 1, 6143, 6144, 6145, 65535, 65536, 65537, 300 << 10];
    let store = open(dir.path());
    let mut digests = Vec::new();
    for (n, &length) in (0..).zip(&lengths) {
        let artifact = sample(length, 0);
        let digest = store.put(&key(n), &artifact, COST).unwrap();
        assert_eq!(digest, store::digest(&artifact).unwrap());
        digests.push(digest);
    }
    drop(store);
    let store = open(dir.path());
    for (n, &length) in (0..).zip(&lengths) {
        let cached = store.get::<Bytes>(&key(n)).unwrap();
        assert_eq!(cached.artifact, sample(length, 0), "{length} bytes");
        assert_eq!((cached.digest, cached.cost), (digests[n as usize], COST));
        let peeked = store.peek::<Bytes>(&key(n)).unwrap();
        assert_eq!((peeked.digest, peeked.cost), (cached.digest, cached.cost));
    }
    assert!(store.get::<Bytes>(&key(99)).is_none());
    assert!(store.peek::<Bytes>(&key(99)).is_none());
}

#[test]
fn an_entry_of_another_schema_is_a_miss_and_can_be_replaced() {
    let dir = TempDir::new().unwrap();
    let store = open(dir.path());
    store.put(&key(0), &sample(10, 0), COST).unwrap();
    assert!(store.get::<BytesOfLater>(&key(0)).is_none());
    assert!(store.peek::<BytesOfLater>(&key(0)).is_none());
    assert!(get(&store, &key(0)).is_some(), "a miss harms nothing");

    let later = BytesOfLater { bytes: vec![1], unit: "m".into() };
    store.put(&key(0), &later, COST).unwrap();
    assert_eq!(store.get::<BytesOfLater>(&key(0)).unwrap().artifact, later);
    assert!(get(&store, &key(0)).is_none());
    assert!(store.quarantined().unwrap().is_empty());
}

#[test]
fn no_page_becomes_a_file_that_is_never_synced() {
    let dir = TempDir::new().unwrap();
    let store = open(dir.path());
    for round in 0..4 {
        for n in 0..10 {
            let length = 100_000 * (1 + (n + round) % 4);
            store.put(&key(n as u64), &sample(length, n as u8), COST).unwrap();
        }
    }
    drop(store);
    let blobs = database(dir.path()).join("blobs");
    assert_eq!(fs::read_dir(blobs).map_or(0, |files| files.count()), 0);
}

fn contents(dir: &Path) -> HashMap<PathBuf, Vec<u8>> {
    let mut files = HashMap::new();
    let mut folders = vec![dir.to_owned()];
    while let Some(folder) = folders.pop() {
        for item in fs::read_dir(folder).unwrap() {
            let path = item.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                files.insert(path.clone(), fs::read(path).unwrap());
            }
        }
    }
    files
}

#[test]
fn a_newer_format_is_refused_and_left_as_it_is() {
    let dir = TempDir::new().unwrap();
    open(dir.path()).put(&key(0), &sample(10, 0), COST).unwrap();
    fs::write(dir.path().join("chladni.format"), "chladni store 3\n").unwrap();
    let before = contents(dir.path());
    let error = Store::open(dir.path()).unwrap_err();
    assert!(matches!(error, StoreError::NewerFormat { found: 3, known: 2, .. }));
    assert!(error.to_string().contains("update chladni"));
    assert_eq!(contents(dir.path()), before);
}

#[test]
fn a_directory_that_cannot_be_made_is_an_error_that_says_what_to_do() {
    let dir = TempDir::new().unwrap();
    let file = dir.path().join("file");
    fs::write(&file, "").unwrap();
    let cache = file.join("cache");
    let message = Store::open(&cache).unwrap_err().to_string();
    assert!(message.starts_with(&format!("cannot create {}", cache.display())), "{message}");
    assert!(message.contains("--cache DIR or CHLADNI_CACHE"), "{message}");
}

/// The format on disk. When this fails, entries of earlier versions are misread or lost: raise the format of the
/// store, or undo the change.
#[test]
fn an_encoded_artifact_is_byte_for_byte_what_it_was() {
    let golden = Golden {
        name: "spot, a cow with a long enough name".into(),
        evals: vec![0.0, 1.25, -3.5e-7, f64::MAX],
        faces: vec![[0, 1, 2], [2, 1, 3]],
        seed: Some(0x0123_4567_89AB_CDEF),
        weights: vec![0.5, -0.25, 1e-20],
    };
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/store/artifact-1.bin");
    let mut stored = rkyv::util::AlignedVec::new();
    stored.extend_from_slice(&fs::read(path).unwrap());
    assert_eq!(store::encode(&golden).unwrap().as_slice(), stored.as_slice());
    assert_eq!(store::decode::<Golden>(&stored).unwrap(), golden);
}

#[test]
fn threads_that_put_and_get_the_same_keys_do_no_harm() {
    let dir = TempDir::new().unwrap();
    let store = open(dir.path());
    std::thread::scope(|scope| {
        for salt in 0..4 {
            let store = store.clone();
            scope.spawn(move || {
                for round in 0..8 {
                    let key = key(round % 2);
                    store.put(&key, &sample(40_000 + usize::from(salt), salt), COST).unwrap();
                    let found = get(&store, &key).expect("someone's entry");
                    let writer = (found.bytes.len() - 40_000) as u8;
                    assert_eq!(found, sample(found.bytes.len(), writer));
                }
            });
        }
    });
    assert!(store.quarantined().unwrap().is_empty());
    assert_eq!(store.stat().unwrap().entries, 2);
}

#[test]
fn a_stat_counts_by_stage() {
    let dir = TempDir::new().unwrap();
    let store = open(dir.path());
    assert_eq!(store.stat().unwrap().entries, 0);
    let later = BytesOfLater { bytes: vec![], unit: String::new() };
    let other = KeyBuilder::new("other", 1).input("x", &Digest::of(b"x")).finish(0, "f32");
    let golden =
        Golden { name: "g".into(), evals: vec![], faces: vec![], seed: None, weights: vec![] };
    store.put(&key(0), &sample(100_000, 0), COST).unwrap();
    store.put(&key(1), &later, COST).unwrap();
    store.put(&other, &golden, COST).unwrap();

    let length =
        |encoded: Result<rkyv::util::AlignedVec, _>| encoded.map(|b| b.len() as u64).unwrap();
    let bytes = length(store::encode(&sample(100_000, 0))) + length(store::encode(&later));
    let stat = store.stat().unwrap();
    assert_eq!(stat.stages["bytes"].entries, 2);
    assert_eq!(stat.stages["bytes"].live_bytes, bytes);
    assert_eq!(stat.stages["golden"].entries, 1);
    assert_eq!((stat.entries, stat.stages.len()), (3, 2));
    assert_eq!(stat.live_bytes, bytes + length(store::encode(&golden)));
    assert!(stat.disk_bytes > stat.live_bytes);
    let json = serde_json::to_value(&stat).unwrap();
    assert_eq!(json["stages"]["bytes"]["entries"], 2);
}

#[derive(Debug, Clone)]
enum Step {
    Put { key: u64, length: usize, salt: u8 },
    Get { key: u64 },
    Reopen,
}

fn step() -> impl Strategy<Value = Step> {
    let length = prop_oneof![0..40usize, 6000..6300usize, 20_000..80_000usize];
    prop_oneof![
        4 => (0..5u64, length, any::<u8>())
            .prop_map(|(key, length, salt)| Step::Put { key, length, salt }),
        4 => (0..5u64).prop_map(|key| Step::Get { key }),
        1 => Just(Step::Reopen),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, failure_persistence: None, ..ProptestConfig::default() })]

    /// Whatever is put, read and reopened, a store is a map from keys to values.
    #[test]
    fn a_store_behaves_as_a_map(steps in prop::collection::vec(step(), 1..30)) {
        let dir = TempDir::new().unwrap();
        let mut store = open(dir.path());
        let mut model = HashMap::new();
        for step in steps {
            match step {
                Step::Put { key: n, length, salt } => {
                    let artifact = sample(length, salt);
                    store.put(&key(n), &artifact, COST).unwrap();
                    model.insert(n, artifact);
                }
                Step::Get { key: n } => {
                    prop_assert_eq!(get(&store, &key(n)), model.get(&n).cloned());
                }
                Step::Reopen => {
                    drop(store);
                    store = open(dir.path());
                }
            }
        }
        prop_assert_eq!(store.stat().unwrap().entries, model.len() as u64);
        prop_assert!(store.quarantined().unwrap().is_empty());
    }
}
