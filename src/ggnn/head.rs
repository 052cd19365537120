//! The decoder, solved instead of trained: Rayleigh–Ritz over the hidden features of a whole batch.
//!
//! With F the deflated features of every member, heads are the lowest eigenvectors of (ΣFᵀLF + σI, ΣFᵀBF). They
//! always give the *next* eigenfunctions. The ridge σ keeps ill-conditioned combinations of features out. On meshes
//! without Dirichlet boundary the constant is among the deflated functions, so no constant column is needed.

use faer::linalg::matmul::triangular::{BlockStructure, matmul};
use faer::{Accum, Par};

use super::deflation::Deflation;
use super::ops::graph::Graph;
use super::ops::loan::Loan;
use super::ops::real::{Real, gemm, view, widely};
use crate::spectrum::Dense;
use crate::spectrum::rayleigh_ritz::lowest_ridge_pairs;

/// (FᵀLF, FᵀBF) of the deflated features, summed over members; each h×h, its lower triangle alone.
#[derive(Debug, Clone)]
pub struct Grams {
    stiffness: Dense,
    mass: Dense,
}

/// A solved head.
#[derive(Debug, Clone, PartialEq)]
pub struct Head {
    /// w_out: one weight a feature, scaled to Σ uᵀBu = 1 over the batch it was solved on.
    pub weights: Vec<f64>,
    /// The Rayleigh quotient of the batch, with the ridge's share σ‖w‖².
    pub quotient: f64,
}

impl Grams {
    /// The sums over no member at all.
    pub fn zeros(h: usize) -> Self {
        Self { stiffness: Dense::zeros(h, h), mass: Dense::zeros(h, h) }
    }

    /// Adds the Gram matrices of one member's `features`, row-major n×h.
    pub fn include<E: Real>(
        &mut self,
        features: &[E],
        stiffness: &Graph<f64>,
        mass: &Graph<f64>,
        deflation: &Deflation,
    ) {
        let h = self.mass.nrows();
        let deflated = deflated(features, features.len() / h, h, deflation);
        let mut product = Loan::<f64>::of(deflated.len());
        for (sum, operator) in [(&mut self.stiffness, stiffness), (&mut self.mass, mass)] {
            operator.for_each_row(&deflated, h, |i, row| {
                product[i * h..(i + 1) * h].copy_from_slice(row);
            });
            add_gram(sum, &deflated, &product);
        }
    }

    /// Adds the sums over other members.
    pub fn add(&mut self, other: &Self) {
        self.stiffness += &other.stiffness;
        self.mass += &other.mass;
    }

    /// The lowest `count` pairs with σ = `ridge` · tr ΣFᵀLF; `None` when the features do not span as many (or are not
    /// numbers).
    pub fn solve(&self, ridge: f64, count: usize) -> Option<Vec<Head>> {
        let [stiffness, mass] = [&self.stiffness, &self.mass].map(mirrored);
        let pairs = lowest_ridge_pairs(&stiffness, &mass, ridge, count)?;
        Some(pairs.into_iter().map(|(quotient, weights)| Head { weights, quotient }).collect())
    }
}

/// P F in double precision, row-major n×h.
fn deflated<E: Real>(features: &[E], n: usize, h: usize, deflation: &Deflation) -> Loan<f64> {
    let mut f = Loan::of(features.len());
    widely(
        #[inline(always)]
        || {
            for (f, v) in f.iter_mut().zip(features) {
                *f = v.wide();
            }
        },
    );
    let k = deflation.phi().ncols();
    let mut overlaps = vec![0.0; k * h];
    gemm(&mut overlaps, deflation.dual().transpose(), view(&f, n, h), Accum::Replace);
    overlaps.iter_mut().for_each(|c| *c = -*c);
    gemm(&mut f, deflation.phi().as_ref(), view(&overlaps, k, h), Accum::Add);
    f
}

/// sum += the lower triangle of FᵀG.
fn add_gram(sum: &mut Dense, f: &[f64], g: &[f64]) {
    let h = sum.nrows();
    let view = |x| view(x, f.len() / h, h);
    matmul(
        sum.as_mut(),
        BlockStructure::TriangularLower,
        Accum::Add,
        view(f).transpose(),
        BlockStructure::Rectangular,
        view(g),
        BlockStructure::Rectangular,
        1.0,
        Par::Seq,
    );
}

/// The symmetric matrix with this lower triangle.
fn mirrored(lower: &Dense) -> Dense {
    Dense::from_fn(lower.nrows(), lower.ncols(), |i, j| lower[(i.max(j), i.min(j))])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::sample::icosphere;
    use crate::operators::{MassKind, Operators};

    #[test]
    fn coordinates_hold_the_first_eigenfunctions_of_the_sphere() {
        let mesh = icosphere(3);
        let operators = Operators::assemble(&mesh, MassKind::Lumped).unwrap();
        let (l, b) = (Graph::new(&operators.stiffness), Graph::new(&operators.mass));
        let constant = Deflation::new(&operators.mass, Dense::from_fn(mesh.n(), 1, |_, _| 1.0));
        let features: Vec<f32> =
            mesh.vertices().iter().flat_map(|p| [p[0] as f32, p[1] as f32, 1.0]).collect();
        let mut grams = Grams::zeros(3);
        grams.include(&features, &l, &b, &constant);
        for head in grams.solve(1e-10, 2).unwrap() {
            assert!((head.quotient / 2.0 - 1.0).abs() < 5e-3, "{}", head.quotient);
        }
        assert_eq!(grams.solve(1e-10, 3), None);
    }
}
