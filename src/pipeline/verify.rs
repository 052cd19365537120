//! `[verify]`: the second opinions, and the tolerances of the verdict.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::MpgdStep;
use crate::spectrum::closed_form::ClosedForm;
use crate::spectrum::mpgd::Stopping;

/// The second opinions, and the tolerances of the verdict: a pair is verified when it agrees with the finite-element reference, and
/// with M-PGD where that has converged.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Verify {
    /// The largest relative difference of λ (for λ = 0: relative to the first that is not).
    pub lambda_tolerance: f64,
    /// The largest principal angle to the reference eigenspace, radians.
    pub angle_tolerance: f64,
    /// The largest entry of ΦᵀBΦ − I.
    pub orthonormality_tolerance: f64,
    /// The largest residual of a solved pair, ‖Lφ − λBφ‖ in the B⁻¹ norm, relative to λ.
    pub residual_tolerance: f64,
    /// How far M-PGD goes in one step. docs/trust.md says which α are stable, and how long they take.
    pub mpgd_step: MpgdStep,
    /// Which way M-PGD goes. Where it comes to rest is the same.
    pub mpgd_direction: MpgdDirection,
    /// M-PGD stops when the relative change of a step falls below this, Tol of (22) …
    pub mpgd_tolerance: f64,
    /// … or after so many steps, N_its of (22).
    pub mpgd_iterations: usize,
    /// Seeds M-PGD's start vectors.
    pub mpgd_seed: u64,
    /// A surface whose eigenfunctions have a formula. spectrum.json then also says how far every eigenfunction, FEM's and M-PGD's are
    /// from it (`closed_form`): the angle to the exact eigenspace, and the mean squared error under either norm. The verdict does not
    /// depend on it.
    pub closed_form: Formula,
}

/// `verify.mpgd_direction`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum MpgdDirection {
    /// Down the gradient times (L + μB)⁻¹, by a factorisation.
    Preconditioned,
    /// Down the plain gradient (19), as the paper prints it, which takes thousands of steps on ten thousand vertices.
    Gradient,
}

/// `verify.closed_form`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Formula {
    /// The mesh is of no such surface.
    #[default]
    None,
    /// [0, π]² in the plane z = 0.
    Square,
    /// Of radius 1 around the origin.
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
