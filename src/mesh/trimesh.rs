//! The canonical triangle mesh: what every later stage can rely on.
//!
//! A [`TriMesh`] is validated once, at construction: finite `f64` positions, triangles of three different
//! in-range vertices, at least one triangle, and no vertex that no triangle uses.

use super::hash::MeshHash;

/// A surface area in squared input units.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub struct Area(pub f64);

/// A triangle mesh M = (X, T): `n` vertices in ℝ³ and their triangles, all valid.
#[derive(Debug, Clone, PartialEq)]
pub struct TriMesh {
    vertices: Vec<[f64; 3]>,
    faces: Vec<[u32; 3]>,
}

/// Why positions and triangles do not make a [`TriMesh`].
///
/// Readers and repair prevent each of these with a message that names the place in the file; seeing one
/// elsewhere means that mesh data was built by hand.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum InvalidMesh {
    /// There is no triangle to integrate over.
    #[error("the mesh has no triangles")]
    Empty,
    /// A coordinate is NaN or infinite.
    #[error("vertex {vertex} has a coordinate that is not finite")]
    NotFinite { vertex: usize },
    /// A triangle names a vertex that does not exist.
    #[error("face {face} refers to vertex {index}, but there are only {vertices} vertices")]
    OutOfRange { face: usize, index: u32, vertices: usize },
    /// A triangle uses the same vertex twice.
    #[error("face {face} uses vertex {index} twice")]
    RepeatedVertex { face: usize, index: u32 },
    /// A vertex belongs to no triangle: its row of the mass matrix would be zero.
    #[error("vertex {vertex} belongs to no face")]
    Unreferenced { vertex: usize },
}

impl TriMesh {
    /// Validates `vertices` (positions) and `faces` (zero-based vertex indices).
    ///
    /// # Errors
    /// The first rule of [`InvalidMesh`] that is broken.
    pub fn new(vertices: Vec<[f64; 3]>, faces: Vec<[u32; 3]>) -> Result<Self, InvalidMesh> {
        if faces.is_empty() {
            return Err(InvalidMesh::Empty);
        }
        if let Some(vertex) = vertices.iter().position(|p| !p.iter().all(|c| c.is_finite())) {
            return Err(InvalidMesh::NotFinite { vertex });
        }
        let mut referenced = vec![false; vertices.len()];
        for (face, &[a, b, c]) in faces.iter().enumerate() {
            for index in [a, b, c] {
                let Some(seen) = referenced.get_mut(index as usize) else {
                    return Err(InvalidMesh::OutOfRange { face, index, vertices: vertices.len() });
                };
                *seen = true;
            }
            if a == b || a == c {
                return Err(InvalidMesh::RepeatedVertex { face, index: a });
            }
            if b == c {
                return Err(InvalidMesh::RepeatedVertex { face, index: b });
            }
        }
        if let Some(vertex) = referenced.iter().position(|seen| !seen) {
            return Err(InvalidMesh::Unreferenced { vertex });
        }
        Ok(Self { vertices, faces })
    }

    /// Positions, one per vertex, in input units.
    pub fn vertices(&self) -> &[[f64; 3]] {
        &self.vertices
    }

    /// Triangles as zero-based vertex indices.
    pub fn faces(&self) -> &[[u32; 3]] {
        &self.faces
    }

    /// The number of vertices, `n` (the paper's n_V).
    pub fn n(&self) -> usize {
        self.vertices.len()
    }

    /// The corner positions of one triangle.
    pub fn corners(&self, face: [u32; 3]) -> [[f64; 3]; 3] {
        face.map(|i| self.vertices[i as usize])
    }

    /// The area of every triangle, |τ_j|.
    pub fn face_areas(&self) -> impl Iterator<Item = f64> + '_ {
        self.faces.iter().map(|&face| triangle_area(self.corners(face)))
    }

    /// The surface area.
    pub fn area(&self) -> Area {
        Area(self.face_areas().sum())
    }

    /// A third of the area of the triangles around each vertex: b_i of (6), length `n`.
    pub fn vertex_areas(&self) -> Vec<f64> {
        let mut areas = vec![0.0; self.n()];
        for (face, area) in self.faces.iter().zip(self.face_areas()) {
            for &i in face {
                areas[i as usize] += area / 3.0;
            }
        }
        areas
    }

    /// The content hash of geometry and connectivity.
    pub fn hash(&self) -> MeshHash {
        MeshHash::of(&self.vertices, &self.faces)
    }
}

/// The area of the triangle with these corners.
pub fn triangle_area([a, b, c]: [[f64; 3]; 3]) -> f64 {
    0.5 * norm(cross(sub(b, a), sub(c, a)))
}

/// Twice the area of a triangle along its normal.
pub fn area_normal([a, b, c]: [[f64; 3]; 3]) -> [f64; 3] {
    cross(sub(b, a), sub(c, a))
}

/// A vector of length 1; none for zero.
pub fn unit(v: [f64; 3]) -> Option<[f64; 3]> {
    let length = norm(v);
    (length > 0.0).then(|| v.map(|c| c / length))
}

/// a − b.
pub fn sub(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[i] - b[i])
}

/// The inner product of two vectors of ℝ³.
pub fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// a × b.
pub fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The Euclidean length of a vector of ℝ³.
pub fn norm(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square() -> TriMesh {
        TriMesh::new(
            vec![[0., 0., 0.], [2., 0., 0.], [2., 2., 0.], [0., 2., 0.]],
            vec![[0, 1, 2], [0, 2, 3]],
        )
        .unwrap()
    }

    #[test]
    fn areas_of_a_square() {
        let mesh = square();
        assert_eq!(mesh.area(), Area(4.0));
        let thirds = mesh.vertex_areas();
        assert!((thirds[0] - 4.0 / 3.0).abs() < 1e-15);
        assert!((thirds[1] - 2.0 / 3.0).abs() < 1e-15);
    }

    #[test]
    fn each_broken_rule_is_named() {
        let p = |x: f64| [x, x * x, 0.0];
        let four = || vec![p(0.), p(1.), p(2.), p(3.)];
        assert_eq!(TriMesh::new(four(), vec![]), Err(InvalidMesh::Empty));
        assert_eq!(
            TriMesh::new(four(), vec![[0, 1, 9]]),
            Err(InvalidMesh::OutOfRange { face: 0, index: 9, vertices: 4 })
        );
        assert_eq!(
            TriMesh::new(four(), vec![[0, 1, 2], [3, 1, 1]]),
            Err(InvalidMesh::RepeatedVertex { face: 1, index: 1 })
        );
        assert_eq!(
            TriMesh::new(four(), vec![[0, 1, 2]]),
            Err(InvalidMesh::Unreferenced { vertex: 3 })
        );
        assert_eq!(
            TriMesh::new(vec![p(0.), p(f64::NAN), p(1.)], vec![[0, 1, 2]]),
            Err(InvalidMesh::NotFinite { vertex: 1 })
        );
    }
}
