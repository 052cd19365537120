//! Models by name: what a training leaves in the store, and what is imported into it.
//!
//! The trunks of a training, each with its heads, are in the store as they are trained. A model is a small entry beside
//! them: its name, its description and their keys. Its name is that of the mesh's file and eight digits of its first
//! trunk's key, for example `spot_829-4f1c90ab`: another mesh, family, recipe or seed has another name. A larger K has the
//! same, and takes the place of the smaller, where every eigenfunction has a trunk of its own; a shared trunk is another
//! one for every K.

use std::sync::Arc;

use rkyv::{Archive, Deserialize, Serialize};

use super::artifacts::TrunkArtifact;
use super::context::Context;
use super::remesh::Surface;
use super::train::{InTraining, TrainedBlock};
use crate::flow::events::How;
use crate::ggnn::Model;
use crate::ggnn::features::Features;
use crate::ggnn::model::{DeflationRule, Description, ModelFileError, TrainedMesh};
use crate::pipeline::{MODEL_EXTENSION as EXTENSION, Pipeline, Train, is_model_file};
use crate::store::{Artifact, CacheKey, Digest, Store, StoreError};

/// Digits of a key in a name.
const SHORT_KEY: usize = 8;

/// A model as the store keeps it.
#[derive(Debug, Clone, PartialEq, Archive, Serialize, Deserialize)]
pub struct ModelArtifact {
    name: String,
    /// JSON.
    description: String,
    /// The keys of its trunks, and how many heads are on each.
    trunks: Vec<([u8; 32], u32)>,
}

impl Artifact for ModelArtifact {
    const STAGE: &'static str = "model";
    const VERSION: u32 = 1;
    const SCHEMA: u32 = 2;
}

/// Why there is no such model.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// The file is none.
    #[error(transparent)]
    File(#[from] ModelFileError),
    /// No model has this name, or begins with it.
    #[error(
        "no model of the cache is called {name:?}, or begins so ({}); `chladni run` leaves one for every mesh that it \
         trains, `chladni model import` brings one in, and a path to a .{EXTENSION} file is taken as a file",
        listing(.known)
    )]
    Unknown { name: String, known: Vec<String> },
    /// Several models begin with this.
    #[error("several models begin with {name:?}: {}; give more of the name", .matches.join(", "))]
    Ambiguous { name: String, matches: Vec<String> },
    /// A block has left the store.
    #[error(
        "the model {name} is no longer whole: its block for φ{k} has left the cache, or was damaged; run its pipeline \
         again, which trains what is missing"
    )]
    Incomplete { name: String, k: usize },
    /// Another model has the name.
    #[error("another model is called {name}; choose a name with --name")]
    Taken { name: String },
    /// It cannot be a name.
    #[error(
        "{name:?} cannot be the name of a model: letters, digits, '.', '-' and '_', not ending in .{EXTENSION}; \
         choose a name with --name"
    )]
    Name { name: String },
    /// The description cannot be read.
    #[error(
        "the description of the model {name} cannot be read ({reason}); run its pipeline again"
    )]
    Description { name: String, reason: String },
    /// The store refuses.
    #[error(transparent)]
    Store(#[from] StoreError),
}

fn listing(names: &[String]) -> String {
    if names.is_empty() { "it has none".into() } else { format!("it has {}", names.join(", ")) }
}

/// A model of the store, without its weights.
#[derive(Debug, Clone, PartialEq)]
pub struct Listed {
    /// Its name.
    pub name: String,
    /// What it was trained on, and how.
    pub description: Description,
    /// K.
    pub k: usize,
    /// Whether the store has all its blocks.
    pub whole: bool,
}

/// All models of a store, by name.
///
/// # Errors
/// When the database cannot be read.
pub fn list(store: &Store) -> Result<Vec<Listed>, ModelError> {
    entries(store)?.into_iter().map(|entry| listed(store, entry)).collect()
}

/// A model of the store with its blocks, each with the trunk that it came from.
#[derive(Debug)]
pub struct Stored {
    /// Its name.
    pub name: String,
    /// What it was trained on, and how.
    pub description: Description,
    /// Its blocks, in the order of their eigenfunctions.
    pub blocks: Vec<TrainedBlock>,
}

/// The model called `name`, or the only one whose name begins so; with its whole name.
///
/// # Errors
/// [`ModelError`].
pub fn load(store: &Store, name: &str) -> Result<(String, Model), ModelError> {
    let Stored { name, description, blocks } = stored(store, find(store, name)?)?;
    let blocks = blocks.into_iter().map(|trained| Arc::unwrap_or_clone(trained.block)).collect();
    Ok((name, Model { description, blocks }))
}

/// The model of just this name; `None` where it is not there, or not whole.
pub fn named(store: &Store, name: &str) -> Option<Stored> {
    let entry = store.get::<ModelArtifact>(&key_of(name))?.artifact;
    stored(store, entry).inspect_err(|error| tracing::debug!("{error}")).ok()
}

fn stored(store: &Store, entry: ModelArtifact) -> Result<Stored, ModelError> {
    let ModelArtifact { name, description, trunks } = entry;
    let description = parse(&name, &description)?;
    let mut blocks = Vec::new();
    for (key, _) in trunks {
        let (key, first) = (CacheKey::from_bytes(key), description.known + 1 + blocks.len());
        let Some(trunk) = store.get::<TrunkArtifact>(&key) else {
            return Err(ModelError::Incomplete { name, k: first });
        };
        let digest = trunk.digest;
        blocks.extend((first..).zip(trunk.artifact.into_blocks()).map(|(k, block)| {
            let block = Arc::new(block);
            TrainedBlock { k, block, key, digest, how: How::Reused, seconds: 0.0 }
        }));
    }
    Ok(Stored { name, description, blocks })
}

/// The entries of the models that are `wanted` by name, their own and those of their trunks.
///
/// # Errors
/// When the database cannot be read.
pub fn keys(store: &Store, wanted: impl Fn(&str) -> bool) -> Result<Vec<CacheKey>, StoreError> {
    let entries = store.keys_of::<ModelArtifact>()?.into_iter();
    let entries = entries.filter_map(|key| Some((key, store.get::<ModelArtifact>(&key)?.artifact)));
    let wanted = entries.filter(|(_, model)| wanted(&model.name));
    Ok(wanted
        .flat_map(|(key, model)| {
            let trunks = model.trunks.into_iter().map(|(key, _)| CacheKey::from_bytes(key));
            std::iter::once(key).chain(trunks)
        })
        .collect())
}

/// Stores a model under `name`; nothing happens when it is there already.
///
/// # Errors
/// [`ModelError::Taken`], [`ModelError::Name`], or when the store cannot be written.
pub fn import(store: &Store, name: &str, model: &Model) -> Result<(), ModelError> {
    if name.is_empty() || name != tidy(name) || is_model_file(name) {
        return Err(ModelError::Name { name: name.into() });
    }
    let bytes = model.to_bytes();
    if store.peek::<ModelArtifact>(&key_of(name)).is_some() {
        return match load(store, name) {
            Ok((_, there)) if there.to_bytes() == bytes => Ok(()),
            Ok(_) | Err(_) => Err(ModelError::Taken { name: name.into() }),
        };
    }
    let digest = Digest::of(&bytes);
    let mut trunks = Vec::new();
    for (part, heads) in (1..).zip(model.trunks()) {
        let key = TrunkArtifact::key().param("part", format!("{part}")).input("model", &digest);
        let key = key.finish(0, "f32");
        store.put(&key, &TrunkArtifact::of(heads), Default::default())?;
        trunks.push((key, heads.len()));
    }
    put(store, name, &model.description, &trunks)
}

/// Makes a training findable by name, which is returned. A store that cannot be written costs a warning and nothing else.
pub fn remember(context: &Context, trained: &InTraining) -> Option<String> {
    let InTraining { training, blocks, chosen, .. } = trained;
    let first = blocks.first()?;
    let surface = &training.surface;
    let name = format!("{}-{:.SHORT_KEY$}", tidy(stem(&surface.name)), first.key.to_string());
    let trunks = blocks.chunk_by(|a, b| a.key == b.key);
    let trunks: Vec<_> = trunks.map(|heads| (heads[0].key, heads.len())).collect();
    let Some(store) = context.writable() else { return Some(name) };
    let kept = store.get::<ModelArtifact>(&key_of(&name));
    if kept.is_some_and(|kept| kept.artifact.trunks.starts_with(&as_stored(&trunks))) {
        return Some(name);
    }
    let features = training.features().clone();
    let description =
        describe(&context.pipeline, &chosen.train, surface, trained.known(), features);
    if let Err(error) = put(store, &name, &description, &trunks) {
        store.complain(ModelArtifact::STAGE, &error);
    }
    Some(name)
}

/// What a training is described by.
fn describe(
    pipeline: &Pipeline,
    train: &Train,
    surface: &Surface,
    known: usize,
    features: Features,
) -> Description {
    let Pipeline { family, operators, features: options, .. } = pipeline;
    Description {
        chladni: env!("CARGO_PKG_VERSION").into(),
        mesh: TrainedMesh::of(&surface.name, surface.mesh(), surface.topology(), &features),
        known,
        features,
        operators: *operators,
        deflation: DeflationRule::InnerProduct,
        parameters: serde_json::json!({ "family": family, "features": options, "train": train }),
    }
}

fn put(
    store: &Store,
    name: &str,
    description: &Description,
    trunks: &[(CacheKey, usize)],
) -> Result<(), ModelError> {
    let artifact = ModelArtifact {
        name: name.into(),
        description: serde_json::to_string(description)
            .expect("a description is numbers and names"),
        trunks: as_stored(trunks),
    };
    store.pin(trunks.iter().map(|(key, _)| *key).chain([key_of(name)]));
    store.put(&key_of(name), &artifact, Default::default())?;
    Ok(())
}

fn as_stored(trunks: &[(CacheKey, usize)]) -> Vec<([u8; 32], u32)> {
    trunks.iter().map(|(key, heads)| (*key.as_bytes(), *heads as u32)).collect()
}

fn key_of(name: &str) -> CacheKey {
    ModelArtifact::key().param("name", name).finish(0, "")
}

/// All model entries, by name.
fn entries(store: &Store) -> Result<Vec<ModelArtifact>, ModelError> {
    let keys = store.keys_of::<ModelArtifact>()?;
    let entries = keys.iter().filter_map(|key| store.get::<ModelArtifact>(key));
    let mut entries: Vec<ModelArtifact> = entries.map(|cached| cached.artifact).collect();
    entries.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(entries)
}

fn find(store: &Store, name: &str) -> Result<ModelArtifact, ModelError> {
    if let Some(exact) = store.get::<ModelArtifact>(&key_of(name)) {
        return Ok(exact.artifact);
    }
    let names = |entries: &[ModelArtifact]| entries.iter().map(|e| e.name.clone()).collect();
    let all = entries(store)?;
    let known = names(&all);
    let mut matches: Vec<ModelArtifact> =
        all.into_iter().filter(|entry| !name.is_empty() && entry.name.starts_with(name)).collect();
    match matches.len() {
        1 => Ok(matches.remove(0)),
        0 => Err(ModelError::Unknown { name: name.into(), known }),
        _ => Err(ModelError::Ambiguous { name: name.into(), matches: names(&matches) }),
    }
}

fn listed(store: &Store, entry: ModelArtifact) -> Result<Listed, ModelError> {
    let description = parse(&entry.name, &entry.description)?;
    let there = |key: &[u8; 32]| store.peek::<TrunkArtifact>(&CacheKey::from_bytes(*key)).is_some();
    let heads: u32 = entry.trunks.iter().map(|(_, heads)| heads).sum();
    Ok(Listed {
        k: description.known + heads as usize,
        whole: entry.trunks.iter().all(|(key, _)| there(key)),
        name: entry.name,
        description,
    })
}

fn parse(name: &str, description: &str) -> Result<Description, ModelError> {
    serde_json::from_str(description)
        .map_err(|error| ModelError::Description { name: name.into(), reason: error.to_string() })
}

/// The name of a file without folders and ending.
fn stem(path: &str) -> &str {
    let name = path.rsplit('/').next().unwrap_or(path);
    name.rsplit_once('.').map_or(name, |(stem, _)| if stem.is_empty() { name } else { stem })
}

/// A name with nothing in it that a shell or a path would take for something else.
fn tidy(name: &str) -> String {
    let plain = |c: char| if c.is_alphanumeric() || "._-".contains(c) { c } else { '-' };
    name.chars().map(plain).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ggnn::model::samples::{shared_model, sphere_model};

    #[test]
    fn a_model_is_imported_once_found_by_its_beginning_and_comes_back_whole() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::open(dir.path()).unwrap();
        let model = sphere_model();
        import(&store, "sphere-a", &model).unwrap();
        import(&store, "sphere-a", &model).unwrap();
        let mut other = model.clone();
        other.blocks.truncate(1);
        assert!(matches!(import(&store, "sphere-a", &other), Err(ModelError::Taken { .. })));
        assert_eq!(load(&store, "sph").unwrap(), ("sphere-a".to_string(), model.clone()));
        assert_eq!(load(&store, "sph").unwrap().1.to_bytes(), model.to_bytes());
        import(&store, "sphere-b", &other).unwrap();
        let ambiguous = load(&store, "sph").unwrap_err().to_string();
        assert!(ambiguous.contains("sphere-a, sphere-b"), "{ambiguous}");
        assert_eq!(load(&store, "sphere-b").unwrap().1, other);
        let unknown = load(&store, "cow").unwrap_err().to_string();
        assert!(unknown.contains("sphere-a, sphere-b"), "{unknown}");
        let listed: Vec<_> =
            list(&store).unwrap().into_iter().map(|m| (m.name, m.k, m.whole)).collect();
        assert_eq!(listed, [("sphere-a".into(), 3, true), ("sphere-b".into(), 2, true)]);
        for name in ["", "a/b", "a b", "x.safetensors"] {
            assert!(matches!(import(&store, name, &model), Err(ModelError::Name { .. })), "{name}");
        }
    }

    #[test]
    fn the_heads_of_a_shared_trunk_come_back_on_one() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::open(dir.path()).unwrap();
        let model = shared_model();
        import(&store, "sphere", &model).unwrap();
        let (_, back) = load(&store, "sphere").unwrap();
        assert_eq!(back, model);
        assert_eq!(back.trunks().map(<[_]>::len).collect::<Vec<_>>(), [1, 2]);
        assert_eq!(store.keys_of::<TrunkArtifact>().unwrap().len(), 2);
        assert_eq!(list(&store).unwrap()[0].k, 4);
    }

    #[test]
    fn a_model_that_lost_a_block_says_so() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::open(dir.path()).unwrap();
        let missing = [(CacheKey::from_bytes([7; 32]), 5)];
        put(&store, "torn", &sphere_model().description, &missing).unwrap();
        let listed = list(&store).unwrap().remove(0);
        assert_eq!((listed.k, listed.whole), (6, false));
        let torn = load(&store, "torn").unwrap_err().to_string();
        assert!(torn.contains("φ2") && torn.contains("run its pipeline again"), "{torn}");
    }

    #[test]
    fn names_come_from_files() {
        assert_eq!(stem("a/b/spot_829.obj"), "spot_829");
        assert_eq!(stem(".obj"), ".obj");
        assert_eq!(tidy("my scan (2)"), "my-scan--2-");
        assert!(
            is_model_file("m.safetensors")
                && is_model_file("a/b")
                && !is_model_file("spot_829-4f1c90ab")
        );
    }
}
