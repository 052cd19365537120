//! What a certificate proves: that nothing is missing and nothing stands twice, and how far an eigenvalue is at most.

use chladni::mesh::{TriMesh, sample::icosphere};
use chladni::operators::{Boundary, MassKind, OperatorOptions};
use chladni::spectrum::certificate::{References, SecondOpinion, certify};
use chladni::spectrum::cluster::zero_below;
use chladni::spectrum::eigenpairs::normalise_columns;
use chladni::spectrum::factor::Analysis;
use chladni::spectrum::mpgd::{self, Direction, Options, Step, Stopping};
use chladni::spectrum::{Certificate, Dense};
use proptest::prelude::*;

use super::{AREAS, Surface, beside, dirichlet, grid, hills, mesh, stretched};

/// The columns of `x` with these numbers.
fn chosen(x: &Dense, columns: &[usize]) -> Dense {
    Dense::from_fn(x.nrows(), columns.len(), |i, j| x[(i, columns[j])])
}

/// The numbers 0 … k − 1, one of them replaced.
fn replaced(k: usize, at: usize, by: usize) -> Vec<usize> {
    (0..k).map(|j| if j == at { by } else { j }).collect()
}

/// A surface with its `k` lowest pairs and some from beyond; K ends no cluster.
struct Known {
    surface: Surface,
    k: usize,
    vectors: Dense,
}

impl Known {
    fn of(mesh: &TriMesh, options: impl Into<OperatorOptions>, k: usize) -> Self {
        let surface = Surface::of(mesh, options);
        let vectors = surface.reference(k + 7).pairs.vectors;
        Self { surface, k, vectors }
    }

    fn certificate(&self, columns: &[usize]) -> Certificate {
        self.surface.certificate(&chosen(&self.vectors, columns))
    }

    fn is_complete(&self, columns: &[usize]) -> bool {
        self.certificate(columns).completeness.complete
    }
}

/// Closed and with boundary, free and held, of one piece and of several, with and without symmetry, by both routes.
fn samples() -> Vec<(&'static str, Known)> {
    let sphere = icosphere(3);
    let spheres =
        beside(&[icosphere(2), stretched(&icosphere(2), std::iter::repeat(0.4)), icosphere(1)]);
    vec![
        // Degrees 0, 1 and 2.
        ("sphere", Known::of(&sphere, MassKind::Lumped, 9)),
        ("bunny", Known::of(&mesh("bunny1.obj"), MassKind::Consistent, 8)),
        ("square", Known::of(&grid(12, 1.0), MassKind::Voronoi, 6)),
        // 2; 5, 5; 8; 10, 10.
        ("held square", Known::of(&grid(24, 1.0), dirichlet(MassKind::Consistent), 6)),
        // Three zeros; twice degree 1 of nearly equal spheres.
        ("spheres", Known::of(&spheres, MassKind::Lumped, 9)),
    ]
}

#[test]
fn the_lowest_pairs_are_certified() {
    for (name, known) in samples() {
        let certificate = known.certificate(&(0..known.k).collect::<Vec<_>>());
        let completeness = certificate.completeness;
        assert!(completeness.complete && !completeness.cut_cluster, "{name}: {completeness:?}");
        assert_eq!(completeness.count, Some(known.k), "{name}");
        assert!(certificate.orthonormality < 1e-11, "{name}: {certificate:?}");
        for pair in &certificate.pairs {
            let scale = pair.lambda.max(certificate.pairs[3].lambda);
            assert!(pair.residual < 1e-9 * scale && pair.rho < 1e-9, "{name}: {pair:?}");
            assert!(pair.angle_fem < 1e-9, "{name}: {pair:?}");
        }
    }
}

#[test]
fn a_missing_pair_is_caught_whichever_it_is() {
    for (name, known) in samples() {
        let k = known.k;
        for missing in 0..k {
            // The rest, and the next one moved up.
            let rest: Vec<usize> = (0..=k).filter(|&j| j != missing).collect();
            assert!(!known.is_complete(&rest), "{name} without {missing}");
        }
    }
    // Without one to move up, where every eigenvalue is a cluster of its own.
    let known = Known::of(&mesh("bunny1.obj"), MassKind::Consistent, 8);
    for missing in 0..7 {
        let rest: Vec<usize> = (0..8).filter(|&j| j != missing).collect();
        let completeness = known.certificate(&rest).completeness;
        assert!(!completeness.cut_cluster && !completeness.complete, "{completeness:?}");
    }
}

#[test]
fn a_repeated_pair_is_caught_whichever_it_is() {
    for (name, known) in samples() {
        for at in 0..known.k {
            let by = (at + 1) % known.k;
            assert!(!known.is_complete(&replaced(known.k, at, by)), "{name}: {by} for {at}");
        }
    }
}

#[test]
fn a_pair_from_beyond_is_caught_wherever_it_stands() {
    for (name, known) in samples() {
        for at in 0..known.k {
            for by in [known.k, known.k + 4] {
                assert!(!known.is_complete(&replaced(known.k, at, by)), "{name}: {by} for {at}");
            }
        }
    }
}

#[test]
fn where_k_cuts_a_cluster_nothing_below_it_may_be_missing() {
    // Degree 3 of the sphere is pairs 9 to 15.
    let known = Known { k: 12, ..Known::of(&icosphere(3), MassKind::Lumped, 16) };
    let check = |columns: &[usize], complete: bool| {
        let completeness = known.certificate(columns).completeness;
        assert!(completeness.cut_cluster, "{completeness:?}");
        assert_eq!(completeness.complete, complete, "{columns:?}: {completeness:?}");
    };
    check(&(0..12).collect::<Vec<_>>(), true);
    // Other members of the cluster are as good.
    check(&replaced(12, 10, 15), true);
    for at in 0..9 {
        check(&replaced(12, at, 14), false);
        check(&replaced(12, at, 17), false);
        check(&replaced(12, at, 9), false);
    }
    // Nor may any of the K lie above the cluster, or stand twice.
    check(&replaced(12, 10, 17), false);
    check(&replaced(12, 10, 9), false);
}

#[test]
fn where_k_cuts_the_zeros_any_of_them_will_do() {
    let spheres = beside(&[icosphere(1), icosphere(2), icosphere(1)]);
    let known = Known { k: 2, ..Known::of(&spheres, MassKind::Lumped, 3) };
    for (columns, complete) in
        [([0, 1], true), ([0, 2], true), ([1, 2], true), ([0, 0], false), ([0, 3], false)]
    {
        let completeness = known.certificate(&columns).completeness;
        assert!(completeness.cut_cluster);
        assert_eq!(completeness.complete, complete, "{columns:?}: {completeness:?}");
    }
}

#[test]
fn both_solvers_are_held_against_the_pairs() {
    let surface = Surface::of(&icosphere(3), MassKind::Lumped);
    let problem = surface.problem();
    let fem = surface.reference(9);
    let stopping = Stopping { tolerance: 1e-6, max_iterations: 20_000 };
    let options = Options { step: Step::Exact(Direction::Gradient), stopping, seed: 3 };
    let known = fem.pairs.truncated(1);
    let (pairs, runs) = mpgd::lowest(problem.pencil(), &known, 9, options, &|| false);
    let vectors = fem.pairs.vectors.clone();
    let references = References { fem, mpgd: Some(SecondOpinion { pairs, runs }) };
    let analysis = Analysis::new(problem.pencil()).unwrap();
    for pair in certify(&problem, &analysis, &vectors, &references).unwrap().pairs {
        assert!(pair.angle_fem < 1e-9 && pair.angle_mpgd < 1e-3, "{pair:?}");
        assert!((pair.lambda_mpgd - pair.lambda).abs() < 1e-5, "{pair:?}");
    }
}

/// A fresh number in [−1, 1) for every entry.
fn noise(seed: u64, i: usize, j: usize) -> f64 {
    let mut x = seed ^ ((i as u64) << 20) ^ ((j as u64) << 40) ^ 0x9e37_79b9_7f4a_7c15;
    for _ in 0..3 {
        x ^= x >> 30;
        x = x.wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x ^= x >> 27;
    }
    (x >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

/// Whether both bounds of every pair of `vectors` contain one of all eigenvalues.
fn bounds_hold(surface: &Surface, all: &[f64], vectors: Dense) -> Result<(), TestCaseError> {
    let problem = surface.problem();
    let mut vectors = vectors;
    normalise_columns(problem.pencil().mass, &mut vectors);
    let pairs = surface.certificate(&vectors).pairs;
    let zero = zero_below(problem.pencil().area());
    let positive = pairs.iter().map(|pair| pair.lambda).filter(|&theta| theta > zero);
    let lowest = positive.fold(f64::INFINITY, f64::min);
    // What rounding does to θ itself.
    let rounding = 1e-14 * all[all.len() - 1];
    for pair in pairs {
        let theta = pair.lambda;
        let least = |bound: &dyn Fn(f64) -> f64| {
            all.iter()
                .map(|&l| ((l - theta).abs() - rounding) / bound(l))
                .fold(f64::INFINITY, f64::min)
        };
        let residual = least(&|_| pair.residual);
        let scale = if theta > zero { theta } else { lowest };
        let energy = least(&|l| pair.rho * (l + scale));
        prop_assert!(residual <= 1.0 + 1e-9, "{residual}: {pair:?}");
        prop_assert!(energy <= 1.0 + 1e-9, "{energy}: {pair:?}");
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..Default::default() })]

    #[test]
    fn both_bounds_contain_an_eigenvalue_whatever_the_perturbation(
        mesh in hills(1),
        mass in prop::sample::select(AREAS.to_vec()),
        exponent in -8.0..1.0_f64,
        seed in any::<u64>(),
    ) {
        let surface = Surface::of(&mesh, mass);
        let all = surface.lowest(mesh.n());
        let vectors = Dense::from_fn(mesh.n(), 12, |i, j| {
            all.vectors[(i, j)] + 10f64.powf(exponent) * noise(seed, i, j)
        });
        bounds_hold(&surface, &all.values, vectors)?;
    }

    #[test]
    fn both_bounds_contain_an_eigenvalue_of_a_surface_that_is_held(
        mass in prop::sample::select(AREAS.to_vec()),
        exponent in -8.0..1.0_f64,
        seed in any::<u64>(),
    ) {
        let options = OperatorOptions { boundary: Boundary::Dirichlet, ..mass.into() };
        let surface = Surface::of(&grid(9, 1.0), options);
        let all = surface.lowest(64);
        let vectors = Dense::from_fn(64, 10, |i, j| {
            all.vectors[(i, j)] + 10f64.powf(exponent) * noise(seed, i, j)
        });
        bounds_hold(&surface, &all.values, vectors)?;
    }
}
