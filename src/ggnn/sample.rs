//! What training works on: the members of a family, and what is known on each when a block is trained.

use std::sync::Arc;

use dfdx::prelude::*;
use rayon::prelude::*;

use super::block::Block;
use super::deflation::Deflation;
use super::head::Grams;
use super::network::{Prepared, Trunk};
use super::ops::graph::Graph;
use super::ops::rayleigh::MemberPencil;
use super::ops::{Matrix, lent};
use super::predict::{NetworkInput, append_next};
use crate::operators::{Boundary, Operators, Sparse};
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

/// `train.boundary_penalty` unless another is asked for.
pub const BOUNDARY_PENALTY: f64 = 1000.0;

impl Member {
    /// What training sees of a mesh with these operators: the mass scaled to add up to 1, a surface of unit area
    /// (Proposition 1).
    ///
    /// Under [`Boundary::Dirichlet`] a function is worth 0 on the boundary whatever the network says there: its energy is
    /// that of the function with these zeros, so that no quotient is below that of finite elements. What the network
    /// says is held to 0 beside by `penalty` times the stiffness's own diagonal, which grows like one over the length of
    /// an edge, as Nitsche's term does.
    pub fn new(
        input: NetworkInput,
        operators: Operators,
        boundary: Boundary,
        penalty: f64,
    ) -> Self {
        let Self { input, stiffness, mass } = Self::whole(input, operators, boundary);
        match boundary {
            Boundary::Neumann => Self { input, stiffness, mass },
            Boundary::Dirichlet => {
                let mut fixed = vec![false; stiffness.rows()];
                input.fixed.iter().for_each(|&i| fixed[i as usize] = true);
                Self {
                    stiffness: inner(&stiffness, &fixed, penalty),
                    mass: inner(&mass, &fixed, 0.0),
                    input,
                }
            }
        }
    }
}

impl Member {
    /// The same for recipe `paper`, whose loss asks for Dirichlet conditions by (24): the operators stay whole. What the
    /// network predicts has zeros on the boundary all the same.
    pub fn whole(input: NetworkInput, operators: Operators, boundary: Boundary) -> Self {
        let total = operators.total_mass();
        let input = input.with_zeros_at(boundary.fixed(&operators.boundary));
        let Operators { stiffness, mass, .. } = operators;
        Self { input, stiffness, mass: mass.map(|b| b / total) }
    }
}

/// The matrix without the rows and columns of fixed vertices; what stands on their diagonal is multiplied by `kept`.
fn inner(matrix: &Sparse, fixed: &[bool], kept: f64) -> Sparse {
    let mut matrix = matrix.clone();
    for (i, mut row) in matrix.outer_iterator_mut().enumerate() {
        for (j, value) in row.iter_mut().filter(|&(j, _)| fixed[i] || fixed[j]) {
            *value *= if i == j { kept } else { 0.0 };
        }
    }
    matrix
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

    /// Prepares several members, each with the functions known on it.
    pub fn all(members: &[Member], earlier: &[Dense]) -> Vec<Self> {
        members.iter().zip(earlier).map(|(member, earlier)| Self::new(member, earlier)).collect()
    }

    /// The features of this member, and the tape that goes on from them; adds their Gram matrices to `sum`.
    pub(super) fn forward<T: Tape<f32, Cpu>>(
        &self,
        trunk: &Trunk<f32>,
        layers: &Prepared<f32>,
        tape: T,
        sum: &mut Grams,
    ) -> (Matrix<f32>, T) {
        let Self { input, stiffness, mass, pencil } = self;
        let x = input.tensor(&Cpu::default()).put_tape(tape);
        let (features, tape) = trunk.forward_with(layers, x, &input.graph).split_tape();
        sum.include(&lent(&features), stiffness, mass, &pencil.deflation);
        (features, tape)
    }
}

/// Appends to the functions that are known on every member what `blocks` predict there, one after the other.
pub fn append_predictions(members: &[Member], blocks: &[&Block], known: &mut [Dense]) {
    members.par_iter().zip(known).for_each(|(member, phi)| {
        for block in blocks {
            append_next(block, &member.input, &member.mass, phi);
        }
    });
}
