//! Functions on the vertices as coefficients of eigenfunctions, and back: the Fourier transform of a surface.
//!
//! c = ΦᵀBf, and Φc is the function of their span that is nearest to f in the B-norm, for a B-orthonormal Φ (B. Vallet and
//! B. Lévy, Spectral geometry processing with manifold harmonics, Computer Graphics Forum 27, 2008). Learned Φ are
//! B-orthonormal to what their certificate says, and c is as good.

use crate::spectrum::Dense;
use crate::spectrum::pencil::{InnerProduct, column, combine, inner};

/// What is left of functions on the span of eigenfunctions.
#[derive(Debug, Clone)]
pub struct Projection {
    /// ΦᵀBF, K×m.
    pub coefficients: Dense,
    /// ‖f − Φc‖/‖f‖ in the B-norm, length m; 0 for f = 0.
    pub residuals: Vec<f64>,
}

/// Projects m functions F, n×m, onto the K eigenfunctions Φ = `vectors`, n×K.
pub fn project(vectors: &Dense, mass: &impl InnerProduct, functions: &Dense) -> Projection {
    let coefficients = inner(vectors, &mass.product(functions));
    let rest = functions - &combine(vectors, &coefficients);
    let residual = |j: usize| {
        let [rest, whole] = [&rest, functions].map(|f| mass.square(column(f, j)).sqrt());
        if whole > 0.0 { rest / whole } else { 0.0 }
    };
    let residuals = (0..functions.ncols()).map(residual).collect();
    Projection { coefficients, residuals }
}

/// The m functions ΦC, n×m, that have these coefficients C, K×m.
pub fn synthesise(vectors: &Dense, coefficients: &Dense) -> Dense {
    combine(vectors, coefficients)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::descriptors::laws::solved;
    use crate::mesh::sample::icosphere;

    #[test]
    fn coordinates_of_the_sphere_are_of_degree_one_and_their_squares_of_zero_and_two() {
        let mesh = icosphere(4);
        let (operators, pairs) = solved(&mesh, 9);
        let f = Dense::from_fn(mesh.n(), 3, |i, j| {
            let [x, y, z] = mesh.vertices()[i];
            [x, z * z, x * y * z][j]
        });
        let Projection { coefficients, residuals } = project(&pairs.vectors, &operators.mass, &f);
        // ∫ x² = 4π/3; ∫ z⁴ = 4π/5, of which (∫ z²)²/4π = 4π/9 is constant; xyz is of degree 3, which is not here.
        let energy = |j: usize, range: std::ops::Range<usize>| -> f64 {
            range.map(|k| coefficients[(k, j)].powi(2)).sum()
        };
        let pi4 = 4.0 * std::f64::consts::PI;
        assert!((energy(0, 1..4) / (pi4 / 3.0) - 1.0).abs() < 0.01);
        assert!(energy(0, 0..1) + energy(0, 4..9) < 1e-3);
        assert!((energy(1, 0..1) / (pi4 / 9.0) - 1.0).abs() < 0.02);
        assert!((energy(1, 4..9) / (pi4 * (0.2 - 1.0 / 9.0)) - 1.0).abs() < 0.02);
        assert!(residuals[0] < 1e-3 && residuals[1] < 1e-3 && residuals[2] > 0.99, "{residuals:?}");
    }

    #[test]
    fn what_is_of_the_span_comes_back() {
        let mesh = icosphere(2);
        let (operators, pairs) = solved(&mesh, 9);
        let c = Dense::from_fn(9, 2, |i, j| (i as f64 - 3.0) * (j as f64 + 0.5));
        let f = synthesise(&pairs.vectors, &c);
        let Projection { coefficients, residuals } = project(&pairs.vectors, &operators.mass, &f);
        assert!((&coefficients - &c).norm_max() < 1e-12);
        assert!(residuals.iter().all(|&residual| residual < 1e-12), "{residuals:?}");
        let zero = project(&pairs.vectors, &operators.mass, &Dense::zeros(mesh.n(), 1));
        assert_eq!(zero.residuals, [0.0]);
    }
}
