//! The loss (23) on one mesh.

use std::sync::Arc;

use dfdx::prelude::*;

use super::{ResidualRows, Weights};
use crate::ggnn::ops::losses::{
    Rows, b_normalise, boundary_loss, orthogonality_loss, residual_loss, weighted,
};
use crate::ggnn::ops::real::Real;
use crate::ggnn::ops::{Scalar, Vector, entries};
use crate::ggnn::predict::NetworkInput;
use crate::ggnn::sample::Member;
use crate::operators::Sparse;
use crate::spectrum::Dense;
use crate::spectrum::pencil::{product, quadratic};

/// One member of a family with the earlier eigenfunctions on it, as recipe `paper` sees it.
#[derive(Debug, Clone)]
pub struct Sample {
    pub(super) input: NetworkInput,
    /// L, n×n, all rows.
    pub(super) stiffness: Arc<Sparse>,
    /// B/area, n×n, all rows.
    pub(super) mass: Arc<Sparse>,
    /// The vertices where (24) asks for 0.
    pub(super) held: Arc<Vec<u32>>,
    /// φ₁ … φ_k, n×k, and B times them.
    pub(super) earlier: Dense,
    pub(super) b_phi: Arc<Dense>,
}

/// The terms (24), (25), (26) for one prediction.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Terms {
    /// ‖z_b‖².
    pub boundary: f64,
    /// ‖Lz − λBz‖².
    pub residual: f64,
    /// ‖zᵀBΦ‖².
    pub orthogonality: f64,
    /// λ = zᵀLz.
    pub quotient: f64,
}

impl Sample {
    /// Prepares `member`, its operators [whole](Member::whole), for the block after the functions `earlier`, n×k.
    pub fn new(member: &Member, earlier: &Dense) -> Self {
        Self {
            input: member.input.clone(),
            stiffness: Arc::new(member.stiffness.clone()),
            mass: Arc::new(member.mass.clone()),
            held: Arc::new(member.input.fixed.clone()),
            earlier: earlier.clone(),
            b_phi: Arc::new(product(&member.mass, earlier)),
        }
    }

    fn rows(&self, which: ResidualRows) -> Rows {
        match which {
            ResidualRows::Interior => Rows::Interior(self.held.clone()),
            ResidualRows::All => Rows::All,
        }
    }

    /// (23) of a prediction before normalisation, and its terms.
    pub fn loss<E: Real, T: Tape<E, Cpu>>(
        &self,
        prediction: Vector<E, T>,
        weights: Weights,
        rows: ResidualRows,
    ) -> (Scalar<E, T>, Terms) {
        let Self { stiffness, mass, held, b_phi, .. } = self;
        // One tape runs through all three terms; the clones of z share its identity, and so its gradient.
        let (z, tape) = b_normalise(prediction, mass).split_tape();
        let on = |tape: T| z.clone().put_tape(tape);
        let (bc, tape) = boundary_loss(on(tape), held).split_tape();
        let (eigen, tape) = residual_loss(on(tape), stiffness, mass, &self.rows(rows)).split_tape();
        let (ortho, tape) = orthogonality_loss(on(tape), b_phi).split_tape();
        let [boundary, residual, orthogonality] =
            [&bc, &eigen, &ortho].map(|t| entries(t)[0].wide());
        let z: Vec<f64> = entries(&z).into_iter().map(Real::wide).collect();
        let terms = Terms { boundary, residual, orthogonality, quotient: quadratic(stiffness, &z) };
        let Weights { boundary, residual, orthogonality } = weights;
        (weighted([(bc, boundary), (eigen, residual), (ortho, orthogonality)], tape), terms)
    }
}

impl Terms {
    /// The sums of both.
    pub fn plus(self, other: Self) -> Self {
        Self {
            boundary: self.boundary + other.boundary,
            residual: self.residual + other.residual,
            orthogonality: self.orthogonality + other.orthogonality,
            quotient: self.quotient + other.quotient,
        }
    }

    /// All of them times `factor`.
    pub fn times(self, factor: f64) -> Self {
        Self {
            boundary: factor * self.boundary,
            residual: factor * self.residual,
            orthogonality: factor * self.orthogonality,
            quotient: factor * self.quotient,
        }
    }

    /// In the order of the fields.
    pub fn entries(self) -> [f64; 4] {
        let Self { boundary, residual, orthogonality, quotient } = self;
        [boundary, residual, orthogonality, quotient]
    }

    /// What [`entries`](Self::entries) gave; `None` for any other number of them.
    pub fn from_entries(entries: &[f64]) -> Option<Self> {
        let &[boundary, residual, orthogonality, quotient] = entries else { return None };
        Some(Self { boundary, residual, orthogonality, quotient })
    }

    /// (23).
    pub fn weighted(self, weights: Weights) -> f64 {
        weights.boundary * self.boundary
            + weights.residual * self.residual
            + weights.orthogonality * self.orthogonality
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ggnn::network::{Layer, Trunk, TrunkShape, parameter_sizes};
    use crate::ggnn::ops::activation::Activation;
    use crate::ggnn::ops::finite_differences::{check, values};
    use crate::ggnn::ops::graph::Graph;
    use crate::ggnn::paper::network::Network;
    use crate::mesh::sample::icosphere;
    use crate::operators::{MassKind, Operators};

    const SHAPE: TrunkShape = TrunkShape {
        inputs: 3,
        width: 4,
        layers: 2,
        iterations: 2,
        layer: Layer::Sggc,
        activation: Activation::Sin,
    };

    #[test]
    fn the_whole_loss_matches_finite_differences_in_trunk_and_decoder() {
        let mesh = icosphere(0);
        let operators = Operators::assemble(&mesh, MassKind::Lumped).unwrap();
        let positions: Vec<f64> = mesh.vertices().iter().flatten().copied().collect();
        let graph = Arc::new(Graph::<f64>::new(&operators.adjacency));
        let member = Member {
            input: NetworkInput::new(&positions, &operators.adjacency).with_zeros_at(&[1, 4, 5]),
            stiffness: operators.stiffness,
            mass: operators.mass,
        };
        let n = mesh.n();
        let earlier = Dense::from_fn(n, 2, |i, j| values(n, 3 + j as u64)[i]);
        let sample = Sample::new(&member, &earlier);
        let mut weights: Vec<Vec<f64>> = parameter_sizes(SHAPE)
            .into_iter()
            .enumerate()
            .map(|(i, (r, c))| values(r * c, i as u64).iter().map(|v| 0.4 * v).collect())
            .collect();
        weights.extend([values(4, 8), values(1, 9)]);
        let alphas = Weights { boundary: 0.7, residual: 1.3, orthogonality: 2.1 };
        for rows in [ResidualRows::Interior, ResidualRows::All] {
            check(&weights, |dev, p, tape| {
                let [trunk @ .., w, b] = p else { unreachable!() };
                let trunk = Trunk::from_weights(SHAPE, trunk.to_vec());
                let network = Network::new(trunk, w.clone(), b[0]);
                let x = dev.tensor_from_vec(positions.clone(), (n, 3)).put_tape(tape);
                let z = network.forward(&network.trunk.prepared(), x, &graph);
                let (loss, terms) = sample.loss(z, alphas, rows);
                assert!((terms.weighted(alphas) / loss.as_vec()[0] - 1.0).abs() < 1e-12);
                let read = move |g: &Gradients<f64, Cpu>| {
                    network.parameters().map(|p| g.get(p).as_vec()).collect()
                };
                (loss, Box::new(read))
            });
        }
    }
}
