//! Where a mesh is no surface, or is wound in two ways: the first few places of each kind.

use serde::Serialize;

use super::{Classes, join_fans, pinched, sorted_half_edges};
use crate::mesh::trimesh::TriMesh;

/// The first few edges and vertices that [`Topology`](super::Topology) counts, in ascending order, by the rows of
/// their vertices in the mesh.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Defects {
    /// Edges of more than two triangles.
    pub non_manifold_edges: Vec<[u32; 2]>,
    /// Vertices whose triangles are not joined by edges around them.
    pub non_manifold_vertices: Vec<u32>,
    /// Edges whose two triangles pass them in the same direction.
    pub misoriented_edges: Vec<[u32; 2]>,
}

impl Defects {
    /// The first `most` of each kind.
    pub fn of(mesh: &TriMesh, most: usize) -> Self {
        let half_edges = sorted_half_edges(mesh.faces());
        let mut fans = Classes::new(3 * mesh.faces().len());
        let mut defects = Self::default();
        for edge in half_edges.chunk_by(|a, b| a.ends == b.ends) {
            join_fans(edge, &mut fans);
            let found = match edge {
                [one, other] if one.ascending() == other.ascending() => {
                    &mut defects.misoriented_edges
                }
                [_] | [_, _] => continue,
                _ => &mut defects.non_manifold_edges,
            };
            if found.len() < most {
                found.extend(edge.first().map(|half| half.ends));
            }
        }
        defects.non_manifold_vertices = pinched(mesh, &mut fans).take(most).collect();
        defects
    }
}
