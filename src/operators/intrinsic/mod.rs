//! A triangulation by edge lengths, for meshes whose own triangles are too thin to compute with.
//!
//! After Sharp and Crane, "A Laplacian for Nonmanifold Triangle Meshes" (2020):
//! - [`cover`]: two sheets of the surface, glued so that every edge has two triangles, if that is asked for
//! - [`mollify`]: all edges become longer by the little that makes the thinnest triangles fat enough
//! - [`delaunay`]: edges are flipped inside the surface until no weight between two triangles is negative
//!
//! Vertices, and the surface but for the little, stay what they are. Triangles are glued by their sides, so that
//! neither a common orientation nor any orientation at all is needed. Without the cover, edges of three or more
//! triangles are not flipped, and their weights may stay negative; nor are those of the boundary.

mod cover;
mod delaunay;
mod mollify;

pub use delaunay::is_delaunay;

use super::gluing::{Gluing, Side};
use super::{OperatorError, Pattern, Triangle};
use crate::mesh::TriMesh;
use crate::mesh::trimesh::{norm, sub};

/// Triangles, the lengths of their sides, and how they are glued.
#[derive(Debug, Clone, PartialEq)]
pub struct IntrinsicTriangulation {
    vertices: Vec<[u32; 3]>,
    /// Of side i of each triangle, from corner i to the next. Glued sides have the same.
    lengths: Vec<[f64; 3]>,
    gluing: Gluing,
}

/// What was done to a triangulation.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Remedies {
    /// What every edge was lengthened by, in input units.
    pub mollification: f64,
    /// How many edges were flipped.
    pub flips: usize,
}

impl IntrinsicTriangulation {
    /// The mollified intrinsic Delaunay triangulation of a mesh.
    pub fn robust(mesh: &TriMesh, pattern: &Pattern, gluing: Gluing) -> (Self, Remedies) {
        let mut triangulation = Self::of_mesh(mesh, gluing);
        let mollification = triangulation.mollify(mean_edge_length(mesh, pattern));
        let flips = triangulation.flip_to_delaunay();
        (triangulation, Remedies { mollification, flips })
    }

    /// The mollified intrinsic Delaunay triangulation of the tufted cover of a mesh: every sum over it is twice that over
    /// the surface.
    pub fn tufted(mesh: &TriMesh, pattern: &Pattern) -> (Self, Remedies) {
        let mut triangulation = Self::of_cover(mesh, pattern);
        let mollification = triangulation.mollify(mean_edge_length(mesh, pattern));
        let flips = triangulation.flip_to_delaunay();
        (triangulation, Remedies { mollification, flips })
    }

    /// The triangles of the mesh itself.
    fn of_mesh(mesh: &TriMesh, gluing: Gluing) -> Self {
        let lengths = mesh.faces().iter().map(|&face| {
            let [p, q, r] = mesh.corners(face);
            [norm(sub(q, p)), norm(sub(r, q)), norm(sub(p, r))]
        });
        Self { vertices: mesh.faces().to_vec(), lengths: lengths.collect(), gluing }
    }

    /// Angles and areas.
    ///
    /// # Errors
    /// [`OperatorError::Collapsed`] when double precision cannot tell them.
    pub fn triangles(&self) -> Result<Vec<Triangle>, OperatorError> {
        let triangles = (0..self.vertices.len()).map(|face| {
            let vertices = self.vertices[face];
            let triangle = self.triangle(face);
            if triangle.is_sound() {
                Ok(triangle)
            } else {
                Err(OperatorError::Collapsed { vertices })
            }
        });
        triangles.collect()
    }

    /// How the triangles are glued.
    pub fn into_gluing(self) -> Gluing {
        self.gluing
    }

    fn triangle(&self, face: usize) -> Triangle {
        Triangle::of_lengths(self.vertices[face], self.lengths[face])
    }

    /// The vertex where a side starts.
    fn start(&self, side: Side) -> u32 {
        self.vertices[side.face()][side.index()]
    }

    fn length(&self, side: Side) -> f64 {
        self.lengths[side.face()][side.index()]
    }
}

fn mean_edge_length(mesh: &TriMesh, pattern: &Pattern) -> f64 {
    let (mut sum, mut count) = (0.0, 0_usize);
    for (i, &p) in mesh.vertices().iter().enumerate() {
        for j in pattern.row(i).iter().map(|&j| j as usize).filter(|&j| j > i) {
            sum += norm(sub(mesh.vertices()[j], p));
            count += 1;
        }
    }
    sum / count as f64
}

#[cfg(test)]
mod tests;
