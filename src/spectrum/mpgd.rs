//! M-PGD, Algorithm 1 of the paper: one eigenpair after the other by projected gradient descent on the
//! Rayleigh quotient, here with the exact line search in place of a fixed step.
//!
//! Plain gradients need thousands of steps on a mesh of ten thousand vertices, since the largest eigenvalue sets
//! their pace. A preconditioner changes the direction alone: whatever it is, the quotient, the constraint and the
//! point where the iteration rests are those of (L, B).

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::eigenpairs::{normalise, orient};
use super::factor::Factor;
use super::pencil::{apply, column, dot};
use super::{Dense, Eigenpairs, Pencil};

/// Steps between a look at cancellation and a correction of rounding.
const CHECK_EVERY: usize = 64;

/// The relative residual above which a point is no eigenvector, however small the step there.
const SETTLED: f64 = 0.05;

/// When the inner iteration stops: (22).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Stopping {
    /// Tol: stop when the relative change of t falls below it.
    pub tolerance: f64,
    /// N_its: stop after this many steps.
    pub max_iterations: usize,
}

/// Which way the iteration goes from the gradient (19).
#[derive(Clone, Copy)]
pub enum Direction<'a> {
    /// Down the gradient, as the paper prints it.
    Gradient,
    /// Down (L + μB)⁻¹ times the gradient.
    Preconditioned(&'a Factor<'a>),
}

impl Direction<'_> {
    fn precondition(self, g: &mut [f64]) {
        if let Self::Preconditioned(factor) = self {
            let mut column = Dense::from_fn(g.len(), 1, |i, _| g[i]);
            factor.solve_in_place(&mut column);
            g.copy_from_slice(super::pencil::column(&column, 0));
        }
    }
}

/// Which condition of (22) ended the iteration for one pair.
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
}

/// How the iteration for one pair went.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Run {
    /// Steps taken.
    pub iterations: usize,
    /// The relative change of the last step.
    pub change: f64,
    /// ‖Lt − R(t)Bt‖ in the norm of diag(B)⁻¹, relative to R(t).
    pub residual: f64,
    /// Why it ended.
    pub stopped_by: StoppedBy,
}

/// Computes the first `count` eigenpairs, the first `known` of which are given.
///
/// Every start vector is random and projected onto the constraint (18) first, or its component along the known
/// vectors would never leave. The step is the lowest Ritz pair of span{t, d}, which needs no α. `cancelled` is
/// asked every so many steps. Cost per step: O(nnz + kn), and a solve where there is a preconditioner.
pub fn lowest(
    pencil: Pencil<'_>,
    known: &Eigenpairs,
    count: usize,
    direction: Direction<'_>,
    stopping: Stopping,
    seed: u64,
    cancelled: &dyn Fn() -> bool,
) -> (Eigenpairs, Vec<Run>) {
    let n = pencil.n();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut constraint = Constraint::new(pencil, count);
    for j in 0..known.len() {
        constraint.push(column(&known.vectors, j));
    }
    let mut values = known.values.clone();
    let mut runs = Vec::new();
    while values.len() < count {
        let start: Vec<f64> = (0..n).map(|_| rng.random_range(-1.0..1.0)).collect();
        let (mut t, mut run) = descend(pencil, &constraint, direction, start, stopping, cancelled);
        let shaken = runs.iter().any(|earlier: &Run| earlier.stopped_by != StoppedBy::Tolerance);
        if shaken && run.stopped_by == StoppedBy::Tolerance {
            run.stopped_by = StoppedBy::AfterUnconverged;
        }
        orient(&mut t);
        values.push(pencil.rayleigh_quotient(&t));
        constraint.push(&t);
        runs.push(run);
        if run.stopped_by == StoppedBy::Cancelled {
            break;
        }
    }
    let vectors = Dense::from_fn(n, values.len(), |i, j| constraint.phi[j][i]);
    (Eigenpairs { values, vectors }, runs)
}

/// The inner iteration over ℓ, from `t` to a B-normalised minimiser of (13) on the constraint.
fn descend(
    pencil: Pencil<'_>,
    constraint: &Constraint<'_>,
    direction: Direction<'_>,
    mut t: Vec<f64>,
    stopping: Stopping,
    cancelled: &dyn Fn() -> bool,
) -> (Vec<f64>, Run) {
    let n = t.len();
    constraint.project(&mut t);
    normalise(&mut t, pencil.mass);
    let [mut lt, mut bt, mut d, mut ld, mut bd] = std::array::from_fn(|_| vec![0.0; n]);
    apply(pencil.stiffness, &t, &mut lt);
    apply(pencil.mass, &t, &mut bt);
    let diagonal: Vec<f64> =
        pencil.mass.diag_iter().map(|b| b.copied().unwrap_or(f64::NAN)).collect();
    let (change, residual) = (f64::INFINITY, f64::INFINITY);
    let mut run = Run { iterations: 0, change, residual, stopped_by: StoppedBy::Count };
    while run.iterations < stopping.max_iterations {
        if run.iterations > 0 && run.iterations.is_multiple_of(CHECK_EVERY) {
            if cancelled() {
                run.stopped_by = StoppedBy::Cancelled;
                break;
            }
            // Rounding lets the iterate drift off the constraint and its images off the iterate.
            constraint.project(&mut t);
            normalise(&mut t, pencil.mass);
            apply(pencil.stiffness, &t, &mut lt);
            apply(pencil.mass, &t, &mut bt);
        }
        let (tlt, tbt) = (dot(&t, &lt), dot(&t, &bt));
        let quotient = tlt / tbt;
        // (19) up to its factor 2/(tᵀBt), which the line search takes up, and (21).
        for (d, (l, b)) in d.iter_mut().zip(lt.iter().zip(&bt)) {
            *d = l - quotient * b;
        }
        let square: f64 = d.iter().zip(&diagonal).map(|(r, b)| r * r / b).sum();
        run.residual = (square / tbt).sqrt() / quotient;
        // A small step alone may only mean that stiff triangles force small steps.
        if run.change < stopping.tolerance && run.residual < SETTLED {
            run.stopped_by = StoppedBy::Tolerance;
            break;
        }
        direction.precondition(&mut d);
        constraint.project(&mut d);
        apply(pencil.stiffness, &d, &mut ld);
        apply(pencil.mass, &d, &mut bd);
        let Some(alpha) =
            exact_step([tlt, dot(&t, &ld), dot(&d, &ld)], [tbt, dot(&t, &bd), dot(&d, &bd)])
        else {
            run.change = 0.0;
            if run.residual < SETTLED {
                run.stopped_by = StoppedBy::Tolerance;
            }
            break;
        };
        run.change = alpha.abs() * (dot(&d, &d) / dot(&t, &t)).sqrt();
        for (x, y) in [(&mut t, &d), (&mut lt, &ld), (&mut bt, &bd)] {
            x.iter_mut().zip(y).for_each(|(x, y)| *x -= alpha * y);
        }
        run.iterations += 1;
    }
    constraint.project(&mut t);
    normalise(&mut t, pencil.mass);
    (t, run)
}

/// The α that minimises the Rayleigh quotient of t − αd, given (tᵀLt, tᵀLd, dᵀLd) and the same with B.
///
/// The derivative of the quotient has the sign of pα² + qα + r; its minimum is the root where that parabola
/// rises. `None` when d is zero to working precision.
fn exact_step(l: [f64; 3], b: [f64; 3]) -> Option<f64> {
    let [l0, l1, l2] = l;
    let [b0, b1, b2] = b;
    let p = l1 * b2 - l2 * b1;
    let q = l2 * b0 - l0 * b2;
    let r = l0 * b1 - l1 * b0;
    let root = (q * q - 4.0 * p * r).max(0.0).sqrt();
    // Two forms of (−q + √…)/2p, each free of cancellation for its sign of q.
    let alpha = if q >= 0.0 { -2.0 * r / (q + root) } else { (root - q) / (2.0 * p) };
    (alpha.is_finite() && alpha != 0.0).then_some(alpha)
}

/// The constraint (18): B-orthogonality to the eigenfunctions found so far.
struct Constraint<'a> {
    pencil: Pencil<'a>,
    phi: Vec<Vec<f64>>,
    b_phi: Vec<Vec<f64>>,
}

impl<'a> Constraint<'a> {
    fn new(pencil: Pencil<'a>, capacity: usize) -> Self {
        Self { pencil, phi: Vec::with_capacity(capacity), b_phi: Vec::with_capacity(capacity) }
    }

    /// Adds an eigenfunction, normalised as in (20).
    fn push(&mut self, phi: &[f64]) {
        let mut phi = phi.to_vec();
        normalise(&mut phi, self.pencil.mass);
        let mut b_phi = vec![0.0; phi.len()];
        apply(self.pencil.mass, &phi, &mut b_phi);
        self.phi.push(phi);
        self.b_phi.push(b_phi);
    }

    /// x ← P x, (21).
    fn project(&self, x: &mut [f64]) {
        for (phi, b_phi) in self.phi.iter().zip(&self.b_phi) {
            let c = dot(b_phi, x);
            x.iter_mut().zip(phi).for_each(|(x, p)| *x -= c * p);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::sample::icosphere;
    use crate::mesh::topology::component_labels;
    use crate::operators::Boundary;
    use crate::operators::{MassKind, Operators};
    use crate::spectrum::{Problem, factor::Analysis, fem};

    #[test]
    fn agrees_with_the_reference_and_finds_whole_eigenspaces() {
        for kind in [MassKind::Lumped, MassKind::Consistent] {
            let operators = Operators::assemble(&icosphere(2), kind).unwrap();
            let pencil = Pencil::from(&operators);
            let analysis = Analysis::new(pencil).unwrap();
            let labels = component_labels(&icosphere(2));
            let problem = Problem::new(&operators, Boundary::Neumann, &labels).unwrap();
            let reference = fem::lowest(&problem, &analysis, 9).unwrap().pairs;
            let factor = analysis.positive(0.1).unwrap();
            let steps =
                [Direction::Gradient, Direction::Preconditioned(&factor)].map(|direction| {
                    let stopping = Stopping { tolerance: 1e-9, max_iterations: 20_000 };
                    let known = reference.truncated(1);
                    let (pairs, runs) =
                        lowest(pencil, &known, 9, direction, stopping, 7, &|| false);
                    for (a, b) in pairs.values.iter().zip(&reference.values).skip(1) {
                        assert!((a / b - 1.0).abs() < 1e-9, "{kind:?}: {a} {b}");
                    }
                    assert!(runs.iter().all(|run| run.stopped_by == StoppedBy::Tolerance));
                    runs.iter().map(|run| run.iterations).sum::<usize>()
                });
            assert!(steps[1] < steps[0], "{steps:?}");
        }
    }

    #[test]
    fn the_exact_step_minimises_the_quotient_along_the_line() {
        let (l, b) = ([3.0, 0.7, 9.0], [1.1, 0.2, 1.3]);
        let quotient = |a: f64| {
            (l[0] - 2.0 * a * l[1] + a * a * l[2]) / (b[0] - 2.0 * a * b[1] + a * a * b[2])
        };
        let alpha = exact_step(l, b).unwrap();
        for delta in [-1e-3, 1e-3] {
            assert!(quotient(alpha) < quotient(alpha + delta));
        }
        assert!(quotient(alpha) < quotient(0.0));
    }

    #[test]
    fn the_exact_step_goes_to_the_minimum_from_above_too() {
        // d has the lower quotient: the step nearly replaces t by d.
        let alpha = exact_step([50.0, 1.0, 2.0], [1.0, 0.1, 1.0]).unwrap();
        let quotient =
            (50.0 - 2.0 * alpha + 2.0 * alpha * alpha) / (1.0 - 0.2 * alpha + alpha * alpha);
        assert!(quotient < 2.1, "{quotient}");
    }
}
