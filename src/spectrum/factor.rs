//! Sparse factorisations L − σB = R D Rᵀ: one symbolic analysis, any number of shifts.
//!
//! The same factorisation serves three ends: solves with a positive definite matrix (σ < 0), solves with an
//! indefinite one (σ inside the spectrum), and counting, since D has as many negative entries as there are
//! eigenvalues below σ (Sylvester). It is not pivoted and not regularised: an indefinite one may lose digits, which
//! its users have to measure.

use super::elimination::Elimination;
use super::multifrontal::{self, BadPivot};
use super::panel::{Panel, WIDTH};
use super::triangular::{Packed, Plan, Workspace};
use super::{Dense, Pencil, SpectrumError};

/// The fill-reducing analysis of the pattern of L − σB: valid for every σ.
pub struct Analysis<'a> {
    pencil: Pencil<'a>,
    elimination: Elimination,
    plan: Plan,
}

/// L − σB = R D Rᵀ, ready for solves with several right-hand sides.
pub struct Factor<'s> {
    plan: &'s Plan,
    packed: Packed,
}

impl<'a> Analysis<'a> {
    /// Orders and analyses the pattern of the pencil.
    ///
    /// # Errors
    /// [`SpectrumError::OutOfMemory`].
    pub fn new(pencil: Pencil<'a>) -> Result<Self, SpectrumError> {
        let elimination = Elimination::new(pencil)?;
        let plan = Plan::new(&elimination);
        Ok(Self { pencil, elimination, plan })
    }

    /// R D Rᵀ of L + μB, μ > 0, which is positive definite.
    ///
    /// # Errors
    /// [`SpectrumError::Breakdown`] when a pivot is zero or not a number, or some are negative;
    /// [`SpectrumError::OutOfMemory`].
    pub fn positive(&self, mu: f64) -> Result<Factor<'_>, SpectrumError> {
        match self.factor(-mu)? {
            (factor, 0) => Ok(factor),
            (_, negative) => Err(SpectrumError::Indefinite { mu, negative }),
        }
    }

    /// The number of eigenvalues below σ, by the signs of D. No factor is stored.
    ///
    /// # Errors
    /// [`SpectrumError::Breakdown`] when a pivot is zero or not a number.
    pub fn negative_pivots(&self, sigma: f64) -> Result<usize, SpectrumError> {
        multifrontal::factorise(self.pencil, sigma, &self.elimination, ())
            .map_err(|BadPivot(pivot)| SpectrumError::Breakdown { sigma, pivot })
    }

    /// R D Rᵀ of L − σB, and the number of negative entries of D.
    fn factor(&self, sigma: f64) -> Result<(Factor<'_>, usize), SpectrumError> {
        let plan = &self.plan;
        let (packed, negative) = plan
            .factorise(self.pencil, sigma, &self.elimination)
            .ok_or(SpectrumError::OutOfMemory { n: self.pencil.n() })?
            .map_err(|BadPivot(pivot)| SpectrumError::Breakdown { sigma, pivot })?;
        Ok((Factor { plan, packed }, negative))
    }
}

impl Factor<'_> {
    /// Room for [`Self::solve_panel`].
    pub fn workspace(&self) -> Workspace {
        self.plan.workspace()
    }

    /// X ← (L − σB)⁻¹ X for the eight columns of a panel.
    pub fn solve_panel(&self, x: &mut Panel, workspace: &mut Workspace) {
        self.plan.solve(&self.packed, x, workspace);
    }

    /// X ← (L − σB)⁻¹ X, whatever the number of columns.
    pub fn solve_in_place(&self, x: &mut Dense) {
        let mut workspace = self.workspace();
        for first in (0..x.ncols()).step_by(WIDTH) {
            let mut panel = Panel::from_columns(x, first);
            self.solve_panel(&mut panel, &mut workspace);
            panel.write_columns(x, first);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::sample::icosphere;
    use crate::operators::{MassKind, Operators};
    use crate::spectrum::pencil::product;

    #[test]
    fn the_factor_solves_what_it_was_made_from() {
        for kind in [MassKind::Lumped, MassKind::Consistent] {
            for levels in [1, 3] {
                let operators = Operators::assemble(&icosphere(levels), kind).unwrap();
                let pencil = Pencil::from(&operators);
                let analysis = Analysis::new(pencil).unwrap();
                for (sigma, columns) in [(-0.7, 1), (-0.7, 3), (4.0, 11)] {
                    let x = Dense::from_fn(pencil.n(), columns, |i, j| ((i + 3 * j) as f64).sin());
                    let mut y = product(pencil.stiffness, &x);
                    y -= faer::Scale(sigma) * product(pencil.mass, &x);
                    let (factor, negative) = analysis.factor(sigma).unwrap();
                    factor.solve_in_place(&mut y);
                    assert!((&y - &x).norm_max() < 1e-11);
                    // Below 4 the sphere has 0 and three times 2.
                    let below = analysis.negative_pivots(sigma).unwrap();
                    assert_eq!(below, if sigma > 0.0 { 4 } else { 0 });
                    assert_eq!(below, negative);
                }
            }
        }
    }
}
