//! Eigenvalues that SciPy, LaPy, libigl and robust_laplacian find. Sources: `tests/data/spectra/README.md`.

use std::collections::BTreeMap;

use chladni::mesh::{Topology, TriMesh, load};
use chladni::operators::{Boundary, MassKind, OperatorOptions, Robust};
use serde::Deserialize;

use super::{Surface, distance, grid, lowest, mesh, meshes, shared};

const SCIPY: &str = include_str!("../data/spectra/eigenvalues.json");

#[derive(Deserialize)]
struct Golden {
    vertices: usize,
    faces: usize,
    area: f64,
    boundary_vertices: usize,
    #[serde(flatten)]
    spectra: BTreeMap<String, Vec<f64>>,
}

fn options(name: &str) -> OperatorOptions {
    let (boundary, mass) = match name {
        "neumann_lumped" => (Boundary::Neumann, MassKind::Lumped),
        "neumann_consistent" => (Boundary::Neumann, MassKind::Consistent),
        "dirichlet_lumped" => (Boundary::Dirichlet, MassKind::Lumped),
        "dirichlet_consistent" => (Boundary::Dirichlet, MassKind::Consistent),
        _ => panic!("{name}"),
    };
    OperatorOptions { boundary, ..mass.into() }
}

#[test]
fn every_spectrum_is_the_one_that_scipy_finds() {
    let all: BTreeMap<String, Golden> = serde_json::from_str(SCIPY).unwrap();
    let mut spectra = 0;
    for (name, golden) in all {
        let own = meshes().join(&name);
        let path = if own.exists() { own } else { shared().join(&name) };
        if !path.exists() && ["horse.obj", "spot_11533.obj"].contains(&name.as_str()) {
            eprintln!("{name} left out: there is no {}", path.display());
            continue;
        }
        let mesh = load(&path).unwrap().mesh;
        assert_eq!((mesh.n(), mesh.faces().len()), (golden.vertices, golden.faces), "{name}");
        assert_eq!(Topology::of(&mesh).boundary_vertices.len(), golden.boundary_vertices);
        assert!((mesh.area().0 / golden.area - 1.0).abs() < 1e-12, "{name}");
        for (problem, expected) in &golden.spectra {
            let found = lowest(&mesh, options(problem), expected.len());
            let worst = distance(&found, expected, 1e-9 / golden.area);
            assert!(worst < 1e-8, "{name}, {problem}: {worst:e}");
            spectra += 1;
        }
    }
    assert!(spectra >= 20, "{spectra}");
}

#[test]
fn the_cube_has_the_eigenvalues_that_lapy_publishes() {
    // lapy_cubeTria.ev, from vertices of single precision: its λ₁ is −4e-6.
    let found = lowest(&mesh("lapy_cubeTria.vtk"), MassKind::Consistent, 3);
    let worst = distance(&found[1..], &[4.169681399189685, 4.170502334138653], 0.0);
    assert!(worst < 2e-6, "{worst:e}");
}

#[test]
fn the_square_has_the_eigenvalues_that_libigl_publishes() {
    // libigl, tests/include/igl/spectra/eigs.cpp: Voronoi mass, no boundary condition.
    let expected = [9.76979543268, 9.76979543268, 19.53959086537, 37.90080021473];
    let found = lowest(&grid(9, 1.0), MassKind::Voronoi, 5);
    assert!(found[0].abs() < 1e-10);
    for (found, expected) in found[1..].iter().zip(expected) {
        assert!((found - expected).abs() < 1e-9, "{found} {expected}");
    }
}

/// The lowest eigenvalues of spot_829 with slivers, by robust_laplacian, an independent implementation.
const SLIVERS: &str = include_str!("../data/spectra/spot_829_slivers.json");

/// Spot, with a new vertex close to an edge in every seventh triangle.
fn spot_with_slivers() -> TriMesh {
    let mesh = mesh("spot_829.obj");
    let (mut vertices, mut faces) = (mesh.vertices().to_vec(), Vec::new());
    for (f, &[a, b, c]) in mesh.faces().iter().enumerate() {
        if f % 7 == 0 {
            let [p, q, r] = mesh.corners([a, b, c]);
            let new = vertices.len() as u32;
            vertices.push(std::array::from_fn(|i| 0.5 * p[i] + 0.499 * q[i] + 0.001 * r[i]));
            faces.extend([[a, b, new], [b, c, new], [c, a, new]]);
        } else {
            faces.push([a, b, c]);
        }
    }
    TriMesh::new(vertices, faces).unwrap()
}

#[test]
fn slivers_are_no_obstacle_to_the_intrinsic_triangulation() {
    let golden: serde_json::Value = serde_json::from_str(SLIVERS).unwrap();
    let mesh = spot_with_slivers();
    let robust = OperatorOptions {
        mass: Some(MassKind::Lumped),
        robust: Robust::Intrinsic,
        ..Default::default()
    };
    let own = Surface::of(&mesh, MassKind::Lumped).operators.quality;
    assert!(own.non_delaunay_edges > 200 && own.min_angle_degrees < 0.2, "{own:?}");
    let surface = Surface::of(&mesh, robust);
    let quality = surface.operators.quality;
    assert_eq!((quality.negative_weights, quality.non_delaunay_edges), (0, 0));
    assert!(quality.min_angle_degrees > 15.0, "{quality:?}");
    let area = surface.operators.area.0;
    assert!((area / golden["area"].as_f64().unwrap() - 1.0).abs() < 1e-12);
    let expected: Vec<f64> = serde_json::from_value(golden["neumann_lumped"].clone()).unwrap();
    let found = surface.lowest(expected.len()).values;
    let worst = distance(&found, &expected, 1e-9 / area);
    assert!(worst < 1e-9, "{worst:e}");
}

/// Lowest eigenvalues under the lumped mass by robust-laplacian 1.1.0 (`mesh_laplacian`, its default mollification)
/// and `scipy.linalg.eigh`, polygons in the same fans.
const TUFTED: [(&str, [f64; 4]); 4] = [
    (
        "gc_fan3.obj",
        [0.19481563551363998, 0.23627642009929342, 0.3200000000000004, 0.4527589587816337],
    ),
    (
        "gc_triple_vierbein.obj",
        [0.14230437854815337, 0.1579371345494486, 0.1978561394673069, 0.6189186164359687],
    ),
    (
        "gc_hourglass_ico.obj",
        [0.27936235252882924, 2.0000106449653847, 2.000031004429941, 2.0000311260838077],
    ),
    (
        "gc_moebius.obj",
        [0.004769596598270545, 0.0047772813936067735, 0.018124758711714824, 0.01813970865184512],
    ),
];

#[test]
fn on_the_tufted_cover_branching_surfaces_have_the_eigenvalues_of_robust_laplacian() {
    for (name, expected) in TUFTED {
        let options = OperatorOptions {
            mass: Some(MassKind::Lumped),
            robust: Robust::Tufted,
            ..Default::default()
        };
        let found = Surface::of(&mesh(name), options).lowest(5).values;
        for (found, expected) in found[1..].iter().zip(expected) {
            assert!((found / expected - 1.0).abs() < 1e-9, "{name}: {found} {expected}");
        }
    }
}
