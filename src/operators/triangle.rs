//! The triangle as the operators see it: three vertices, the cotangents of its angles, its area.
//!
//! Stiffness and every mass follow from these alone, wherever they come from. The squared length of the side
//! opposite to the angle α is 2|τ|(cot β + cot γ).

use rayon::prelude::*;

use super::OperatorError;
use crate::mesh::TriMesh;
use crate::mesh::trimesh::{cross, dot, norm, sub, triangle_area};

/// A triangle τ of a triangulation, in the plane of its own metric.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Triangle {
    /// Its vertices.
    pub vertices: [u32; 3],
    /// The cotangent of the angle at each vertex.
    pub cotangents: [f64; 3],
    /// |τ|, in squared input units.
    pub area: f64,
}

impl Triangle {
    /// The triangles of a mesh, by its positions, in the order of its faces.
    ///
    /// # Errors
    /// [`OperatorError::Degenerate`] for a face whose angles double precision cannot tell.
    pub fn of_mesh(mesh: &TriMesh) -> Result<Vec<Self>, OperatorError> {
        let faces = mesh.faces().par_iter();
        let triangles: Vec<Self> =
            faces.map(|&vertices| Self::at(vertices, mesh.corners(vertices))).collect();
        match triangles.iter().position(|triangle| !triangle.is_sound()) {
            Some(face) => Err(OperatorError::Degenerate { face, vertices: mesh.faces()[face] }),
            None => Ok(triangles),
        }
    }

    /// The triangle whose side i, from corner i to the next, has `lengths[i]`. Angles and area are as accurate as the
    /// differences of the lengths (Kahan, "Miscalculating Area and Angles of a Needle-like Triangle"); they are not
    /// finite where one length exceeds the sum of the others.
    pub fn of_lengths(vertices: [u32; 3], lengths: [f64; 3]) -> Self {
        let [perimeter, excess @ ..] = kahan(lengths);
        let [a, b, c] = excess;
        let area = 0.25 * (perimeter * a).sqrt() * (b * c).sqrt();
        // cot = (s(s − a) − (s − b)(s − c))/2|τ| at the corner opposite to a, with all factors doubled.
        let cotangent = |a: f64, b: f64, c: f64| (perimeter * a - b * c) / (8.0 * area);
        // Corner i is opposite to side i + 1.
        Self {
            vertices,
            cotangents: [cotangent(b, c, a), cotangent(c, a, b), cotangent(a, b, c)],
            area,
        }
    }

    /// Whether all angles and the area are numbers to compute with.
    pub fn is_sound(&self) -> bool {
        self.cotangents.iter().all(|cotangent| cotangent.is_finite()) && self.area.is_normal()
    }

    fn at(vertices: [u32; 3], [p, q, r]: [[f64; 3]; 3]) -> Self {
        let cotangents = [cotangent(p, q, r), cotangent(q, r, p), cotangent(r, p, q)];
        Self { vertices, cotangents, area: triangle_area([p, q, r]) }
    }
}

/// The perimeter of a triangle, and by how much two sides exceed the first, second and third: a + b + c, b + c − a,
/// c + a − b, a + b − c, in the order of operations that loses nothing.
fn kahan(lengths: [f64; 3]) -> [f64; 4] {
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| lengths[j].total_cmp(&lengths[i]));
    let [x, y, z] = order.map(|i| lengths[i]);
    let mut factors = [x + (y + z); 4];
    for (i, excess) in order.into_iter().zip([z - (x - y), z + (x - y), x + (y - z)]) {
        factors[1 + i] = excess;
    }
    factors
}

/// The cotangent of the angle at `p` in the triangle (p, q, r).
fn cotangent(p: [f64; 3], q: [f64; 3], r: [f64; 3]) -> f64 {
    let (u, v) = (sub(q, p), sub(r, p));
    dot(u, v) / norm(cross(u, v))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn only(corners: [[f64; 3]; 3]) -> Result<Triangle, OperatorError> {
        let mesh = TriMesh::new(corners.to_vec(), vec![[0, 1, 2]]).unwrap();
        Ok(Triangle::of_mesh(&mesh)?[0])
    }

    #[test]
    fn half_a_square() {
        let triangle = only([[0., 0., 0.], [2., 0., 0.], [0., 2., 0.]]).unwrap();
        assert_eq!(triangle.cotangents, [0.0, 1.0, 1.0]);
        assert_eq!(triangle.area, 2.0);
    }

    #[test]
    fn lengths_give_what_positions_give() {
        let [p, q, r] = [[0.1, 0.2, 0.3], [1.1, -0.4, 0.7], [0.5, 0.9, 1.6]];
        let by_positions = only([p, q, r]).unwrap();
        let lengths = [sub(q, p), sub(r, q), sub(p, r)].map(norm);
        let by_lengths = Triangle::of_lengths([0, 1, 2], lengths);
        for (a, b) in by_positions.cotangents.iter().zip(by_lengths.cotangents) {
            assert!((a - b).abs() < 1e-14, "{a} {b}");
        }
        assert!((by_positions.area - by_lengths.area).abs() < 1e-14);
    }

    #[test]
    fn needles_keep_their_digits() {
        // Isosceles with legs 1 and base b: area b/4 √(4 − b²), cot of a base angle b/√(4 − b²).
        let base = 1e-9_f64;
        let root = (4.0 - base * base).sqrt();
        let needle = Triangle::of_lengths([0, 1, 2], [base, 1.0, 1.0]);
        assert!((needle.area / (0.25 * base * root) - 1.0).abs() < 1e-15);
        assert!((needle.cotangents[0] - base / root).abs() < 1e-15);
        assert!((needle.cotangents[2] * base - 1.0).abs() < 1e-15);
    }

    #[test]
    fn lengths_of_no_triangle_are_not_sound() {
        assert!(!Triangle::of_lengths([0, 1, 2], [1.0, 1.0, 3.0]).is_sound());
        assert!(!Triangle::of_lengths([0, 1, 2], [1.0, 2.0, 3.0]).is_sound());
    }

    #[test]
    fn a_face_without_angles_is_named() {
        let error = only([[0., 0., 0.], [1., 1., 1.], [3., 3., 3.]]).unwrap_err();
        assert_eq!(error, OperatorError::Degenerate { face: 0, vertices: [0, 1, 2] });
    }
}
