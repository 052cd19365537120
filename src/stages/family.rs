//! What training may see of a mesh: its family with operators, and nothing of any reference.

use std::time::Instant;

use super::Failure;
use super::assemble::operators_of;
use super::context::Context;
use super::remesh::Familied;
use super::train::InTraining;
use crate::flow::events::How;
use crate::ggnn::features::Features;
use crate::ggnn::predict::NetworkInput;
use crate::ggnn::sample::Member;
use crate::mesh::TriMesh;
use crate::mesh::topology::component_labels;
use crate::operators::Operators;
use crate::spectrum::Dense;
use crate::spectrum::nullspace::nullspace;
use crate::store::Digest;

/// All that training may see: the family, nothing of any reference.
#[derive(Debug)]
pub struct TrainingSet {
    /// The members, scaled to unit area.
    pub members: Vec<Member>,
    /// What the network reads of them, and of every other mesh of the shape.
    pub features: Features,
    /// The eigenfunctions of λ = 0 on every member.
    pub nullspaces: Vec<Dense>,
    /// Of the family's meshes.
    pub family_digest: Digest,
    /// Of the operators of each member.
    pub operators_digests: Vec<Digest>,
}

/// Assembles or recalls the operators of a family.
///
/// # Errors
/// When a member has no operators, or the run is interrupted.
pub fn prepare(context: &Context, item: usize, familied: Familied) -> Result<InTraining, Failure> {
    let started = Instant::now();
    let Familied { mut assembled, family, family_digest } = familied;
    let mut operators_digests = Vec::new();
    let (mut members, mut nullspaces) = (Vec::new(), Vec::new());
    let features = Features::of(&assembled.loaded.ingested.mesh, context.pipeline.features);
    let mut how = How::Reused;
    for mesh in &family.members {
        let recalled = operators_of(context, item, mesh)?;
        if recalled.how == How::Computed {
            how = How::Computed;
        }
        operators_digests.push(recalled.digest);
        let member = member(&features, mesh, recalled.artifact.into());
        nullspaces.push(nullspace(&component_labels(mesh), &member.mass));
        members.push(member);
    }
    assembled.loaded.spent("assemble family", how, started.elapsed());
    Ok(InTraining::new(
        assembled,
        TrainingSet { members, features, nullspaces, family_digest, operators_digests },
    ))
}

/// A member as training sees it: the mass scaled to add up to 1, a surface of unit area (Proposition 1).
fn member(features: &Features, mesh: &TriMesh, operators: Operators) -> Member {
    let total = operators.total_mass();
    Member {
        input: network_input(features, mesh, &operators),
        stiffness: operators.stiffness,
        mass: operators.mass.map(|b| b / total),
    }
}

/// What the network reads of a mesh.
pub fn network_input(features: &Features, mesh: &TriMesh, operators: &Operators) -> NetworkInput {
    NetworkInput::new(&features.read(mesh), &operators.adjacency)
}
