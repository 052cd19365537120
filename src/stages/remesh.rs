//! From a mesh to the family that its blocks are trained on.

use std::sync::Arc;

use super::Failure;
use super::artifacts::FamilyArtifact;
use super::assemble::Assembled;
use super::context::Context;
use super::ingest::Loaded;
use super::work::{Work, canonical};
use crate::flow::Panicked;
use crate::mesh::{Ingested, Topology, TriMesh};
use crate::remesh::{Family, FamilyError, FamilyRecipe};
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
    /// What its members are samplings of.
    pub surface: Arc<Surface>,
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
    recipe.suits(&loaded.ingested.topology)?;
    let surface = Arc::new(Surface::of(recipe, loaded)?);
    let work = Work::<FamilyArtifact>::of_stage()
        .param("recipe", canonical(recipe))
        .input("mesh", &surface.digest)
        .seeded(recipe.seed, "f32");
    let recalled = context.recall(item, work, || {
        Ok(FamilyArtifact::from(&Family::of(&loaded.ingested.mesh, recipe)?))
    })?;
    loaded.spent("remesh", recalled.how, recalled.spent);
    let family = Family::try_from(recalled.artifact).map_err(|invalid| Panicked {
        message: format!("a cached family holds an invalid mesh ({invalid})"),
    })?;
    Ok(Familied {
        assembled,
        family: Arc::new(family),
        family_digest: recalled.digest,
        surface,
        known,
    })
}

/// The surface that the members of a family are samplings of.
#[derive(Debug)]
pub struct Surface {
    /// What models of it are called after: the name of the mesh, or that of a surface with a formula.
    pub name: String,
    /// Of its mesh.
    pub digest: Digest,
    own: Own,
}

/// A mesh of a surface, with its topology.
#[derive(Debug)]
enum Own {
    Given(Arc<Ingested>),
    Sampled(TriMesh, Topology),
}

/// The sampling that stands for a surface with a formula: its frame is read from it, and its finer samplings lie on it.
const STANDS_FOR: (usize, u64) = (2000, u64::MAX);

impl Surface {
    fn of(recipe: &FamilyRecipe, loaded: &Loaded) -> Result<Self, FamilyError> {
        let Some(shape) = recipe.of.shape() else {
            let (name, own) = (loaded.job.name.clone(), Own::Given(loaded.ingested.clone()));
            return Ok(Self { name, digest: loaded.digest(), own });
        };
        let (vertices, member) = STANDS_FOR;
        let mesh = shape.sample(vertices, 0, member)?;
        let (digest, topology) = (mesh.hash(), Topology::of(&mesh));
        let digest = Digest::from_bytes(*digest.as_bytes());
        Ok(Self { name: shape.name().into(), digest, own: Own::Sampled(mesh, topology) })
    }

    /// A mesh of it.
    pub fn mesh(&self) -> &TriMesh {
        match &self.own {
            Own::Given(ingested) => &ingested.mesh,
            Own::Sampled(mesh, _) => mesh,
        }
    }

    /// What kind of surface it is.
    pub fn topology(&self) -> &Topology {
        match &self.own {
            Own::Given(ingested) => &ingested.topology,
            Own::Sampled(_, topology) => topology,
        }
    }
}

/// How many eigenfunctions of λ = 0 a mesh has that can have K eigenpairs: found out before anything is made of it.
pub fn multiplicity(context: &Context, assembled: &Assembled) -> Result<usize, Failure> {
    let problem = assembled.problem(context.pipeline.operators.boundary)?;
    let (n, asked) = (problem.pencil().n(), assembled.loaded.k);
    if n < asked {
        return Err(SpectrumError::TooMany { asked, n }.into());
    }
    Ok(problem.nullspace().ncols())
}
