//! Spectral coordinates: the first three eigenfunctions of λ > 0 as x, y and z of a point.
//!
//! Eigenmaps (M. Belkin and P. Niyogi, Laplacian eigenmaps for dimensionality reduction and data representation, Neural
//! Computation 15, 2003) as they are used to see and to segment shapes: φ₂, φ₃ and φ₄ of a mesh of one piece. In 1/(input
//! unit).

use super::{Basis, Descriptor, TooFew};
use crate::spectrum::Dense;

/// The first three φ_k with λ_k > 0, n×3.
///
/// # Errors
/// When there are fewer.
pub fn spectral_coordinates(basis: &Basis<'_>) -> Result<Dense, TooFew> {
    let columns = basis.first_positive(Descriptor::SpectralCoordinates, 3)?;
    Ok(Dense::from_fn(basis.n(), 3, |i, j| basis.vectors[(i, columns[j])]))
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
    fn of_the_sphere_they_are_a_sphere() {
        let mesh = icosphere(2);
        let exact = ClosedForm::Sphere.eigenpairs(&mesh, Boundary::Neumann, 9).unwrap();
        let pairs = Eigenpairs { values: exact.values, vectors: exact.vectors };
        let found = spectral_coordinates(&Basis::new(&pairs, 4.0 * PI)).unwrap();
        for x in 0..mesh.n() {
            let square: f64 = (0..3).map(|j| found[(x, j)].powi(2)).sum();
            assert!((square - 3.0 / (4.0 * PI)).abs() < 1e-14);
        }
    }
}
