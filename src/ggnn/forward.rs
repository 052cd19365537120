//! What do a trunk and its heads say on a mesh? Forward passes alone: no tape, rows dealt to all threads.
//!
//! Rows go in chunks that stay in a core's cache. Without neighbours a chunk passes through encoder, layers and heads in one
//! go, so that its features are never in memory; with them, layer by layer. Every row is computed alike wherever its chunk
//! begins and whoever computes it: the bits do not depend on the number of threads.

use faer::Accum;
use rayon::prelude::*;

use super::block::Block;
use super::network::{Layer, TrunkShape};
use super::ops::graph::Graph;
use super::ops::product::{Layout, Panels};
use super::ops::real::{gemm, view};
use super::predict::NetworkInput;

/// Rows of a chunk.
const ROWS: usize = 96;

/// A trunk and m heads on it, packed for many rows.
#[derive(Debug, Clone)]
pub struct Forward {
    shape: TrunkShape,
    /// w_inᵀ, d×h.
    encoder: Panels<f32>,
    /// b_in, h.
    phases: Vec<f32>,
    layers: Vec<Weights>,
    /// Features to functions, row-major h×m.
    heads: Vec<f64>,
    /// b_out, m.
    biases: Vec<f64>,
}

/// What a layer multiplies with.
#[derive(Debug, Clone)]
enum Weights {
    /// (I − w₁ᵀ)^I: all iterations in one product.
    Alone(Panels<f32>),
    /// I − w₁ᵀ − 2w₂ᵀ and 2w₂ᵀ of (29).
    WithNeighbours { own: Panels<f32>, near: Panels<f32> },
}

/// The features of a chunk, and room for the next ones.
#[derive(Default)]
struct Scratch {
    state: Vec<f32>,
    next: Vec<f32>,
    wide: Vec<f64>,
}

impl Forward {
    /// Packs the heads `blocks` on the trunk of the first; `None` for layers that have a pass with a tape alone.
    pub fn of(blocks: &[&Block]) -> Option<Self> {
        let first = blocks.first()?;
        let (shape, weights) = (first.shape, &first.weights);
        let TrunkShape { inputs, width: h, iterations, .. } = shape;
        let per_layer = match shape.layer {
            Layer::Pointwise => 1,
            Layer::Sggc => 2,
            Layer::Gcn | Layer::Gat => return None,
        };
        let layers = weights[2..].chunks_exact(per_layer).map(|w| match w {
            [w1, w2] => with_neighbours(w1, w2, h),
            _ => alone(&w[0], h, iterations),
        });
        let bias = |block: &&Block| block.head.get(h).copied().unwrap_or(0.0);
        Some(Self {
            shape,
            encoder: Panels::of(Layout::Columns(&weights[0], inputs), inputs, h),
            phases: weights[1].clone(),
            layers: layers.collect(),
            heads: (0..h).flat_map(|j| blocks.iter().map(move |block| block.head[j])).collect(),
            biases: blocks.iter().map(bias).collect(),
        })
    }

    /// F w_outᵀ + b_out of every vertex for every head, row-major n×m.
    pub fn run(&self, input: &NetworkInput) -> Vec<f64> {
        let mut outputs = vec![0.0; input.n() * self.biases.len()];
        match self.shape.layer {
            Layer::Pointwise => self.chunk_by_chunk(input, &mut outputs),
            _ => self.layer_by_layer(input, &mut outputs),
        }
        outputs
    }

    fn chunk_by_chunk(&self, input: &NetworkInput, outputs: &mut [f64]) {
        let chunks = outputs.par_chunks_mut(ROWS * self.biases.len()).enumerate();
        chunks.for_each_init(Scratch::default, |scratch, (chunk, outputs)| {
            let (h, rows) = (self.shape.width, outputs.len() / self.biases.len());
            let Scratch { state, next, wide } = scratch;
            state.resize(rows * h, 0.0);
            next.resize(rows * h, 0.0);
            self.encode(input, chunk * ROWS, state);
            for layer in &self.layers {
                let Weights::Alone(matrix) = layer else { continue };
                matrix.multiply(next, h, Layout::Rows(state, h), rows, Accum::Replace);
                self.shape.activation.in_place(next);
                std::mem::swap(state, next);
            }
            self.decode(state, wide, outputs);
        });
    }

    fn layer_by_layer(&self, input: &NetworkInput, outputs: &mut [f64]) {
        let h = self.shape.width;
        let mut state = vec![0.0; input.n() * h];
        let chunks = state.par_chunks_mut(ROWS * h).enumerate();
        chunks.for_each(|(chunk, state)| self.encode(input, chunk * ROWS, state));
        let mut next = vec![0.0; state.len()];
        for layer in &self.layers {
            let Weights::WithNeighbours { own, near } = layer else { continue };
            for iteration in 1..=self.shape.iterations {
                let chunks = next.par_chunks_mut(ROWS * h).enumerate();
                chunks.for_each_init(Vec::new, |gathered, (chunk, next)| {
                    mix(&input.graph, &state, [own, near], chunk * ROWS, gathered, next);
                    if iteration == self.shape.iterations {
                        self.shape.activation.in_place(next);
                    }
                });
                std::mem::swap(&mut state, &mut next);
            }
        }
        let chunks = outputs.par_chunks_mut(ROWS * self.biases.len());
        chunks
            .zip(state.par_chunks(ROWS * h))
            .for_each_init(Vec::new, |wide, (outputs, state)| self.decode(state, wide, outputs));
    }

    /// (28) for the rows from `first` on.
    fn encode(&self, input: &NetworkInput, first: usize, state: &mut [f32]) {
        let TrunkShape { inputs, width: h, activation, .. } = self.shape;
        state.chunks_exact_mut(h).for_each(|row| row.copy_from_slice(&self.phases));
        let features = Layout::Rows(&input.features[first * inputs..], inputs);
        self.encoder.multiply(state, h, features, state.len() / h, Accum::Add);
        activation.in_place(state);
    }

    /// The heads on a chunk, in double precision: their weights are large and cancel.
    fn decode(&self, state: &[f32], wide: &mut Vec<f64>, outputs: &mut [f64]) {
        let (h, m) = (self.shape.width, self.biases.len());
        wide.clear();
        wide.extend(state.iter().map(|&f| f64::from(f)));
        outputs.chunks_exact_mut(m).for_each(|row| row.copy_from_slice(&self.biases));
        gemm(outputs, view(wide, state.len() / h, h), view(&self.heads, h, m), Accum::Add);
    }
}

/// One iteration of (29) for the rows from `first` on: x A + (W x) C.
fn mix(
    graph: &Graph<f32>,
    state: &[f32],
    [own, near]: [&Panels<f32>; 2],
    first: usize,
    gathered: &mut Vec<f32>,
    next: &mut [f32],
) {
    let n = graph.n();
    let h = state.len() / n;
    let rows = next.len() / h;
    gathered.clear();
    graph.for_rows(
        first..first + rows,
        state,
        h,
        #[inline(always)]
        |_, row| gathered.extend_from_slice(row),
    );
    own.multiply(next, h, Layout::Rows(&state[first * h..], h), rows, Accum::Replace);
    near.multiply(next, h, Layout::Rows(gathered, h), rows, Accum::Add);
}

fn alone(w1: &[f32], h: usize, iterations: usize) -> Weights {
    let identity = |i: usize| f64::from(i.is_multiple_of(h + 1));
    let step: Vec<f64> = w1.iter().enumerate().map(|(i, &w)| identity(i) - f64::from(w)).collect();
    let mut power: Vec<f64> = (0..h * h).map(identity).collect();
    for _ in 0..iterations {
        let last = power.clone();
        gemm(&mut power, view(&last, h, h), view(&step, h, h), Accum::Replace);
    }
    let power: Vec<f32> = power.into_iter().map(|v| v as f32).collect();
    Weights::Alone(Panels::of(Layout::Columns(&power, h), h, h))
}

fn with_neighbours(w1: &[f32], w2: &[f32], h: usize) -> Weights {
    let mut own: Vec<f32> = w1.iter().zip(w2).map(|(&a, &b)| -a - (b + b)).collect();
    own.iter_mut().step_by(h + 1).for_each(|diagonal| *diagonal += 1.0);
    let near: Vec<f32> = w2.iter().map(|&b| b + b).collect();
    let packed = |matrix: &[f32]| Panels::of(Layout::Columns(matrix, h), h, h);
    Weights::WithNeighbours { own: packed(&own), near: packed(&near) }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use dfdx::prelude::*;

    use super::super::block::TrainingRecord;
    use super::super::network::{Interval, Ranges, Trunk};
    use super::super::ops::activation::Activation;
    use super::super::ops::entries;
    use super::*;
    use crate::mesh::sample::icosphere;
    use crate::operators::{Pattern, adjacency::adjacency};

    const RANGES: Ranges = Ranges { encoder: 2.0, hidden: 0.1, interval: Interval::Symmetric };

    fn input() -> NetworkInput {
        let mesh = icosphere(3);
        let positions: Vec<f64> = mesh.vertices().iter().flatten().copied().collect();
        NetworkInput::new(&positions, &adjacency(&Pattern::of_mesh(&mesh)))
    }

    fn heads(shape: TrunkShape) -> Vec<Block> {
        let weights = Arc::new(Trunk::init(shape, RANGES, 5).weights());
        let record = TrainingRecord::default();
        let head = |seed: usize| (0..=shape.width).map(|j| ((j * seed) as f64).sin()).collect();
        let block = |seed| Block {
            shape,
            weights: weights.clone(),
            head: head(seed),
            record: record.clone(),
        };
        (1..4).map(block).collect()
    }

    fn shapes() -> impl Iterator<Item = TrunkShape> {
        let all = [Layer::Sggc, Layer::Pointwise].into_iter().flat_map(|layer| {
            (1..=3).flat_map(move |iterations| {
                Activation::ALL.map(|activation| (layer, iterations, activation))
            })
        });
        all.map(|(layer, iterations, activation)| TrunkShape {
            inputs: 3,
            width: 33,
            layers: 2,
            iterations,
            layer,
            activation,
        })
    }

    #[test]
    fn outputs_are_those_of_the_pass_with_a_tape() {
        let input = input();
        for shape in shapes() {
            let blocks = heads(shape);
            let found = Forward::of(&blocks.iter().collect::<Vec<_>>()).unwrap().run(&input);
            let x = input.tensor(&Cpu::default());
            let features = entries(&blocks[0].trunk().forward(x, &input.graph));
            for (k, block) in blocks.iter().enumerate() {
                let expected = block.decode(&features);
                for (found, expected) in found.iter().skip(k).step_by(3).zip(expected) {
                    assert!((found - expected).abs() < 1e-4, "{shape:?}: {found} {expected}");
                }
            }
        }
    }

    #[test]
    fn the_bits_do_not_depend_on_the_number_of_threads() {
        let input = input();
        for shape in shapes() {
            let blocks = heads(shape);
            let passes = Forward::of(&blocks.iter().collect::<Vec<_>>()).unwrap();
            let on = |threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                pool.install(|| passes.run(&input))
            };
            assert_eq!(on(1), on(3));
        }
    }

    #[test]
    fn layers_that_are_there_for_comparison_have_no_pass_of_their_own() {
        for layer in [Layer::Gcn, Layer::Gat] {
            let shape = TrunkShape { layer, ..shapes().next().unwrap() };
            assert!(Forward::of(&[&heads(shape)[0]]).is_none());
        }
    }
}
