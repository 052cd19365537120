//! Operators of the graph of vertices and edges, which know no geometry: the row-normalised adjacency
//! W = D⁻¹A of (5), the graph Laplacian I − W, and the symmetric pencil (D − A, D) with the same eigenpairs.

use super::{Pattern, Sparse};

/// The adjacency W of (5), n×n: W_ij = 1/deg(i) for every edge (i, j). Rows sum to one.
pub fn adjacency(pattern: &Pattern) -> Sparse {
    let n = pattern.n();
    let entries = pattern.places() - n;
    let (mut pointers, mut columns) = (Vec::with_capacity(n + 1), Vec::with_capacity(entries));
    let mut values = Vec::with_capacity(entries);
    pointers.push(0);
    for (row, degree) in pattern.degrees().enumerate() {
        columns.extend(pattern.row(row).iter().map(|&c| c as usize).filter(|&c| c != row));
        values.resize(columns.len(), 1.0 / degree);
        pointers.push(columns.len());
    }
    Sparse::new((n, n), pointers, columns, values)
}

/// The normalised graph Laplacian I − W of (5), n×n, not symmetric in general.
pub fn graph_laplacian(adjacency: &Sparse) -> Sparse {
    &Sparse::eye(adjacency.rows()) - adjacency
}

/// D − A, n×n, symmetric positive semi-definite: the stiffness whose pencil with the mass D has the eigenpairs of
/// I − W.
pub fn graph_stiffness(pattern: &Pattern) -> Sparse {
    let values = pattern.degrees().enumerate().flat_map(|(row, degree)| {
        let columns = pattern.row(row).iter();
        columns.map(move |&column| if column as usize == row { degree } else { -1.0 })
    });
    pattern.matrix(values.collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::sample::icosphere;

    #[test]
    fn rows_of_w_sum_to_one_and_the_laplacian_kills_constants() {
        let w = adjacency(&Pattern::of_mesh(&icosphere(1)));
        let laplacian = graph_laplacian(&w);
        assert_eq!(laplacian.nnz(), w.nnz() + w.rows());
        for (row, image) in w.outer_iterator().zip(laplacian.outer_iterator()) {
            assert!((row.data().iter().sum::<f64>() - 1.0).abs() < 1e-15);
            assert!(image.data().iter().sum::<f64>().abs() < 1e-15);
        }
    }

    #[test]
    fn the_symmetric_stiffness_is_d_times_the_laplacian() {
        let pattern = Pattern::of_mesh(&icosphere(1));
        let laplacian = graph_laplacian(&adjacency(&pattern));
        let stiffness = graph_stiffness(&pattern);
        for (row, degree) in pattern.degrees().enumerate() {
            for column in pattern.row(row).iter().map(|&column| column as usize) {
                let scaled = degree * laplacian.get(row, column).unwrap();
                assert!((stiffness.get(row, column).unwrap() - scaled).abs() < 1e-14);
            }
        }
    }
}
