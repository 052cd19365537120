//! From meshes to operators: those of the mesh itself, and those of every member of its family.

use std::sync::Arc;
use std::time::Instant;

use super::Failure;
use super::artifacts::OperatorsArtifact;
use super::context::{Context, Recalled, Work};
use super::ingest::Loaded;
use super::remesh::Familied;
use crate::ggnn::features::coordinates;
use crate::ggnn::predict::NetworkInput;
use crate::ggnn::sample::Member;
use crate::mesh::TriMesh;
use crate::operators::Operators;
use crate::spectrum::Dense;
use crate::spectrum::nullspace::nullspace;
use crate::store::Digest;

/// A mesh with its operators, and its family ready for training.
#[derive(Debug, Clone)]
pub struct Assembled {
    /// The mesh.
    pub loaded: Loaded,
    /// The operators of the mesh, in input units.
    pub operators: Arc<Operators>,
    /// Of the operators.
    pub operators_digest: Digest,
    /// What training may see.
    pub training: Arc<TrainingSet>,
}

/// All that training may see: the family, nothing of any reference.
#[derive(Debug)]
pub struct TrainingSet {
    /// The members, scaled to unit area.
    pub members: Vec<Member>,
    /// The eigenfunctions of λ = 0 on every member.
    pub nullspaces: Vec<Dense>,
    /// Of the family's meshes.
    pub family_digest: Digest,
    /// Of the operators of each member.
    pub operators_digests: Vec<Digest>,
}

/// Assembles or recalls the operators of a mesh and of its family.
///
/// # Errors
/// When a mesh has no operators, or the run is interrupted.
pub fn assemble(context: &Context, item: usize, familied: Familied) -> Result<Assembled, Failure> {
    let started = Instant::now();
    let Familied { mut loaded, family, family_digest } = familied;
    let own = operators_of(context, item, &loaded.ingested.mesh)?;
    let mut digests = Vec::new();
    let (mut members, mut nullspaces) = (Vec::new(), Vec::new());
    for mesh in &family.members {
        let recalled = operators_of(context, item, mesh)?;
        digests.push(recalled.digest);
        let member = member(context, mesh, recalled.artifact.into());
        nullspaces.push(nullspace(&crate::mesh::topology::component_labels(mesh), &member.mass));
        members.push(member);
    }
    loaded.spent("assemble", own.how, started.elapsed());
    Ok(Assembled {
        loaded,
        operators: Arc::new(own.artifact.into()),
        operators_digest: own.digest,
        training: Arc::new(TrainingSet {
            members,
            nullspaces,
            family_digest,
            operators_digests: digests,
        }),
    })
}

fn operators_of(
    context: &Context,
    item: usize,
    mesh: &TriMesh,
) -> Result<Recalled<OperatorsArtifact>, Failure> {
    let options = context.pipeline.operators;
    let work = Work::<OperatorsArtifact>::of_stage()
        .param("mass", options.mass_kind()?.name())
        .param("robust", options.robust.to_string())
        .input("mesh", &Digest::from_bytes(*mesh.hash().as_bytes()))
        .seeded(0, "f64");
    context.recall(item, work, || Ok((&Operators::assemble(mesh, options)?).into()))
}

/// A member as training sees it: the mass scaled to add up to 1, a surface of unit area (Proposition 1).
fn member(context: &Context, mesh: &TriMesh, operators: Operators) -> Member {
    let total = operators.total_mass();
    Member {
        input: network_input(context, mesh, &operators),
        stiffness: operators.stiffness,
        mass: operators.mass.map(|b| b / total),
    }
}

/// What the network reads of a mesh.
pub fn network_input(context: &Context, mesh: &TriMesh, operators: &Operators) -> NetworkInput {
    let features = coordinates(mesh, context.pipeline.features.normalise);
    NetworkInput::new(&features, &operators.adjacency)
}
