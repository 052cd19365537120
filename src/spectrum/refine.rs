//! From functions that are nearly eigenfunctions to better ones: [`rayleigh_ritz`] on their span, without a matrix, and
//! [`lowest_from`], block Lanczos on (L + μB)⁻¹B that starts from them.
//!
//! Eight sums of the given functions make the first panel, each function in one of them and neighbours, which may share an
//! eigenvalue, in different ones. The Krylov space of such a start holds next to nothing of higher eigenfunctions, so it needs
//! little more than the dimension that separates the wanted ones. Which pairs are found does not depend on the start: the
//! lowest, as those of [`fem`].

use super::cluster::zero_below;
use super::factor::Analysis;
use super::fem::{self, ROUNDINGS, largest_eigenvalue};
use super::lanczos::{Krylov, Ritz};
use super::panel::{Panel, WIDTH};
use super::pencil::combine;
use super::rayleigh_ritz::ritz_pairs;
use super::{Dense, Eigenpairs, Pencil, Problem, SpectrumError};

/// A pair is refined when its residual in the B⁻¹ norm is below this, relative to λ, or as small as rounding allows.
pub const TOLERANCE: f64 = 1e-8;

/// Up to so many rows, or up to so many times the number of pairs, all eigenpairs are computed densely.
const DENSE: usize = 400;
const DENSE_PAIRS: usize = 4;

/// The Ritz pairs of (ΦᵀLΦ, ΦᵀBΦ) for Φ = `phi`, n×K, in canonical form; `projected` gives both matrices for a set of
/// functions. The first `known` columns are the eigenfunctions of λ = 0, which the others are B-orthogonal to; they stay.
/// λ below `zero` counts as zero.
///
/// `None` when the functions are linearly dependent or are no numbers.
pub fn rayleigh_ritz(
    projected: impl FnOnce(&Dense) -> (Dense, Dense),
    phi: &Dense,
    known: usize,
    zero: f64,
) -> Option<Eigenpairs> {
    let learned = phi.subcols(known, phi.ncols() - known).to_owned();
    let (stiffness, mass) = projected(&learned);
    let ritz = ritz_pairs(&stiffness, &mass, INDEPENDENT);
    if ritz.values.len() < learned.ncols() {
        return None;
    }
    let mut vectors = phi.clone();
    vectors.subcols_mut(known, learned.ncols()).copy_from(combine(&learned, &ritz.coefficients));
    let values = vec![0.0; known].into_iter().chain(ritz.values).collect();
    Some(Eigenpairs { values, vectors }.canonical(zero))
}

/// Functions are linearly dependent when the eigenvalues of their Gram matrix spread further.
const INDEPENDENT: f64 = 1e-10;

/// Eigenpairs, and what it took.
#[derive(Debug, Clone)]
pub struct Refined {
    /// The lowest K pairs in canonical form, those of λ = 0 first.
    pub pairs: Eigenpairs,
    /// Blocks of eight solves with L + μB; 0 for a mesh so small that the pencil was solved densely.
    pub blocks: usize,
}

/// The lowest eigenpairs: those of λ = 0, and as many more as `start`, n×m on the free vertices, has functions.
///
/// The result depends on the arguments alone, not on the number of threads.
///
/// # Errors
/// As [`fem::lowest`].
pub fn lowest_from(
    problem: &Problem<'_>,
    analysis: &Analysis<'_>,
    start: &Dense,
) -> Result<Refined, SpectrumError> {
    let pencil = problem.pencil();
    let (n, m, area) = (pencil.n(), start.ncols(), pencil.area());
    let zeros = problem.nullspace();
    let k = zeros.ncols() + m;
    if n <= DENSE.max(DENSE_PAIRS * k) {
        let pairs = fem::lowest(problem, analysis, k)?.pairs.truncated(k);
        return Ok(Refined { pairs, blocks: 0 });
    }
    let mu = 1.0 / area;
    let factor = analysis.positive(mu)?;
    let known = (0..zeros.ncols()).step_by(WIDTH).map(|first| Panel::from_columns(zeros, first));
    let mut krylov =
        Krylov::from_start(factor, pencil.mass, known.collect(), Panel::sums(start), 0);
    let goal = Goal::new(pencil, mu);
    loop {
        krylov.grow();
        let dimension = krylov.dimension();
        if dimension < m {
            continue;
        }
        let ritz = krylov.ritz();
        let excess = goal.excess(&ritz, m);
        if excess <= 1.0 {
            let pairs = joined(zeros, krylov, &ritz, mu, m).canonical(zero_below(area));
            return Ok(Refined { pairs, blocks: dimension / WIDTH });
        }
        if dimension + 2 * WIDTH + zeros.ncols() > n || dimension > 40 * m + 1000 {
            return Err(SpectrumError::NotConverged { iterations: dimension / WIDTH, excess });
        }
    }
}

/// What is asked of residuals.
struct Goal {
    mu: f64,
    /// A residual that is as small as rounding allows.
    floor: f64,
}

impl Goal {
    fn new(pencil: Pencil<'_>, mu: f64) -> Self {
        Self { mu, floor: ROUNDINGS * f64::EPSILON * largest_eigenvalue(pencil) }
    }

    /// The largest residual of the lowest `m` pairs, relative to what is asked of it.
    fn excess(&self, ritz: &Ritz, m: usize) -> f64 {
        let relative = |j: usize| {
            let at = ritz.values.len() - 1 - j;
            let theta = ritz.values[at];
            let lambda = (theta.recip() - self.mu).abs();
            // x' = (L + μB)⁻¹Bx has the residual B(x − x'/θ). Half, since the recurrence only estimates it.
            ritz.residuals[at] / (theta * theta) / (0.5 * (TOLERANCE * lambda).max(self.floor))
        };
        (0..m).map(relative).fold(0.0, |a, b| if b.is_nan() { f64::INFINITY } else { b.max(a) })
    }
}

/// The zeros and the lowest `m` Ritz pairs.
fn joined(zeros: &Dense, krylov: Krylov<'_>, ritz: &Ritz, mu: f64, m: usize) -> Eigenpairs {
    let chosen: Vec<usize> = (0..ritz.values.len()).rev().take(m).collect();
    let new = krylov.vectors(ritz, &chosen);
    let c = zeros.ncols();
    let mut vectors = Dense::zeros(zeros.nrows(), c + m);
    vectors.subcols_mut(0, c).copy_from(zeros);
    for (group, panel) in new.iter().enumerate() {
        panel.write_columns(&mut vectors, c + group * WIDTH);
    }
    let lambdas = chosen.iter().map(|&at| ritz.values[at].recip() - mu);
    Eigenpairs { values: vec![0.0; c].into_iter().chain(lambdas).collect(), vectors }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::TriMesh;
    use crate::mesh::sample::icosphere;
    use crate::mesh::topology::component_labels;
    use crate::operators::{Boundary, MassKind, Operators};
    use crate::spectrum::TrianglePencil;

    fn posed<T>(
        mesh: &TriMesh,
        kind: MassKind,
        work: impl FnOnce(&Problem<'_>, &Analysis<'_>) -> T,
    ) -> T {
        let operators = Operators::assemble(mesh, kind).unwrap();
        let labels = component_labels(mesh);
        let problem = Problem::new(&operators, Boundary::Neumann, &labels).unwrap();
        work(&problem, &Analysis::new(problem.pencil()).unwrap())
    }

    /// Functions 1 % off the eigenfunctions after the constant.
    fn nearly(pairs: &Eigenpairs, k: usize) -> Dense {
        let n = pairs.vectors.nrows();
        Dense::from_fn(n, k - 1, |i, j| {
            pairs.vectors[(i, j + 1)] + 0.01 * ((i * (j + 3)) as f64 * 0.61).sin()
        })
    }

    #[test]
    fn from_nearby_functions_the_pairs_of_the_reference_in_fewer_blocks_than_from_any_others() {
        for (kind, k) in [(MassKind::Lumped, 9), (MassKind::Consistent, 20)] {
            posed(&icosphere(4), kind, |problem, analysis| {
                let reference = fem::lowest(problem, analysis, k).unwrap().pairs;
                let warm = lowest_from(problem, analysis, &nearly(&reference, k)).unwrap();
                for (found, expected) in warm.pairs.values.iter().zip(&reference.values) {
                    assert!((found - expected).abs() <= 1e-10 * expected, "{found} {expected}");
                }
                let other = Dense::from_fn(problem.pencil().n(), k - 1, |i, j| {
                    ((i * (2 * j + 7)) as f64 * 1.37).cos()
                });
                let cold = lowest_from(problem, analysis, &other).unwrap();
                assert!(warm.blocks < cold.blocks, "{} {}", warm.blocks, cold.blocks);
                for (found, expected) in cold.pairs.values.iter().zip(&reference.values) {
                    assert!((found - expected).abs() <= 1e-10 * expected, "{found} {expected}");
                }
            });
        }
    }

    #[test]
    fn ritz_values_on_the_span_are_those_of_the_assembled_pencil_and_no_mean_is_above() {
        let mesh = icosphere(3);
        posed(&mesh, MassKind::Consistent, |problem, analysis| {
            let pencil = TrianglePencil::of_mesh(&mesh, MassKind::Consistent).unwrap();
            let reference = fem::lowest(problem, analysis, 6).unwrap().pairs.truncated(6);
            let mut phi = reference.vectors.clone();
            phi.subcols_mut(1, 5).copy_from(nearly(&reference, 6));
            let refined = rayleigh_ritz(|x| pencil.projected(x), &phi, 1, 1e-9).unwrap();
            let (a, m) = problem.pencil().projected(&phi.subcols(1, 5).to_owned());
            let expected = ritz_pairs(&a, &m, 0.0).values;
            for (found, expected) in refined.values[1..].iter().zip(&expected) {
                assert!((found / expected - 1.0).abs() < 1e-11, "{found} {expected}");
            }
            let quotients = pencil.rayleigh_quotients(&phi);
            let sum = |values: &[f64]| values.iter().sum::<f64>();
            assert!(sum(&refined.values) <= sum(&quotients));
            let twice = Dense::from_fn(phi.nrows(), 3, |i, _| phi[(i, 2)]);
            assert!(rayleigh_ritz(|x| pencil.projected(x), &twice, 0, 1e-9).is_none());
        });
    }

    #[test]
    fn nothing_to_start_from_leaves_the_constants_and_small_meshes_are_solved_densely() {
        posed(&icosphere(4), MassKind::Lumped, |problem, analysis| {
            let none = Dense::zeros(problem.pencil().n(), 0);
            assert_eq!(lowest_from(problem, analysis, &none).unwrap().pairs.values, [0.0]);
        });
        posed(&icosphere(1), MassKind::Lumped, |problem, analysis| {
            let start = Dense::from_fn(42, 3, |i, j| ((i + 5 * j) as f64).sin());
            let refined = lowest_from(problem, analysis, &start).unwrap();
            assert_eq!((refined.blocks, refined.pairs.len()), (0, 4));
        });
    }
}
