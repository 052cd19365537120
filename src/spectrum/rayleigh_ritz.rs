//! Rayleigh–Ritz: the eigenpairs of (8) restricted to a subspace, by small dense eigenproblems.

use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{cholesky_in_place, cholesky_in_place_scratch};
use faer::linalg::evd::{ComputeEigenvectors, self_adjoint_evd, self_adjoint_evd_scratch};
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::{Accum, Par, linalg::matmul::matmul};

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::Dense;
use super::pencil::{column, column_mut};

/// Ritz values in ascending order and the coefficients of their vectors, one a column.
#[derive(Debug, Clone)]
pub struct RitzPairs {
    /// The Ritz values.
    pub values: Vec<f64>,
    /// The coefficients Y with YᵀMY = I.
    pub coefficients: Dense,
}

/// Solves A y = θ M y for symmetric A and symmetric positive semi-definite M, both m×m.
///
/// Directions in which M is below `cutoff` times its largest eigenvalue are left out, so that nearly dependent
/// bases do no harm; there may be fewer pairs than m.
pub fn ritz_pairs(a: &Dense, m: &Dense, cutoff: f64) -> RitzPairs {
    let (scales, directions) = symmetric_eigen(m);
    let largest = scales.last().copied().unwrap_or(0.0);
    let kept: Vec<usize> =
        (0..scales.len()).filter(|&i| scales[i] > cutoff * largest && scales[i] > 0.0).collect();
    let whitening = Dense::from_fn(m.nrows(), kept.len(), |i, j| {
        directions[(i, kept[j])] / scales[kept[j]].sqrt()
    });
    let (values, vectors) = symmetric_eigen(&congruence(a, &whitening));
    RitzPairs { values, coefficients: times(whitening.as_ref(), vectors.as_ref()) }
}

/// All eigenvalues (ascending) and orthonormal eigenvectors of a symmetric matrix (its lower triangle is read).
pub fn symmetric_eigen(a: &Dense) -> (Vec<f64>, Dense) {
    if a.nrows() == 0 {
        return (Vec::new(), Dense::zeros(0, 0));
    }
    // On one thread: these matrices are small, and the callers are parallel already.
    let n = a.nrows();
    // The decomposition has absolute tolerances, for matrices of norm 1.
    let unit = power_of_two_below(a.norm_max());
    let a = faer::Scale(unit.recip()) * a;
    let (mut values, mut vectors) = (Diag::zeros(n), Dense::zeros(n, n));
    let scratch =
        self_adjoint_evd_scratch::<f64>(n, ComputeEigenvectors::Yes, Par::Seq, Default::default());
    let outcome = self_adjoint_evd(
        a.as_ref(),
        values.as_mut(),
        Some(vectors.as_mut()),
        Par::Seq,
        MemStack::new(&mut MemBuffer::new(scratch)),
        Default::default(),
    );
    match outcome {
        Ok(()) => (values.column_vector().iter().map(|value| unit * value).collect(), vectors),
        // Only matrices with NaN or infinite entries fail; what is not a number stays visibly so.
        Err(_) => (vec![f64::NAN; n], Dense::identity(n, n)),
    }
}

/// The largest power of two that is not above x, with which a product is exact; 1 where there is none.
fn power_of_two_below(x: f64) -> f64 {
    let power = f64::from_bits(x.abs().to_bits() & f64::INFINITY.to_bits());
    if power.is_normal() && power.recip().is_normal() { power } else { 1.0 }
}

/// The lowest `count` pairs of (A + σI) y = θ M y, ascending, with yᵀMy = 1, for symmetric positive semi-definite A and M,
/// m×m, and σ = `ridge` · tr A. `None` when there are fewer: M has not that rank, or something is not a number.
///
/// A combination y that A and M hardly see would have a meaningless quotient; the ridge makes it a large one. It
/// costs one Cholesky factorisation A + σI = RRᵀ and the eigenpairs of R⁻¹MR⁻ᵀ: for one pair a few dozen steps of
/// Lanczos. [`ritz_pairs`] takes two full eigendecompositions.
pub fn lowest_ridge_pairs(
    a: &Dense,
    m: &Dense,
    ridge: f64,
    count: usize,
) -> Option<Vec<(f64, Vec<f64>)>> {
    let n = a.nrows();
    let shift = ridge * (0..n).map(|i| a[(i, i)]).sum::<f64>();
    let mut factor = a.clone();
    (0..n).for_each(|i| factor[(i, i)] += shift);
    let scratch = cholesky_in_place_scratch::<f64>(n, Par::Seq, Default::default());
    cholesky_in_place(
        factor.as_mut(),
        Default::default(),
        Par::Seq,
        MemStack::new(&mut MemBuffer::new(scratch)),
        Default::default(),
    )
    .ok()?;
    // R⁻¹(R⁻¹M)ᵀ = R⁻¹MR⁻ᵀ.
    let mut half = m.clone();
    solve_lower_triangular_in_place(factor.as_ref(), half.as_mut(), Par::Seq);
    let mut whitened = half.transpose().to_owned();
    solve_lower_triangular_in_place(factor.as_ref(), whitened.as_mut(), Par::Seq);
    let (largest, mut y) = largest_pairs(&whitened, count)?;
    faer::linalg::triangular_solve::solve_upper_triangular_in_place(
        factor.transpose(),
        y.as_mut(),
        Par::Seq,
    );
    let pair = |(j, largest): (usize, f64)| {
        let scale = largest.sqrt().recip();
        let weights: Vec<f64> = column(&y, j).iter().map(|y| y * scale).collect();
        let sound = largest > 0.0 && weights.iter().all(|w| w.is_finite());
        sound.then_some((largest.recip(), weights))
    };
    largest.into_iter().enumerate().map(pair).collect()
}

/// The `count` largest eigenvalues of a symmetric positive semi-definite matrix, m×m, descending, and their unit vectors,
/// m×count.
fn largest_pairs(a: &Dense, count: usize) -> Option<(Vec<f64>, Dense)> {
    if count == 1 {
        return largest_pair(a).map(|(value, vector)| (vec![value], vector));
    }
    let m = a.nrows();
    let (values, vectors) = symmetric_eigen(a);
    let rank = m as f64 * f64::EPSILON * values.last()?;
    let chosen: Vec<usize> = (0..m).rev().take(count).filter(|&j| values[j] > rank).collect();
    (chosen.len() == count).then(|| {
        let vectors = Dense::from_fn(m, count, |i, j| vectors[(i, chosen[j])]);
        (chosen.iter().map(|&j| values[j]).collect(), vectors)
    })
}

/// Lanczos stops when the residual is this small, relative to the eigenvalue. The error of the eigenvalue is its
/// square, relative to the gap.
const LANCZOS_RESIDUAL: f64 = 1e-9;

/// The largest eigenvalue of a symmetric positive semi-definite matrix, m×m, and its unit vector, m×1, by Lanczos
/// with full reorthogonalisation: exact after as many steps as there are different eigenvalues. The start vector is
/// a fixed random one, which no eigenvector of a matrix from elsewhere is orthogonal to.
fn largest_pair(a: &Dense) -> Option<(f64, Dense)> {
    let n = a.nrows();
    let mut basis = Dense::zeros(n, n);
    let mut tridiagonal = Dense::zeros(n, n);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut next = Dense::from_fn(n, 1, |_, _| rng.random_range(-1.0..1.0));
    let length = next.norm_l2();
    column_mut(&mut next, 0).iter_mut().for_each(|v| *v /= length);
    let mut overlaps = Dense::zeros(n, 1);
    let mut check_at = 16;
    for step in 0..n {
        column_mut(&mut basis, step).copy_from_slice(column(&next, 0));
        matmul(next.as_mut(), Accum::Replace, a.as_ref(), basis.subcols(step, 1), 1.0, Par::Seq);
        let (known, mut overlaps) = (basis.subcols(0, step + 1), overlaps.subrows_mut(0, step + 1));
        // Twice is enough: the second pass removes what rounding left of the first.
        for pass in 0..2 {
            matmul(
                overlaps.as_mut(),
                Accum::Replace,
                known.transpose(),
                next.as_ref(),
                1.0,
                Par::Seq,
            );
            matmul(next.as_mut(), Accum::Add, known, overlaps.as_ref(), -1.0, Par::Seq);
            if pass == 0 {
                tridiagonal[(step, step)] = overlaps[(step, 0)];
            }
        }
        let norm = next.norm_l2();
        let exhausted = step + 1 == n || norm <= f64::EPSILON * tridiagonal[(0, 0)].abs();
        if exhausted || step + 1 == check_at {
            let size = step + 1;
            let (values, vectors) =
                symmetric_eigen(&tridiagonal.submatrix(0, 0, size, size).to_owned());
            let largest = values[step];
            let residual = norm * vectors[(step, step)].abs();
            if largest.is_nan() || (exhausted && largest <= 0.0) {
                return None;
            }
            if exhausted || residual <= LANCZOS_RESIDUAL * largest {
                return Some((largest, times(known, vectors.subcols(step, 1))));
            }
            check_at += check_at / 2;
        }
        tridiagonal[(step + 1, step)] = norm;
        column_mut(&mut next, 0).iter_mut().for_each(|v| *v /= norm);
    }
    None
}

/// TᵀAT.
pub fn congruence(a: &Dense, t: &Dense) -> Dense {
    times(t.transpose(), times(a.as_ref(), t.as_ref()).as_ref())
}

fn times(x: faer::MatRef<'_, f64>, y: faer::MatRef<'_, f64>) -> Dense {
    let mut z = Dense::zeros(x.nrows(), y.ncols());
    matmul(z.as_mut(), Accum::Replace, x, y, 1.0, Par::Seq);
    z
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lowest(a: &Dense, m: &Dense, ridge: f64) -> Option<(f64, Vec<f64>)> {
        lowest_ridge_pairs(a, m, ridge, 1).map(|mut pairs| pairs.remove(0))
    }

    #[test]
    fn a_pencil_with_known_values() {
        // diag(2, 12) against diag(1, 4): θ = 2 and 3.
        let a = Dense::from_fn(2, 2, |i, j| if i == j { [2.0, 12.0][i] } else { 0.0 });
        let m = Dense::from_fn(2, 2, |i, j| if i == j { [1.0, 4.0][i] } else { 0.0 });
        let pairs = ritz_pairs(&a, &m, 0.0);
        assert!((pairs.values[0] - 2.0).abs() < 1e-14 && (pairs.values[1] - 3.0).abs() < 1e-14);
        let gram = congruence(&m, &pairs.coefficients);
        assert!((gram[(0, 0)] - 1.0).abs() < 1e-14 && gram[(0, 1)].abs() < 1e-14);
    }

    #[test]
    fn eigenvalues_do_not_depend_on_the_unit_of_a_matrix() {
        // −d²/dx² on a line of 120 vertices, times a smooth density.
        let a = Dense::from_fn(120, 120, |i, j| match i.abs_diff(j) {
            0 => 2.0 + (i as f64 * 0.3).sin(),
            1 => -0.9 - 0.1 * ((i + j) as f64 * 0.7).cos(),
            _ => 0.0,
        });
        let expected = symmetric_eigen(&a);
        for unit in [2.0_f64.powi(-60), 2.0_f64.powi(50)] {
            let (values, vectors) = symmetric_eigen(&(faer::Scale(unit) * &a));
            assert_eq!(values, expected.0.iter().map(|value| unit * value).collect::<Vec<_>>());
            assert_eq!(vectors, expected.1);
        }
    }

    #[test]
    fn the_lowest_pair_is_that_of_the_full_decomposition() {
        for n in [1, 2, 40] {
            // Gram matrices of smooth functions, which are nearly dependent, as features are.
            let gram = |power: i32| {
                Dense::from_fn(n, n, |i, j| {
                    let product = |k: i32| {
                        let [a, b] = [i, j].map(|l| (f64::from(k) * (l + 1) as f64 * 0.05).sin());
                        a * b * f64::from(k).powi(power)
                    };
                    (1..60).map(product).sum::<f64>() + if i == j { 1e-6 } else { 0.0 }
                })
            };
            let (a, m) = (gram(1), gram(0));
            let all = ritz_pairs(&a, &m, 0.0);
            let (value, y) = lowest(&a, &m, 1e-15).unwrap();
            assert!((value / all.values[0] - 1.0).abs() < 1e-7, "{value} {}", all.values[0]);
            let norm: f64 =
                (0..n).map(|j| y[j] * (0..n).map(|i| m[(i, j)] * y[i]).sum::<f64>()).sum();
            assert!((norm - 1.0).abs() < 1e-8);
        }
    }

    #[test]
    fn a_direction_that_neither_matrix_sees_is_not_the_lowest() {
        let a = Dense::from_fn(3, 3, |i, j| if i == j { [5.0, 0.0, 3.0][i] } else { 0.0 });
        let m = Dense::from_fn(3, 3, |i, j| if i == j { [1.0, 1e-17, 1.0][i] } else { 0.0 });
        let (value, y) = lowest(&a, &m, 1e-10).unwrap();
        assert!((value - 3.0).abs() < 1e-8 && y[1].abs() < 1e-3 && y[0].abs() < 1e-6);
        assert_eq!(lowest(&a, &Dense::zeros(3, 3), 1e-10), None);
        let undefined = Dense::from_fn(3, 3, |_, _| f64::NAN);
        assert_eq!(lowest(&undefined, &m, 1e-10), None);
        assert_eq!(lowest(&a, &undefined, 1e-10), None);
    }

    #[test]
    fn dependent_directions_are_left_out() {
        let m = Dense::from_fn(3, 3, |_, _| 1.0);
        let pairs = ritz_pairs(&Dense::identity(3, 3), &m, 1e-12);
        assert_eq!(pairs.values.len(), 1);
        assert!((pairs.values[0] - 1.0 / 3.0).abs() < 1e-14);
    }

    #[test]
    fn the_ridge_pair_of_a_matrix_whose_top_vector_alternates() {
        // M = [[2, −1], [−1, 2]] has 3 with (1, −1); a start of ones would never see it.
        let m = Dense::from_fn(2, 2, |i, j| if i == j { 2.0 } else { -1.0 });
        let (quotient, weights) = lowest(&Dense::identity(2, 2), &m, 1e-15).unwrap();
        assert!((quotient - 1.0 / 3.0).abs() < 1e-12);
        assert!((weights[0] + weights[1]).abs() < 1e-12);
    }
}
