//! The cotangent stiffness L of (4) and (6), with the signs that make it positive semi-definite.

use super::{Sparse, assemble};
use crate::mesh::TriMesh;
use crate::mesh::trimesh::{cross, dot, norm, sub};

/// The cotangent stiffness L, n×n, symmetric positive semi-definite, unit-free: L_ij = −w_ij with
/// w_ij = (cot α_ij + cot β_ij)/2 (6), and rows that sum to zero.
pub fn cotangent_stiffness(mesh: &TriMesh) -> Sparse {
    let entries = mesh.faces().iter().flat_map(|&face| {
        let corners = mesh.corners(face);
        // Corner i is opposite to the edge (j, k).
        [(0, 1, 2), (1, 2, 0), (2, 0, 1)].into_iter().flat_map(move |(i, j, k)| {
            let half = 0.5 * cotangent(corners[i], corners[j], corners[k]);
            let (a, b) = (face[j], face[k]);
            [(a, b, -half), (b, a, -half), (a, a, half), (b, b, half)]
        })
    });
    assemble(mesh.n(), entries)
}

/// The cotangent of the angle at `p` in the triangle (p, q, r).
fn cotangent(p: [f64; 3], q: [f64; 3], r: [f64; 3]) -> f64 {
    let (u, v) = (sub(q, p), sub(r, p));
    dot(u, v) / norm(cross(u, v))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::sample::icosphere;

    #[test]
    fn the_unit_right_triangle_has_its_textbook_stiffness() {
        let mesh =
            TriMesh::new(vec![[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]], vec![[0, 1, 2]]).unwrap();
        let l = cotangent_stiffness(&mesh);
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
        let l = cotangent_stiffness(&icosphere(2));
        for (i, row) in l.outer_iterator().enumerate() {
            assert!(row.iter().map(|(_, v)| v).sum::<f64>().abs() < 1e-13);
            for (j, &value) in row.iter() {
                assert_eq!(l.get(j, i), Some(&value));
            }
        }
    }
}
