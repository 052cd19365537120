//! The unit sphere, evenly but not regularly: a Fibonacci lattice, turned at random, its vertices moved along the sphere.
//!
//! The triangles are those of the convex hull, which are Delaunay on the sphere: seen from one vertex, all others are
//! projected onto the plane (stereographically, which takes circles to circles), and what bounds the plane's Delaunay
//! triangulation is joined to the one.

use std::f64::consts::{PI, TAU};

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use spade::{DelaunayTriangulation, Point2, Triangulation};

use super::revolution::GOLDEN;
use crate::mesh::TriMesh;
use crate::mesh::trimesh::{cross, dot, unit};

/// How far a vertex moves at most in each direction, in mean distances.
const JITTER: f64 = 0.25;

/// A sampling with `n` ≥ 12 vertices.
pub(super) fn sample(n: usize, rng: &mut ChaCha8Rng) -> Option<TriMesh> {
    let turn = turning(rng);
    let far = JITTER * (4.0 * PI / n as f64).sqrt();
    let point = |i: usize| {
        let z = 1.0 - (2 * i + 1) as f64 / n as f64;
        let (sin, cos) = (TAU * GOLDEN * i as f64).sin_cos();
        let r = (1.0 - z * z).sqrt();
        let moved =
            turn.map(|axis| dot(axis, [r * cos, r * sin, z]) + far * rng.random_range(-1.0..1.0));
        unit(moved)
    };
    let vertices: Vec<[f64; 3]> = (0..n).map(point).collect::<Option<_>>()?;
    TriMesh::new(vertices.clone(), hull(&vertices)?).ok()
}

/// A rotation: the rows of its matrix, from a random unit quaternion (Shoemake 1992).
fn turning(rng: &mut ChaCha8Rng) -> [[f64; 3]; 3] {
    let [share, one, two] = [1.0, TAU, TAU].map(|most| rng.random_range(0.0..most));
    let (near, far) = ((1.0_f64 - share).sqrt(), share.sqrt());
    let (x, y, z, w) = (near * one.sin(), near * one.cos(), far * two.sin(), far * two.cos());
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

/// The triangles of the convex hull of points on the unit sphere, seen from outside counterclockwise.
fn hull(points: &[[f64; 3]]) -> Option<Vec<[u32; 3]>> {
    let pole = points[0];
    // Two directions across it, the first from the axis that is farthest from it.
    let axis = (0..3).min_by(|&a, &b| pole[a].abs().total_cmp(&pole[b].abs()))?;
    let across = unit(cross(pole, std::array::from_fn(|c| f64::from(c == axis))))?;
    let third = cross(pole, across);
    let mut plane = DelaunayTriangulation::<Point2<f64>>::new();
    for &point in &points[1..] {
        let down = 1.0 - dot(point, pole);
        plane.insert(Point2::new(dot(point, across) / down, dot(point, third) / down)).ok()?;
    }
    // In the order of insertion, after the pole; seen from outside, the plane is seen from below.
    let index = |v: usize| v as u32 + 1;
    let mut faces: Vec<[u32; 3]> = plane
        .inner_faces()
        .map(|face| {
            let [a, b, c] = face.vertices().map(|v| index(v.index()));
            [a, c, b]
        })
        .collect();
    // The hull's edges have the outside on their left.
    faces.extend(
        plane.convex_hull().map(|edge| [index(edge.to().index()), index(edge.from().index()), 0]),
    );
    Some(faces)
}
