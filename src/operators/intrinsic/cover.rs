//! The tufted cover of a mesh: every triangle twice, as a front and a back, and around every edge each front or back
//! glued to the one that it faces.
//!
//! Every edge of the cover has two triangles, however many met at the edge of the mesh; at the boundary a front meets
//! its own back. So the cover is closed, is oriented, and has an intrinsic Delaunay triangulation. It covers the surface
//! twice: half of its operators are those of the surface. A closed manifold mesh has two copies of itself for a cover.

use super::IntrinsicTriangulation;
use crate::mesh::TriMesh;
use crate::mesh::trimesh::{cross, dot, sub, unit};
use crate::operators::Pattern;
use crate::operators::gluing::{Gluing, Run, Side};

/// Triangle f of the mesh is 2f and, turned over, 2f + 1 of the cover.
fn front(side: Side) -> Side {
    Side::new(2 * side.face(), side.index())
}

/// The same side of the back (b, a, c) of a triangle (a, b, c).
fn back(side: Side) -> Side {
    Side::new(2 * side.face() + 1, [0, 2, 1][side.index()])
}

impl IntrinsicTriangulation {
    /// The triangles of the cover, with the lengths of the mesh.
    pub(super) fn of_cover(mesh: &TriMesh, pattern: &Pattern) -> Self {
        let faces = mesh.faces().len();
        let sheet = Self::of_mesh(mesh, Gluing::none(0));
        let vertices = sheet.vertices.iter().flat_map(|&[a, b, c]| [[a, b, c], [b, a, c]]);
        let lengths = sheet.lengths.iter().flat_map(|&[p, q, r]| [[p, q, r], [p, r, q]]);
        let mut gluing = Gluing::none(2 * faces);
        for around in edges(mesh, pattern) {
            let next = around.iter().cycle().skip(1);
            for (this, next) in around.iter().zip(next) {
                gluing.glue(this.up, next.down, Run::Against);
            }
        }
        Self { vertices: vertices.collect(), lengths: lengths.collect(), gluing }
    }
}

/// A triangle at an edge.
struct AtEdge {
    /// Where it stands around the edge, seen along it from its lower vertex: an angle in radians.
    angle: f64,
    /// The side of its front or back that runs up the edge. Its normal points towards larger angles.
    up: Side,
    /// That of the other one.
    down: Side,
}

/// For every edge of a mesh the triangles around it, by ascending angle.
fn edges(mesh: &TriMesh, pattern: &Pattern) -> Vec<Vec<AtEdge>> {
    let mut edges: Vec<Vec<AtEdge>> = Vec::new();
    edges.resize_with(pattern.places(), Vec::new);
    for (face, vertices) in mesh.faces().iter().enumerate() {
        for side in [0, 1, 2].map(|index| Side::new(face, index)) {
            let [i, j, k] = [side, side.next(), side.previous()].map(Side::index);
            let ascends = vertices[i] < vertices[j];
            let (lower, upper) = if ascends { (i, j) } else { (j, i) };
            let (up, down) =
                if ascends { (front(side), back(side)) } else { (back(side), front(side)) };
            let corners =
                [lower, upper, k].map(|corner| mesh.vertices()[vertices[corner] as usize]);
            let angle = angle(corners);
            edges[pattern.place(face, lower, upper)].push(AtEdge { angle, up, down });
        }
    }
    edges.retain(|around| !around.is_empty());
    // The order of equal angles is that of the faces.
    edges.iter_mut().for_each(|around| around.sort_by(|a, b| a.angle.total_cmp(&b.angle)));
    edges
}

/// The angle of the half-plane through r whose border is the line from p to q, from a direction that depends on the
/// line alone.
fn angle([p, q, r]: [[f64; 3]; 3]) -> f64 {
    let along = unit(sub(q, p)).unwrap_or([1.0, 0.0, 0.0]);
    // The axis that is farthest from the line.
    let axis = (0..3).min_by(|&i, &j| along[i].abs().total_cmp(&along[j].abs())).unwrap_or(0);
    let mut other = [0.0; 3];
    other[axis] = 1.0;
    let first = cross(along, other);
    let second = cross(along, first);
    let towards = sub(r, p);
    dot(towards, second).atan2(dot(towards, first))
}
