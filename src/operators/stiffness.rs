//! The cotangent stiffness L of (4) and (6), with the signs that make it positive semi-definite.

use super::{Pattern, Sparse, Triangle};

/// The cotangent stiffness L, n×n, symmetric positive semi-definite, unit-free: L_ij = −w_ij with
/// w_ij = (cot α_ij + cot β_ij)/2 (6), and rows that sum to zero. The pattern is that of the triangles.
pub fn cotangent_stiffness(pattern: &Pattern, triangles: &[Triangle]) -> Sparse {
    let entries = triangles.iter().enumerate().flat_map(|(face, triangle)| {
        let cotangents = triangle.cotangents;
        // Corner i is opposite to the edge (j, k).
        [(0, 1, 2), (1, 2, 0), (2, 0, 1)].into_iter().flat_map(move |(i, j, k)| {
            let half = 0.5 * cotangents[i];
            [(j, k, -half), (k, j, -half), (j, j, half), (k, k, half)]
                .map(|(row, column, value)| (face, row, column, value))
        })
    });
    pattern.assemble(entries)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{TriMesh, sample::icosphere};

    fn stiffness(mesh: &TriMesh) -> Sparse {
        cotangent_stiffness(&Pattern::of_mesh(mesh), &Triangle::of_mesh(mesh).unwrap())
    }

    #[test]
    fn the_unit_right_triangle_has_its_textbook_stiffness() {
        let mesh =
            TriMesh::new(vec![[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]], vec![[0, 1, 2]]).unwrap();
        let l = stiffness(&mesh);
        let expected = [[1.0, -0.5, -0.5], [-0.5, 0.5, 0.0], [-0.5, 0.0, 0.5]];
        for (i, row) in expected.iter().enumerate() {
            for (j, &value) in row.iter().enumerate() {
                let found = l.get(i, j).copied().unwrap_or(0.0);
                assert!((found - value).abs() < 1e-15, "L[{i},{j}] = {found}");
            }
        }
    }

    #[test]
    fn symmetric_with_rows_that_sum_to_zero() {
        let l = stiffness(&icosphere(2));
        for (i, row) in l.outer_iterator().enumerate() {
            assert!(row.iter().map(|(_, v)| v).sum::<f64>().abs() < 1e-13);
            for (j, &value) in row.iter() {
                assert_eq!(l.get(j, i), Some(&value));
            }
        }
    }
}
