//! The decoder, solved instead of trained: Rayleigh–Ritz over the hidden features of a whole batch.
//!
//! With F the deflated features of every member, heads are the lowest eigenvectors of (ΣFᵀLF + σI, ΣFᵀBF). They
//! always give the *next* eigenfunctions. The ridge σ keeps ill-conditioned combinations of features out. On meshes
//! without Dirichlet boundary the constant is among the deflated functions, so no constant column is needed.

use std::ops::Range;

use super::deflation::Deflation;
use super::ops::dealt::{self, ROWS, rows_of_sum};
use super::ops::graph::Graph;
use super::ops::loan::Loan;
use super::ops::product::Layout;
use super::ops::real::{Real, add, axpy, widely};
use crate::spectrum::Dense;
use crate::spectrum::pencil::column;
use crate::spectrum::rayleigh_ritz::lowest_ridge_pairs;

/// (FᵀLF, FᵀBF) of the deflated features, summed over members; each h×h, row-major, its lower triangle alone.
#[derive(Debug, Clone)]
pub struct Grams {
    h: usize,
    stiffness: Vec<f64>,
    mass: Vec<f64>,
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
        Self { h, stiffness: vec![0.0; h * h], mass: vec![0.0; h * h] }
    }

    /// Adds the Gram matrices of one member's `features`, row-major n×h.
    pub fn include<E: Real>(
        &mut self,
        features: &[E],
        stiffness: &Graph<f64>,
        mass: &Graph<f64>,
        deflation: &Deflation,
    ) {
        let h = self.h;
        let deflated = deflated(features, h, deflation);
        let n = stiffness.n();
        let rows = rows_of_sum(n);
        if n <= rows {
            self.include_rows(0..n, &deflated, stiffness, mass);
            return;
        }
        let mut parts: Vec<_> = (0..n).step_by(rows).map(|first| (first, Self::zeros(h))).collect();
        dealt::for_each(parts.iter_mut(), |(first, part)| {
            let rows = *first..n.min(*first + rows);
            part.include_rows(rows, &deflated, stiffness, mass);
        });
        parts.iter().for_each(|(_, part)| self.add(part));
    }

    /// Adds what these rows contribute to the products: of F, and of LF and BF.
    fn include_rows(
        &mut self,
        rows: Range<usize>,
        f: &[f64],
        stiffness: &Graph<f64>,
        mass: &Graph<f64>,
    ) {
        let h = self.h;
        let own = Layout::Columns(&f[rows.start * h..rows.end * h], h);
        f64::panels().with_borrow_mut(|product| {
            for (sum, operator) in [(&mut self.stiffness, stiffness), (&mut self.mass, mass)] {
                product.resize(rows.len(), h);
                operator
                    .for_rows(rows.clone(), f, h, |i, row| product.set_row(i - rows.start, row));
                product.add_lower_product(sum, own);
            }
        });
    }

    /// Adds the sums over other members.
    pub fn add(&mut self, other: &Self) {
        add(&other.stiffness, &mut self.stiffness);
        add(&other.mass, &mut self.mass);
    }

    /// The lowest `count` pairs with σ = `ridge` · tr ΣFᵀLF; `None` when the features do not span as many (or are not
    /// numbers).
    pub fn solve(&self, ridge: f64, count: usize) -> Option<Vec<Head>> {
        let [stiffness, mass] = [&self.stiffness, &self.mass].map(|lower| mirrored(lower, self.h));
        let pairs = lowest_ridge_pairs(&stiffness, &mass, ridge, count)?;
        Some(pairs.into_iter().map(|(quotient, weights)| Head { weights, quotient }).collect())
    }
}

/// P F in double precision, row-major n×h.
fn deflated<E: Real>(features: &[E], h: usize, deflation: &Deflation) -> Loan<f64> {
    let mut f = Loan::of(features.len());
    let rows = f.chunks_mut(ROWS * h).zip(features.chunks(ROWS * h));
    dealt::for_each(rows, |(f, features)| {
        widely(
            #[inline(always)]
            || f.iter_mut().zip(features).for_each(|(f, v)| *f = v.wide()),
        );
    });
    let functions = 0..deflation.phi().ncols();
    let overlaps: Vec<Vec<f64>> =
        functions.map(|k| overlap(&f, h, column(deflation.dual(), k))).collect();
    dealt::for_each(f.chunks_mut(ROWS * h).enumerate(), |(chunk, f)| {
        for (k, overlap) in overlaps.iter().enumerate() {
            let phi = &column(deflation.phi(), k)[chunk * ROWS..];
            widely(
                #[inline(always)]
                || {
                    for (row, &phi) in f.chunks_exact_mut(h).zip(phi) {
                        axpy(-phi, overlap, row);
                    }
                },
            );
        }
    });
    f
}

/// Fᵀ d for F, n×h.
fn overlap(f: &[f64], h: usize, dual: &[f64]) -> Vec<f64> {
    let mut overlap = vec![0.0; h];
    widely(
        #[inline(always)]
        || {
            for (row, &dual) in f.chunks_exact(h).zip(dual) {
                axpy(dual, row, &mut overlap);
            }
        },
    );
    overlap
}

/// The symmetric matrix with this lower triangle.
fn mirrored(lower: &[f64], h: usize) -> Dense {
    Dense::from_fn(h, h, |i, j| lower[i.max(j) * h + i.min(j)])
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
