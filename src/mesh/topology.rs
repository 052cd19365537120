//! What kind of surface a mesh is: pieces, boundary, handles, and the edges and vertices where it is none.
//!
//! Counts come from one sorted list of half-edges, in O(n log n), and do not depend on anything but the faces.

mod defects;
mod pieces;

use serde::Serialize;

use super::trimesh::TriMesh;
pub use defects::Defects;
pub use pieces::{Piece, pieces};

/// The topology of a mesh.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Topology {
    /// V, the number of vertices.
    pub vertices: usize,
    /// E, the number of edges.
    pub edges: usize,
    /// F, the number of triangles.
    pub faces: usize,
    /// Pieces that share no vertex: the multiplicity of λ = 0 without Dirichlet boundary. Pieces that touch in
    /// one vertex are one.
    pub components: usize,
    /// χ = V − E + F: 2 for a sphere, 0 for a torus or a Möbius strip, 1 for a disc.
    pub euler_characteristic: i64,
    /// Closed curves of edges with one triangle. Curves that touch in a vertex are several where the faces
    /// around that vertex do not join them.
    pub boundary_loops: usize,
    /// The vertices of edges with one triangle, ascending.
    pub boundary_vertices: Vec<u32>,
    /// Edges of more than two triangles: the surface branches there.
    pub non_manifold_edges: usize,
    /// Vertices whose triangles are not joined by edges around them: the surface is pinched there.
    pub non_manifold_vertices: usize,
    /// Edges whose two triangles pass them in the same direction. A surface that cannot be oriented, such as
    /// a Möbius strip, always has some.
    pub misoriented_edges: usize,
}

impl Topology {
    /// Examines a mesh.
    pub fn of(mesh: &TriMesh) -> Self {
        let faces = mesh.faces();
        let half_edges = sorted_half_edges(faces);
        let mut fans = Classes::new(3 * faces.len());
        let mut topology = Self {
            vertices: mesh.n(),
            edges: 0,
            faces: faces.len(),
            components: component_labels(mesh).iter().max().map_or(0, |&last| last as usize + 1),
            euler_characteristic: 0,
            boundary_loops: 0,
            boundary_vertices: Vec::new(),
            non_manifold_edges: 0,
            non_manifold_vertices: 0,
            misoriented_edges: 0,
        };
        let mut boundary = Vec::new();
        for edge in half_edges.chunk_by(|a, b| a.ends == b.ends) {
            topology.edges += 1;
            match edge {
                [alone] => boundary.push(*alone),
                [one, other] if one.ascending() == other.ascending() => {
                    topology.misoriented_edges += 1;
                }
                [_, _] => {}
                _ => topology.non_manifold_edges += 1,
            }
            join_fans(edge, &mut fans);
        }
        topology.euler_characteristic =
            topology.vertices as i64 - topology.edges as i64 + topology.faces as i64;
        topology.boundary_loops = count_loops(&boundary, &mut fans);
        topology.non_manifold_vertices = pinched(mesh, &mut fans).count();
        topology.boundary_vertices = boundary.iter().flat_map(|edge| edge.ends).collect();
        topology.boundary_vertices.sort_unstable();
        topology.boundary_vertices.dedup();
        topology
    }

    /// Whether there is no boundary.
    pub fn is_closed(&self) -> bool {
        self.boundary_vertices.is_empty()
    }

    /// Whether every point has a neighbourhood like a disc or a half-disc.
    pub fn is_manifold(&self) -> bool {
        self.non_manifold_edges == 0 && self.non_manifold_vertices == 0
    }

    /// Whether neighbouring triangles agree on which side is out.
    pub fn is_oriented(&self) -> bool {
        self.misoriented_edges == 0
    }
}

/// The component of each vertex. Components are numbered from 0 in the order of their lowest vertices.
pub fn component_labels(mesh: &TriMesh) -> Vec<u32> {
    let mut classes = Classes::new(mesh.n());
    for &[a, b, c] in mesh.faces() {
        classes.join(a as usize, b as usize);
        classes.join(b as usize, c as usize);
    }
    // A class is led by its lowest member, so its label exists when the others ask for it.
    let mut labels = vec![0; mesh.n()];
    let mut next = 0;
    for vertex in 0..mesh.n() {
        let leader = classes.leader(vertex);
        if leader == vertex {
            labels[vertex] = next;
            next += 1;
        } else {
            labels[vertex] = labels[leader];
        }
    }
    labels
}

/// A side of a triangle. Corner 3f + i is corner i of face f; half-edge 3f + i runs from it to the next one.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct HalfEdge {
    /// The two vertices, ascending.
    ends: [u32; 2],
    from: usize,
    to: usize,
    start: u32,
}

impl HalfEdge {
    fn ascending(&self) -> bool {
        self.start == self.ends[0]
    }

    fn lower_corner(&self) -> usize {
        if self.ascending() { self.from } else { self.to }
    }

    fn upper_corner(&self) -> usize {
        if self.ascending() { self.to } else { self.from }
    }
}

fn sorted_half_edges(faces: &[[u32; 3]]) -> Vec<HalfEdge> {
    let mut half_edges = Vec::with_capacity(3 * faces.len());
    for (f, face) in faces.iter().enumerate() {
        for (i, j) in [(0, 1), (1, 2), (2, 0)] {
            let (start, end) = (face[i], face[j]);
            half_edges.push(HalfEdge {
                ends: [start.min(end), start.max(end)],
                from: 3 * f + i,
                to: 3 * f + j,
                start,
            });
        }
    }
    half_edges.sort_unstable();
    half_edges
}

/// Makes the corners at either end of an edge, given by all its half-edges, one fan.
fn join_fans(edge: &[HalfEdge], fans: &mut Classes) {
    for pair in edge.windows(2) {
        fans.join(pair[0].lower_corner(), pair[1].lower_corner());
        fans.join(pair[0].upper_corner(), pair[1].upper_corner());
    }
}

/// Boundary edges follow one another where they end in the same fan: corners of one vertex joined by edges.
fn count_loops(boundary: &[HalfEdge], fans: &mut Classes) -> usize {
    let mut loops = fans.clone();
    for edge in boundary {
        loops.join(edge.from, edge.to);
    }
    let mut leaders: Vec<usize> = boundary.iter().map(|e| loops.leader(e.from)).collect();
    leaders.sort_unstable();
    leaders.dedup();
    leaders.len()
}

/// The vertices with more than one fan, ascending.
fn pinched<'a>(mesh: &TriMesh, fans: &'a mut Classes) -> impl Iterator<Item = u32> + use<'a> {
    let mut fans_at = vec![0_u32; mesh.n()];
    for (corner, &vertex) in mesh.faces().iter().flatten().enumerate() {
        if fans.leader(corner) == corner {
            fans_at[vertex as usize] += 1;
        }
    }
    (0..).zip(fans_at).filter(|&(_, fans)| fans > 1).map(|(vertex, _)| vertex)
}

/// Disjoint sets of 0..n, each led by its lowest member.
#[derive(Clone)]
struct Classes {
    parent: Vec<usize>,
}

impl Classes {
    fn new(n: usize) -> Self {
        Self { parent: (0..n).collect() }
    }

    fn leader(&mut self, mut member: usize) -> usize {
        while self.parent[member] != member {
            // Halving the path keeps later look-ups short.
            self.parent[member] = self.parent[self.parent[member]];
            member = self.parent[member];
        }
        member
    }

    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.leader(a), self.leader(b));
        self.parent[a.max(b)] = a.min(b);
    }
}

#[cfg(test)]
mod tests;
