//! Prediction: forward passes on a mesh that training may never have seen.
//!
//! Needs coordinates, adjacency and an inner product on the mesh, which vertex areas give; no stiffness.

use std::sync::Arc;

use dfdx::prelude::*;
use rayon::prelude::*;

use super::block::Block;
use super::deflation::Deflation;
use super::forward::Forward;
use super::ops::entries;
use super::ops::graph::Graph;
use super::orthonormal::orthonormalise;
use crate::mesh::TriMesh;
use crate::operators::{Pattern, Sparse};
use crate::spectrum::Dense;
use crate::spectrum::eigenpairs::{normalise, orient};
use crate::spectrum::pencil::{InnerProduct, column_mut, columns_mut};

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
        Self::of_graph(features, Graph::new(adjacency))
    }

    /// What `blocks` read of a mesh with these features: no adjacency, where they have no layer with neighbours.
    pub fn read_by(blocks: &[&Block], features: &[f64], mesh: &TriMesh) -> Self {
        let neighbours = blocks.iter().any(|block| block.shape.layer.has_neighbours());
        let graph = if neighbours {
            Graph::of_edges(&Pattern::of_mesh(mesh))
        } else {
            Graph::empty(mesh.n())
        };
        Self::of_graph(features, graph)
    }

    fn of_graph(features: &[f64], graph: Graph<f32>) -> Self {
        Self {
            features: features.iter().map(|&x| x as f32).collect(),
            inputs: features.len() / graph.n().max(1),
            graph: Arc::new(graph),
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
    let mut outputs = forward(&[block], input);
    input.fixed.iter().for_each(|&i| outputs[i as usize] = 0.0);
    settle(&mut outputs, mass, earlier);
    outputs
}

/// The same, as a further column of `phi`, the earlier ones.
pub fn append_next(block: &Block, input: &NetworkInput, mass: &impl InnerProduct, phi: &mut Dense) {
    let (next, columns) = (predict_next(block, input, mass, phi), phi.ncols());
    let entry = |i, j| if j < columns { phi[(i, j)] } else { next[i] };
    *phi = Dense::from_fn(phi.nrows(), columns + 1, entry);
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
        let outputs: Vec<Vec<f64>> =
            together.par_iter().map(|heads| forward(heads, input)).collect();
        for (heads, outputs) in together.iter().zip(outputs) {
            write_columns(&outputs, heads.len(), columns_mut(&mut phi).skip(k));
            k += heads.len();
        }
    }
    for column in columns_mut(&mut phi).skip(c) {
        input.fixed.iter().for_each(|&i| column[i as usize] = 0.0);
    }
    settle_all(&mut phi, c, mass);
    phi
}

/// What a forward pass and m heads of a trunk make of a mesh, row-major n×m.
fn forward(blocks: &[&Block], input: &NetworkInput) -> Vec<f64> {
    if let Some(passes) = Forward::of(blocks) {
        return passes.run(input);
    }
    let Some(first) = blocks.first() else { return vec![] };
    let features = entries(&first.trunk().forward(input.tensor(&Cpu::default()), &input.graph));
    let functions: Vec<Vec<f64>> = blocks.iter().map(|block| block.decode(&features)).collect();
    (0..input.n()).flat_map(|i| functions.iter().map(move |u| u[i])).collect()
}

/// Rows that are written at a time, so that they are read from memory once.
const ROWS: usize = 512;

/// Writes row-major functions, n×m, to `columns`.
fn write_columns<'a>(functions: &[f64], m: usize, columns: impl Iterator<Item = &'a mut [f64]>) {
    let mut columns: Vec<&mut [f64]> = columns.take(m).collect();
    for (chunk, rows) in functions.chunks(ROWS * m.max(1)).enumerate() {
        for (j, column) in columns.iter_mut().enumerate() {
            let values = rows.iter().skip(j).step_by(m);
            column[chunk * ROWS..].iter_mut().zip(values).for_each(|(to, &from)| *to = from);
        }
    }
}

/// Deflates every function from the one numbered `first` on against all before it, scales it to unit B-norm, fixes its
/// sign.
///
/// Since all functions vanish at fixed vertices, B need not know of these: only its inner block counts.
fn settle_all(phi: &mut Dense, first: usize, mass: &impl InnerProduct) {
    if orthonormalise(phi, first, mass).is_some() {
        let columns: Vec<&mut [f64]> = columns_mut(phi).skip(first).collect();
        columns.into_par_iter().for_each(orient);
        return;
    }
    for k in first..phi.ncols() {
        let earlier = phi.subcols(0, k).to_owned();
        settle(column_mut(phi, k), mass, &earlier);
    }
}

/// u ← P u, scaled to unit B-norm, its sign fixed.
fn settle(u: &mut [f64], mass: &impl InnerProduct, earlier: &Dense) {
    Deflation::new(mass, earlier.clone()).apply(u);
    normalise(u, mass);
    orient(u);
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
