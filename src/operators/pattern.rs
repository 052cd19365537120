//! Where the entries of a sparse operator stand: one pattern for adjacency, stiffness and consistent mass.
//!
//! First the pattern is found from the triangles, in time proportional to their number; then matrices are
//! filled in, each in the order in which its entries are contributed, so that equal input gives equal bytes.

use super::Sparse;
use crate::mesh::TriMesh;

/// The places (i, i) and (i, j), for every edge (i, j), of an n×n matrix; columns ascend within a row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pattern {
    pointers: Vec<usize>,
    columns: Vec<usize>,
}

impl Pattern {
    /// The pattern of `n` vertices and the triangles between them.
    pub fn of(n: usize, faces: impl Iterator<Item = [u32; 3]> + Clone) -> Self {
        let (starts, mut columns) = gathered(n, faces);
        let mut pointers = Vec::with_capacity(n + 1);
        let mut kept = 0;
        pointers.push(0);
        for row in starts.windows(2) {
            columns[row[0]..row[1]].sort_unstable();
            let start = kept;
            for next in row[0]..row[1] {
                if kept == start || columns[kept - 1] != columns[next] {
                    columns[kept] = columns[next];
                    kept += 1;
                }
            }
            pointers.push(kept);
        }
        columns.truncate(kept);
        Self { pointers, columns: columns.into_iter().map(|column| column as usize).collect() }
    }

    /// The pattern of a mesh.
    pub fn of_mesh(mesh: &TriMesh) -> Self {
        Self::of(mesh.n(), mesh.faces().iter().copied())
    }

    /// The number of vertices.
    pub fn n(&self) -> usize {
        self.pointers.len() - 1
    }

    /// The columns of one row, ascending, its own among them.
    pub fn row(&self, row: usize) -> &[usize] {
        &self.columns[self.pointers[row]..self.pointers[row + 1]]
    }

    /// The number of neighbours of every vertex.
    pub fn degrees(&self) -> impl Iterator<Item = f64> + '_ {
        self.pointers.windows(2).map(|row| (row[1] - row[0] - 1) as f64)
    }

    /// The matrix to whose places (row, column) these values add up.
    ///
    /// # Panics
    /// When an entry stands outside the pattern.
    pub fn assemble(&self, entries: impl Iterator<Item = (u32, u32, f64)>) -> Sparse {
        // The neutral element of addition: −0 + x has the bits of x.
        let mut values = vec![-0.0; self.columns.len()];
        entries.for_each(|(row, column, value)| values[self.place(row, column)] += value);
        let n = self.n();
        Sparse::new((n, n), self.pointers.clone(), self.columns.clone(), values)
    }

    fn place(&self, row: u32, column: u32) -> usize {
        let place = self.row(row as usize).iter().position(|&c| c == column as usize);
        self.pointers[row as usize] + place.expect("entries are contributed by the triangles")
    }
}

/// For every row its own column and two for each of its triangles, not in order; and where the rows start.
fn gathered(n: usize, faces: impl Iterator<Item = [u32; 3]> + Clone) -> (Vec<usize>, Vec<u32>) {
    let mut starts = vec![0; n + 1];
    faces.clone().flatten().for_each(|vertex| starts[vertex as usize + 1] += 2);
    for row in 0..n {
        starts[row + 1] += starts[row] + 1;
    }
    let mut ends = starts.clone();
    let mut columns = vec![0; starts[n]];
    let mut push = |row: u32, column: u32| {
        let end = &mut ends[row as usize];
        columns[*end] = column;
        *end += 1;
    };
    (0..n as u32).for_each(|vertex| push(vertex, vertex));
    for [a, b, c] in faces {
        for (row, others) in [(a, [b, c]), (b, [c, a]), (c, [a, b])] {
            others.into_iter().for_each(|column| push(row, column));
        }
    }
    (starts, columns)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_sorted_and_without_repetition() {
        let pattern = Pattern::of(5, [[4, 0, 2], [2, 0, 1]].into_iter());
        let rows: Vec<&[usize]> = (0..5).map(|row| pattern.row(row)).collect();
        let expected: [&[usize]; 5] = [&[0, 1, 2, 4], &[0, 1, 2], &[0, 1, 2, 4], &[3], &[0, 2, 4]];
        assert_eq!(rows, expected);
        assert_eq!(pattern.degrees().collect::<Vec<_>>(), [3.0, 2.0, 3.0, 0.0, 2.0]);
    }

    #[test]
    fn entries_of_one_place_add_up() {
        let pattern = Pattern::of(3, [[0, 1, 2]].into_iter());
        let matrix = pattern.assemble([(0, 1, 1.0), (2, 2, 3.0), (0, 1, 0.5)].into_iter());
        assert_eq!(matrix.get(0, 1), Some(&1.5));
        assert_eq!(matrix.get(2, 2), Some(&3.0));
        assert_eq!(matrix.nnz(), 9);
    }

    #[test]
    fn a_triangle_may_meet_a_vertex_twice() {
        let pattern = Pattern::of(2, [[0, 0, 1]].into_iter());
        assert_eq!((pattern.row(0), pattern.row(1)), (&[0, 1][..], &[0, 1][..]));
    }
}
