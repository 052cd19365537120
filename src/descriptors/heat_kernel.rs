//! HKS, the heat kernel signature: how much of the heat that is put on a point is still there at time t.
//!
//! J. Sun, M. Ovsjanikov and L. Guibas, A concise and provably informative multi-scale signature based on heat diffusion,
//! Computer Graphics Forum 28 (2009): k_t(x, x) = Σ exp(−λ_k t) φ_k(x)², over all k, those of λ = 0 among them. It is in
//! 1/(input unit)², and t in (input unit)². Scaled by the heat trace Σ exp(−λ_k t) = ∫ k_t(x, x) dx, all times weigh the
//! same.

use super::{Basis, Descriptor, TooFew};
use crate::spectrum::Dense;
use crate::spectrum::pencil::{column_mut, combine};

/// How many times the paper takes.
pub const TIMES: usize = 100;

/// `count` times, a constant factor apart, from 4 ln 10/λ_K, with the largest λ, to 4 ln 10/λ₂, with the smallest that is
/// not 0.
///
/// # Errors
/// When no λ is positive.
pub fn times(basis: &Basis<'_>, count: usize) -> Result<Vec<f64>, TooFew> {
    let [low, high] = basis.range(Descriptor::Hks, 1)?;
    let [first, last] = [high, low].map(|lambda| 4.0 * 10_f64.ln() / lambda);
    let steps = count.saturating_sub(1).max(1) as f64;
    Ok((0..count).map(|i| first * (last / first).powf(i as f64 / steps)).collect())
}

/// k_t(x, x) at every vertex for every time, n×T.
pub fn hks(basis: &Basis<'_>, times: &[f64]) -> Dense {
    let decay = |j: usize, i: usize| (-basis.values[j] * times[i]).exp();
    combine(&basis.squares(), &Dense::from_fn(basis.values.len(), times.len(), decay))
}

/// k_t(x, x) over the heat trace, n×T: its integral over the surface is 1 at every time.
pub fn scaled_hks(basis: &Basis<'_>, times: &[f64]) -> Dense {
    let mut scaled = hks(basis, times);
    for (i, trace) in heat_trace(basis.values, times).into_iter().enumerate() {
        column_mut(&mut scaled, i).iter_mut().for_each(|value| *value /= trace);
    }
    scaled
}

/// Σ exp(−λ_k t) for every time.
pub fn heat_trace(values: &[f64], times: &[f64]) -> Vec<f64> {
    times.iter().map(|t| values.iter().map(|value| (-value * t).exp()).sum()).collect()
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
    fn on_the_sphere_every_point_has_the_series_of_the_degrees() {
        // The squares of the harmonics of degree l sum to (2l + 1)/4π.
        let exact = ClosedForm::Sphere.eigenpairs(&icosphere(2), Boundary::Neumann, 100).unwrap();
        let pairs = Eigenpairs { values: exact.values, vectors: exact.vectors };
        let basis = Basis::new(&pairs, 4.0 * PI);
        let times = times(&basis, TIMES).unwrap();
        assert!((times[0] - 4.0 * 10_f64.ln() / 90.0).abs() < 1e-15);
        assert!((times[TIMES - 1] - 2.0 * 10_f64.ln()).abs() < 1e-14);
        let (hks, scaled) = (hks(&basis, &times), scaled_hks(&basis, &times));
        for (i, t) in times.iter().enumerate() {
            let of_degree = |l: i32| f64::from(2 * l + 1) * (-f64::from(l * (l + 1)) * t).exp();
            let expected = (0..10).map(of_degree).sum::<f64>() / (4.0 * PI);
            for x in 0..basis.n() {
                assert!((hks[(x, i)] / expected - 1.0).abs() < 1e-12);
                assert!((scaled[(x, i)] * 4.0 * PI - 1.0).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn on_the_square_it_is_a_product_of_theta_series() {
        let mesh = Shape::Square.sample(80, 1, 0).unwrap();
        let exact = ClosedForm::Square.eigenpairs(&mesh, Boundary::Neumann, 300).unwrap();
        let pairs = Eigenpairs { values: exact.values, vectors: exact.vectors };
        let basis = Basis::new(&pairs, PI * PI);
        let times = [0.1, 0.3, 1.0, 10.0];
        let found = hks(&basis, &times);
        for (x, &[a, b, _]) in mesh.vertices().iter().enumerate() {
            for (i, t) in times.into_iter().enumerate() {
                let theta = |x: f64| {
                    let term =
                        |n: i32| (-f64::from(n * n) * t).exp() * (f64::from(n) * x).cos().powi(2);
                    (1.0 + 2.0 * (1..50).map(term).sum::<f64>()) / PI
                };
                assert!((found[(x, i)] / (theta(a) * theta(b)) - 1.0).abs() < 1e-12);
            }
        }
    }
}
