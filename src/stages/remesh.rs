//! From a mesh to the family that its blocks are trained on.

use std::sync::Arc;

use super::Failure;
use super::artifacts::FamilyArtifact;
use super::assemble::Assembled;
use super::context::{Context, Work, canonical};
use crate::flow::Panicked;
use crate::remesh::Family;
use crate::store::Digest;

/// A mesh with its family.
#[derive(Debug, Clone)]
pub struct Familied {
    /// The mesh with its operators.
    pub assembled: Assembled,
    /// Its variants.
    pub family: Arc<Family>,
    /// Of the family.
    pub family_digest: Digest,
}

/// Makes or recalls the family of a mesh.
///
/// # Errors
/// When no variants of the wanted size keep the topology.
pub fn remesh(
    context: &Context,
    item: usize,
    mut assembled: Assembled,
) -> Result<Familied, Failure> {
    let loaded = &mut assembled.loaded;
    let recipe = &context.pipeline.family;
    let work = Work::<FamilyArtifact>::of_stage()
        .param("recipe", canonical(recipe))
        .input("mesh", &loaded.digest())
        .seeded(recipe.seed, "f32");
    let recalled = context.recall(item, work, || {
        Ok(FamilyArtifact::from(&Family::of(&loaded.ingested.mesh, recipe)?))
    })?;
    loaded.spent("remesh", recalled.how, recalled.spent);
    let family = Family::try_from(recalled.artifact).map_err(|invalid| Panicked {
        message: format!("a cached family holds an invalid mesh ({invalid})"),
    })?;
    let (k, smallest) = (context.pipeline.train.k, family.members.iter().map(|m| m.n()).min());
    match smallest {
        Some(n) if n < k => Err(Failure::CoarseFamily { n, k }),
        _ => Ok(Familied { assembled, family: Arc::new(family), family_digest: recalled.digest }),
    }
}
