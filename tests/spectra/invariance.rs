//! What a spectrum may not depend on: where a surface lies, its unit, the order of its vertices and faces, which way its
//! faces wind, and vertices that no face uses.

use std::path::Path;

use chladni::mesh::trimesh::{cross, dot};
use chladni::mesh::{Topology, TriMesh, load_bytes, sample::icosphere};
use chladni::operators::{MassKind, OperatorOptions, Robust};
use chladni::spectrum::Dense;
use chladni::spectrum::certificate::principal_angle;
use chladni::spectrum::cluster::{CLUSTER_GAP, clusters, zero_below};
use chladni::spectrum::fem::Reference;
use proptest::prelude::*;

use super::{AREAS, Surface, distance, hills, lowest, mesh};

const K: usize = 10;

/// A mesh with vertex i moved to place `to[i]`, and face f taken from place `from[f]`, its corners rotated.
fn reordered(mesh: &TriMesh, to: &[usize], from: &[usize]) -> TriMesh {
    let mut vertices = vec![[0.0; 3]; mesh.n()];
    to.iter().zip(mesh.vertices()).for_each(|(&to, &position)| vertices[to] = position);
    let face = |&from: &usize| {
        let mut face = mesh.faces()[from].map(|vertex| to[vertex as usize] as u32);
        face.rotate_left(from % 3);
        face
    };
    TriMesh::new(vertices, from.iter().map(face).collect()).unwrap()
}

fn moved(mesh: &TriMesh, to: impl Fn([f64; 3]) -> [f64; 3]) -> TriMesh {
    let vertices = mesh.vertices().iter().map(|&p| to(p)).collect();
    TriMesh::new(vertices, mesh.faces().to_vec()).unwrap()
}

fn scaled(mesh: &TriMesh, scale: f64) -> TriMesh {
    moved(mesh, |p| p.map(|c| scale * c))
}

/// v + 2u × (u × v + wv), divided by the norm of the quaternion w + u squared.
fn rotate([w, u @ ..]: [f64; 4], v: [f64; 3]) -> [f64; 3] {
    let inner = cross(u, v);
    let outer = cross(u, std::array::from_fn(|i| inner[i] + w * v[i]));
    std::array::from_fn(|i| v[i] + 2.0 * outer[i] / (w * w + dot(u, u)))
}

/// The largest angle between the clusters of two spectra; row i of the first is row `to[i]` of the second.
fn angle(surface: &Surface, first: &Reference, second: &Reference, to: &[usize]) -> f64 {
    let rows = |j: usize| move |i: usize| second.pairs.vectors[(to[i], j)];
    let (n, k) = (to.len(), first.pairs.len());
    let back = Dense::from_fn(n, k, |i, j| rows(j)(i));
    let area = surface.operators.area.0;
    let runs = clusters(&first.pairs.values, CLUSTER_GAP, zero_below(area));
    let angles = runs.into_iter().map(|run| {
        let part = |x: &Dense| x.subcols(run.start, run.len()).to_owned();
        principal_angle(&surface.operators.mass, &part(&first.pairs.vectors), &part(&back))
    });
    angles.fold(0.0, f64::max)
}

/// Of 162 vertices, which are solved densely, or of 642.
fn hill_meshes() -> impl Strategy<Value = TriMesh> {
    prop_oneof![2 => hills(2), 1 => hills(3)]
}

fn orders() -> impl Strategy<Value = (TriMesh, Vec<usize>, Vec<usize>)> {
    hill_meshes().prop_flat_map(|mesh| {
        let (n, faces) = (mesh.n(), mesh.faces().len());
        let shuffled = |n: usize| Just((0..n).collect::<Vec<_>>()).prop_shuffle();
        (Just(mesh), shuffled(n), shuffled(faces))
    })
}

fn masses() -> impl Strategy<Value = MassKind> {
    prop::sample::select(AREAS.to_vec())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, failure_persistence: None, ..Default::default() })]

    #[test]
    fn eigenvalues_times_area_do_not_depend_on_the_unit(
        mesh in hill_meshes(), mass in masses(), exponent in -6.0..6.0_f64,
    ) {
        unit(&mesh, mass, 10f64.powf(exponent));
    }

    #[test]
    fn eigenvalues_do_not_depend_on_where_a_surface_lies(
        mesh in hill_meshes(),
        mass in masses(),
        quaternion in prop::array::uniform4(0.1..1.0_f64),
        translation in prop::array::uniform3(-5.0..5.0_f64),
    ) {
        let before = lowest(&mesh, mass, K);
        let turned = moved(&mesh, |p| rotate(quaternion, p));
        let shifted = moved(&mesh, |p| std::array::from_fn(|i| p[i] + translation[i]));
        for after in [turned, shifted] {
            let worst = distance(&lowest(&after, mass, K), &before, 1e-10);
            prop_assert!(worst < 1e-9, "{worst:e}");
        }
    }

    #[test]
    fn a_spectrum_does_not_depend_on_the_order_of_vertices_and_faces(
        (mesh, vertices, faces) in orders(), mass in masses(),
    ) {
        let surface = Surface::of(&mesh, mass);
        let before = surface.reference(K);
        let after = Surface::of(&reordered(&mesh, &vertices, &faces), mass).reference(K);
        prop_assert_eq!(before.count, after.count);
        let worst = distance(&after.pairs.values, &before.pairs.values, 1e-10);
        prop_assert!(worst < 1e-9, "{worst:e}");
        let angle = angle(&surface, &before, &after, &vertices);
        prop_assert!(angle < 1e-8, "{angle:e}");
    }
}

/// λ · area at two scales.
fn unit(mesh: &TriMesh, mass: MassKind, scale: f64) {
    let by_area = |mesh: &TriMesh| {
        let area = mesh.area().0;
        lowest(mesh, mass, K).into_iter().map(|lambda| lambda * area).collect::<Vec<_>>()
    };
    let worst = distance(&by_area(&scaled(mesh, scale)), &by_area(mesh), 1e-9);
    assert!(worst < 1e-11, "{scale}: {worst:e}");
}

#[test]
fn micrometres_and_megametres_are_as_good_as_metres() {
    for mesh in [icosphere(2), mesh("bunny2.obj"), mesh("lapy_square-mesh.off")] {
        for mass in AREAS {
            for scale in [1e-6, 1e6] {
                unit(&mesh, mass, scale);
            }
        }
    }
}

/// A mesh with every third of its faces turned over.
fn turned_over(mesh: &TriMesh) -> TriMesh {
    let turn = |(f, &[a, b, c]): (usize, &[u32; 3])| if f % 3 == 1 { [a, c, b] } else { [a, b, c] };
    let faces = mesh.faces().iter().enumerate().map(turn).collect();
    TriMesh::new(mesh.vertices().to_vec(), faces).unwrap()
}

#[test]
fn eigenvalues_do_not_depend_on_which_way_faces_wind() {
    // The strip cannot be oriented at all.
    for name in ["torus.obj", "spot_829.obj", "lapy_square-mesh.off", "gc_moebius.obj"] {
        let mesh = mesh(name);
        let turned = turned_over(&mesh);
        assert!(Topology::of(&turned).misoriented_edges > mesh.n() / 4, "{name}");
        for (mass, robust) in
            AREAS.into_iter().flat_map(|mass| Robust::ALL.map(|robust| (mass, robust)))
        {
            let options = OperatorOptions { robust, ..mass.into() };
            let worst = distance(&lowest(&turned, options, K), &lowest(&mesh, options, K), 1e-9);
            assert!(worst < 1e-10, "{name}, {options:?}: {worst:e}");
        }
    }
}

#[test]
fn vertices_that_no_face_uses_take_no_part() {
    let text = std::fs::read_to_string(super::meshes().join("torus.obj")).unwrap();
    let vertices = text.lines().filter(|line| line.starts_with("v ")).collect::<Vec<_>>();
    let faces = mesh("torus.obj");
    // One before all others, one among them, one after.
    let mut with_strays = String::from("v 7 7 7\n");
    for (i, line) in vertices.iter().enumerate() {
        with_strays += line;
        with_strays += if i == 49 { "\nv 8 8 8\n" } else { "\n" };
    }
    with_strays += "v 9 9 9\n";
    let row = |i: u32| i + 2 + u32::from(i > 49);
    for face in faces.faces() {
        let [a, b, c] = face.map(row);
        with_strays += &format!("f {a} {b} {c}\n");
    }
    let ingested = load_bytes(Path::new("strays.obj"), with_strays.as_bytes()).unwrap();
    let map = &ingested.vertex_map;
    assert_eq!((map.len(), map[0], map[51], map[102]), (103, -1, -1, -1));
    assert_eq!((map[1], map[50], map[52], map[101]), (0, 49, 50, 99));
    for mass in AREAS {
        let [with, without] =
            [&ingested.mesh, &faces].map(|mesh| Surface::of(mesh, mass).lowest(K));
        assert_eq!((with.values, with.vectors), (without.values, without.vectors));
    }
}
