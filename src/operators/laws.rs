//! What operators may not depend on: where a mesh lies, its unit, and the order of its vertices and faces.

use proptest::prelude::*;

use super::{MassKind, OperatorOptions, Operators, Robust, Sparse};
use crate::mesh::{TriMesh, sample::icosphere};

const N: usize = 42;
const FACES: usize = 80;

/// A sphere with hills and valleys.
fn hills() -> impl Strategy<Value = TriMesh> {
    prop::collection::vec(0.7..1.3_f64, N).prop_map(|heights| {
        let mesh = icosphere(1);
        let hill = |(p, height): (&[f64; 3], f64)| p.map(|c| height * c);
        let vertices = mesh.vertices().iter().zip(heights).map(hill).collect();
        TriMesh::new(vertices, mesh.faces().to_vec()).unwrap()
    })
}

#[derive(Debug)]
struct Change {
    quaternion: [f64; 4],
    translation: [f64; 3],
    scale: f64,
    /// Where each vertex goes.
    vertices: Vec<usize>,
    /// Where each face comes from.
    faces: Vec<usize>,
}

fn change() -> impl Strategy<Value = Change> {
    let quaternion = prop::array::uniform4(-1.0..1.0_f64);
    let away_from_zero = |q: &[f64; 4]| q.iter().map(|c| c * c).sum::<f64>() > 0.01;
    (
        quaternion.prop_filter("a quaternion that can be normalised", away_from_zero),
        prop::array::uniform3(-5.0..5.0_f64),
        -3.0..3.0_f64,
        Just((0..N).collect::<Vec<_>>()).prop_shuffle(),
        Just((0..FACES).collect::<Vec<_>>()).prop_shuffle(),
    )
        .prop_map(|(quaternion, translation, exponent, vertices, faces)| Change {
            quaternion,
            translation,
            scale: 10f64.powf(exponent),
            vertices,
            faces,
        })
}

impl Change {
    fn of(&self, mesh: &TriMesh) -> TriMesh {
        let mut vertices = vec![[0.0; 3]; N];
        for (&to, &position) in self.vertices.iter().zip(mesh.vertices()) {
            let turned = rotate(self.quaternion, position);
            vertices[to] = std::array::from_fn(|i| self.scale * (turned[i] + self.translation[i]));
        }
        let face = |&from: &usize| {
            let mut face = mesh.faces()[from].map(|vertex| self.vertices[vertex as usize] as u32);
            face.rotate_left(from % 3);
            face
        };
        TriMesh::new(vertices, self.faces.iter().map(face).collect()).unwrap()
    }

    /// Whether `after` is `factor` times `before`, rows and columns where the vertices have gone.
    fn carries(&self, before: &Sparse, after: &Sparse, factor: f64) -> bool {
        let largest = before.data().iter().fold(0.0, |m: f64, entry| m.max(entry.abs()));
        let close = |(&entry, (i, j)): (&f64, (usize, usize))| {
            let moved = after.get(self.vertices[i], self.vertices[j]).unwrap_or(&0.0);
            (moved / factor - entry).abs() < 1e-10 * largest
        };
        before.iter().all(close) && after.nnz() == before.nnz()
    }
}

/// v + 2u × (u × v + wv), divided by the norm of the quaternion w + u squared.
fn rotate([w, u @ ..]: [f64; 4], v: [f64; 3]) -> [f64; 3] {
    use crate::mesh::trimesh::{cross, dot};
    let inner = cross(u, v);
    let outer = cross(u, std::array::from_fn(|i| inner[i] + w * v[i]));
    std::array::from_fn(|i| v[i] + 2.0 * outer[i] / (w * w + dot(u, u)))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..Default::default() })]

    #[test]
    fn stiffness_is_invariant_and_mass_scales_with_the_area(mesh in hills(), change in change()) {
        let moved = change.of(&mesh);
        for robust in Robust::ALL {
            for mass in [MassKind::Lumped, MassKind::Voronoi, MassKind::Consistent] {
                let options =
                    OperatorOptions { mass: Some(mass), robust, ..Default::default() };
                let before = Operators::assemble(&mesh, options).unwrap();
                let after = Operators::assemble(&moved, options).unwrap();
                let square = change.scale * change.scale;
                prop_assert!(change.carries(&before.stiffness, &after.stiffness, 1.0));
                prop_assert!(change.carries(&before.mass, &after.mass, square));
                prop_assert!(change.carries(&before.adjacency, &after.adjacency, 1.0));
                prop_assert!((after.area.0 / (square * before.area.0) - 1.0).abs() < 1e-10);
            }
        }
    }

    #[test]
    fn the_graph_does_not_see_where_vertices_lie(mesh in hills(), change in change()) {
        let before = Operators::assemble(&icosphere(1), MassKind::Degree).unwrap();
        let after = Operators::assemble(&change.of(&mesh), MassKind::Degree).unwrap();
        prop_assert!(change.carries(&before.stiffness, &after.stiffness, 1.0));
        prop_assert!(change.carries(&before.mass, &after.mass, 1.0));
    }
}
