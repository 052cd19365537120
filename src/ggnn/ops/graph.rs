//! A sparse matrix in the precision of the network, and its products with features.

use pulp::Arch;

use super::real::{Real, axpy};
use crate::operators::Sparse;

/// A square sparse matrix with n rows, in compressed rows, with its transpose at hand for the backward pass.
#[derive(Debug, Clone)]
pub struct Graph<E> {
    forward: Rows<E>,
    backward: Rows<E>,
}

#[derive(Debug, Clone)]
struct Rows<E> {
    pointers: Vec<usize>,
    columns: Vec<u32>,
    values: Vec<E>,
}

impl<E: Real> Graph<E> {
    /// Rounds `matrix` to the precision of the network.
    pub fn new(matrix: &Sparse) -> Self {
        Self { forward: Rows::new(matrix), backward: Rows::new(&matrix.transpose_view().to_csr()) }
    }

    /// The number of rows.
    pub fn n(&self) -> usize {
        self.forward.pointers.len() - 1
    }

    /// W x for row-major x, n×h; `write(i, row)` places row i.
    pub fn for_each_row(&self, x: &[E], h: usize, write: impl FnMut(usize, &[E])) {
        self.forward.for_each_row(x, h, write);
    }

    /// Wᵀ x for row-major x, n×h.
    pub fn for_each_transposed_row(&self, x: &[E], h: usize, write: impl FnMut(usize, &[E])) {
        self.backward.for_each_row(x, h, write);
    }
}

impl<E: Real> Rows<E> {
    fn new(matrix: &Sparse) -> Self {
        Self {
            pointers: matrix.proper_indptr().into_owned(),
            columns: matrix.indices().iter().map(|&j| j as u32).collect(),
            values: matrix.data().iter().map(|&v| E::round(v)).collect(),
        }
    }

    fn for_each_row(&self, x: &[E], h: usize, mut write: impl FnMut(usize, &[E])) {
        Arch::new().dispatch(|| {
            let mut sum = vec![E::default(); h];
            for (i, range) in self.pointers.windows(2).enumerate() {
                sum.fill(E::default());
                for at in range[0]..range[1] {
                    let j = self.columns[at] as usize;
                    axpy(self.values[at], &x[j * h..(j + 1) * h], &mut sum);
                }
                write(i, &sum);
            }
        });
    }
}
