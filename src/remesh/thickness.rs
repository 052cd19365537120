//! How far a triangle is from collapsing.

use crate::mesh::TriMesh;
use crate::mesh::trimesh::{dot, sub, triangle_area};

/// The ratio of a triangle's area to its squared longest side: √3/4 for an equilateral one, 0 for a collapsed one.
pub fn thickness(corners: [[f64; 3]; 3]) -> f64 {
    let [a, b, c] = corners;
    let sides = [sub(a, b), sub(b, c), sub(c, a)].map(|side| dot(side, side));
    triangle_area(corners) / sides.into_iter().fold(f64::MIN_POSITIVE, f64::max)
}

/// The smallest [`thickness`] of all triangles.
pub fn thinnest(mesh: &TriMesh) -> f64 {
    let thicknesses = mesh.faces().iter().map(|&face| thickness(mesh.corners(face)));
    thicknesses.fold(f64::INFINITY, f64::min)
}
