//! Where the entries of a sparse operator stand: one pattern for adjacency, stiffness and consistent mass.
//!
//! First the pattern is found from the triangles, in time proportional to their number, and with it the place of each
//! pair of corners of each triangle. Then matrices are filled in without a search, each in the order in which its
//! entries are contributed, so that equal input gives equal bytes.

use super::Sparse;
use crate::mesh::TriMesh;

/// The places (i, i) and (i, j), for every edge (i, j), of an n×n matrix; columns ascend within a row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pattern {
    pointers: Vec<usize>,
    columns: Vec<u32>,
    /// For every triangle, the places of its pairs of corners (0, 0), (0, 1) … (2, 2).
    corners: Vec<[u32; 9]>,
}

/// What a triangle adds to an operator: triangle, corner of the row, corner of the column, value.
pub type Entry = (usize, usize, usize, f64);

impl Pattern {
    /// The pattern of `n` vertices and the triangles between them.
    ///
    /// # Panics
    /// When there are more pairs of corners than a `u32` can number, those of 477 million triangles.
    pub fn of(n: usize, faces: impl ExactSizeIterator<Item = [u32; 3]> + Clone) -> Self {
        assert!(9 * faces.len() < ROW as usize, "too many triangles to number their corners");
        let (starts, mut cells) = gathered(n, faces.clone());
        let mut columns = Vec::with_capacity(cells.len());
        let mut pointers = Vec::with_capacity(n + 1);
        let mut corners = vec![[0; 9]; faces.len()];
        let mut diagonal = Vec::with_capacity(n);
        pointers.push(0);
        for row in starts.windows(2) {
            let cells = &mut cells[row[0]..row[1]];
            cells.sort_unstable_by_key(|cell| cell.column);
            let mut last = None;
            for &Cell { column, pair } in &*cells {
                if last.replace(column) != Some(column) {
                    columns.push(column);
                }
                let place = columns.len() as u32 - 1;
                match corners.as_flattened_mut().get_mut(pair as usize) {
                    Some(corner) => *corner = place,
                    None => diagonal.push(place),
                }
            }
            pointers.push(columns.len());
        }
        for (places, face) in corners.iter_mut().zip(faces) {
            for (corner, vertex) in face.into_iter().enumerate() {
                places[4 * corner] = diagonal[vertex as usize];
            }
        }
        Self { pointers, columns, corners }
    }

    /// The pattern of a mesh.
    pub fn of_mesh(mesh: &TriMesh) -> Self {
        Self::of(mesh.n(), mesh.faces().iter().copied())
    }

    /// The number of vertices.
    pub fn n(&self) -> usize {
        self.pointers.len() - 1
    }

    /// The number of places.
    pub fn places(&self) -> usize {
        self.columns.len()
    }

    /// The columns of one row, ascending, its own among them.
    pub fn row(&self, row: usize) -> &[u32] {
        &self.columns[self.pointers[row]..self.pointers[row + 1]]
    }

    /// The number of neighbours of every vertex.
    pub fn degrees(&self) -> impl Iterator<Item = f64> + '_ {
        self.pointers.windows(2).map(|row| (row[1] - row[0] - 1) as f64)
    }

    /// The place of two corners of a triangle, counted row by row.
    pub fn place(&self, face: usize, row_corner: usize, column_corner: usize) -> usize {
        self.corners[face][3 * row_corner + column_corner] as usize
    }

    /// The matrix that the contributions of all triangles add up to.
    pub fn assemble(&self, entries: impl Iterator<Item = Entry>) -> Sparse {
        // The neutral element of addition: −0 + x has the bits of x.
        let mut values = vec![-0.0; self.places()];
        entries
            .for_each(|(face, row, column, value)| values[self.place(face, row, column)] += value);
        self.matrix(values)
    }

    /// The matrix with these values, one a place.
    pub fn matrix(&self, values: Vec<f64>) -> Sparse {
        let columns = self.columns.iter().map(|&column| column as usize).collect();
        Sparse::new((self.n(), self.n()), self.pointers.clone(), columns, values)
    }
}

/// A cell of a row, before cells of equal columns become one place.
#[derive(Clone, Copy)]
struct Cell {
    column: u32,
    /// 9·triangle + 3·corner + other corner, or [`ROW`] for the row's own column.
    pair: u32,
}

/// No pair of corners.
const ROW: u32 = u32::MAX;

/// The cells of every row, not in order, and where the rows start.
fn gathered(n: usize, faces: impl Iterator<Item = [u32; 3]> + Clone) -> (Vec<usize>, Vec<Cell>) {
    let mut starts = vec![0; n + 1];
    faces.clone().flatten().for_each(|vertex| starts[vertex as usize + 1] += 2);
    for row in 0..n {
        starts[row + 1] += starts[row] + 1;
    }
    let mut ends = starts.clone();
    let mut cells = vec![Cell { column: 0, pair: ROW }; starts[n]];
    let mut push = |row: u32, cell: Cell| {
        let end = &mut ends[row as usize];
        cells[*end] = cell;
        *end += 1;
    };
    (0..n as u32).for_each(|row| push(row, Cell { column: row, pair: ROW }));
    for (face, vertices) in (0..).zip(faces) {
        for (i, j) in [(0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)] {
            push(vertices[i], Cell { column: vertices[j], pair: 9 * face + (3 * i + j) as u32 });
        }
    }
    (starts, cells)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_sorted_and_without_repetition() {
        let pattern = Pattern::of(4, [[3, 0, 2], [2, 0, 1]].into_iter());
        let rows: Vec<&[u32]> = (0..4).map(|row| pattern.row(row)).collect();
        let expected: [&[u32]; 4] = [&[0, 1, 2, 3], &[0, 1, 2], &[0, 1, 2, 3], &[0, 2, 3]];
        assert_eq!(rows, expected);
        assert_eq!(pattern.degrees().collect::<Vec<_>>(), [3.0, 2.0, 3.0, 2.0]);
    }

    #[test]
    fn corners_know_their_places() {
        let faces = [[3, 0, 2], [2, 0, 1]];
        let pattern = Pattern::of(4, faces.into_iter());
        for (f, face) in faces.iter().enumerate() {
            for i in 0..3 {
                let start = pattern.pointers[face[i] as usize];
                for j in 0..3 {
                    let place = pattern.place(f, i, j);
                    assert_eq!(pattern.row(face[i] as usize)[place - start], face[j]);
                }
            }
        }
    }

    #[test]
    fn entries_of_one_place_add_up() {
        let pattern = Pattern::of(3, [[0, 2, 1]].into_iter());
        let matrix = pattern.assemble([(0, 0, 2, 1.0), (0, 1, 1, 3.0), (0, 0, 2, 0.5)].into_iter());
        assert_eq!(matrix.get(0, 1), Some(&1.5));
        assert_eq!(matrix.get(2, 2), Some(&3.0));
        assert_eq!(matrix.nnz(), 9);
    }

    #[test]
    fn a_triangle_may_meet_a_vertex_twice() {
        let pattern = Pattern::of(2, [[0, 0, 1]].into_iter());
        assert_eq!((pattern.row(0), pattern.row(1)), (&[0, 1][..], &[0, 1][..]));
        let places = [0, 1].map(|i| [0, 1].map(|j| pattern.place(0, i, j)));
        assert_eq!(places, [[0, 0], [0, 0]]);
    }
}
