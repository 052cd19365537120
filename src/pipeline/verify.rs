//! `[verify]`: the second opinions, and the tolerances of the verdict.

use serde::{Deserialize, Serialize};

use super::MpgdStep;
use crate::spectrum::closed_form::ClosedForm;
use crate::spectrum::mpgd::Stopping;

/// `[verify]`
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Verify {
    /// The largest relative difference of λ from the reference.
    pub lambda_tolerance: f64,
    /// The largest principal angle to the reference cluster, radians.
    pub angle_tolerance: f64,
    /// The largest entry of ΦᵀBΦ − I.
    pub orthonormality_tolerance: f64,
    /// The largest ‖Lφ − λBφ‖ in the B⁻¹ norm, relative to λ, of a solved pair.
    pub residual_tolerance: f64,
    /// How far M-PGD goes in one step: `exact`, to the lowest quotient along its direction, or a fixed α.
    pub mpgd_step: MpgdStep,
    /// Which way M-PGD goes: `preconditioned` by a factorisation, or down the plain `gradient` as the paper prints
    /// it, which takes thousands of steps on ten thousand vertices.
    pub mpgd_direction: MpgdDirection,
    /// M-PGD's Tol of (22).
    pub mpgd_tolerance: f64,
    /// M-PGD's N_its of (22).
    pub mpgd_iterations: usize,
    /// Seeds M-PGD's start vectors.
    pub mpgd_seed: u64,
    /// The surface whose formula eigenfunctions are measured against as well; the verdict does not depend on it.
    pub closed_form: Formula,
}

/// `verify.mpgd_direction`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MpgdDirection {
    /// (L + μB)⁻¹ times the gradient.
    Preconditioned,
    /// The gradient (19).
    Gradient,
}

/// `verify.closed_form`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Formula {
    /// None is known.
    #[default]
    None,
    /// [`ClosedForm::Square`].
    Square,
    /// [`ClosedForm::Sphere`].
    Sphere,
}

impl Formula {
    /// The surface, if there is one.
    pub fn surface(self) -> Option<ClosedForm> {
        match self {
            Self::None => None,
            Self::Square => Some(ClosedForm::Square),
            Self::Sphere => Some(ClosedForm::Sphere),
        }
    }
}

impl Default for Verify {
    fn default() -> Self {
        Self {
            lambda_tolerance: 0.01,
            angle_tolerance: 0.05,
            orthonormality_tolerance: 1e-8,
            residual_tolerance: 1e-6,
            mpgd_step: MpgdStep::Exact,
            mpgd_direction: MpgdDirection::Preconditioned,
            mpgd_tolerance: 1e-6,
            mpgd_iterations: 20_000,
            mpgd_seed: 1,
            closed_form: Formula::None,
        }
    }
}

impl Verify {
    /// When M-PGD stops.
    pub fn stopping(&self) -> Stopping {
        Stopping { tolerance: self.mpgd_tolerance, max_iterations: self.mpgd_iterations }
    }
}
