//! WKS, the wave kernel signature: how likely a quantum particle of energy about e is met at a point.
//!
//! M. Aubry, U. Schlickewei and D. Cremers, The wave kernel signature: a quantum mechanical approach to shape analysis,
//! ICCV Workshops (2011): WKS(x, e) = C_e Σ φ_k(x)² exp(−(e − ln λ_k)²/2σ²) over λ_k > 0, where C_e = 1/Σ exp(−(e − ln
//! λ_k)²/2σ²), so that the integral over the surface is 1 for every e. In 1/(input unit)².

use super::{Basis, Descriptor, TooFew};
use crate::spectrum::Dense;
use crate::spectrum::pencil::combine;

/// How many energies the paper takes.
pub const ENERGIES: usize = 100;

/// σ, in steps between energies.
const WIDTH: f64 = 7.0;

/// Logarithms of energies, and how far a particle's may be from one.
#[derive(Debug, Clone, PartialEq)]
pub struct Energies {
    /// e, ascending.
    pub e: Vec<f64>,
    /// σ.
    pub sigma: f64,
}

impl Energies {
    /// `count` energies. With δ = (ln λ_K − ln λ₂)/count, from the smallest λ that is not 0 to the largest, σ
    /// is 7δ, and e goes from ln λ₂ + 2σ to ln λ_K − 2σ in even steps.
    ///
    /// # Errors
    /// When there are not two different λ > 0.
    ///
    /// # Panics
    /// When `count` is below 29: 4σ are then more than what there is from ln λ₂ to ln λ_K.
    pub fn of(basis: &Basis<'_>, count: usize) -> Result<Self, TooFew> {
        assert!(count as f64 > 4.0 * WIDTH, "{count} energies are too few");
        let [low, high] = basis.range(Descriptor::Wks, 2)?.map(f64::ln);
        let sigma = WIDTH * (high - low) / count as f64;
        let [first, last] = [low + 2.0 * sigma, high - 2.0 * sigma];
        let step = (last - first) / count.saturating_sub(1).max(1) as f64;
        Ok(Self { e: (0..count).map(|i| first + step * i as f64).collect(), sigma })
    }
}

/// WKS(x, e) at every vertex for every energy, n×E.
pub fn wks(basis: &Basis<'_>, energies: &Energies) -> Dense {
    let Energies { e, sigma } = energies;
    let columns: Vec<usize> = basis.positive().collect();
    let weight = |j: usize, i: usize| {
        let away = (e[i] - basis.values[columns[j]].ln()) / sigma;
        (-0.5 * away * away).exp()
    };
    let mut weights = Dense::from_fn(columns.len(), e.len(), weight);
    for i in 0..e.len() {
        let c = weights.col(i).iter().sum::<f64>().recip();
        weights.col_mut(i).iter_mut().for_each(|weight| *weight *= c);
    }
    let square = |i: usize, j: usize| basis.vectors[(i, columns[j])].powi(2);
    combine(&Dense::from_fn(basis.n(), columns.len(), square), &weights)
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
    fn on_the_sphere_it_is_one_over_the_area_at_every_energy() {
        let exact = ClosedForm::Sphere.eigenpairs(&icosphere(2), Boundary::Neumann, 100).unwrap();
        let pairs = Eigenpairs { values: exact.values, vectors: exact.vectors };
        let basis = Basis::new(&pairs, 4.0 * PI);
        let energies = Energies::of(&basis, ENERGIES).unwrap();
        let delta = (90_f64.ln() - 2_f64.ln()) / 100.0;
        assert!((energies.sigma - 7.0 * delta).abs() < 1e-15);
        assert!((energies.e[0] - 2_f64.ln() - 14.0 * delta).abs() < 1e-14);
        assert!((energies.e[99] - 90_f64.ln() + 14.0 * delta).abs() < 1e-14);
        let wks = wks(&basis, &energies);
        for (x, i) in (0..basis.n()).flat_map(|x| (0..ENERGIES).map(move |i| (x, i))) {
            assert!((wks[(x, i)] * 4.0 * PI - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn on_the_square_it_is_the_weighted_mean_of_the_squares() {
        let mesh = Shape::Square.sample(60, 1, 0).unwrap();
        let exact = ClosedForm::Square.eigenpairs(&mesh, Boundary::Dirichlet, 20).unwrap();
        let pairs = Eigenpairs { values: exact.values, vectors: exact.vectors };
        let basis = Basis::new(&pairs, PI * PI);
        let energies = Energies::of(&basis, ENERGIES).unwrap();
        let found = wks(&basis, &energies);
        for (x, &[a, b, _]) in mesh.vertices().iter().enumerate() {
            for (i, e) in energies.e.iter().enumerate() {
                // Over the whole eigenspaces up to λ₂₀, n² + m² ≤ 32.
                let (mut sum, mut weights) = (0.0, 0.0);
                for (n, m) in
                    (1..=5).flat_map(|n| (1..=5).map(move |m| (f64::from(n), f64::from(m))))
                {
                    let lambda = n * n + m * m;
                    if lambda <= pairs.values[pairs.len() - 1] {
                        let weight =
                            (-(e - lambda.ln()).powi(2) / (2.0 * energies.sigma.powi(2))).exp();
                        sum += weight * ((n * a).sin() * (m * b).sin() * 2.0 / PI).powi(2);
                        weights += weight;
                    }
                }
                assert!((found[(x, i)] - sum / weights).abs() < 1e-12);
            }
        }
    }
}
