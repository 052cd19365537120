//! What training works on: the members of a family, and what is known on each when a block is trained.

use std::sync::Arc;

use super::deflation::Deflation;
use super::ops::graph::Graph;
use super::ops::rayleigh::MemberPencil;
use super::predict::NetworkInput;
use crate::operators::Sparse;
use crate::spectrum::Dense;

/// One mesh of a family as training sees it. The mass is scaled to unit area.
#[derive(Debug, Clone)]
pub struct Member {
    /// What the network reads.
    pub input: NetworkInput,
    /// L.
    pub stiffness: Sparse,
    /// B/area.
    pub mass: Sparse,
}

/// One member with the earlier eigenfunctions on it: a row of the training set for one block.
#[derive(Debug)]
pub struct Sample {
    pub(super) input: NetworkInput,
    pub(super) stiffness: Graph<f64>,
    pub(super) mass: Graph<f64>,
    pub(super) pencil: Arc<MemberPencil>,
}

impl Sample {
    /// Prepares `member` for the block after the functions `earlier`, n×k.
    pub fn new(member: &Member, earlier: &Dense) -> Self {
        Self {
            input: member.input.clone(),
            stiffness: Graph::new(&member.stiffness),
            mass: Graph::new(&member.mass),
            pencil: Arc::new(MemberPencil {
                stiffness: member.stiffness.clone(),
                mass: member.mass.clone(),
                deflation: Deflation::new(&member.mass, earlier.clone()),
            }),
        }
    }
}
