//! From a mesh to the family that its blocks are trained on.

use std::sync::Arc;

use super::Failure;
use super::artifacts::FamilyArtifact;
use super::context::{Context, Work};
use super::ingest::Loaded;
use crate::flow::Panicked;
use crate::remesh::{Family, FamilyRecipe};
use crate::store::Digest;

/// A mesh with its family.
#[derive(Debug, Clone)]
pub struct Familied {
    /// The mesh.
    pub loaded: Loaded,
    /// Its variants.
    pub family: Arc<Family>,
    /// Of the family.
    pub family_digest: Digest,
}

/// Fewer vertices than this for each eigenpair resolve no eigenfunction.
const VERTICES_PER_PAIR: usize = 3;

/// Makes or recalls the family of a mesh.
///
/// # Errors
/// When no variants of the wanted size keep the topology.
pub fn remesh(context: &Context, item: usize, mut loaded: Loaded) -> Result<Familied, Failure> {
    let recipe = recipe_for(context, &loaded);
    let FamilyRecipe { members, vertices, jitter, seed } = recipe;
    let work = Work::<FamilyArtifact>::of_stage()
        .param("members", members.to_string())
        .param("vertices", vertices.to_string())
        .param("jitter", jitter.to_string())
        .input("mesh", &loaded.digest())
        .seeded(seed, "f32");
    let recalled = context.recall(item, work, || {
        Ok(FamilyArtifact::from(&Family::of(&loaded.ingested.mesh, &recipe)?))
    })?;
    loaded.spent("remesh", recalled.how, recalled.spent);
    let family = Family::try_from(recalled.artifact).map_err(|invalid| Panicked {
        message: format!("a cached family holds an invalid mesh ({invalid})"),
    })?;
    Ok(Familied { loaded, family: Arc::new(family), family_digest: recalled.digest })
}

/// The pipeline's family; the mesh alone where a coarser variant could not carry K eigenfunctions.
fn recipe_for(context: &Context, loaded: &Loaded) -> FamilyRecipe {
    let (recipe, k) = (context.pipeline.family, context.pipeline.train.k);
    let smallest = recipe.vertices_of(loaded.ingested.mesh.n());
    if recipe.members > 1 && smallest < VERTICES_PER_PAIR * k {
        tracing::warn!(
            mesh = loaded.job.name,
            "variants of {smallest} vertices are too coarse for {k} eigenpairs: training on the mesh alone"
        );
        return FamilyRecipe { members: 1, ..recipe };
    }
    recipe
}
