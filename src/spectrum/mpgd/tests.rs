//! M-PGD against the reference solver, its fixed step against a second reading of (19) to (22), and why it stops.

use super::constraint::Constraint;
use super::descent::descend;
use super::{Direction, Options, Run, Step, StoppedBy, Stopping, largest_step, lowest};
use crate::mesh::topology::component_labels;
use crate::mesh::{TriMesh, load, sample::icosphere};
use crate::operators::{Boundary, MassKind, Operators, Sparse};
use crate::spectrum::eigenpairs::normalise;
use crate::spectrum::factor::Analysis;
use crate::spectrum::pencil::column;
use crate::spectrum::{Dense, Eigenpairs, Pencil, Problem, fem};

const GRADIENT: Step<'_> = Step::Exact(Direction::Gradient);

fn options(step: Step<'_>, tolerance: f64, max_iterations: usize) -> Options<'_> {
    Options { step, stopping: Stopping { tolerance, max_iterations }, seed: 7 }
}

/// The eigenfunctions of λ = 0, as M-PGD is given them.
fn zeros(problem: &Problem<'_>) -> Eigenpairs {
    let vectors = problem.nullspace().clone();
    Eigenpairs { values: vec![0.0; vectors.ncols()], vectors }
}

fn found(problem: &Problem<'_>, count: usize, options: Options<'_>) -> (Eigenpairs, Vec<Run>) {
    lowest(problem.pencil(), &zeros(problem), count, options, &|| false)
}

fn with_problem<T>(
    mesh: &TriMesh,
    kind: MassKind,
    boundary: Boundary,
    test: impl FnOnce(&Problem<'_>) -> T,
) -> T {
    let operators = Operators::assemble(mesh, kind).unwrap();
    let labels = component_labels(mesh);
    test(&Problem::new(&operators, boundary, &labels).unwrap())
}

/// Both directions of the exact step, and the fixed step where it is asked for, against the reference.
fn agrees_with_the_reference(problem: &Problem<'_>, count: usize, fixed: Option<f64>) {
    let analysis = Analysis::new(problem.pencil()).unwrap();
    let reference = fem::lowest(problem, &analysis, count).unwrap().pairs;
    let factor = analysis.positive(1.0 / problem.pencil().area()).unwrap();
    let given = problem.nullspace().ncols();
    let check = |step: Step<'_>, tolerance: f64, relative: f64| {
        let (pairs, runs) = found(problem, count, options(step, tolerance, 200_000));
        for (a, b) in pairs.values.iter().zip(&reference.values).skip(given) {
            assert!((a / b - 1.0).abs() < relative, "{a} {b}");
        }
        assert_eq!(runs.len(), count - given);
        assert!(runs.iter().all(|run| run.stopped_by == StoppedBy::Tolerance), "{runs:?}");
        runs.iter().map(|run| run.iterations).sum::<usize>()
    };
    let plain = check(GRADIENT, 1e-9, 1e-9);
    let preconditioned = check(Step::Exact(Direction::Preconditioned(&factor)), 1e-9, 1e-9);
    assert!(preconditioned < plain, "{preconditioned} {plain}");
    if let Some(part) = fixed {
        let fixed = check(Step::Fixed(part * largest_step(problem.pencil())), 1e-8, 1e-6);
        assert!(plain < fixed, "{plain} {fixed}");
    }
}

#[test]
fn every_mass_gives_the_reference_and_whole_eigenspaces() {
    for kind in [MassKind::Lumped, MassKind::Voronoi, MassKind::Consistent] {
        with_problem(&icosphere(2), kind, Boundary::Neumann, |problem| {
            agrees_with_the_reference(problem, 9, Some(1.0));
        });
    }
}

/// n×n vertices on the square [0, π]², every second cell with the other diagonal.
fn square(n: usize) -> TriMesh {
    let step = std::f64::consts::PI / (n - 1) as f64;
    let vertices = (0..n * n).map(|v| [(v % n) as f64 * step, (v / n) as f64 * step, 0.0]);
    let cells = (0..n - 1).flat_map(|j| (0..n - 1).map(move |i| (i, j)));
    let faces = cells.flat_map(|(i, j)| {
        let [a, b] = [j * n + i, j * n + i + 1].map(|v| v as u32);
        let [c, d] = [a, b].map(|v| v + n as u32);
        if (i + j).is_multiple_of(2) { [[a, b, d], [a, d, c]] } else { [[a, b, c], [b, d, c]] }
    });
    TriMesh::new(vertices.collect(), faces.collect()).unwrap()
}

#[test]
fn dirichlet_conditions_leave_no_zero_mode_to_be_given() {
    with_problem(&square(13), MassKind::Consistent, Boundary::Dirichlet, |problem| {
        assert_eq!(problem.nullspace().ncols(), 0);
        agrees_with_the_reference(problem, 4, Some(1.0));
        let first = found(problem, 1, options(GRADIENT, 1e-8, 20_000)).0.values[0];
        assert!((first - 2.0).abs() < 0.05, "{first}, on the smooth square 2");
    });
}

#[test]
fn every_component_brings_its_zero_mode() {
    let one = icosphere(2);
    let n = one.n() as u32;
    let moved = one.vertices().iter().map(|&[x, y, z]| [0.7 * x + 3.0, 0.7 * y, 0.7 * z]);
    let vertices = one.vertices().iter().copied().chain(moved).collect();
    let shifted = one.faces().iter().map(|face| face.map(|v| v + n));
    let faces = one.faces().iter().copied().chain(shifted).collect();
    let two = TriMesh::new(vertices, faces).unwrap();
    with_problem(&two, MassKind::Lumped, Boundary::Neumann, |problem| {
        assert_eq!(problem.nullspace().ncols(), 2);
        agrees_with_the_reference(problem, 8, None);
    });
}

fn times(a: &Sparse, x: &[f64]) -> Vec<f64> {
    a.outer_iterator().map(|row| row.iter().map(|(j, v)| v * x[j]).sum()).collect()
}

fn dot(x: &[f64], y: &[f64]) -> f64 {
    x.iter().zip(y).map(|(x, y)| x * y).sum()
}

/// Algorithm 1 once more, read from the paper line by line: t^(ℓ), and the left side of (22).
fn printed(
    pencil: Pencil<'_>,
    phi: &Dense,
    mut t: Vec<f64>,
    alpha: f64,
    steps: usize,
) -> (Vec<f64>, f64) {
    let mut change = f64::NAN;
    for _ in 0..steps {
        let (lt, bt) = (times(pencil.stiffness, &t), times(pencil.mass, &t));
        let tbt = dot(&t, &bt);
        let r = dot(&t, &lt) / tbt; // (13)
        let g: Vec<f64> = lt.iter().zip(&bt).map(|(l, b)| 2.0 / tbt * (l - r * b)).collect(); // (19)
        let bg = times(pencil.mass, &g);
        let mut d = g;
        for phi in (0..phi.ncols()).map(|i| column(phi, i)) {
            let c = dot(phi, &bg);
            d.iter_mut().zip(phi).for_each(|(d, phi)| *d -= phi * c); // (21)
        }
        change = alpha * dot(&d, &d).sqrt() / dot(&t, &t).sqrt(); // (22)
        t.iter_mut().zip(&d).for_each(|(t, d)| *t -= alpha * d);
    }
    (t, change)
}

fn torus() -> TriMesh {
    load("tests/data/meshes/torus.obj".as_ref()).unwrap().mesh
}

#[test]
fn the_fixed_step_goes_where_the_paper_says() {
    for kind in [MassKind::Lumped, MassKind::Consistent] {
        with_problem(&torus(), kind, Boundary::Neumann, |problem| {
            let pencil = problem.pencil();
            let analysis = Analysis::new(pencil).unwrap();
            let phi = fem::lowest(problem, &analysis, 2).unwrap().pairs.truncated(2).vectors;
            let mut constraint = Constraint::new(pencil, 2);
            (0..2).for_each(|i| constraint.push(column(&phi, i)));
            let mut start: Vec<f64> = (0..pencil.n()).map(|i| (7.0 * i as f64).sin()).collect();
            constraint.project(&mut start);
            for steps in 1..=20 {
                let alpha = largest_step(pencil);
                let options = options(Step::Fixed(alpha), 1e-300, steps);
                let (ours, run) = descend(&constraint, start.clone(), options, &|| false);
                let (theirs, change) = printed(pencil, &phi, start.clone(), alpha, steps);
                assert_eq!((run.iterations, run.stopped_by), (steps, StoppedBy::Count));
                assert!((run.change / change - 1.0).abs() < 1e-12, "{} {change}", run.change);
                let apart = ours.iter().zip(&theirs).map(|(a, b)| (a - b).abs());
                let apart = apart.fold(0.0, f64::max);
                assert!(apart < 1e-12, "{kind:?}, {steps} steps: {apart:e}");
            }
        });
    }
}

#[test]
fn each_condition_of_22_is_reported_as_what_it_was() {
    with_problem(&icosphere(2), MassKind::Lumped, Boundary::Neumann, |problem| {
        let stable = largest_step(problem.pencil());
        let run = |step, tolerance, steps| found(problem, 2, options(step, tolerance, steps)).1[0];
        for step in [GRADIENT, Step::Fixed(stable)] {
            let done = run(step, 1e-6, 100_000);
            assert_eq!(done.stopped_by, StoppedBy::Tolerance);
            assert!(done.change < 1e-6 && done.residual < 0.05 && done.iterations < 100_000);
            let cut = run(step, 1e-6, done.iterations - 1);
            assert_eq!((cut.stopped_by, cut.iterations), (StoppedBy::Count, done.iterations - 1));
            assert!(cut.change >= 1e-6);
            // Where the count and the tolerance are met by one step, the tolerance is.
            assert_eq!(run(step, 1e-6, done.iterations).stopped_by, StoppedBy::Tolerance);
        }
        let stalled = run(Step::Fixed(1e-9 * stable), 1e-6, 100_000);
        assert_eq!((stalled.stopped_by, stalled.iterations), (StoppedBy::Stalled, 1));
    });
}

#[test]
fn a_step_that_is_too_long_is_noticed_and_poisons_nothing() {
    with_problem(&icosphere(2), MassKind::Lumped, Boundary::Neumann, |problem| {
        let stable = largest_step(problem.pencil());
        for alpha in [1e4 * stable, 1e6 * stable, 1e160, f64::MAX] {
            let (pairs, runs) = found(problem, 4, options(Step::Fixed(alpha), 1e-6, 50));
            for run in &runs {
                assert_eq!(run.stopped_by, StoppedBy::Diverged, "{alpha:e}");
            }
            assert!(pairs.values.iter().all(|value| value.is_finite()), "{alpha:e}");
        }
    });
}

#[test]
fn the_quotient_falls_in_every_step_up_to_the_largest_and_rises_beyond() {
    with_problem(&torus(), MassKind::Lumped, Boundary::Neumann, |problem| {
        let pencil = problem.pencil();
        let mut constraint = Constraint::new(pencil, 1);
        constraint.push(column(problem.nullspace(), 0));
        let mut start: Vec<f64> = (0..pencil.n()).map(|i| (7.0 * i as f64).sin()).collect();
        constraint.project(&mut start);
        normalise(&mut start, pencil.mass);
        let after = |alpha: f64, steps: usize| {
            let options = options(Step::Fixed(alpha), 1e-300, steps);
            let (t, _) = descend(&constraint, start.clone(), options, &|| false);
            pencil.rayleigh_quotient(&t)
        };
        let first = pencil.rayleigh_quotient(&start);
        let stable = largest_step(pencil);
        let quotients: Vec<f64> = (1..60).map(|steps| after(stable, steps)).collect();
        assert!(quotients[0] < first && quotients.is_sorted_by(|a, b| a > b), "{quotients:?}");
        assert!(after(10.0 * stable, 1) > first);
    });
}

#[test]
fn the_fixed_step_is_the_same_at_every_scale() {
    let scaled = |s: f64| {
        let vertices = torus().vertices().iter().map(|p| p.map(|c| s * c)).collect();
        TriMesh::new(vertices, torus().faces().to_vec()).unwrap()
    };
    let run = |s: f64| {
        with_problem(&scaled(s), MassKind::Lumped, Boundary::Neumann, |problem| {
            let (pairs, runs) = found(problem, 2, options(Step::Fixed(0.001), 1e-6, 300));
            (pairs.values[1] * s * s, runs[0].change)
        })
    };
    let (lambda, change) = run(1.0);
    for s in [0.01, 64.0] {
        let (other, there) = run(s);
        assert!((other / lambda - 1.0).abs() < 1e-9 && (there / change - 1.0).abs() < 1e-9);
    }
}

/// Why the paper's α end a run, for K = 4 and Tol = `tolerance`, and how far λ is from the reference.
fn with_the_papers_step(mesh: &TriMesh, alpha: f64, tolerance: f64) -> Vec<(StoppedBy, f64)> {
    with_problem(mesh, MassKind::Lumped, Boundary::Neumann, |problem| {
        assert!(alpha < 0.05 * largest_step(problem.pencil()), "far inside what is stable");
        let analysis = Analysis::new(problem.pencil()).unwrap();
        let reference = fem::lowest(problem, &analysis, 4).unwrap().pairs;
        let (pairs, runs) = found(problem, 4, options(Step::Fixed(alpha), tolerance, 1_000_000));
        let off = pairs.values.iter().zip(&reference.values).map(|(a, b)| (a / b - 1.0).abs());
        runs.iter().map(|run| run.stopped_by).zip(off.skip(1)).collect()
    })
}

#[test]
fn the_papers_step_comes_down_on_the_torus() {
    for (stopped_by, off) in with_the_papers_step(&torus(), 0.001, 1e-6) {
        assert!(stopped_by == StoppedBy::Tolerance && off < 1e-5, "{stopped_by:?} {off:e}");
    }
}

/// The horse's α is so short that Tol = 1e-6 would end it at once anywhere near an eigenfunction.
#[test]
fn the_papers_steps_come_down_on_its_other_meshes() {
    for (file, alpha, tolerance, off_at_most) in [
        ("bunny1.obj", 0.001, 1e-6, 1e-4),
        // λ₃ and λ₄ lie 4 % apart: at this Tol the two are still mixed, by an amount that depends on the start.
        ("bunny2.obj", 0.001, 1e-6, 5e-3),
        ("horse.obj", 0.0001, 1e-7, 1e-3),
    ] {
        let path = format!("{}/../shared/data/{file}", env!("CARGO_MANIFEST_DIR"));
        if !std::path::Path::new(&path).exists() {
            eprintln!("{file} is not there and passed over: {path}");
            continue;
        }
        let mesh = load(path.as_ref()).unwrap().mesh;
        for (stopped_by, off) in with_the_papers_step(&mesh, alpha, tolerance) {
            assert_eq!(stopped_by, StoppedBy::Tolerance, "{file}");
            assert!(off < off_at_most, "{file}: {off:e}");
        }
    }
}
