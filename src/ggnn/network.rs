//! The GGNN of (27) without its decoder: encoder and H hidden layers, SGGC (29) unless another is chosen. The decoder
//! is the head, see [`super::head`].

use std::sync::Arc;

use dfdx::prelude::*;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::ops::activation::Activation;
use super::ops::encoder::encode;
use super::ops::gat::gat;
use super::ops::gcn::gcn;
use super::ops::graph::Graph;
use super::ops::real::Real;
use super::ops::sggc::{Mixing, sggc};
use super::ops::{Matrix, entries};

/// The sizes of a trunk and the functions that it is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct TrunkShape {
    /// d: input features per vertex.
    pub inputs: usize,
    /// h_f: hidden features per vertex.
    pub width: usize,
    /// H: hidden layers.
    pub layers: usize,
    /// I: iterations of (29) in every layer, with or without neighbours; 1 for other layers.
    pub iterations: usize,
    /// What a hidden layer is.
    pub layer: Layer,
    /// σ of the encoder and of every hidden layer.
    pub activation: Activation,
}

/// What a hidden layer is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Layer {
    /// The smoothing generalised graph convolution (29).
    #[default]
    Sggc,
    /// To compare it with: the graph convolution of Kipf and Welling (2017).
    Gcn,
    /// To compare it with: the graph attention of Veličković et al. (2018), with one head.
    Gat,
    /// (29) without its neighbours, which predicts better on other samplings and takes half the time.
    Pointwise,
}

impl Layer {
    /// In the order of their codes in a stored block.
    pub const ALL: [Self; 4] = [Self::Sggc, Self::Gcn, Self::Gat, Self::Pointwise];

    /// Whether a vertex reads what its neighbours hold.
    pub fn has_neighbours(self) -> bool {
        self != Self::Pointwise
    }

    /// Rows and columns of its weights for h features: w₁ and w₂ of (29); w of GCN; w and a of GAT; w₁ alone.
    fn weight_sizes(self, h: usize) -> Vec<(usize, usize)> {
        match self {
            Self::Sggc => vec![(h, h), (h, h)],
            Self::Gcn | Self::Pointwise => vec![(h, h)],
            Self::Gat => vec![(h, h), (2, h)],
        }
    }
}

/// How a trunk starts.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Ranges {
    /// γ₁: the band of frequencies that the encoder offers.
    pub encoder: f64,
    /// γ₂: how far the hidden layers start from σ alone.
    pub hidden: f64,
    /// Where the weights lie within ±γ.
    pub interval: Interval,
}

/// Where initial weights lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Interval {
    /// Encoder U[−γ₁, γ₁], its phases U[−π, π], hidden weights U[−γ₂, γ₂].
    #[default]
    Symmetric,
    /// The paper's: all of the encoder, Θ_in = {w_in, b_in}, U[0, γ₁], hidden weights U[0, γ₂].
    Positive,
}

impl Interval {
    /// A number in [−1, 1) or [0, 1).
    fn draw(self, rng: &mut impl Rng) -> f64 {
        match self {
            Self::Symmetric => rng.random_range(-1.0..1.0),
            Self::Positive => rng.random_range(0.0..1.0),
        }
    }

    /// How far phases reach.
    fn phases(self, encoder: f64) -> f64 {
        match self {
            Self::Symmetric => std::f64::consts::PI,
            Self::Positive => encoder,
        }
    }
}

/// The trainable weights Θ_in, Θ_1, …, Θ_H.
#[derive(Debug, Clone)]
pub struct Trunk<E: Real> {
    shape: TrunkShape,
    /// w_in (h×d), b_in (1×h), then the weights of every layer.
    parameters: Vec<Matrix<E>>,
}

/// The weights of the hidden layers in the form their products want.
#[derive(Debug, Clone)]
pub enum Prepared<E: Real> {
    /// w₁ of (29) and, where vertices read their neighbours, w₂.
    Sggc(Arc<[Mixing<E>]>),
    /// w.
    Gcn(Vec<Matrix<E>>),
    /// w and a.
    Gat(Vec<[Matrix<E>; 2]>),
}

impl<E: Real> Trunk<E> {
    /// Draws weights from `ranges`; the same seed gives the same weights.
    pub fn init(shape: TrunkShape, ranges: Ranges, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let Ranges { encoder, hidden, interval } = ranges;
        let reaches = [encoder, interval.phases(encoder)].into_iter();
        let weights = parameter_sizes(shape)
            .into_iter()
            .zip(reaches.chain(std::iter::repeat(hidden)))
            .map(|((rows, columns), reach)| {
                let entries = 0..rows * columns;
                entries.map(|_| E::round(reach * interval.draw(&mut rng))).collect()
            })
            .collect();
        Self::from_weights(shape, weights)
    }

    /// Restores a trunk from the weights of [`Self::weights`].
    ///
    /// # Panics
    /// When a weight does not have the size that `shape` asks for.
    pub fn from_weights(shape: TrunkShape, weights: Vec<Vec<E>>) -> Self {
        let device = Cpu::default();
        let sizes = parameter_sizes(shape);
        assert_eq!(weights.len(), sizes.len(), "every parameter of the trunk has its weights");
        let parameters = weights
            .into_iter()
            .zip(sizes)
            .map(|(w, size)| device.tensor_from_vec(w, size))
            .collect();
        Self { shape, parameters }
    }

    /// The sizes of this trunk.
    pub fn shape(&self) -> TrunkShape {
        self.shape
    }

    /// The weights, row-major, in the order w_in, b_in, then those of every layer.
    pub fn weights(&self) -> Vec<Vec<E>> {
        self.parameters.iter().map(entries).collect()
    }

    /// The parameters themselves, for an optimiser.
    pub fn parameters_mut(&mut self) -> &mut [Matrix<E>] {
        &mut self.parameters
    }

    /// The parameters themselves, for their gradients.
    pub fn parameters(&self) -> &[Matrix<E>] {
        &self.parameters
    }

    /// The last hidden features F, n×h, of the input features x, n×d.
    pub fn forward<T: Tape<E, Cpu>>(&self, x: Matrix<E, T>, graph: &Arc<Graph<E>>) -> Matrix<E, T> {
        self.forward_with(&self.prepared(), x, graph)
    }

    /// What [`Self::forward_with`] needs of the layers; for many passes with the same weights.
    pub fn prepared(&self) -> Prepared<E> {
        let layers = &self.parameters[2..];
        let pairs = || layers.chunks_exact(2);
        match self.shape.layer {
            Layer::Sggc => Prepared::Sggc(pairs().map(|w| Mixing::new(&w[0], &w[1])).collect()),
            Layer::Pointwise => Prepared::Sggc(layers.iter().map(Mixing::alone).collect()),
            Layer::Gcn => Prepared::Gcn(layers.to_vec()),
            Layer::Gat => Prepared::Gat(pairs().map(|w| [w[0].clone(), w[1].clone()]).collect()),
        }
    }

    /// [`Self::forward`] with what is [`Self::prepared`] of this trunk.
    pub fn forward_with<T: Tape<E, Cpu>>(
        &self,
        layers: &Prepared<E>,
        x: Matrix<E, T>,
        graph: &Arc<Graph<E>>,
    ) -> Matrix<E, T> {
        let TrunkShape { iterations, activation, .. } = self.shape;
        let encoded = encode(x, &self.parameters[0], &self.parameters[1], activation);
        match layers {
            Prepared::Sggc(layers) => sggc(encoded, graph, layers, iterations, activation),
            Prepared::Gcn(layers) => {
                layers.iter().fold(encoded, |x, w| gcn(x, graph, w, activation))
            }
            Prepared::Gat(layers) => {
                layers.iter().fold(encoded, |x, [w, a]| gat(x, graph, w, a, activation))
            }
        }
    }
}

/// Rows and columns of every parameter, in order.
pub fn parameter_sizes(shape: TrunkShape) -> Vec<(usize, usize)> {
    let h = shape.width;
    let layers = std::iter::repeat_n(shape.layer.weight_sizes(h), shape.layers).flatten();
    [(h, shape.inputs), (1, h)].into_iter().chain(layers).collect()
}

#[cfg(test)]
mod tests {
    use super::super::ops::finite_differences::{check, values, weighted_sum};
    use super::*;
    use crate::mesh::{TriMesh, sample::icosphere};
    use crate::operators::{Pattern, Sparse, adjacency::adjacency};
    use crate::spectrum::Dense;

    const SHAPE: TrunkShape = TrunkShape {
        inputs: 3,
        width: 4,
        layers: 2,
        iterations: 1,
        layer: Layer::Sggc,
        activation: Activation::Sin,
    };

    /// Every layer with every activation, and the paper's with two iterations.
    fn shapes() -> impl Iterator<Item = TrunkShape> {
        let pairs = Layer::ALL.into_iter().flat_map(|layer| {
            Activation::ALL.map(|activation| TrunkShape { layer, activation, ..SHAPE })
        });
        pairs.chain([TrunkShape { iterations: 2, ..SHAPE }])
    }

    fn some_weights(shape: TrunkShape) -> Vec<Vec<f64>> {
        let sizes = parameter_sizes(shape).into_iter().enumerate();
        sizes.map(|(i, (r, c))| values(r * c, i as u64).iter().map(|v| 0.4 * v).collect()).collect()
    }

    fn w_of(mesh: &TriMesh) -> Sparse {
        adjacency(&Pattern::of_mesh(mesh))
    }

    #[test]
    fn the_whole_trunk_matches_finite_differences() {
        let mesh = icosphere(0);
        let graph = Arc::new(Graph::new(&w_of(&mesh)));
        let positions: Vec<f64> = mesh.vertices().iter().flatten().copied().collect();
        for shape in shapes() {
            check(&some_weights(shape), |dev, p, tape| {
                let trunk = Trunk::from_weights(shape, p.to_vec());
                let x = dev.tensor_from_vec(positions.clone(), (mesh.n(), 3)).put_tape(tape);
                let loss = weighted_sum(trunk.forward(x, &graph));
                let read = move |g: &Gradients<f64, Cpu>| {
                    trunk.parameters().iter().map(|p| g.get(p).as_vec()).collect()
                };
                (loss, Box::new(read))
            });
        }
    }

    /// (27) with dense matrices and no kernel in common with [`Trunk::forward`].
    fn written_out(shape: TrunkShape, weights: &[Vec<f64>], x: &[f64], w: &Sparse) -> Dense {
        let n = w.rows();
        let dense = |entries: &[f64], columns: usize| {
            Dense::from_fn(entries.len() / columns, columns, |i, j| entries[i * columns + j])
        };
        let a = Dense::from_fn(n, n, |i, j| f64::from(w.get(i, j).is_some()));
        let looped = &a + Dense::identity(n, n);
        let degree = |i: usize| (0..n).map(|j| looped[(i, j)]).sum::<f64>();
        let w = Dense::from_fn(n, n, |i, j| a[(i, j)] / (degree(i) - 1.0));
        let normalised =
            Dense::from_fn(n, n, |i, j| looped[(i, j)] / (degree(i) * degree(j)).sqrt());
        let activated = |x: Dense| {
            Dense::from_fn(x.nrows(), x.ncols(), |i, j| match shape.activation {
                Activation::Sin => x[(i, j)].sin(),
                Activation::Tanh => x[(i, j)].tanh(),
                Activation::Relu => x[(i, j)].max(0.0),
            })
        };
        let h = shape.width;
        let phases = dense(x, shape.inputs) * dense(&weights[0], shape.inputs).transpose();
        let mut x = activated(Dense::from_fn(n, h, |i, j| phases[(i, j)] + weights[1][j]));
        for layer in weights[2..].chunks_exact(shape.layer.weight_sizes(h).len()) {
            let first = dense(&layer[0], h);
            let z = &x * first.transpose();
            x = activated(match shape.layer {
                Layer::Sggc => (0..shape.iterations).fold(x, |x, _| {
                    let smoothing = (&x - &w * &x) * dense(&layer[1], h).transpose();
                    &x - (&x * first.transpose() + smoothing * 2.0)
                }),
                Layer::Gcn => &normalised * z,
                Layer::Gat => attended(&z, &layer[1], &looped),
                Layer::Pointwise => x - z,
            });
        }
        x
    }

    /// Σ_j α_ij z_j, straight from the definition of α.
    fn attended(z: &Dense, a: &[f64], looped: &Dense) -> Dense {
        let (n, h) = (z.nrows(), z.ncols());
        let power = |i: usize, j: usize| {
            let e: f64 = (0..h).map(|c| a[c] * z[(i, c)] + a[h + c] * z[(j, c)]).sum();
            looped[(i, j)] * if e > 0.0 { e } else { 0.2 * e }.exp()
        };
        let sums: Vec<f64> = (0..n).map(|i| (0..n).map(|j| power(i, j)).sum()).collect();
        Dense::from_fn(n, n, |i, j| power(i, j) / sums[i]) * z
    }

    #[test]
    fn the_whole_trunk_is_its_definition_written_out() {
        let mesh = icosphere(1);
        let w = w_of(&mesh);
        let graph = Arc::new(Graph::new(&w));
        let positions: Vec<f64> = mesh.vertices().iter().flatten().copied().collect();
        for shape in shapes() {
            let weights = some_weights(shape);
            let x = Cpu::default().tensor_from_vec(positions.clone(), (mesh.n(), 3));
            let found = Trunk::from_weights(shape, weights.clone()).forward(x, &graph).as_vec();
            let expected = written_out(shape, &weights, &positions, &w);
            for (at, found) in found.into_iter().enumerate() {
                let expected = expected[(at / SHAPE.width, at % SHAPE.width)];
                assert!((found - expected).abs() < 1e-13, "{shape:?} at {at}");
            }
        }
    }

    const RANGES: Ranges = Ranges { encoder: 2.0, hidden: 0.005, interval: Interval::Symmetric };

    #[test]
    fn weights_survive_a_round_trip_and_a_seed_repeats() {
        let trunk = Trunk::<f32>::init(SHAPE, RANGES, 3);
        assert_eq!(trunk.weights(), Trunk::<f32>::init(SHAPE, RANGES, 3).weights());
        assert_ne!(trunk.weights(), Trunk::<f32>::init(SHAPE, RANGES, 4).weights());
        assert_eq!(Trunk::from_weights(SHAPE, trunk.weights()).weights(), trunk.weights());
    }

    #[test]
    fn initial_weights_fill_their_ranges() {
        let shape = TrunkShape { width: 64, ..SHAPE };
        for (interval, lowest, phases) in
            [(Interval::Symmetric, -1.0, std::f64::consts::PI), (Interval::Positive, 0.0, 2.0)]
        {
            let weights = Trunk::<f64>::init(shape, Ranges { interval, ..RANGES }, 3).weights();
            for (weights, reach) in weights.iter().zip([2.0, phases, 0.005, 0.005]) {
                let (low, high) = weights
                    .iter()
                    .fold((f64::MAX, f64::MIN), |(low, high), &w| (low.min(w), high.max(w)));
                assert!(low >= lowest * reach && low < (lowest + 0.2) * reach);
                assert!(high < reach && high > 0.8 * reach);
            }
        }
    }
}
