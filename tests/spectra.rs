//! Spectra through the public API, held against closed forms and values computed by others.

use chladni::mesh::topology::component_labels;
use chladni::mesh::{TriMesh, load, sample::icosphere};
use chladni::operators::{Boundary, MassKind, OperatorOptions, Operators};
use chladni::spectrum::certificate::{References, SecondOpinion, certify};
use chladni::spectrum::factor::Analysis;
use chladni::spectrum::mpgd::{self, Direction, Options, Step, Stopping};
use chladni::spectrum::{Dense, Eigenpairs, Problem, fem};

fn lowest(mesh: &TriMesh, options: impl Into<OperatorOptions>, count: usize) -> Eigenpairs {
    let operators = Operators::assemble(mesh, options).unwrap();
    let labels = component_labels(mesh);
    let problem = Problem::new(&operators, Boundary::Neumann, &labels).unwrap();
    let analysis = Analysis::new(problem.pencil()).unwrap();
    fem::lowest(&problem, &analysis, count).unwrap().pairs.truncated(count)
}

#[test]
fn the_sphere_has_l_times_l_plus_one_with_multiplicity_2l_plus_1() {
    let pairs = lowest(&icosphere(4), MassKind::Lumped, 25);
    let mut k = 0;
    for l in 0..5 {
        for _ in 0..=2 * l {
            let exact = f64::from(l * (l + 1));
            // h² of 2,562 vertices is 0.005; the error of λ is below λ² h²/12.
            assert!((pairs.values[k] - exact).abs() <= 5e-4 * exact * exact + 1e-10, "k = {k}");
            k += 1;
        }
    }
}

/// The lowest eigenvalues of spot_829, by NumPy assembly and SciPy's ARPACK in shift-invert mode at 1e-13.
const SPOT: &str = include_str!("data/spectra/spot_829.json");

#[test]
fn spot_has_the_eigenvalues_that_scipy_finds() {
    let golden: serde_json::Value = serde_json::from_str(SPOT).unwrap();
    let mesh = load("tests/data/meshes/spot_829.obj".as_ref()).unwrap().mesh;
    let area = mesh.area().0;
    for (kind, name) in
        [(MassKind::Lumped, "neumann_lumped"), (MassKind::Consistent, "neumann_consistent")]
    {
        let expected: Vec<f64> = serde_json::from_value(golden[name].clone()).unwrap();
        let found = lowest(&mesh, kind, expected.len());
        assert!(found.values[0].abs() < 1e-9 / area);
        for (found, expected) in found.values.iter().zip(&expected).skip(1) {
            assert!((found / expected - 1.0).abs() < 1e-8, "{name}: {found} {expected}");
        }
    }
}

#[test]
fn the_spectrum_does_not_depend_on_units() {
    let mesh = icosphere(2);
    let area = |mesh: &TriMesh| mesh.area().0;
    let reference = lowest(&mesh, MassKind::Lumped, 12);
    for scale in [1e-6, 1e6] {
        let scaled = mesh.vertices().iter().map(|p| p.map(|c| scale * c)).collect();
        let scaled = TriMesh::new(scaled, mesh.faces().to_vec()).unwrap();
        let pairs = lowest(&scaled, MassKind::Lumped, 12);
        for (a, b) in pairs.values.iter().zip(&reference.values).skip(1) {
            let ratio = a * area(&scaled) / (b * area(&mesh));
            assert!((ratio - 1.0).abs() < 1e-11, "{scale}: {ratio}");
        }
    }
}

/// A certificate of `vectors` on the unit sphere with 642 vertices, K = 9: degrees 0, 1 and 2.
fn certificate(change: impl Fn(&Eigenpairs) -> Dense) -> chladni::spectrum::Certificate {
    let operators = Operators::assemble(&icosphere(3), MassKind::Lumped).unwrap();
    let labels = vec![0; operators.n()];
    let problem = Problem::new(&operators, Boundary::Neumann, &labels).unwrap();
    let pencil = problem.pencil();
    let analysis = Analysis::new(pencil).unwrap();
    // Sixteen, so that a change can take pairs from beyond K.
    let beyond = fem::lowest(&problem, &analysis, 16).unwrap().pairs;
    let fem = fem::lowest(&problem, &analysis, 9).unwrap();
    let stopping = Stopping { tolerance: 1e-6, max_iterations: 20_000 };
    let options = Options { step: Step::Exact(Direction::Gradient), stopping, seed: 3 };
    let (pairs, runs) = mpgd::lowest(pencil, &beyond.truncated(1), 9, options, &|| false);
    let vectors = change(&beyond);
    let references = References { fem, mpgd: Some(SecondOpinion { pairs, runs }) };
    certify(&problem, &analysis, &vectors, &references).unwrap()
}

#[test]
fn a_true_spectrum_is_certified() {
    let certificate = certificate(|fem| fem.truncated(9).vectors);
    assert!(certificate.orthonormality < 1e-11);
    assert!(certificate.completeness.complete && !certificate.completeness.cut_cluster);
    assert_eq!(certificate.completeness.count, Some(9));
    for pair in &certificate.pairs {
        assert!(pair.angle_fem < 1e-9 && pair.angle_mpgd < 1e-3, "{pair:?}");
        assert!(pair.residual < 1e-9 && pair.rho < 1e-9, "{pair:?}");
    }
}

#[test]
fn a_repeated_or_foreign_pair_is_caught_by_the_count() {
    let with = |from: usize| {
        certificate(move |fem| {
            let mut vectors = fem.truncated(9).vectors;
            let foreign = fem.vectors.col(from).to_owned();
            vectors.col_mut(5).copy_from(foreign);
            vectors
        })
    };
    assert!(!with(6).completeness.complete, "pair 7 stands twice, pair 6 is missing");
    assert!(!with(9).completeness.complete, "a pair from beyond K stands for pair 6");
}

#[test]
fn both_residual_bounds_contain_an_eigenvalue_whatever_the_perturbation() {
    let all = lowest(&icosphere(3), MassKind::Lumped, 60).values;
    for seed in 1..6 {
        let amount = 10f64.powi(-seed);
        let certificate = certificate(|fem| {
            let mut vectors = Dense::from_fn(fem.vectors.nrows(), 9, |i, j| {
                let noise = ((i * 31 + j * 17) as f64 * f64::from(seed)).sin();
                fem.vectors[(i, j)] + amount * noise
            });
            let operators = Operators::assemble(&icosphere(3), MassKind::Lumped).unwrap();
            chladni::spectrum::eigenpairs::normalise_columns(&operators.mass, &mut vectors);
            vectors
        });
        for pair in &certificate.pairs[1..] {
            let theta = pair.lambda;
            assert!(all.iter().any(|l| (l - theta).abs() <= pair.residual * (1.0 + 1e-9)));
            let energy = |l: &f64| (l - theta).abs() <= pair.rho * (l + theta) * (1.0 + 1e-9);
            assert!(all.iter().any(energy), "{pair:?}");
        }
    }
}

/// A grid of `n` × `n` vertices on the unit square, all diagonals one way.
fn grid(n: usize) -> TriMesh {
    let step = 1.0 / (n - 1) as f64;
    let vertices =
        (0..n * n).map(|v| [(v % n) as f64 * step, (v / n) as f64 * step, 0.0]).collect();
    let corners = (0..n - 1).flat_map(|j| (0..n - 1).map(move |i| (j * n + i) as u32));
    let faces = corners.flat_map(|v| {
        let (right, above) = (v + 1, v + n as u32);
        [[v, right, above + 1], [v, above + 1, above]]
    });
    TriMesh::new(vertices, faces.collect()).unwrap()
}

#[test]
fn the_square_has_the_eigenvalues_that_libigl_publishes() {
    // libigl, tests/include/igl/spectra/eigs.cpp: Voronoi mass, no boundary condition.
    let expected = [9.76979543268, 9.76979543268, 19.53959086537, 37.90080021473];
    let found = lowest(&grid(10), MassKind::Voronoi, 5).values;
    assert!(found[0].abs() < 1e-10);
    for (found, expected) in found[1..].iter().zip(expected) {
        assert!((found - expected).abs() < 1e-9, "{found} {expected}");
    }
    // In closed form: 4 sin²(π/18)/h², with h = 1/9.
    let second = 324.0 * (std::f64::consts::PI / 18.0).sin().powi(2);
    assert!((found[1] - second).abs() < 1e-11);
}

#[test]
fn the_graph_laplacian_of_the_icosahedron_has_its_known_eigenvalues() {
    // The adjacency of the icosahedron has eigenvalues 5, √5 (3 times), −1 (5 times), −√5 (3 times); degrees are 5.
    let root = 5.0_f64.sqrt();
    let adjacency = [vec![5.0], vec![root; 3], vec![-1.0; 5], vec![-root; 3]].concat();
    let found = lowest(&icosphere(0), MassKind::Degree, 12).values;
    for (found, adjacency) in found.iter().zip(adjacency) {
        assert!((found - (1.0 - adjacency / 5.0)).abs() < 1e-12, "{found}");
    }
}

/// The lowest eigenvalues of spot_829 with slivers, by robust_laplacian, an independent implementation.
const SLIVERS: &str = include_str!("data/spectra/spot_829_slivers.json");

/// Spot, with a new vertex close to an edge in every seventh triangle.
fn spot_with_slivers() -> TriMesh {
    let mesh = load("tests/data/meshes/spot_829.obj".as_ref()).unwrap().mesh;
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
    let robust =
        OperatorOptions { mass: Some(MassKind::Lumped), robust: true, ..Default::default() };
    let own = Operators::assemble(&mesh, MassKind::Lumped).unwrap().quality;
    assert!(own.non_delaunay_edges > 200 && own.min_angle_degrees < 0.2, "{own:?}");
    let operators = Operators::assemble(&mesh, robust).unwrap();
    let quality = operators.quality;
    assert_eq!((quality.negative_weights, quality.non_delaunay_edges), (0, 0));
    assert!(quality.min_angle_degrees > 15.0, "{quality:?}");
    assert!((operators.area.0 / golden["area"].as_f64().unwrap() - 1.0).abs() < 1e-12);
    let expected: Vec<f64> = serde_json::from_value(golden["neumann_lumped"].clone()).unwrap();
    let found = lowest(&mesh, robust, expected.len()).values;
    for (found, expected) in found.iter().zip(&expected).skip(1) {
        assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
    }
}
