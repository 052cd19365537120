//! The sphere as an icosahedron whose faces are split.

use crate::mesh::subdivide::subdivide;
use crate::mesh::trimesh::{TriMesh, norm};

/// The unit sphere: an icosahedron whose faces are split in four `levels` times, vertices pushed onto the
/// sphere. Has 10·4^levels + 2 vertices. Spectrum of S²: l(l+1) with multiplicity 2l+1.
pub fn icosphere(levels: u32) -> TriMesh {
    let t = (1.0 + 5.0_f64.sqrt()) / 2.0;
    let vertices: Vec<[f64; 3]> = [
        [-1., t, 0.],
        [1., t, 0.],
        [-1., -t, 0.],
        [1., -t, 0.],
        [0., -1., t],
        [0., 1., t],
        [0., -1., -t],
        [0., 1., -t],
        [t, 0., -1.],
        [t, 0., 1.],
        [-t, 0., -1.],
        [-t, 0., 1.],
    ]
    .map(onto_sphere)
    .to_vec();
    let faces: Vec<[u32; 3]> = vec![
        [0, 11, 5],
        [0, 5, 1],
        [0, 1, 7],
        [0, 7, 10],
        [0, 10, 11],
        [1, 5, 9],
        [5, 11, 4],
        [11, 10, 2],
        [10, 7, 6],
        [7, 1, 8],
        [3, 9, 4],
        [3, 4, 2],
        [3, 2, 6],
        [3, 6, 8],
        [3, 8, 9],
        [4, 9, 5],
        [2, 4, 11],
        [6, 2, 10],
        [8, 6, 7],
        [9, 8, 1],
    ];
    let mut mesh = TriMesh::new(vertices, faces).expect("an icosahedron is a valid mesh");
    for _ in 0..levels {
        let corners = mesh.n();
        let finer = subdivide(&mesh);
        let mut vertices = finer.vertices().to_vec();
        vertices[corners..].iter_mut().for_each(|p| *p = onto_sphere(*p));
        mesh = TriMesh::new(vertices, finer.faces().to_vec())
            .expect("a subdivided icosahedron is a valid mesh");
    }
    mesh
}

fn onto_sphere(p: [f64; 3]) -> [f64; 3] {
    let length = norm(p);
    p.map(|c| c / length)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_icosphere_closes_on_the_sphere() {
        let mesh = icosphere(3);
        assert_eq!(mesh.n(), 10 * 64 + 2);
        assert_eq!(mesh.faces().len(), 20 * 64);
        let area = mesh.area().0 / (4.0 * std::f64::consts::PI);
        assert!((0.98..1.0).contains(&area), "area ratio {area}");
    }
}
