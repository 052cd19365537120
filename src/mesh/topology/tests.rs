use super::*;
use crate::mesh::sample::icosphere;

/// A mesh with these faces; where its vertices lie does not matter here.
fn mesh(faces: &[[u32; 3]]) -> TriMesh {
    let n = faces.iter().flatten().max().unwrap() + 1;
    let position = |i| [f64::from(i), f64::from(i * i), f64::from(i * i * i)];
    TriMesh::new((0..n).map(position).collect(), faces.to_vec()).unwrap()
}

/// An m × n grid of squares, glued along both directions: a torus.
fn torus(m: u32, n: u32) -> TriMesh {
    let at = |i: u32, j: u32| (i % m) * n + j % n;
    let squares = (0..m).flat_map(|i| (0..n).map(move |j| (i, j)));
    let faces: Vec<_> = squares
        .flat_map(|(i, j)| {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    mesh(&faces)
}

#[test]
fn closed_surfaces_by_genus() {
    let sphere = Topology::of(&icosphere(2));
    assert_eq!((sphere.vertices, sphere.edges, sphere.faces), (162, 480, 320));
    assert_eq!((sphere.euler_characteristic, sphere.components), (2, 1));
    assert!(sphere.is_closed() && sphere.is_manifold() && sphere.is_oriented());

    let torus = Topology::of(&torus(5, 4));
    assert_eq!((torus.edges, torus.faces), (60, 40));
    assert_eq!((torus.euler_characteristic, torus.boundary_loops), (0, 0));
    assert!(torus.is_manifold() && torus.is_oriented());
}

#[test]
fn one_triangle_is_a_disc() {
    let topology = Topology::of(&mesh(&[[0, 1, 2]]));
    assert_eq!((topology.euler_characteristic, topology.boundary_loops), (1, 1));
    assert_eq!(topology.boundary_vertices, [0, 1, 2]);
}

#[test]
fn an_annulus_has_two_loops_and_a_flipped_face_shows() {
    // A ring of four squares between the squares 0–3 and 4–7.
    let mut faces: Vec<[u32; 3]> = (0..4)
        .flat_map(|i| {
            let j = (i + 1) % 4;
            [[i, j, 4 + j], [i, 4 + j, 4 + i]]
        })
        .collect();
    let topology = Topology::of(&mesh(&faces));
    assert_eq!((topology.euler_characteristic, topology.boundary_loops), (0, 2));
    assert_eq!(topology.boundary_vertices, [0, 1, 2, 3, 4, 5, 6, 7]);
    assert!(topology.is_oriented());
    faces[2].swap(0, 1);
    // One of its three edges is boundary.
    assert_eq!(Topology::of(&mesh(&faces)).misoriented_edges, 2);
}

#[test]
fn a_moebius_strip_of_five_triangles() {
    let faces = [0, 1, 2, 3, 4].map(|i| [i, (i + 1) % 5, (i + 2) % 5]);
    let topology = Topology::of(&mesh(&faces));
    assert_eq!((topology.euler_characteristic, topology.boundary_loops), (0, 1));
    assert!(topology.is_manifold() && !topology.is_oriented());
}

#[test]
fn two_triangles_that_touch_in_a_vertex() {
    let bow_tie = mesh(&[[0, 1, 2], [2, 3, 4]]);
    let topology = Topology::of(&bow_tie);
    assert_eq!((topology.components, topology.boundary_loops), (1, 2));
    assert_eq!((topology.non_manifold_vertices, topology.non_manifold_edges), (1, 0));
    assert_eq!(topology.boundary_vertices, [0, 1, 2, 3, 4]);
}

#[test]
fn three_triangles_on_one_edge() {
    let topology = Topology::of(&mesh(&[[0, 1, 2], [0, 1, 3], [0, 1, 4]]));
    assert_eq!((topology.edges, topology.non_manifold_edges), (7, 1));
    assert_eq!((topology.misoriented_edges, topology.boundary_loops), (0, 1));
    assert!(!topology.is_manifold());
}

#[test]
fn components_are_numbered_by_their_lowest_vertex() {
    // 0 and 5 in one piece, 1 in the next, 2 in the last; faces in another order.
    let pieces = mesh(&[[8, 7, 2], [5, 4, 0], [3, 6, 1]]);
    assert_eq!(component_labels(&pieces), [0, 1, 2, 1, 0, 0, 1, 2, 2]);
    assert_eq!(Topology::of(&pieces).components, 3);
}

#[test]
fn the_order_of_faces_does_not_matter() {
    let sphere = icosphere(1);
    let mut faces = sphere.faces().to_vec();
    faces.reverse();
    let reversed = TriMesh::new(sphere.vertices().to_vec(), faces).unwrap();
    assert_eq!(Topology::of(&sphere), Topology::of(&reversed));
}
