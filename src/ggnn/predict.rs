//! Prediction: forward passes on a mesh that training may never have seen.
//!
//! Needs coordinates, adjacency and vertex areas of the mesh; no stiffness.

use std::sync::Arc;

use dfdx::prelude::*;

use super::block::Block;
use super::deflation::Deflation;
use super::ops::graph::Graph;
use super::ops::rayleigh::deflated_prediction;
use crate::operators::Sparse;
use crate::spectrum::Dense;
use crate::spectrum::eigenpairs::{normalise, orient};
use crate::spectrum::pencil::{InnerProduct, column_mut};

/// What the network reads of one mesh.
#[derive(Debug, Clone)]
pub struct NetworkInput {
    /// Input features, row-major n×d.
    pub features: Vec<f32>,
    /// The adjacency W.
    pub graph: Arc<Graph<f32>>,
    /// d.
    pub inputs: usize,
}

impl NetworkInput {
    /// Features (row-major n×d, double precision) and adjacency of a mesh.
    pub fn new(features: &[f64], adjacency: &Sparse) -> Self {
        Self {
            features: features.iter().map(|&x| x as f32).collect(),
            graph: Arc::new(Graph::new(adjacency)),
            inputs: features.len() / adjacency.rows().max(1),
        }
    }

    /// The number of vertices.
    pub fn n(&self) -> usize {
        self.graph.n()
    }

    /// The features as a tensor.
    pub fn tensor(&self, device: &Cpu) -> super::ops::Matrix<f32> {
        device.tensor_from_vec(self.features.clone(), (self.n(), self.inputs))
    }
}

/// One more eigenfunction, from a block and the `earlier` ones on the same mesh (n×k): deflated in the inner
/// product of `mass`, scaled to unit B-norm, its sign fixed.
pub fn predict_next(
    block: &Block,
    input: &NetworkInput,
    mass: &impl InnerProduct,
    earlier: &Dense,
) -> Vec<f64> {
    let features = block.trunk().forward(input.tensor(&Cpu::default()), &input.graph).as_vec();
    let deflation = Deflation::new(mass, earlier.clone());
    let mut u = deflated_prediction(&features, &block.head, &deflation);
    normalise(&mut u, mass);
    orient(&mut u);
    u
}

/// All eigenfunctions on a mesh: the `known` ones (constants, n×c), then one for every block. n×(c + blocks).
pub fn predict_all<'b>(
    known: &Dense,
    blocks: impl ExactSizeIterator<Item = &'b Block>,
    input: &NetworkInput,
    mass: &impl InnerProduct,
) -> Dense {
    let c = known.ncols();
    let mut phi = Dense::zeros(known.nrows(), c + blocks.len());
    phi.subcols_mut(0, c).copy_from(known);
    for (i, block) in blocks.enumerate() {
        let u = predict_next(block, input, mass, &phi.subcols(0, c + i).to_owned());
        column_mut(&mut phi, c + i).copy_from_slice(&u);
    }
    phi
}
