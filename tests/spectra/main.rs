//! Spectra through the public API: values computed by others, closed forms, and laws.

mod certificates;
mod closed_forms;
mod flat;
mod golden;
mod invariance;
mod routes;
mod zoo;

use std::path::{Path, PathBuf};

use chladni::mesh::topology::component_labels;
use chladni::mesh::{TriMesh, load, sample::icosphere};
use chladni::operators::{Boundary, MassKind, OperatorOptions, Operators};
use chladni::spectrum::certificate::{References, certify};
use chladni::spectrum::factor::Analysis;
use chladni::spectrum::fem::{self, Reference};
use chladni::spectrum::{Certificate, Dense, Eigenpairs, Problem};
use proptest::prelude::*;

const AREAS: [MassKind; 3] = [MassKind::Lumped, MassKind::Voronoi, MassKind::Consistent];

/// A surface with what it takes to pose its eigenproblem.
struct Surface {
    operators: Operators,
    labels: Vec<u32>,
    boundary: Boundary,
}

impl Surface {
    fn of(mesh: &TriMesh, options: impl Into<OperatorOptions>) -> Self {
        let options = options.into();
        let operators = Operators::assemble(mesh, options).unwrap();
        Self { operators, labels: component_labels(mesh), boundary: options.boundary }
    }

    fn problem(&self) -> Problem<'_> {
        Problem::new(&self.operators, self.boundary, &self.labels).unwrap()
    }

    /// The lowest `k` pairs, to the end of the cluster of λ_k.
    fn reference(&self, k: usize) -> Reference {
        let problem = self.problem();
        fem::lowest(&problem, &Analysis::new(problem.pencil()).unwrap(), k).unwrap()
    }

    /// The lowest `k` pairs.
    fn lowest(&self, k: usize) -> Eigenpairs {
        self.reference(k).pairs.truncated(k)
    }

    /// The certificate of `vectors`, as a set of the lowest.
    fn certificate(&self, vectors: &Dense) -> Certificate {
        let problem = self.problem();
        let references = References { fem: self.reference(vectors.ncols()), mpgd: None };
        let analysis = Analysis::new(problem.pencil()).unwrap();
        certify(&problem, &analysis, vectors, &references).unwrap()
    }
}

/// The lowest `k` eigenvalues.
fn lowest(mesh: &TriMesh, options: impl Into<OperatorOptions>, k: usize) -> Vec<f64> {
    Surface::of(mesh, options).lowest(k).values
}

fn dirichlet(mass: MassKind) -> OperatorOptions {
    OperatorOptions { boundary: Boundary::Dirichlet, ..mass.into() }
}

/// The largest relative difference; what should be below `zero` has to be.
fn distance(found: &[f64], expected: &[f64], zero: f64) -> f64 {
    assert_eq!(found.len(), expected.len());
    let difference = |(&found, &expected): (&f64, &f64)| match expected.abs() <= zero {
        true if found.abs() <= zero => 0.0,
        true => f64::INFINITY,
        false => (found / expected - 1.0).abs(),
    };
    // Not a number is as far as can be.
    let differences = found.iter().zip(expected).map(difference);
    differences.fold(0.0, |a, b| if b.is_nan() { f64::INFINITY } else { b.max(a) })
}

fn meshes() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/meshes")
}

/// Meshes that stand beside the repository on some machines, and cannot be part of it.
fn shared() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data")
}

fn mesh(name: &str) -> TriMesh {
    load(&meshes().join(name)).unwrap_or_else(|error| panic!("{error}")).mesh
}

/// A square of `cells` × `cells` squares, all with the same diagonal.
fn grid(cells: usize, side: f64) -> TriMesh {
    let (n, step) = (cells + 1, side / cells as f64);
    let vertices =
        (0..n * n).map(|v| [(v % n) as f64 * step, (v / n) as f64 * step, 0.0]).collect();
    let corners = (0..cells).flat_map(|j| (0..cells).map(move |i| (j * n + i) as u32));
    let faces = corners.flat_map(|v| {
        let (right, above) = (v + 1, v + n as u32);
        [[v, right, above + 1], [v, above + 1, above]]
    });
    TriMesh::new(vertices, faces.collect()).unwrap()
}

/// Meshes side by side.
fn beside(meshes: &[TriMesh]) -> TriMesh {
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    for (place, mesh) in meshes.iter().enumerate() {
        let first = vertices.len() as u32;
        vertices.extend(mesh.vertices().iter().map(|[x, y, z]| [x + 9.0 * place as f64, *y, *z]));
        faces.extend(mesh.faces().iter().map(|face| face.map(|i| i + first)));
    }
    TriMesh::new(vertices, faces).unwrap()
}

/// A mesh, each vertex at a multiple of its place.
fn stretched(mesh: &TriMesh, factors: impl Iterator<Item = f64>) -> TriMesh {
    let vertices = mesh.vertices().iter().zip(factors).map(|(p, s)| p.map(|c| s * c));
    TriMesh::new(vertices.collect(), mesh.faces().to_vec()).unwrap()
}

/// A sphere with hills and valleys: no symmetry, and no eigenvalue twice.
fn hills(levels: u32) -> impl Strategy<Value = TriMesh> {
    let sphere = icosphere(levels);
    prop::collection::vec(0.85..1.15_f64, sphere.n())
        .prop_map(move |heights| stretched(&sphere, heights.into_iter()))
}
