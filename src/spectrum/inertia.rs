//! The exact number of eigenvalues below a shift, by Sylvester's law of inertia.

use super::SpectrumError;
use super::factor::Analysis;

/// The relative perturbation of σ that must not change the count.
const ROBUSTNESS: f64 = 1e-6;

/// Counts the eigenvalues of (8) below σ: the negative pivots of an unregularised LDLᵀ of L − σB.
///
/// Returns `None` when the count cannot be trusted: when those at σ(1 ± 1e-6) differ, that is, σ sits on an
/// eigenvalue, or when a pivot vanishes, which says something of a leading minor and nothing of the mesh.
///
/// # Errors
/// [`SpectrumError::OutOfMemory`].
pub fn count_below(analysis: &Analysis<'_>, sigma: f64) -> Result<Option<usize>, SpectrumError> {
    let count = |sigma: f64| match analysis.negative_pivots(sigma) {
        Ok(count) => Ok(Some(count)),
        Err(SpectrumError::Breakdown { .. }) => Ok(None),
        Err(error) => Err(error),
    };
    // At once: near its root an elimination tree has no two fronts that are independent.
    let (below, above) =
        rayon::join(|| count(sigma * (1.0 - ROBUSTNESS)), || count(sigma * (1.0 + ROBUSTNESS)));
    let (below, above) = (below?, above?);
    Ok(below.filter(|_| below == above))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::sample::icosphere;
    use crate::operators::{MassKind, Operators};
    use crate::spectrum::Pencil;

    #[test]
    fn the_sphere_has_l_plus_one_squared_eigenvalues_up_to_degree_l() {
        for levels in [2, 4] {
            let operators = Operators::assemble(&icosphere(levels), MassKind::Lumped).unwrap();
            let analysis = Analysis::new(Pencil::from(&operators)).unwrap();
            for l in 0..4_usize {
                // Halfway between l(l+1) and (l+1)(l+2).
                let sigma = ((l + 1) * (l + 1)) as f64;
                assert_eq!(count_below(&analysis, sigma).unwrap(), Some((l + 1) * (l + 1)));
            }
        }
    }
}
