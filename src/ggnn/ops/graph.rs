//! A sparse matrix in the precision of the network, and its products with features.

use std::ops::Range;
use std::sync::OnceLock;

use pulp::{Arch, NullaryFnOnce};

use super::real::Real;
use crate::operators::{Pattern, Sparse};

/// A square sparse matrix with n rows, in compressed rows, with its transpose for the backward pass.
#[derive(Debug, Clone)]
pub struct Graph<E> {
    forward: Rows<E>,
    /// Made when it is first asked for: a prediction has no backward pass.
    backward: OnceLock<Rows<E>>,
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
        Self { forward: Rows::new(matrix), backward: OnceLock::new() }
    }

    /// The adjacency W of (5): 1/deg(i) for every edge (i, j).
    pub fn of_edges(edges: &Pattern) -> Self {
        let n = edges.n();
        let mut rows = Rows::with_capacity(n, edges.places() - n);
        for (row, degree) in edges.degrees().enumerate() {
            rows.columns.extend(edges.row(row).iter().filter(|&&column| column as usize != row));
            rows.values.resize(rows.columns.len(), E::round(1.0 / degree));
            rows.pointers.push(rows.columns.len());
        }
        Self { forward: rows, backward: OnceLock::new() }
    }

    /// n vertices without any edge.
    pub fn empty(n: usize) -> Self {
        let mut rows = Rows::with_capacity(n, 0);
        rows.pointers.resize(n + 1, 0);
        Self { forward: rows, backward: OnceLock::new() }
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
        self.forward.for_each_row(0..self.n(), x, h, 0..h, write);
    }

    /// The given rows of W x alone.
    pub fn for_rows(&self, rows: Range<usize>, x: &[E], h: usize, write: impl FnMut(usize, &[E])) {
        self.forward.for_each_row(rows, x, h, 0..h, write);
    }

    /// The given rows of Wᵀ x, for the given columns x of a row-major matrix with rows of length `stride`.
    pub fn for_transposed_rows(
        &self,
        rows: Range<usize>,
        matrix: &[E],
        stride: usize,
        columns: Range<usize>,
        write: impl FnMut(usize, &[E]),
    ) {
        let backward = self.backward.get_or_init(|| self.forward.transposed());
        backward.for_each_row(rows, matrix, stride, columns, write);
    }
}

impl<E: Real> Rows<E> {
    fn with_capacity(n: usize, entries: usize) -> Self {
        let mut pointers = Vec::with_capacity(n + 1);
        pointers.push(0);
        let (columns, values) = (Vec::with_capacity(entries), Vec::with_capacity(entries));
        Self { pointers, columns, values }
    }

    /// The transpose of a square matrix, columns ascending in its rows.
    fn transposed(&self) -> Self {
        let n = self.pointers.len() - 1;
        let mut pointers = vec![0; n + 1];
        self.columns.iter().for_each(|&column| pointers[column as usize + 1] += 1);
        (0..n).for_each(|row| pointers[row + 1] += pointers[row]);
        let mut ends = pointers.clone();
        let (mut columns, mut values) =
            (vec![0; self.columns.len()], vec![E::default(); self.values.len()]);
        for (row, range) in self.pointers.windows(2).enumerate() {
            for at in range[0]..range[1] {
                let end = &mut ends[self.columns[at] as usize];
                (columns[*end], values[*end]) = (row as u32, self.values[at]);
                *end += 1;
            }
        }
        Self { pointers, columns, values }
    }

    fn new(matrix: &Sparse) -> Self {
        Self {
            pointers: matrix.proper_indptr().into_owned(),
            columns: matrix.indices().iter().map(|&j| j as u32).collect(),
            values: matrix.data().iter().map(|&v| E::round(v)).collect(),
        }
    }

    fn for_each_row(
        &self,
        range: Range<usize>,
        matrix: &[E],
        stride: usize,
        columns: Range<usize>,
        write: impl FnMut(usize, &[E]),
    ) {
        Arch::new().dispatch(Product { rows: self, range, matrix, stride, columns, write });
    }
}

/// One product as an operation that pulp compiles for the widest registers: a closure in its place is called, not
/// inlined, and stays narrow.
struct Product<'a, E, F> {
    rows: &'a Rows<E>,
    range: Range<usize>,
    matrix: &'a [E],
    stride: usize,
    columns: Range<usize>,
    write: F,
}

impl<E: Real, F: FnMut(usize, &[E])> NullaryFnOnce for Product<'_, E, F> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { rows, range: all, matrix, stride, columns, mut write } = self;
        let mut sum = vec![E::default(); columns.len()];
        for i in all {
            let range = &rows.pointers[i..i + 2];
            sum.fill(E::default());
            let entries = rows.values[range[0]..range[1]].iter();
            let terms = entries.zip(&rows.columns[range[0]..range[1]]).map(
                #[inline(always)]
                |(&value, &j)| (value, &matrix[j as usize * stride..][columns.clone()]),
            );
            E::add_rows(&mut sum, terms);
            write(i, &sum);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::finite_differences::values;
    use super::*;
    use crate::mesh::sample::icosphere;
    use crate::operators::adjacency::adjacency;

    #[test]
    fn edges_give_the_adjacency_and_it_has_its_transpose() {
        let edges = Pattern::of_mesh(&icosphere(1));
        let w = adjacency(&edges);
        let turned = w.transpose_view().to_csr();
        let (h, x) = (5, values(5 * w.rows(), 3));
        let product = |w: &Sparse, i: usize, j: usize| -> f64 {
            let row = w.outer_view(i).unwrap();
            row.iter().map(|(column, w)| w * x[column * h + j]).sum()
        };
        for graph in [Graph::of_edges(&edges), Graph::new(&w)] {
            let mut seen = 0;
            graph.for_rows(3..7, &x, h, |i, row| {
                row.iter().enumerate().for_each(|(j, v)| assert_eq!(*v, product(&w, i, j)));
                seen += 1;
            });
            assert_eq!(seen, 4);
            graph.for_transposed_rows(0..graph.n(), &x, h, 0..h, |i, row| {
                let close = |(j, v): (usize, &f64)| (v - product(&turned, i, j)).abs() < 1e-15;
                assert!(row.iter().enumerate().all(close));
            });
        }
    }

    #[test]
    fn without_edges_there_is_nothing_to_add_up() {
        let graph = Graph::<f64>::empty(3);
        assert_eq!(graph.n(), 3);
        graph.for_each_row(&[1.0; 6], 2, |_, row| assert_eq!(row, [0.0; 2]));
    }
}
