//! The GGNN of (27) without its decoder: encoder and H SGGC layers. The decoder is the head, see
//! [`super::head`].

use std::sync::Arc;

use dfdx::prelude::*;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::ops::encoder::encode;
use super::ops::graph::Graph;
use super::ops::real::Real;
use super::ops::sggc::{Mixing, sggc};
use super::ops::{Matrix, entries};

/// The sizes of a trunk.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct TrunkShape {
    /// d: input features per vertex.
    pub inputs: usize,
    /// h_f: hidden features per vertex.
    pub width: usize,
    /// H: SGGC layers.
    pub layers: usize,
    /// I: iterations of (29) in every layer.
    pub iterations: usize,
}

/// Symmetric initialisation: encoder U[−γ₁, γ₁], phases U[−π, π], hidden weights U[−γ₂, γ₂].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Ranges {
    /// γ₁: the band of frequencies that the encoder offers.
    pub encoder: f64,
    /// γ₂: how far the hidden layers start from sin alone.
    pub hidden: f64,
}

/// The trainable weights Θ_in, Θ_1, …, Θ_H.
#[derive(Debug, Clone)]
pub struct Trunk<E: Real> {
    shape: TrunkShape,
    /// w_in (h×d), b_in (1×h), then w₁ and w₂ (h×h) of every layer.
    parameters: Vec<Matrix<E>>,
}

impl<E: Real> Trunk<E> {
    /// Draws weights from `ranges`; the same seed gives the same weights.
    pub fn init(shape: TrunkShape, ranges: Ranges, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut draw = |rows: usize, columns: usize, range: f64| -> Vec<E> {
            (0..rows * columns).map(|_| E::round(range * rng.random_range(-1.0..1.0))).collect()
        };
        let h = shape.width;
        let mut weights = vec![draw(h, shape.inputs, ranges.encoder)];
        weights.push(draw(1, h, std::f64::consts::PI));
        for _ in 0..2 * shape.layers {
            weights.push(draw(h, h, ranges.hidden));
        }
        Self::from_weights(shape, weights)
    }

    /// Restores a trunk from the weights of [`Self::weights`].
    ///
    /// # Panics
    /// When a weight does not have the size that `shape` asks for.
    pub fn from_weights(shape: TrunkShape, weights: Vec<Vec<E>>) -> Self {
        let device = Cpu::default();
        let sizes = parameter_sizes(shape);
        assert_eq!(weights.len(), sizes.len(), "a trunk has 2 + 2H parameters");
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

    /// The weights, row-major, in the order w_in, b_in, then w₁ and w₂ of every layer.
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
        self.forward_with(&self.mixings(), x, graph)
    }

    /// What [`Self::forward_with`] needs of every layer; for many passes with the same weights.
    pub fn mixings(&self) -> Vec<Mixing<E>> {
        self.parameters[2..].chunks_exact(2).map(|w| Mixing::new(&w[0], &w[1])).collect()
    }

    /// [`Self::forward`] with the [`Self::mixings`] of this trunk.
    pub fn forward_with<T: Tape<E, Cpu>>(
        &self,
        mixings: &[Mixing<E>],
        x: Matrix<E, T>,
        graph: &Arc<Graph<E>>,
    ) -> Matrix<E, T> {
        let encoded = encode(x, &self.parameters[0], &self.parameters[1]);
        mixings.iter().fold(encoded, |x, mixing| sggc(x, graph, mixing, self.shape.iterations))
    }
}

/// Rows and columns of every parameter, in order.
pub fn parameter_sizes(shape: TrunkShape) -> Vec<(usize, usize)> {
    let h = shape.width;
    let mut sizes = vec![(h, shape.inputs), (1, h)];
    sizes.resize(2 + 2 * shape.layers, (h, h));
    sizes
}

#[cfg(test)]
mod tests {
    use super::super::ops::finite_differences::{check, values, weighted_sum};
    use super::*;
    use crate::mesh::sample::icosphere;
    use crate::operators::{Pattern, adjacency::adjacency};

    const SHAPE: TrunkShape = TrunkShape { inputs: 3, width: 4, layers: 2, iterations: 2 };

    #[test]
    fn the_whole_trunk_matches_finite_differences() {
        let mesh = icosphere(0);
        let graph = Arc::new(Graph::new(&adjacency(&Pattern::of_mesh(&mesh))));
        let positions: Vec<f64> = mesh.vertices().iter().flatten().copied().collect();
        let inputs: Vec<Vec<f64>> = parameter_sizes(SHAPE)
            .into_iter()
            .enumerate()
            .map(|(i, (r, c))| values(r * c, i as u64).iter().map(|v| 0.4 * v).collect())
            .collect();
        check(&inputs, |dev, p, tape| {
            let trunk = Trunk::from_weights(SHAPE, p.to_vec());
            let x = dev.tensor_from_vec(positions.clone(), (mesh.n(), 3)).put_tape(tape);
            let loss = weighted_sum(trunk.forward(x, &graph));
            let read = move |g: &Gradients<f64, Cpu>| {
                trunk.parameters().iter().map(|p| g.get(p).as_vec()).collect()
            };
            (loss, Box::new(read))
        });
    }

    #[test]
    fn weights_survive_a_round_trip_and_a_seed_repeats() {
        let ranges = Ranges { encoder: 2.0, hidden: 0.005 };
        let trunk = Trunk::<f32>::init(SHAPE, ranges, 3);
        assert_eq!(trunk.weights(), Trunk::<f32>::init(SHAPE, ranges, 3).weights());
        assert_ne!(trunk.weights(), Trunk::<f32>::init(SHAPE, ranges, 4).weights());
        assert_eq!(Trunk::from_weights(SHAPE, trunk.weights()).weights(), trunk.weights());
    }
}
