//! From a mesh to its operators, and to the eigenproblem they pose.

use std::sync::Arc;

use super::Failure;
use super::artifacts::OperatorsArtifact;
use super::context::{Context, Recalled};
use super::ingest::Loaded;
use super::work::Work;
use crate::mesh::TriMesh;
use crate::mesh::topology::component_labels;
use crate::operators::{Boundary, Operators};
use crate::spectrum::{Problem, SpectrumError};
use crate::store::Digest;

/// A mesh with its operators.
#[derive(Debug, Clone)]
pub struct Assembled {
    /// The mesh.
    pub loaded: Loaded,
    /// The operators of the mesh, in input units.
    pub operators: Arc<Operators>,
    /// Of the operators.
    pub operators_digest: Digest,
}

impl Assembled {
    /// The eigenproblem of the mesh.
    ///
    /// # Errors
    /// When the mesh cannot have this boundary condition.
    pub fn problem(&self, boundary: Boundary) -> Result<Problem<'_>, SpectrumError> {
        let labels = component_labels(&self.loaded.ingested.mesh);
        Problem::new(&self.operators, boundary, &labels)
    }
}

/// Assembles or recalls the operators of a mesh.
///
/// # Errors
/// When the mesh has no operators, or the run is interrupted.
pub fn assemble(context: &Context, item: usize, mut loaded: Loaded) -> Result<Assembled, Failure> {
    let own = operators_of(context, item, &loaded.ingested.mesh)?;
    loaded.spent("assemble", own.how, own.spent);
    Ok(Assembled { loaded, operators: Arc::new(own.artifact.into()), operators_digest: own.digest })
}

/// The operators of a mesh or of a variant of it.
///
/// # Errors
/// When it has none, or the run is interrupted.
pub fn operators_of(
    context: &Context,
    item: usize,
    mesh: &TriMesh,
) -> Result<Recalled<OperatorsArtifact>, Failure> {
    let options = context.pipeline.operators;
    let work = Work::<OperatorsArtifact>::of_stage()
        .param("mass", options.mass_kind()?.name())
        .param("robust", options.robust.name())
        .input("mesh", &Digest::from_bytes(*mesh.hash().as_bytes()))
        .seeded(0, "f64");
    context.recall(item, work, || Ok((&Operators::assemble(mesh, options)?).into()))
}
