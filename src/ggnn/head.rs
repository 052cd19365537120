//! The decoder, solved instead of trained: Rayleigh–Ritz over the hidden features of a whole batch.
//!
//! With F the deflated features of every member, the head is the lowest eigenvector of (ΣFᵀLF, ΣFᵀBF), the
//! ill-conditioned directions of ΣFᵀBF cut off. It always gives the *next* eigenfunction. On meshes without
//! Dirichlet boundary the constant is among the deflated functions, so no constant column is needed.

use faer::{Accum, Par, linalg::matmul::matmul};

use super::deflation::Deflation;
use super::ops::graph::Graph;
use super::ops::real::Real;
use crate::spectrum::Dense;
use crate::spectrum::rayleigh_ritz::ritz_pairs;

/// (FᵀLF, FᵀBF) of the deflated features of one member, or their sum over several; each h×h.
#[derive(Debug, Clone)]
pub struct Grams {
    /// FᵀLF.
    pub stiffness: Dense,
    /// FᵀBF.
    pub mass: Dense,
}

/// A solved head.
#[derive(Debug, Clone, PartialEq)]
pub struct Head {
    /// w_out: one weight a feature, scaled to Σ uᵀBu = 1 over the batch it was solved on.
    pub weights: Vec<f64>,
    /// The Rayleigh quotient of the batch.
    pub quotient: f64,
}

impl Grams {
    /// The sums over no member at all.
    pub fn zeros(h: usize) -> Self {
        Self { stiffness: Dense::zeros(h, h), mass: Dense::zeros(h, h) }
    }

    /// The Gram matrices of `features`, row-major n×h.
    pub fn of<E: Real>(
        features: &[E],
        h: usize,
        stiffness: &Graph<f64>,
        mass: &Graph<f64>,
        deflation: &Deflation,
    ) -> Self {
        let n = features.len() / h;
        let deflated = deflated(features, n, h, deflation);
        Self { stiffness: gram(&deflated, n, h, stiffness), mass: gram(&deflated, n, h, mass) }
    }

    /// Adds another member's matrices.
    pub fn add(&mut self, other: &Self) {
        self.stiffness += &other.stiffness;
        self.mass += &other.mass;
    }

    /// The lowest Ritz pair; `None` when the features span nothing (or are not numbers).
    pub fn solve(&self, cutoff: f64) -> Option<Head> {
        let ritz = ritz_pairs(&self.stiffness, &self.mass, cutoff);
        let quotient = ritz.values.first().copied().filter(|v| v.is_finite())?;
        let weights = (0..self.mass.nrows()).map(|i| ritz.coefficients[(i, 0)]).collect();
        Some(Head { weights, quotient })
    }

    /// (wᵀ(ΣFᵀLF)w, wᵀ(ΣFᵀBF)w) of a head that was solved elsewhere.
    pub fn quotient_parts(&self, head: &[f64]) -> (f64, f64) {
        let form = |a: &Dense| -> f64 {
            (0..head.len())
                .map(|j| head[j] * (0..head.len()).map(|i| a[(i, j)] * head[i]).sum::<f64>())
                .sum()
        };
        (form(&self.stiffness), form(&self.mass))
    }
}

/// P F in double precision, row-major n×h.
fn deflated<E: Real>(features: &[E], n: usize, h: usize, deflation: &Deflation) -> Vec<f64> {
    let mut f: Vec<f64> = features.iter().map(|v| v.wide()).collect();
    let k = deflation.phi().ncols();
    let mut overlaps = vec![0.0; k * h];
    super::ops::real::gemm(
        &mut overlaps,
        deflation.dual().transpose(),
        super::ops::real::view(&f, n, h),
        Accum::Replace,
    );
    overlaps.iter_mut().for_each(|c| *c = -*c);
    super::ops::real::gemm(
        &mut f,
        deflation.phi().as_ref(),
        super::ops::real::view(&overlaps, k, h),
        Accum::Add,
    );
    f
}

/// FᵀAF, made exactly symmetric.
fn gram(f: &[f64], n: usize, h: usize, a: &Graph<f64>) -> Dense {
    let mut af = Vec::with_capacity(n * h);
    a.for_each_row(f, h, |_, row| af.extend_from_slice(row));
    let mut g = Dense::zeros(h, h);
    let view = |x| faer::MatRef::from_row_major_slice(x, n, h);
    matmul(g.as_mut(), Accum::Replace, view(f).transpose(), view(&af), 1.0, Par::Seq);
    for j in 0..h {
        for i in 0..j {
            let mean = 0.5 * (g[(i, j)] + g[(j, i)]);
            g[(i, j)] = mean;
            g[(j, i)] = mean;
        }
    }
    g
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::sample::icosphere;
    use crate::operators::{MassKind, Operators};

    #[test]
    fn coordinates_hold_the_first_eigenfunctions_of_the_sphere() {
        let mesh = icosphere(3);
        let operators = Operators::assemble(&mesh, MassKind::Lumped);
        let (l, b) = (Graph::new(&operators.stiffness), Graph::new(&operators.mass));
        let constant = Deflation::new(&operators.mass, Dense::from_fn(mesh.n(), 1, |_, _| 1.0));
        let features: Vec<f32> =
            mesh.vertices().iter().flat_map(|p| [p[0] as f32, p[1] as f32, 1.0]).collect();
        let head = Grams::of(&features, 3, &l, &b, &constant).solve(1e-10).unwrap();
        assert!((head.quotient / 2.0 - 1.0).abs() < 5e-3, "{}", head.quotient);
    }
}
