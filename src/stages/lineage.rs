//! What a mesh can begin with: the blocks of its previous version, and which mesh grew from which.
//!
//! Kept are, for every path, the content that it had last, and, for every content, the model that its eigenfunctions come
//! from with the one that this grew from, if any. Both only for the very same options: blocks that were trained otherwise are no
//! version of these. So
//! - a content that was seen before, wherever, ends as it did before: from the same parent, or from none;
//! - a content that is new at a path begins with the model of the content that was there last;
//! - without lineage nothing of this is looked at, and all of it is written: later runs can begin with what was trained.

use std::collections::HashSet;
use std::sync::Arc;

use rkyv::{Archive, Deserialize, Serialize};

use super::context::Context;
use super::ingest::Loaded;
use super::models::{self, Stored};
use super::train::TrainedBlock;
use super::work::canonical;
use crate::ggnn::features::Features;
use crate::ggnn::model::Description;
use crate::ggnn::recipe::Trunks;
use crate::mesh::MeshHash;
use crate::pipeline::{Count, Method, Pipeline, Refine, Train};
use crate::store::{Artifact, CacheKey, KeyBuilder, Store, StoreError};

/// Where the eigenfunctions of one content come from.
#[derive(Debug, Clone, PartialEq, Eq, Archive, Serialize, Deserialize)]
pub struct VersionArtifact {
    /// The model that predicts them.
    model: String,
    /// The model that this grew from, or that is itself an earlier version's; none for one that was trained from nothing.
    parent: Option<String>,
}

impl Artifact for VersionArtifact {
    const STAGE: &'static str = "version";
    const VERSION: u32 = 1;
    const SCHEMA: u32 = 1;
}

/// The content that a path had last.
#[derive(Debug, Clone, PartialEq, Eq, Archive, Serialize, Deserialize)]
pub struct PathArtifact {
    /// The key of its version.
    version: [u8; 32],
}

impl Artifact for PathArtifact {
    const STAGE: &'static str = "path";
    const VERSION: u32 = 1;
    const SCHEMA: u32 = 1;
}

/// The model of a previous version.
#[derive(Debug, Clone)]
pub struct Parent {
    /// Its name in the store.
    pub name: String,
    /// What it was trained on, and how.
    pub description: Description,
    /// Its blocks, in the order of their eigenfunctions.
    pub blocks: Vec<TrainedBlock>,
    /// The options that it was trained by, K and all that is done with learned functions as this run has it.
    pub train: Train,
}

impl Parent {
    /// The mesh that its blocks were trained for.
    pub fn mesh(&self) -> MeshHash {
        self.description.mesh.hash
    }

    /// What its network reads of a mesh of the shape, where that lies.
    pub fn features(&self, loaded: &Loaded) -> Features {
        self.description.features.near(&loaded.ingested.mesh).into_owned()
    }

    /// The blocks of φ_{c+1} … φ_K, if it has them all.
    pub fn blocks_to(&self, k: usize) -> Option<&[TrainedBlock]> {
        self.blocks.get(..k.saturating_sub(self.description.known))
    }
}

/// The model that the mesh is to begin with, where it has one.
pub fn parent(context: &Context, loaded: &Loaded) -> Option<Arc<Parent>> {
    // What is trained for a surface with a formula does not depend on the mesh.
    let depends = context.pipeline.family.of.shape().is_none();
    let store = context.store.as_ref().filter(|_| context.lineage && depends)?;
    let own = version_key::<VersionArtifact>(&context.pipeline, &loaded.hash);
    let name = match store.get::<VersionArtifact>(&own) {
        Some(version) => version.artifact.parent?,
        None => store.get::<VersionArtifact>(&last_version(context, loaded)?)?.artifact.model,
    };
    let Stored { name, description, blocks } = models::named(store, &name)?;
    let trained: Train = serde_json::from_value(description.parameters["train"].clone()).ok()?;
    let Train { k, refine, .. } = context.pipeline.train;
    let train = Train { k, refine, ..trained };
    Some(Arc::new(Parent { name, description, blocks, train }))
}

/// Takes note that the eigenfunctions of a mesh come from `model`, which grew from `parent`. A store that cannot be written costs
/// a warning and nothing else.
pub fn record(context: &Context, loaded: &Loaded, model: &str, parent: Option<&Parent>) {
    let Some(store) = context.writable() else { return };
    let parent = parent.map(|parent| parent.name.clone());
    note(context, store, loaded, &VersionArtifact { model: model.into(), parent });
}

/// The key of the version that the mesh's path had last.
pub fn last_version(context: &Context, loaded: &Loaded) -> Option<CacheKey> {
    let path = path_key(&context.pipeline, loaded)?;
    let last = context.store.as_ref()?.get::<PathArtifact>(&path)?;
    Some(CacheKey::from_bytes(last.artifact.version))
}

/// Stores the version of a mesh, and that its path has it now.
pub fn note<V: Artifact + PartialEq>(
    context: &Context,
    store: &Store,
    loaded: &Loaded,
    version: &V,
) {
    let key = version_key::<V>(&context.pipeline, &loaded.hash);
    store.note(&key, version);
    if let Some(path) = path_key(&context.pipeline, loaded) {
        store.note(&path, &PathArtifact { version: *key.as_bytes() });
    }
}

/// Tells of a model whether every path has gone on from it: then it need not stay.
///
/// # Errors
/// When the database cannot be read.
pub fn superseded(store: &Store) -> Result<impl Fn(&str) -> bool, StoreError> {
    let models = |keys: Vec<CacheKey>| -> HashSet<String> {
        let versions = keys.iter().filter_map(|key| store.get::<VersionArtifact>(key));
        versions.map(|version| version.artifact.model).collect()
    };
    let paths = store.keys_of::<PathArtifact>()?;
    let last = paths.iter().filter_map(|key| store.get::<PathArtifact>(key));
    let current = models(last.map(|p| CacheKey::from_bytes(p.artifact.version)).collect());
    let all = models(store.keys_of::<VersionArtifact>()?);
    Ok(move |name: &str| all.contains(name) && !current.contains(name))
}

/// Where the version with this content is, by the options of the pipeline.
pub fn version_key<V: Artifact>(pipeline: &Pipeline, mesh: &MeshHash) -> CacheKey {
    under(V::key(), pipeline).param("mesh", mesh.as_bytes()).finish(0, "")
}

/// `None` for a file that is gone.
fn path_key(pipeline: &Pipeline, loaded: &Loaded) -> Option<CacheKey> {
    let path = loaded.job.source.canonicalize().ok()?;
    let key = under(PathArtifact::key(), pipeline);
    let key = key.param("path", path.as_os_str().as_encoded_bytes());
    let key = match &loaded.job.object {
        None => key,
        Some(object) => key.param("object", object.as_bytes()),
    };
    Some(key.finish(0, ""))
}

/// What results depend on besides the mesh: with trunks of their own, and with solved pairs, not on K.
fn under(key: KeyBuilder, pipeline: &Pipeline) -> KeyBuilder {
    let Pipeline { input: _, ingest: _, family, operators, features, train, verify: _, publish: _ } =
        pipeline;
    let key = key.param("operators", canonical(operators));
    if train.method == Method::Fem {
        return key.param("method", "fem");
    }
    let train = Train {
        method: Method::LepDpinn,
        model: String::new(),
        refine: Refine::None,
        k: if train.trunk == Trunks::Shared { train.k } else { Count::Number(0) },
        ..train.clone()
    };
    key.param("family", canonical(family))
        .param("features", canonical(&features.effective()))
        .param("train", canonical(&train))
}
