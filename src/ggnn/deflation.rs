//! Deflation against earlier eigenfunctions: P = I − Φ(ΦᵀBΦ)⁻¹ΦᵀB.
//!
//! Predicted eigenfunctions are not exactly B-orthonormal, so the Gram matrix is inverted rather than assumed.

use faer::Side;
use faer::linalg::solvers::Solve;

use crate::spectrum::Dense;
use crate::spectrum::pencil::{InnerProduct, column, combine, inner};

/// P for a set Φ of functions on one mesh, n×k.
#[derive(Debug, Clone)]
pub struct Deflation {
    phi: Dense,
    /// BΦ(ΦᵀBΦ)⁻¹, n×k: the dual basis.
    dual: Dense,
}

impl Deflation {
    /// Deflates the columns of `phi` in the inner product of `mass`.
    pub fn new(mass: &impl InnerProduct, phi: Dense) -> Self {
        let b_phi = mass.product(&phi);
        let gram = inner(&phi, &b_phi);
        let inverse = match gram.llt(Side::Lower) {
            Ok(factor) => factor.solve(Dense::identity(gram.nrows(), gram.nrows())),
            // Linearly dependent functions: the pseudo-inverse deflates their span all the same.
            Err(_) => pseudo_inverse(&gram),
        };
        Self { dual: combine(&b_phi, &inverse), phi }
    }

    /// u ← P u.
    pub fn apply(&self, u: &mut [f64]) {
        subtract_projection(u, &self.phi, &self.dual);
    }

    /// r ← Pᵀ r.
    pub fn apply_transposed(&self, r: &mut [f64]) {
        subtract_projection(r, &self.dual, &self.phi);
    }

    /// The functions that are deflated, n×k.
    pub fn phi(&self) -> &Dense {
        &self.phi
    }

    /// BΦ(ΦᵀBΦ)⁻¹, n×k.
    pub fn dual(&self) -> &Dense {
        &self.dual
    }
}

/// x ← x − Y (Zᵀ x).
fn subtract_projection(x: &mut [f64], y: &Dense, z: &Dense) {
    let coefficients: Vec<f64> =
        (0..z.ncols()).map(|k| column(z, k).iter().zip(&*x).map(|(z, x)| z * x).sum()).collect();
    for (k, c) in coefficients.into_iter().enumerate() {
        x.iter_mut().zip(column(y, k)).for_each(|(x, y)| *x -= c * y);
    }
}

fn pseudo_inverse(gram: &Dense) -> Dense {
    let pairs = crate::spectrum::rayleigh_ritz::ritz_pairs(gram, gram, 1e-12).coefficients;
    combine(&pairs, &pairs.transpose().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::sample::icosphere;
    use crate::operators::{MassKind, Operators};

    #[test]
    fn what_is_left_is_orthogonal_and_deflating_twice_changes_nothing() {
        let b = Operators::assemble(&icosphere(1), MassKind::Consistent).unwrap().mass;
        let n = b.rows();
        let phi = Dense::from_fn(n, 3, |i, j| ((i * (j + 2)) as f64 * 0.37).sin() + 0.5);
        let deflation = Deflation::new(&b, phi);
        let mut u: Vec<f64> = (0..n).map(|i| (i as f64).cos()).collect();
        deflation.apply(&mut u);
        let mut again = u.clone();
        deflation.apply(&mut again);
        for k in 0..3 {
            let c: f64 = column(deflation.dual(), k).iter().zip(&u).map(|(a, b)| a * b).sum();
            assert!(c.abs() < 1e-13);
        }
        assert!(u.iter().zip(&again).all(|(a, b)| (a - b).abs() < 1e-13));
    }
}
