//! Eigenpairs as a basis of functions, and which of them belong to λ = 0.
//!
//! A surface of c pieces has λ = 0 c times, and rounding makes something like 1e-15 of it. Formulas that divide by λ, or
//! take its logarithm, begin after these; sums over all eigenfunctions have them in.

use super::{Counted, Descriptor, TooFew};
use crate::spectrum::cluster::zero_below;
use crate::spectrum::{Dense, Eigenpairs};

/// K eigenvalues and eigenfunctions, n×K, B-orthonormal.
#[derive(Debug, Clone, Copy)]
pub struct Basis<'a> {
    /// λ by k, in 1/(input unit)²; learned ones ascend only from cluster to cluster.
    pub values: &'a [f64],
    /// φ, one a column.
    pub vectors: &'a Dense,
    /// At or below this λ counts as zero.
    zero: f64,
}

impl<'a> Basis<'a> {
    /// These pairs, on a surface of this total mass: 1ᵀB1, the area.
    pub fn new(pairs: &'a Eigenpairs, total_mass: f64) -> Self {
        Self { values: &pairs.values, vectors: &pairs.vectors, zero: zero_below(total_mass) }
    }

    /// n.
    pub fn n(&self) -> usize {
        self.vectors.nrows()
    }

    /// The columns with λ > 0, ascending.
    pub fn positive(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.values.len()).filter(|&j| self.values[j] > self.zero)
    }

    /// The smallest and the largest λ > 0, for a descriptor that takes `different` ones.
    ///
    /// # Errors
    /// When there are fewer.
    pub(super) fn range(
        &self,
        descriptor: Descriptor,
        different: usize,
    ) -> Result<[f64; 2], TooFew> {
        let positive = || self.positive().map(|j| self.values[j]);
        let (low, high) =
            (positive().fold(f64::INFINITY, f64::min), positive().fold(0.0, f64::max));
        let found = usize::from(high > 0.0) + usize::from(high > low);
        let (k, what) = (self.values.len(), Counted::Different);
        match found < different {
            true => Err(TooFew { descriptor, needed: different, what, found, k }),
            false => Ok([low, high]),
        }
    }

    /// The columns with λ > 0, for a descriptor that takes so many.
    ///
    /// # Errors
    /// When there are fewer.
    pub(super) fn first_positive(
        &self,
        descriptor: Descriptor,
        needed: usize,
    ) -> Result<Vec<usize>, TooFew> {
        let columns: Vec<usize> = self.positive().collect();
        let (k, what, found) = (self.values.len(), Counted::Functions, columns.len());
        match found < needed {
            true => Err(TooFew { descriptor, needed, what, found, k }),
            false => Ok(columns),
        }
    }

    /// φ_k(x)² for all k, n×K.
    pub(super) fn squares(&self) -> Dense {
        Dense::from_fn(self.n(), self.values.len(), |i, j| self.vectors[(i, j)].powi(2))
    }
}
