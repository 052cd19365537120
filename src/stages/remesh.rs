//! From a mesh to the family that its blocks are trained on.

use std::sync::Arc;

use super::Failure;
use super::artifacts::FamilyArtifact;
use super::assemble::Assembled;
use super::context::Context;
use super::work::{Work, canonical};
use crate::flow::Panicked;
use crate::remesh::Family;
use crate::spectrum::SpectrumError;
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
    /// How many eigenfunctions of λ = 0 the mesh has.
    pub known: usize,
}

/// Makes or recalls the family of a mesh.
///
/// # Errors
/// When the mesh cannot have the boundary condition or K eigenpairs under it, or no variants of the wanted size keep the
/// topology.
pub fn remesh(
    context: &Context,
    item: usize,
    mut assembled: Assembled,
) -> Result<Familied, Failure> {
    let known = multiplicity(context, &assembled)?;
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
    Ok(Familied { assembled, family: Arc::new(family), family_digest: recalled.digest, known })
}

/// How many eigenfunctions of λ = 0 a mesh has that can have K eigenpairs: found out before anything is made of it.
pub fn multiplicity(context: &Context, assembled: &Assembled) -> Result<usize, Failure> {
    let problem = assembled.problem(context.pipeline.operators.boundary)?;
    let (n, asked) = (problem.pencil().n(), context.pipeline.train.k);
    if n < asked {
        return Err(SpectrumError::TooMany { asked, n }.into());
    }
    Ok(problem.nullspace().ncols())
}
