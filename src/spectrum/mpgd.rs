//! M-PGD, Algorithm 1 of the paper: one eigenpair after the other by projected gradient descent on the
//! Rayleigh quotient, with its fixed step as printed, or with an exact line search.
//!
//! - `descent`: the inner iteration, (19) to (22), and the two steps
//! - `constraint`: the projection (21)
//! - `stability`: which fixed steps are stable
//!
//! Plain gradients need thousands of steps on a mesh of ten thousand vertices, since the largest eigenvalue sets
//! their pace. A preconditioner changes the direction alone: whatever it is, the quotient, the constraint and the
//! point where the iteration rests are those of (L, B).

mod constraint;
mod descent;
mod stability;
#[cfg(test)]
mod tests;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::eigenpairs::{normalise, orient};
use super::factor::Factor;
use super::pencil::column;
use super::{Dense, Eigenpairs, Pencil};
use constraint::Constraint;
pub use stability::largest_step;

/// When the inner iteration stops: (22).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Stopping {
    /// Tol: stop when the relative change of t falls below it.
    pub tolerance: f64,
    /// N_its: stop after this many steps.
    pub max_iterations: usize,
}

/// How far the iteration goes in one step, and which way.
#[derive(Clone, Copy)]
pub enum Step<'a> {
    /// t ← t − αd for a fixed α > 0 and the projected gradient d, as the paper prints it. [`largest_step`] tells
    /// which α are stable.
    Fixed(f64),
    /// The lowest Ritz pair of span{t, d}, which needs no α.
    Exact(Direction<'a>),
}

/// Which way the exact step goes from the gradient (19).
#[derive(Clone, Copy)]
pub enum Direction<'a> {
    /// Down the gradient, as the paper prints it.
    Gradient,
    /// Down (L + μB)⁻¹ times the gradient.
    Preconditioned(&'a Factor<'a>),
}

/// How M-PGD is to go.
#[derive(Clone, Copy)]
pub struct Options<'a> {
    /// The step, and its direction.
    pub step: Step<'a>,
    /// When a pair is done.
    pub stopping: Stopping,
    /// Seeds the start vectors.
    pub seed: u64,
}

/// What ended the iteration for one pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StoppedBy {
    /// The relative change fell below Tol, at a point where the residual is small too.
    Tolerance,
    /// N_its steps were taken.
    Count,
    /// As `Tolerance`, but an earlier pair that this one was kept away from had not converged: it may rest
    /// anywhere.
    AfterUnconverged,
    /// The caller asked to stop.
    Cancelled,
    /// The fixed step is too long: the quotient is no number any more; or the iteration ended short of an eigenpair
    /// with the quotient above where it began, or t a hundred times as long. The vector is the last one whose
    /// quotient was a number.
    Diverged,
    /// The relative change fell below Tol where the residual is still large: for this Tol the steps are too short
    /// to get anywhere.
    Stalled,
}

/// How the iteration for one pair went.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Run {
    /// Steps taken.
    pub iterations: usize,
    /// The relative change of the last step.
    pub change: f64,
    /// ‖Lt − R(t)Bt‖ in the norm of diag(B)⁻¹, relative to R(t), where the iteration ended.
    pub residual: f64,
    /// Why it ended.
    pub stopped_by: StoppedBy,
}

/// Computes the first `count` eigenpairs, the first `known` of which are given.
///
/// Every start vector is random, projected onto the constraint (18), or its component along the known vectors
/// would never leave, and scaled to unit B-norm. `cancelled` is asked every so many steps. Cost per step:
/// O(nnz + kn), and a solve where there is a preconditioner.
///
/// # Panics
/// When `count` is larger than the pencil.
pub fn lowest(
    pencil: Pencil<'_>,
    known: &Eigenpairs,
    count: usize,
    options: Options<'_>,
    cancelled: &dyn Fn() -> bool,
) -> (Eigenpairs, Vec<Run>) {
    let n = pencil.n();
    assert!(count <= n, "{count} pairs of a pencil with {n} rows");
    let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
    let mut constraint = Constraint::new(pencil, count);
    for j in 0..known.len() {
        constraint.push(column(&known.vectors, j));
    }
    let mut values = known.values.clone();
    let mut runs = Vec::new();
    while values.len() < count {
        let mut start: Vec<f64> = (0..n).map(|_| rng.random_range(-1.0..1.0)).collect();
        constraint.project(&mut start);
        normalise(&mut start, pencil.mass);
        let (mut t, mut run) = descent::descend(&constraint, start, options, cancelled);
        let shaken = runs.iter().any(|earlier: &Run| earlier.stopped_by != StoppedBy::Tolerance);
        if shaken && run.stopped_by == StoppedBy::Tolerance {
            run.stopped_by = StoppedBy::AfterUnconverged;
        }
        constraint.project(&mut t);
        normalise(&mut t, pencil.mass);
        orient(&mut t);
        values.push(pencil.rayleigh_quotient(&t));
        constraint.push(&t);
        runs.push(run);
        if run.stopped_by == StoppedBy::Cancelled {
            break;
        }
    }
    let vectors = Dense::from_fn(n, values.len(), |i, j| constraint.functions()[j][i]);
    (Eigenpairs { values, vectors }, runs)
}
