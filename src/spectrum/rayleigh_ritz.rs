//! Rayleigh–Ritz: the eigenpairs of (8) restricted to a subspace, by small dense eigenproblems.

use faer::{Accum, Par, Side, linalg::matmul::matmul};

use super::Dense;

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
    match a.self_adjoint_eigen(Side::Lower) {
        Ok(eigen) => (eigen.S().column_vector().iter().copied().collect(), eigen.U().to_owned()),
        // Only matrices with NaN or infinite entries fail; what is not a number stays visibly so.
        Err(_) => (vec![f64::NAN; a.nrows()], Dense::identity(a.nrows(), a.nrows())),
    }
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
    fn dependent_directions_are_left_out() {
        let m = Dense::from_fn(3, 3, |_, _| 1.0);
        let pairs = ritz_pairs(&Dense::identity(3, 3), &m, 1e-12);
        assert_eq!(pairs.values.len(), 1);
        assert!((pairs.values[0] - 1.0 / 3.0).abs() < 1e-14);
    }
}
