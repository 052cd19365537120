//! The row-normalised adjacency W = D⁻¹A of (5) and the graph Laplacian I − W.

use super::{Sparse, assemble};
use crate::mesh::TriMesh;

/// The adjacency W of (5), n×n: W_ij = 1/deg(i) for every edge (i, j). Rows sum to one.
pub fn adjacency(mesh: &TriMesh) -> Sparse {
    let edges = mesh.faces().iter().flat_map(|&[a, b, c]| {
        [(a, b), (b, a), (b, c), (c, b), (c, a), (a, c)].map(|(i, j)| (i, j, 1.0))
    });
    let mut w = assemble(mesh.n(), edges);
    for mut row in w.outer_iterator_mut() {
        let degree = row.nnz() as f64;
        for (_, value) in row.iter_mut() {
            *value = 1.0 / degree;
        }
    }
    w
}

/// The normalised graph Laplacian I − W of (5), n×n, not symmetric in general.
pub fn graph_laplacian(adjacency: &Sparse) -> Sparse {
    &Sparse::eye(adjacency.rows()) - adjacency
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::sample::icosphere;

    #[test]
    fn rows_of_w_sum_to_one_and_the_laplacian_kills_constants() {
        let w = adjacency(&icosphere(1));
        let laplacian = graph_laplacian(&w);
        assert_eq!(laplacian.nnz(), w.nnz() + w.rows());
        for (row, image) in w.outer_iterator().zip(laplacian.outer_iterator()) {
            assert!((row.data().iter().sum::<f64>() - 1.0).abs() < 1e-15);
            assert!(image.data().iter().sum::<f64>().abs() < 1e-15);
        }
    }
}
