//! Surfaces whose spectrum is known: the sphere, the square, and the graph of the icosahedron.

use std::f64::consts::PI;
use std::ops::Range;

use chladni::mesh::sample::icosphere;
use chladni::operators::{Boundary, MassKind, OperatorOptions};
use chladni::spectrum::cluster::{CLUSTER_GAP, clusters, zero_below};

use super::{AREAS, dirichlet, distance, grid, lowest};

/// The order of convergence, from errors on meshes whose edges differ by two.
fn order(coarse: f64, fine: f64) -> f64 {
    (coarse / fine).log2()
}

#[test]
fn the_sphere_has_l_times_l_plus_one_with_multiplicity_2l_plus_1() {
    for mass in AREAS {
        let values = lowest(&icosphere(4), mass, 25);
        let runs = clusters(&values, CLUSTER_GAP, zero_below(4.0 * PI));
        for (l, run) in runs.iter().enumerate() {
            assert_eq!(run.len(), 2 * l + 1, "{mass:?}");
            let exact = (l * (l + 1)) as f64;
            for value in &values[run.clone()] {
                // h² of 2,562 vertices is 0.005; the error of λ is below λ² h²/5.
                assert!((value - exact).abs() <= 1e-3 * exact * exact + 1e-10, "{mass:?}: {value}");
            }
        }
        assert_eq!(runs.len(), 5);
    }
}

#[test]
fn on_the_sphere_every_degree_converges_with_order_two() {
    // Lumped masses underestimate and the consistent one overestimates l(l+1).
    for (mass, side) in AREAS.into_iter().zip([-1.0, -1.0, 1.0]) {
        // The mean of each multiplet: the icosahedron splits some.
        let errors = |levels| {
            let values = lowest(&icosphere(levels), mass, 25);
            [1, 2, 3, 4].map(|l| {
                let sum: f64 = values[l * l..(l + 1) * (l + 1)].iter().sum();
                side * (sum / (l * (l + 1) * (2 * l + 1)) as f64 - 1.0)
            })
        };
        for (l, (coarse, fine)) in (1..).zip(errors(3).into_iter().zip(errors(4))) {
            assert!(fine > 0.0, "{mass:?}, degree {l}: {fine:e}");
            // Degree 1 under a lumped mass converges faster: coordinates are discrete eigenfunctions but for a little.
            let fastest = if l == 1 && side < 0.0 { 4.1 } else { 2.1 };
            let order = order(coarse, fine);
            assert!((1.9..fastest).contains(&order), "{mass:?}, degree {l}: {coarse:e} {fine:e}");
        }
    }
}

/// The `count` lowest sums a(n) + a(m) with n and m in `range`, ascending.
fn sums(range: Range<usize>, count: usize, a: impl Fn(usize) -> f64) -> Vec<f64> {
    let pairs = range.clone().flat_map(|n| range.clone().map(move |m| (n, m)));
    let mut sums: Vec<f64> = pairs.map(|(n, m)| a(n) + a(m)).collect();
    sums.sort_by(f64::total_cmp);
    sums.truncate(count);
    sums
}

#[test]
fn the_square_has_n_squared_plus_m_squared_to_order_two() {
    for mass in AREAS {
        for (boundary, from) in [(Boundary::Neumann, 0), (Boundary::Dirichlet, 1)] {
            let options = OperatorOptions { boundary, ..mass.into() };
            let exact = sums(from..12, 12, |n| (n * n) as f64);
            let error = |cells| distance(&lowest(&grid(cells, PI), options, 12), &exact, 1e-10);
            let (coarse, fine) = (error(24), error(48));
            assert!((1.9..2.1).contains(&order(coarse, fine)), "{options:?}: {coarse:e} {fine:e}");
        }
    }
}

#[test]
fn the_square_of_right_triangles_has_the_spectrum_of_the_five_point_stencil() {
    // A diagonal has weight cot 90° = 0. Inner vertices own h² under both lumped masses; on the boundary, half of it
    // under Voronoi's.
    for (options, from) in [
        (MassKind::Voronoi.into(), 0),
        (dirichlet(MassKind::Voronoi), 1),
        (dirichlet(MassKind::Lumped), 1),
    ] {
        // The first is solved densely, the second by Lanczos.
        for cells in [18, 27] {
            let step = PI / cells as f64;
            let line = |n: usize| (2.0 * (0.5 * n as f64 * step).sin() / step).powi(2);
            let worst = distance(
                &lowest(&grid(cells, PI), options, 40),
                &sums(from..cells + 1 - from, 40, line),
                1e-11,
            );
            assert!(worst < 1e-11, "{options:?}: {worst:e}");
        }
    }
}

#[test]
fn the_graph_laplacian_of_the_icosahedron_has_its_known_eigenvalues() {
    // The adjacency of the icosahedron has eigenvalues 5, √5 (3 times), −1 (5 times), −√5 (3 times); degrees are 5.
    let root = 5.0_f64.sqrt();
    let adjacency = [vec![5.0], vec![root; 3], vec![-1.0; 5], vec![-root; 3]].concat();
    let found = lowest(&icosphere(0), MassKind::Degree, 12);
    for (found, adjacency) in found.iter().zip(adjacency) {
        assert!((found - (1.0 - adjacency / 5.0)).abs() < 1e-12, "{found}");
    }
}
