//! GPS, the global point signature: every point at (φ_k(x)/√λ_k) over λ_k > 0.
//!
//! R. M. Rustamov, Laplace–Beltrami eigenfunctions for deformation invariant shape representation, Symposium on Geometry
//! Processing (2007). The inner product of two points is Green's function G(x, y) = Σ φ_k(x) φ_k(y)/λ_k. It has no unit and
//! does not change with size; the signs, and the basis inside an eigenspace, are those of the eigenfunctions.

use super::{Basis, Descriptor, TooFew};
use crate::spectrum::Dense;

/// φ_k(x)/√λ_k, one column for every λ_k > 0.
///
/// # Errors
/// When there is none.
pub fn gps(basis: &Basis<'_>) -> Result<Dense, TooFew> {
    let columns = basis.first_positive(Descriptor::Gps, 1)?;
    let value = |i, j: usize| basis.vectors[(i, columns[j])] / basis.values[columns[j]].sqrt();
    Ok(Dense::from_fn(basis.n(), columns.len(), value))
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::mesh::sample::icosphere;
    use crate::operators::Boundary;
    use crate::spectrum::Eigenpairs;
    use crate::spectrum::closed_form::ClosedForm;

    #[test]
    fn inner_products_are_green_s_function_of_the_sphere() {
        let mesh = icosphere(1);
        let exact = ClosedForm::Sphere.eigenpairs(&mesh, Boundary::Neumann, 1600).unwrap();
        let pairs = Eigenpairs { values: exact.values, vectors: exact.vectors };
        let gps = gps(&Basis::new(&pairs, 4.0 * PI)).unwrap();
        assert_eq!(gps.ncols(), pairs.len() - 1);
        for y in 1..mesh.n() {
            let [p, q] = [0, y].map(|i| mesh.vertices()[i]);
            let cosine: f64 = p.iter().zip(q).map(|(p, q)| p * q).sum();
            let found: f64 = (0..gps.ncols()).map(|j| gps[(0, j)] * gps[(y, j)]).sum();
            // The series by Legendre's recursion, to degree 39; and what it converges to.
            let (mut before, mut legendre, mut series) = (1.0, cosine, 0.0);
            for l in 1..40 {
                let l = f64::from(l);
                series += (2.0 * l + 1.0) / (4.0 * PI * l * (l + 1.0)) * legendre;
                let next = ((2.0 * l + 1.0) * cosine * legendre - l * before) / (l + 1.0);
                (before, legendre) = (legendre, next);
            }
            assert!((found - series).abs() < 1e-12, "{found} {series}");
            let limit = -(((1.0 - cosine) / 2.0).ln() + 1.0) / (4.0 * PI);
            assert!((found - limit).abs() < 2e-3, "{found} {limit}");
        }
    }
}
