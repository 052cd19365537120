//! Prediction: forward passes on a mesh that training may never have seen.
//!
//! Needs coordinates, adjacency and an inner product on the mesh, which vertex areas give; no stiffness.

use std::sync::Arc;

use dfdx::prelude::*;
use rayon::prelude::*;

use super::block::Block;
use super::deflation::Deflation;
use super::ops::entries;
use super::ops::graph::Graph;
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
    /// The vertices where the function is 0 whatever the network says: the boundary under Dirichlet conditions.
    pub fixed: Vec<u32>,
}

impl NetworkInput {
    /// Features (row-major n×d, double precision) and adjacency of a mesh.
    pub fn new(features: &[f64], adjacency: &Sparse) -> Self {
        Self {
            features: features.iter().map(|&x| x as f32).collect(),
            graph: Arc::new(Graph::new(adjacency)),
            inputs: features.len() / adjacency.rows().max(1),
            fixed: Vec::new(),
        }
    }

    /// The same, with functions that are 0 at the vertices `fixed`.
    pub fn with_zeros_at(self, fixed: &[u32]) -> Self {
        Self { fixed: fixed.to_vec(), ..self }
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
/// product of `mass`, scaled to unit B-norm, its sign fixed; 0 where the input says so, as the earlier ones are.
pub fn predict_next(
    block: &Block,
    input: &NetworkInput,
    mass: &impl InnerProduct,
    earlier: &Dense,
) -> Vec<f64> {
    let outputs = forward(&[block], input).remove(0);
    settled(outputs, &input.fixed, mass, earlier)
}

/// All eigenfunctions on a mesh: the `known` ones (constants, n×c), then one for every block. n×(c + blocks).
///
/// The forward passes do not depend on one another and run in parallel; deflation follows in the order of the blocks.
pub fn predict_all(
    known: &Dense,
    blocks: &[&Block],
    input: &NetworkInput,
    mass: &impl InnerProduct,
) -> Dense {
    let c = known.ncols();
    let mut phi = Dense::zeros(known.nrows(), c + blocks.len());
    phi.subcols_mut(0, c).copy_from(known);
    let mut k = c;
    // Heads of one trunk share its forward pass.
    let trunks: Vec<&[&Block]> = blocks.chunk_by(|a, b| a.shares_trunk(b)).collect();
    for together in trunks.chunks(at_once(blocks, input.n())) {
        let outputs: Vec<Vec<Vec<f64>>> =
            together.par_iter().map(|heads| forward(heads, input)).collect();
        for u in outputs.into_iter().flatten() {
            let u = settled(u, &input.fixed, mass, &phi.subcols(0, k).to_owned());
            column_mut(&mut phi, k).copy_from_slice(&u);
            k += 1;
        }
    }
    phi
}

/// What a forward pass and the heads of a trunk make of a mesh, n each.
fn forward(blocks: &[&Block], input: &NetworkInput) -> Vec<Vec<f64>> {
    let Some(first) = blocks.first() else { return vec![] };
    let features = first.trunk().forward(input.tensor(&Cpu::default()), &input.graph);
    let features = entries(&features);
    blocks.iter().map(|block| block.decode(&features)).collect()
}

/// P u with zeros at the vertices `fixed`, scaled to unit B-norm, its sign fixed.
///
/// Since u and all earlier functions vanish there, B need not know of these vertices: only its inner block counts.
fn settled(mut u: Vec<f64>, fixed: &[u32], mass: &impl InnerProduct, earlier: &Dense) -> Vec<f64> {
    fixed.iter().for_each(|&i| u[i as usize] = 0.0);
    Deflation::new(mass, earlier.clone()).apply(&mut u);
    normalise(&mut u, mass);
    orient(&mut u);
    u
}

/// What forward passes may hold at once, bytes: on a machine of many threads a large mesh would fill its memory.
const MEMORY: usize = 4 << 30;

/// A forward pass holds so many n×h matrices at its widest: state, [x | Wx], sine, cosine, output.
const MATRICES: usize = 6;

/// How many forward passes run at a time. The bits do not depend on it.
fn at_once(blocks: &[&Block], n: usize) -> usize {
    let widest = blocks.iter().map(|block| block.shape.width).max().unwrap_or(1);
    let one = n.saturating_mul(widest).saturating_mul(MATRICES * size_of::<f32>());
    (MEMORY / one.max(1)).clamp(1, blocks.len().max(1))
}
