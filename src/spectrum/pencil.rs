//! The pair (L, B) of the generalised eigenproblem (8), and its products with blocks of vectors.

use faer::{Accum, Par, linalg::matmul::matmul};
use rayon::prelude::*;

use super::Dense;
use crate::operators::{Operators, Sparse};

/// The symmetric pencil (L, B): L positive semi-definite, B positive definite, both n×n.
#[derive(Debug, Clone, Copy)]
pub struct Pencil<'a> {
    /// The stiffness L.
    pub stiffness: &'a Sparse,
    /// The mass B.
    pub mass: &'a Sparse,
}

/// A symmetric positive definite B, n×n, known by what it does to a function: a matrix, or a sum over triangles.
pub trait InnerProduct: Sync {
    /// y = B x.
    fn apply(&self, x: &[f64], y: &mut [f64]);

    /// xᵀBx.
    fn square(&self, x: &[f64]) -> f64;

    /// B X for a block of columns.
    fn product(&self, x: &Dense) -> Dense {
        let mut y = Dense::zeros(x.nrows(), x.ncols());
        let columns: Vec<&mut [f64]> = columns_mut(&mut y).collect();
        columns.into_par_iter().enumerate().for_each(|(j, y)| self.apply(column(x, j), y));
        y
    }
}

impl InnerProduct for Sparse {
    fn apply(&self, x: &[f64], y: &mut [f64]) {
        apply(self, x, y);
    }

    fn square(&self, x: &[f64]) -> f64 {
        quadratic(self, x)
    }
}

impl<'a> From<&'a Operators> for Pencil<'a> {
    fn from(operators: &'a Operators) -> Self {
        Self { stiffness: &operators.stiffness, mass: &operators.mass }
    }
}

impl Pencil<'_> {
    /// The number of rows.
    pub fn n(&self) -> usize {
        self.stiffness.rows()
    }

    /// The area: 1ᵀB1. The scale that every shift and tolerance is relative to.
    pub fn area(&self) -> f64 {
        self.mass.data().iter().sum()
    }

    /// The Rayleigh quotient (13) of one vector.
    pub fn rayleigh_quotient(&self, x: &[f64]) -> f64 {
        quadratic(self.stiffness, x) / quadratic(self.mass, x)
    }

    /// (XᵀLX, XᵀBX) for a block X, each k×k and exactly symmetric.
    pub fn projected(&self, x: &Dense) -> (Dense, Dense) {
        (projection(self.stiffness, x), projection(self.mass, x))
    }
}

/// A · X for a block of columns.
pub fn product(a: &Sparse, x: &Dense) -> Dense {
    let mut y = Dense::zeros(a.rows(), x.ncols());
    for j in 0..x.ncols() {
        apply(a, column(x, j), column_mut(&mut y, j));
    }
    y
}

/// y = A x.
pub fn apply(a: &Sparse, x: &[f64], y: &mut [f64]) {
    let (indices, data) = (a.indices(), a.data());
    let indptr = a.indptr();
    for (row, y) in y.iter_mut().enumerate() {
        let range = indptr.outer_inds_sz(row);
        *y = indices[range.clone()].iter().zip(&data[range]).map(|(&j, v)| v * x[j]).sum();
    }
}

/// xᵀAx.
pub fn quadratic(a: &Sparse, x: &[f64]) -> f64 {
    a.outer_iterator()
        .zip(x)
        .map(|(row, xi)| xi * row.iter().map(|(j, v)| v * x[j]).sum::<f64>())
        .sum()
}

/// XᵀAX for symmetric A, made exactly symmetric.
pub fn projection(a: &Sparse, x: &Dense) -> Dense {
    let mut p = inner(x, &product(a, x));
    for j in 0..p.ncols() {
        for i in 0..j {
            let mean = 0.5 * (p[(i, j)] + p[(j, i)]);
            p[(i, j)] = mean;
            p[(j, i)] = mean;
        }
    }
    p
}

/// XᵀY.
pub fn inner(x: &Dense, y: &Dense) -> Dense {
    let mut p = Dense::zeros(x.ncols(), y.ncols());
    matmul(p.as_mut(), Accum::Replace, x.transpose(), y.as_ref(), 1.0, Par::Seq);
    p
}

/// X C.
pub fn combine(x: &Dense, c: &Dense) -> Dense {
    let mut y = Dense::zeros(x.nrows(), c.ncols());
    matmul(y.as_mut(), Accum::Replace, x.as_ref(), c.as_ref(), 1.0, Par::Seq);
    y
}

/// X ← X − Φ (ΦᵀB) X for a B-orthonormal Φ whose BΦ is given: the projection P of section IV.
pub fn project_out(x: &mut Dense, phi: &Dense, b_phi: &Dense) {
    if phi.ncols() == 0 {
        return;
    }
    let coefficients = inner(b_phi, x);
    matmul(x.as_mut(), Accum::Add, phi.as_ref(), coefficients.as_ref(), -1.0, Par::Seq);
}

/// Column `j` as a slice.
pub fn column(x: &Dense, j: usize) -> &[f64] {
    x.col(j).try_as_col_major().expect("columns of Dense are contiguous").as_slice()
}

/// Column `j` as a mutable slice.
pub fn column_mut(x: &mut Dense, j: usize) -> &mut [f64] {
    x.col_mut(j).try_as_col_major_mut().expect("columns of Dense are contiguous").as_slice_mut()
}

/// All columns as mutable slices.
pub fn columns_mut(x: &mut Dense) -> impl Iterator<Item = &mut [f64]> {
    x.col_iter_mut().map(|column| {
        column.try_as_col_major_mut().expect("columns of Dense are contiguous").as_slice_mut()
    })
}

/// xᵀy, in eight running sums that fit one wide register.
pub fn dot(x: &[f64], y: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (xs, ys) = (x.chunks_exact(8), y.chunks_exact(8));
    let tail: f64 = xs.remainder().iter().zip(ys.remainder()).map(|(a, b)| a * b).sum();
    for (x, y) in xs.zip(ys) {
        for k in 0..8 {
            sums[k] += x[k] * y[k];
        }
    }
    sums.iter().sum::<f64>() + tail
}
