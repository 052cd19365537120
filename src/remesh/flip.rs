//! The same vertices with other triangles: the diagonals of nearly flat pairs of triangles are exchanged.

use rand::Rng;
use rand::seq::SliceRandom;

use super::edges::Edges;
use super::thickness::thickness;
use crate::mesh::TriMesh;
use crate::mesh::trimesh::{area_normal, dot, unit};

/// Two triangles are flat enough when they, and the two that take their place, lie within this angle of their mean: the
/// cosine of 15°. Where they are not coplanar, a flip changes the surface.
const LEAST_COSINE: f64 = 0.965_925_826_289_068_3;

/// No triangle becomes thinner than this, unless one of the two that it comes from is: an equilateral pair gives 0.144.
const THINNEST: f64 = 0.1;

/// Flips up to the given `share` of all edges, drawn at random.
///
/// An edge stays where it is no edge of two triangles that agree on which side is out, where they are not flat enough,
/// where the other diagonal is an edge already, and where a triangle would turn over or become much thinner. A surface
/// that is manifold stays so.
pub fn flip(mesh: &TriMesh, share: f64, rng: &mut impl Rng) -> TriMesh {
    let mut faces = mesh.faces().to_vec();
    let mut edges = Edges::of(&faces);
    let mut drawn = edges.all();
    drawn.shuffle(rng);
    drawn.truncate((share * drawn.len() as f64).round() as usize);
    for edge in drawn {
        if let Some(pair) = edges.pair(&faces, edge) {
            let corners = |pair: [[u32; 3]; 2]| pair.map(|face| mesh.corners(face));
            if is_sound(corners(pair.triangles()), corners(pair.exchanged())) {
                edges.exchange(&mut faces, &pair);
            }
        }
    }
    TriMesh::new(mesh.vertices().to_vec(), faces)
        .expect("a flip keeps every vertex in use and makes no triangle of two vertices")
}

/// Whether the `new` pair of triangles may take the place of the `old` one.
fn is_sound(old: [[[f64; 3]; 3]; 2], new: [[[f64; 3]; 3]; 2]) -> bool {
    let flat = || {
        let [n, m, k, l] =
            [old[0], old[1], new[0], new[1]].map(|corners| unit(area_normal(corners)));
        let normals = [n?, m?, k?, l?];
        let mean = unit(std::array::from_fn(|i| normals[0][i] + normals[1][i]))?;
        Some(normals.iter().all(|&normal| dot(normal, mean) >= LEAST_COSINE))
    };
    let thinner = |pair: [[[f64; 3]; 3]; 2]| thickness(pair[0]).min(thickness(pair[1]));
    thinner(new) >= THINNEST.min(thinner(old)) && flat() == Some(true)
}

#[cfg(test)]
mod tests {
    use super::super::thickness::thinnest;
    use super::*;
    use crate::mesh::{Topology, load, sample::icosphere};
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    fn rng() -> ChaCha8Rng {
        ChaCha8Rng::seed_from_u64(3)
    }

    #[test]
    fn the_surface_stays_manifold_with_the_same_vertices() {
        for mesh in [icosphere(3), spot()] {
            let before = Topology::of(&mesh);
            let flipped = flip(&mesh, 0.5, &mut rng());
            let after = Topology::of(&flipped);
            assert_eq!(before, after);
            assert!(after.is_manifold() && after.is_oriented());
            assert_eq!(mesh.vertices(), flipped.vertices());
            let changed = flipped.faces().iter().zip(mesh.faces()).filter(|(a, b)| a != b).count();
            assert!(changed > mesh.faces().len() / 8, "{changed}");
            assert!(thinnest(&flipped) >= THINNEST.min(thinnest(&mesh)));
            let ratio = flipped.area().0 / mesh.area().0;
            assert!((ratio - 1.0).abs() < 5e-3, "{ratio}");
        }
    }

    fn spot() -> TriMesh {
        load("tests/data/meshes/spot_829.obj".as_ref()).unwrap().mesh
    }

    #[test]
    fn a_square_changes_its_diagonal_and_a_dart_or_a_roof_does_not() {
        let pair = |d: [f64; 3]| {
            let vertices = vec![[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], d];
            let mesh = TriMesh::new(vertices, vec![[0, 1, 2], [0, 2, 3]]).unwrap();
            flip(&mesh, 1.0, &mut rng()).faces().to_vec()
        };
        let unchanged = vec![[0, 1, 2], [0, 2, 3]];
        assert_eq!(pair([0., 1., 0.]), vec![[0, 1, 3], [1, 2, 3]]);
        assert_eq!(pair([-0.5, -0.2, 0.]), unchanged);
        assert_eq!(pair([0.4, 0.6, 1.]), unchanged);
    }

    #[test]
    fn a_tetrahedron_has_no_other_triangles() {
        let vertices = vec![[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0.3, 0.3, 1e-3]];
        let faces = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
        let mesh = TriMesh::new(vertices, faces).unwrap();
        assert_eq!(flip(&mesh, 1.0, &mut rng()), mesh);
    }
}
