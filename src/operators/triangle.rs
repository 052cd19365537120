//! The triangle as the operators see it: three vertices, the cotangents of its angles, its area.
//!
//! Stiffness and every mass follow from these alone, wherever they come from. The squared length of the side
//! opposite to the angle α is 2|τ|(cot β + cot γ).

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
        let triangles = mesh.faces().iter().enumerate().map(|(face, &vertices)| {
            let triangle = Self::at(vertices, mesh.corners(vertices));
            let finite = triangle.cotangents.iter().all(|cotangent| cotangent.is_finite());
            let sound = finite && triangle.area.is_normal();
            if sound { Ok(triangle) } else { Err(OperatorError::Degenerate { face, vertices }) }
        });
        triangles.collect()
    }

    fn at(vertices: [u32; 3], [p, q, r]: [[f64; 3]; 3]) -> Self {
        let cotangents = [cotangent(p, q, r), cotangent(q, r, p), cotangent(r, p, q)];
        Self { vertices, cotangents, area: triangle_area([p, q, r]) }
    }
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
    fn a_face_without_angles_is_named() {
        let error = only([[0., 0., 0.], [1., 1., 1.], [3., 3., 3.]]).unwrap_err();
        assert_eq!(error, OperatorError::Degenerate { face: 0, vertices: [0, 1, 2] });
    }
}
