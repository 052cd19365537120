//! A sparse matrix in the precision of the network, and its products with features.

use std::ops::Range;

use pulp::{Arch, NullaryFnOnce};

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

    /// The columns of the entries of one row, ascending: the neighbours of a vertex, for an adjacency.
    pub fn neighbours(&self, row: usize) -> &[u32] {
        let Rows { pointers, columns, .. } = &self.forward;
        &columns[pointers[row]..pointers[row + 1]]
    }

    /// W x for row-major x, n×h; `write(i, row)` places row i.
    pub fn for_each_row(&self, x: &[E], h: usize, write: impl FnMut(usize, &[E])) {
        self.forward.for_each_row(x, h, 0..h, write);
    }

    /// Wᵀ x for the given columns x of a row-major matrix with rows of length `stride`.
    pub fn for_each_transposed_row(
        &self,
        matrix: &[E],
        stride: usize,
        columns: Range<usize>,
        write: impl FnMut(usize, &[E]),
    ) {
        self.backward.for_each_row(matrix, stride, columns, write);
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

    fn for_each_row(
        &self,
        matrix: &[E],
        stride: usize,
        columns: Range<usize>,
        write: impl FnMut(usize, &[E]),
    ) {
        Arch::new().dispatch(Product { rows: self, matrix, stride, columns, write });
    }
}

/// One product as an operation that pulp compiles for the widest registers: a closure in its place is called, not
/// inlined, and stays narrow.
struct Product<'a, E, F> {
    rows: &'a Rows<E>,
    matrix: &'a [E],
    stride: usize,
    columns: Range<usize>,
    write: F,
}

impl<E: Real, F: FnMut(usize, &[E])> NullaryFnOnce for Product<'_, E, F> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { rows, matrix, stride, columns, mut write } = self;
        let mut sum = vec![E::default(); columns.len()];
        for (i, range) in rows.pointers.windows(2).enumerate() {
            sum.fill(E::default());
            for at in range[0]..range[1] {
                let j = rows.columns[at] as usize;
                let row = &matrix[j * stride..(j + 1) * stride];
                axpy(rows.values[at], &row[columns.clone()], &mut sum);
            }
            write(i, &sum);
        }
    }
}
