//! The reference solvers: assembly, factorisation, lowest eigenpairs and the count by inertia on spheres, and
//! M-PGD on spot.

use std::hint::black_box;

use chladni::mesh::topology::component_labels;
use chladni::mesh::{load, sample::icosphere};
use chladni::operators::{Boundary, MassKind, Operators};
use chladni::spectrum::mpgd::{self, Direction, Stopping};
use chladni::spectrum::nullspace::nullspace;
use chladni::spectrum::{Eigenpairs, Pencil, Problem, factor::Analysis, fem, inertia};
use criterion::{Criterion, criterion_group, criterion_main};

fn spheres(c: &mut Criterion) {
    let mut group = c.benchmark_group("sphere, 10242 vertices");
    group.sample_size(10);
    let mesh = icosphere(5);
    group.bench_function("assemble", |b| {
        b.iter(|| Operators::assemble(black_box(&mesh), MassKind::Lumped));
    });
    let operators = Operators::assemble(&mesh, MassKind::Lumped).expect("its triangles are round");
    let pencil = Pencil::from(&operators);
    group.bench_function("analyse and factorise", |b| {
        b.iter(|| Analysis::new(pencil).and_then(|a| a.positive(0.1).map(drop)));
    });
    let labels = component_labels(&mesh);
    let problem =
        Problem::new(&operators, Boundary::Neumann, &labels).expect("no boundary is needed");
    group.bench_function("lowest 50 eigenpairs, with the count", |b| {
        b.iter(|| fem::lowest(&problem, &Analysis::new(pencil)?, 50));
    });
    group.bench_function("count by inertia", |b| {
        b.iter(|| inertia::count_below(&Analysis::new(pencil)?, 52.0));
    });
    group.finish();
}

fn spot(c: &mut Criterion) {
    let mesh = load("pipelines/meshes/spot_829.obj".as_ref()).expect("spot is shipped").mesh;
    let operators = Operators::assemble(&mesh, MassKind::Lumped).expect("its triangles are round");
    let pencil = Pencil::from(&operators);
    let vectors = nullspace(&vec![0; mesh.n()], &operators.mass);
    let constant = Eigenpairs { values: vec![0.0], vectors };
    let stopping = Stopping { tolerance: 1e-6, max_iterations: 20_000 };
    let mut group = c.benchmark_group("spot, 829 vertices");
    group.sample_size(10);
    let analysis = Analysis::new(pencil).expect("spot is well conditioned");
    let factor = analysis.positive(1.0 / pencil.area()).expect("spot is well conditioned");
    for (name, direction) in [
        ("M-PGD, 8 eigenpairs, gradient", Direction::Gradient),
        ("M-PGD, 8 eigenpairs, preconditioned", Direction::Preconditioned(&factor)),
    ] {
        group.bench_function(name, |b| {
            b.iter(|| mpgd::lowest(pencil, &constant, 8, direction, stopping, 1, &|| false));
        });
    }
    let labels = component_labels(&mesh);
    let problem =
        Problem::new(&operators, Boundary::Neumann, &labels).expect("no boundary is needed");
    group.bench_function("reference, 8 eigenpairs", |b| {
        b.iter(|| fem::lowest(&problem, &Analysis::new(pencil)?, 8));
    });
    group.finish();
}

criterion_group!(benches, spheres, spot);
criterion_main!(benches);
