//! Diffusion distances: two points are near when heat from either spreads alike.
//!
//! R. R. Coifman and S. Lafon, Diffusion maps, Applied and Computational Harmonic Analysis 21 (2006): d_t(x, y)² = Σ
//! exp(−2λ_k t) (φ_k(x) − φ_k(y))², which is ‖k_t(x, ·) − k_t(y, ·)‖² over the surface. In 1/(input unit); t in (input
//! unit)². Points of different pieces are apart at every time, since no heat goes from one to the other.

use super::Basis;

/// d_t from vertex `x` to every vertex, length n.
///
/// # Panics
/// When there is no vertex `x`.
pub fn from_vertex(basis: &Basis<'_>, x: usize, t: f64) -> Vec<f64> {
    let weights = weights(basis, t);
    (0..basis.n()).map(|y| distance(basis, &weights, x, y)).collect()
}

/// d_t between the vertices of every pair.
///
/// # Panics
/// When there is no such vertex.
pub fn between(basis: &Basis<'_>, vertices: &[[usize; 2]], t: f64) -> Vec<f64> {
    let weights = weights(basis, t);
    vertices.iter().map(|&[x, y]| distance(basis, &weights, x, y)).collect()
}

fn weights(basis: &Basis<'_>, t: f64) -> Vec<f64> {
    basis.values.iter().map(|value| (-2.0 * value * t).exp()).collect()
}

fn distance(basis: &Basis<'_>, weights: &[f64], x: usize, y: usize) -> f64 {
    let apart = |j: usize| basis.vectors[(x, j)] - basis.vectors[(y, j)];
    let terms = weights.iter().enumerate().map(|(j, weight)| weight * apart(j).powi(2));
    terms.sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::mesh::sample::{Shape, icosphere};
    use crate::operators::Boundary;
    use crate::spectrum::Eigenpairs;
    use crate::spectrum::closed_form::ClosedForm;

    #[test]
    fn on_the_sphere_it_is_a_series_of_legendre_polynomials() {
        let mesh = icosphere(2);
        let exact = ClosedForm::Sphere.eigenpairs(&mesh, Boundary::Neumann, 100).unwrap();
        let pairs = Eigenpairs { values: exact.values, vectors: exact.vectors };
        let basis = Basis::new(&pairs, 4.0 * PI);
        let t = 0.07;
        let found = from_vertex(&basis, 3, t);
        for (y, found) in found.into_iter().enumerate() {
            let cosine: f64 =
                mesh.vertices()[3].iter().zip(mesh.vertices()[y]).map(|(p, q)| p * q).sum();
            let (mut before, mut legendre, mut square) = (1.0, cosine, 0.0);
            for l in 1..10 {
                let l = f64::from(l);
                let decay = (-2.0 * l * (l + 1.0) * t).exp();
                square += decay * (2.0 * l + 1.0) / (2.0 * PI) * (1.0 - legendre);
                let next = ((2.0 * l + 1.0) * cosine * legendre - l * before) / (l + 1.0);
                (before, legendre) = (legendre, next);
            }
            assert!((found.powi(2) - square).abs() < 1e-12, "{y}: {found} {}", square.sqrt());
        }
    }

    #[test]
    fn it_is_a_metric_that_fades() {
        let mesh = Shape::Square.sample(60, 0, 0).unwrap();
        let exact = ClosedForm::Square.eigenpairs(&mesh, Boundary::Neumann, 40).unwrap();
        let pairs = Eigenpairs { values: exact.values, vectors: exact.vectors };
        let basis = Basis::new(&pairs, PI * PI);
        let [xy, yx, yz, xz] =
            between(&basis, &[[0, 1], [1, 0], [1, 2], [0, 2]], 0.2).try_into().unwrap();
        assert!(xy == yx && xz <= xy + yz);
        assert_eq!(from_vertex(&basis, 2, 0.2)[2], 0.0);
        assert!(between(&basis, &[[0, 1]], 30.0)[0] < 1e-12);
    }
}
