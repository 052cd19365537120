//! Eigenvalues with their eigenvectors, and the rules that make them the same on every run.

use rayon::prelude::*;

use super::Dense;
use super::cluster::clusters;
use super::pencil::{InnerProduct, column, column_mut, columns_mut, dot};

/// K eigenpairs of (8): ascending values in 1/(input unit)² and B-orthonormal vectors, n×K.
#[derive(Debug, Clone)]
pub struct Eigenpairs {
    /// λ₁ ≤ … ≤ λ_K.
    pub values: Vec<f64>,
    /// φ₁ … φ_K, one a column.
    pub vectors: Dense,
}

/// Eigenvalues closer than this (relative) are one eigenvalue to working precision: their vectors are
/// an arbitrary basis until [`Eigenpairs::canonical`] fixes it. No more than what residuals are allowed, since turning
/// the vectors of different eigenvalues into one another makes residuals as large as these differ.
const NUMERICAL_CLUSTER: f64 = 1e-10;

/// Rows that one thread takes at a time.
const CHUNK: usize = 2048;

/// Entries within this of the largest magnitude tie; the lowest index wins.
const SIGN_TIE: f64 = 1e-6;

impl Eigenpairs {
    /// The number of pairs.
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// Whether there is no pair.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// The first `k` pairs.
    pub fn truncated(&self, k: usize) -> Self {
        Self { values: self.values[..k].to_vec(), vectors: self.vectors.subcols(0, k).to_owned() }
    }

    /// Fixes what the eigenproblem leaves open.
    ///
    /// Inside a numerical cluster the basis is the one of a pivoted QR of the rows: the first vector is the
    /// cluster's projection of the vertex where the cluster is largest, the second that of the vertex where the
    /// rest is largest, and so on. Then every vector gets the sign of [`orient`].
    /// The eigenfunctions of λ = 0, whose eigenvalues are below `zero`, stay as they are: indicators of components.
    pub fn canonical(mut self, zero: f64) -> Self {
        for run in clusters(&self.values, NUMERICAL_CLUSTER, zero) {
            let is_zero = self.values[run.start].abs() <= zero;
            if run.len() > 1 && !is_zero {
                let block = self.vectors.subcols(run.start, run.len()).to_owned();
                write_pivoted(&block, columns_mut(&mut self.vectors).skip(run.start));
            }
        }
        columns_mut(&mut self.vectors).for_each(orient);
        self
    }
}

/// Makes the entry of largest magnitude positive; ties within 1e-6 are decided by the lowest index.
pub fn orient(x: &mut [f64]) {
    let largest = x.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    let first = x.iter().find(|v| v.abs() >= largest * (1.0 - SIGN_TIE));
    if first.is_some_and(|&v| v < 0.0) {
        x.iter_mut().for_each(|v| *v = -*v);
    }
}

/// Scales `x` to xᵀBx = 1.
pub fn normalise(x: &mut [f64], mass: &impl InnerProduct) {
    let scale = mass.square(x).sqrt().recip();
    x.iter_mut().for_each(|v| *v *= scale);
}

/// Scales every column to φᵀBφ = 1.
pub fn normalise_columns(mass: &impl InnerProduct, x: &mut Dense) {
    for j in 0..x.ncols() {
        normalise(column_mut(x, j), mass);
    }
}

/// Writes a basis of the span of the m orthonormal columns of `block` that depends on this span alone.
fn write_pivoted<'a>(block: &Dense, to: impl Iterator<Item = &'a mut [f64]>) {
    let m = block.ncols();
    let mut directions: Vec<Vec<f64>> = Vec::with_capacity(m);
    // Of every row, the square of what is left of it.
    let mut squares = vec![0.0; block.nrows()];
    for j in 0..m {
        squares.iter_mut().zip(column(block, j)).for_each(|(s, v)| *s += v * v);
    }
    for to in to.take(m) {
        let pivot = largest(&squares);
        let mut direction: Vec<f64> = (0..m).map(|j| block[(pivot, j)]).collect();
        // Twice: the pivots shrink, rounding does not.
        for earlier in directions.iter().chain(&directions) {
            let c = dot(earlier, &direction);
            direction.iter_mut().zip(earlier).for_each(|(d, e)| *d -= c * e);
        }
        let length = norm(&direction).max(f64::MIN_POSITIVE);
        direction.iter_mut().for_each(|d| *d /= length);
        let chunks = to.par_chunks_mut(CHUNK).zip(squares.par_chunks_mut(CHUNK));
        chunks.enumerate().for_each(|(chunk, (to, squares))| {
            to.fill(0.0);
            for (j, &d) in direction.iter().enumerate() {
                let column = &column(block, j)[chunk * CHUNK..];
                to.iter_mut().zip(column).for_each(|(to, v)| *to += v * d);
            }
            squares.iter_mut().zip(to).for_each(|(s, v)| *s -= *v * *v);
        });
        directions.push(direction);
    }
}

/// The row with the largest value; ties go to the lowest index.
fn largest(squares: &[f64]) -> usize {
    let largest = squares.iter().fold(0.0_f64, |a, &b| a.max(b));
    squares.iter().position(|&s| s >= largest * (1.0 - SIGN_TIE)).unwrap_or(0)
}

fn norm(x: &[f64]) -> f64 {
    dot(x, x).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectrum::pencil::combine;

    #[test]
    fn sign_ties_go_to_the_lowest_index() {
        let mut x = [-1.0, 1.0 + 1e-9, 0.5];
        orient(&mut x);
        assert_eq!(x[0], 1.0);
    }

    #[test]
    fn the_basis_of_a_cluster_does_not_depend_on_the_one_given() {
        let n = 7;
        let base = Dense::from_fn(n, 2, |i, j| {
            ((i * (j + 1)) as f64 * 1.3 + j as f64).sin() + 0.1 * i as f64
        });
        let qr = base.qr().compute_thin_Q();
        let (s, c) = 0.7_f64.sin_cos();
        let turn = Dense::from_fn(2, 2, |i, j| [[c, -s], [s, c]][i][j]);
        let pairs = |vectors| Eigenpairs { values: vec![3.0, 3.0], vectors };
        let a = pairs(qr.clone()).canonical(1e-7);
        let b = pairs(combine(&qr, &turn)).canonical(1e-7);
        for i in 0..n {
            for j in 0..2 {
                assert!((a.vectors[(i, j)] - b.vectors[(i, j)]).abs() < 1e-12);
            }
        }
    }
}
