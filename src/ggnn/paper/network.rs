//! All of (27): trunk and decoder.

use std::sync::Arc;

use dfdx::prelude::*;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::Paper;
use crate::ggnn::network::{Prepared, Trunk};
use crate::ggnn::ops::decoder::decode;
use crate::ggnn::ops::graph::Graph;
use crate::ggnn::ops::real::Real;
use crate::ggnn::ops::{Matrix, Vector, entries};

/// The trainable weights Θ_in, Θ_1, …, Θ_H, Θ_out.
#[derive(Debug, Clone)]
pub struct Network<E: Real> {
    pub(super) trunk: Trunk<E>,
    /// w_out, 1×h, and b_out, 1×1.
    pub(super) decoder: [Matrix<E>; 2],
}

impl<E: Real> Network<E> {
    /// Draws the trunk's weights from the recipe's ranges, and w_out after Kaiming He: U[−√(6/h), √(6/h)]. b_out = 0. The
    /// same seed gives the same weights.
    pub fn init(recipe: &Paper, seed: u64) -> Self {
        // Its own stream of the seed: the trunk and the order of batches have others.
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(2);
        let h = recipe.shape.width;
        let reach = (6.0 / h as f64).sqrt();
        let weights = (0..h).map(|_| E::round(rng.random_range(-reach..reach))).collect();
        Self::new(Trunk::init(recipe.shape, recipe.ranges, seed), weights, E::default())
    }

    /// A trunk with w_out, h, and b_out.
    pub fn new(trunk: Trunk<E>, weights: Vec<E>, bias: E) -> Self {
        let device = Cpu::default();
        let size = (1, weights.len());
        let decoder =
            [device.tensor_from_vec(weights, size), device.tensor_from_vec(vec![bias], (1, 1))];
        Self { trunk, decoder }
    }

    /// GGNN(X, W; Θ), n, of the input features x, n×d. `layers` are those of [`Trunk::prepared`].
    pub fn forward<T: Tape<E, Cpu>>(
        &self,
        layers: &Prepared<E>,
        x: Matrix<E, T>,
        graph: &Arc<Graph<E>>,
    ) -> Vector<E, T> {
        let [w, b] = &self.decoder;
        decode(self.trunk.forward_with(layers, x, graph), w, b)
    }

    /// All parameters, for their gradients: the trunk's, w_out, b_out.
    pub fn parameters(&self) -> impl Iterator<Item = &Matrix<E>> {
        self.trunk.parameters().iter().chain(&self.decoder)
    }

    /// All parameters, for an optimiser.
    pub fn parameters_mut(&mut self) -> impl Iterator<Item = &mut Matrix<E>> {
        self.trunk.parameters_mut().iter_mut().chain(&mut self.decoder)
    }

    /// w_out, then b_out: h + 1.
    pub fn head(&self) -> Vec<f64> {
        self.decoder.iter().flat_map(entries).map(Real::wide).collect()
    }
}
