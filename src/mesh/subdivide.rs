//! Midpoint subdivision: every triangle becomes four, and the surface stays where it is.

use std::collections::HashMap;

use super::trimesh::TriMesh;

/// Splits every triangle of `mesh` at the middles of its sides.
///
/// The vertices keep their numbers; the middles follow, one an edge, in the order in which the triangles meet them.
pub fn subdivide(mesh: &TriMesh) -> TriMesh {
    let mut vertices = mesh.vertices().to_vec();
    let mut middles = HashMap::new();
    let mut middle = |a: u32, b: u32| {
        *middles.entry([a.min(b), a.max(b)]).or_insert_with(|| {
            let (p, q) = (vertices[a as usize], vertices[b as usize]);
            vertices.push(std::array::from_fn(|i| 0.5 * p[i] + 0.5 * q[i]));
            (vertices.len() - 1) as u32
        })
    };
    let mut faces = Vec::with_capacity(4 * mesh.faces().len());
    for &[a, b, c] in mesh.faces() {
        let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
        faces.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
    }
    TriMesh::new(vertices, faces).expect("the middles of a valid mesh's edges make a valid mesh")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Topology, sample::icosphere};

    #[test]
    fn the_surface_stays_and_every_triangle_has_a_quarter_of_the_area() {
        let mesh = icosphere(1);
        let finer = subdivide(&mesh);
        let (before, after) = (Topology::of(&mesh), Topology::of(&finer));
        assert_eq!(after.vertices, before.vertices + before.edges);
        assert_eq!(after.euler_characteristic, before.euler_characteristic);
        assert!(after.is_oriented() && after.is_manifold() && after.is_closed());
        assert_eq!(finer.vertices()[..mesh.n()], *mesh.vertices());
        let quarters = mesh.face_areas().flat_map(|area| [0.25 * area; 4]);
        assert!(finer.face_areas().zip(quarters).all(|(a, b)| (a - b).abs() < 1e-15));
    }
}
