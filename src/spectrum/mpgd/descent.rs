//! The inner iteration of Algorithm 1 over ℓ: from a start on the constraint down to the next eigenfunction.
//!
//! Both steps go along the projection of a direction: the fixed one along the gradient (19) itself, from images Lt
//! and Bt that are made anew each time; the exact one along the gradient up to its length or a preconditioned one,
//! with images that are combined like the vectors.

use super::constraint::Constraint;
use super::{Direction, Options, Run, Step, StoppedBy, Stopping};
use crate::spectrum::eigenpairs::normalise;
use crate::spectrum::pencil::{apply, column, dot};
use crate::spectrum::{Dense, Pencil};

/// Steps between a look at cancellation and, where images are combined, a correction of rounding.
const CHECK_EVERY: usize = 64;

/// The relative residual above which a point is no eigenvector, however small the step there.
const SETTLED: f64 = 0.05;

/// How long t becomes, from unit B-norm, under a fixed step that is too long. A stable one hardly lengthens it.
const STRETCHED: f64 = 100.0;

/// A vector x with Lx and Bx.
struct Imaged {
    x: Vec<f64>,
    lx: Vec<f64>,
    bx: Vec<f64>,
}

impl Imaged {
    fn new(x: Vec<f64>, pencil: Pencil<'_>) -> Self {
        let [lx, bx] = std::array::from_fn(|_| vec![0.0; x.len()]);
        let mut imaged = Self { x, lx, bx };
        imaged.renew(pencil);
        imaged
    }

    /// Makes the images from the vector.
    fn renew(&mut self, pencil: Pencil<'_>) {
        apply(pencil.stiffness, &self.x, &mut self.lx);
        apply(pencil.mass, &self.x, &mut self.bx);
    }

    /// (13)
    fn quotient(&self) -> f64 {
        dot(&self.x, &self.lx) / dot(&self.x, &self.bx)
    }
}

/// The iteration at t^(ℓ).
struct Descent<'c> {
    constraint: &'c Constraint<'c>,
    diagonal: Vec<f64>,
    t: Imaged,
    d: Imaged,
    /// Where t^(ℓ+1) is made; it takes the place of t only when its quotient is a number.
    next: Imaged,
}

/// Runs the iteration from `start`, of unit B-norm on the constraint, and returns where it ended.
pub fn descend(
    constraint: &Constraint<'_>,
    start: Vec<f64>,
    options: Options<'_>,
    cancelled: &dyn Fn() -> bool,
) -> (Vec<f64>, Run) {
    let Options { step, stopping, seed: _ } = options;
    let mut descent = Descent::new(constraint, start);
    let first = descent.t.quotient();
    let (change, residual) = (f64::INFINITY, f64::INFINITY);
    let mut run = Run { iterations: 0, change, residual, stopped_by: StoppedBy::Count };
    run.stopped_by = loop {
        if run.iterations > 0 && run.iterations.is_multiple_of(CHECK_EVERY) {
            if cancelled() {
                break StoppedBy::Cancelled;
            }
            if let Step::Exact(_) = step {
                descent.correct();
            }
        }
        run.residual = descent.gradient();
        if let Some(stopped_by) = stopped(&run, step, stopping) {
            break stopped_by;
        }
        let stepped = match step {
            Step::Fixed(alpha) => Ok(descent.fixed_step(alpha)),
            Step::Exact(direction) => descent.exact_step(direction),
        };
        match stepped {
            Ok(_) if !descent.next.quotient().is_finite() => break StoppedBy::Diverged,
            Ok(change) => run.change = change,
            Err(AtRest) => {
                run.change = 0.0;
                break at_rest(run.residual);
            }
        }
        std::mem::swap(&mut descent.t, &mut descent.next);
        run.iterations += 1;
    };
    let unsettled = matches!(run.stopped_by, StoppedBy::Count | StoppedBy::Stalled);
    if unsettled && matches!(step, Step::Fixed(_)) && descent.ran_away(first) {
        run.stopped_by = StoppedBy::Diverged;
    }
    (descent.t.x, run)
}

/// The conditions of (22) at a point whose residual is known.
///
/// The fixed step stops at the first short step, as printed. The exact step goes on where the residual is still
/// large: there a short step may only mean that stiff triangles force short ones.
fn stopped(run: &Run, step: Step<'_>, stopping: Stopping) -> Option<StoppedBy> {
    let short = run.change < stopping.tolerance;
    let waits = matches!(step, Step::Exact(_)) && run.residual >= SETTLED;
    if short && !waits {
        Some(at_rest(run.residual))
    } else if run.iterations >= stopping.max_iterations {
        Some(StoppedBy::Count)
    } else {
        None
    }
}

/// What an iteration that no longer moves has come to.
fn at_rest(residual: f64) -> StoppedBy {
    if residual < SETTLED { StoppedBy::Tolerance } else { StoppedBy::Stalled }
}

/// The direction is zero to working precision.
struct AtRest;

impl<'c> Descent<'c> {
    fn new(constraint: &'c Constraint<'c>, start: Vec<f64>) -> Self {
        let pencil = constraint.pencil();
        let n = start.len();
        let zero = || Imaged { x: vec![0.0; n], lx: vec![0.0; n], bx: vec![0.0; n] };
        let diagonal = pencil.mass.diag_iter().map(|b| b.copied().unwrap_or(f64::NAN)).collect();
        Self { constraint, diagonal, t: Imaged::new(start, pencil), d: zero(), next: zero() }
    }

    /// Whether a fixed step was too long: the quotient stands above `first`, where it began, or t has become so long
    /// that no later step gets anywhere.
    fn ran_away(&self, first: f64) -> bool {
        let square = dot(&self.t.x, &self.t.bx);
        self.t.quotient() > first || square > STRETCHED * STRETCHED
    }

    /// Rounding lets the iterate drift off the constraint, and combined images off the iterate.
    fn correct(&mut self) {
        let pencil = self.constraint.pencil();
        self.constraint.project(&mut self.t.x);
        normalise(&mut self.t.x, pencil.mass);
        self.t.renew(pencil);
    }

    /// d ← Lt − R(t)Bt: the gradient (19) without its factor 2/tᵀBt. Returns its norm as in [`Run::residual`].
    fn gradient(&mut self) -> f64 {
        let Imaged { x, lx, bx } = &self.t;
        let quotient = self.t.quotient();
        let mut square = 0.0;
        for (((d, l), b), mass) in self.d.x.iter_mut().zip(lx).zip(bx).zip(&self.diagonal) {
            *d = l - quotient * b;
            square += *d * *d / mass;
        }
        (square / dot(x, bx)).sqrt() / quotient
    }

    /// t^(ℓ+1) = t − αd with d of (19) and (21). Returns the relative change of (22).
    fn fixed_step(&mut self, alpha: f64) -> f64 {
        let factor = 2.0 / dot(&self.t.x, &self.t.bx);
        self.d.x.iter_mut().for_each(|d| *d *= factor);
        self.constraint.project(&mut self.d.x);
        subtract(&mut self.next.x, &self.t.x, alpha, &self.d.x);
        self.next.renew(self.constraint.pencil());
        self.change(alpha)
    }

    /// The lowest Ritz vector of span{t, d} whose coefficient of t is 1. Returns the relative change of (22).
    ///
    /// The line search takes up the length of d, and with it the factor of (19).
    fn exact_step(&mut self, direction: Direction<'_>) -> Result<f64, AtRest> {
        if let Direction::Preconditioned(factor) = direction {
            let mut x = Dense::from_fn(self.d.x.len(), 1, |i, _| self.d.x[i]);
            factor.solve_in_place(&mut x);
            self.d.x.copy_from_slice(column(&x, 0));
        }
        self.constraint.project(&mut self.d.x);
        self.d.renew(self.constraint.pencil());
        let (t, d) = (&self.t, &self.d);
        let alpha = minimiser(
            [dot(&t.x, &t.lx), dot(&t.x, &d.lx), dot(&d.x, &d.lx)],
            [dot(&t.x, &t.bx), dot(&t.x, &d.bx), dot(&d.x, &d.bx)],
        )
        .ok_or(AtRest)?;
        subtract(&mut self.next.x, &t.x, alpha, &d.x);
        subtract(&mut self.next.lx, &t.lx, alpha, &d.lx);
        subtract(&mut self.next.bx, &t.bx, alpha, &d.bx);
        Ok(self.change(alpha))
    }

    /// ‖t^(ℓ+1) − t^(ℓ)‖/‖t^(ℓ)‖ in the Euclidean norm, (22).
    fn change(&self, alpha: f64) -> f64 {
        alpha.abs() * (dot(&self.d.x, &self.d.x) / dot(&self.t.x, &self.t.x)).sqrt()
    }
}

/// to ← x − αy.
fn subtract(to: &mut [f64], x: &[f64], alpha: f64, y: &[f64]) {
    for ((to, x), y) in to.iter_mut().zip(x).zip(y) {
        *to = x - alpha * y;
    }
}

/// The α that minimises the Rayleigh quotient of t − αd, given (tᵀLt, tᵀLd, dᵀLd) and the same with B.
///
/// The derivative of the quotient has the sign of pα² + qα + r; its minimum is the root where that parabola
/// rises. `None` when d is zero to working precision.
fn minimiser(l: [f64; 3], b: [f64; 3]) -> Option<f64> {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exact_step_minimises_the_quotient_along_the_line() {
        let (l, b) = ([3.0, 0.7, 9.0], [1.1, 0.2, 1.3]);
        let quotient = |a: f64| {
            (l[0] - 2.0 * a * l[1] + a * a * l[2]) / (b[0] - 2.0 * a * b[1] + a * a * b[2])
        };
        let alpha = minimiser(l, b).unwrap();
        for delta in [-1e-3, 1e-3] {
            assert!(quotient(alpha) < quotient(alpha + delta));
        }
        assert!(quotient(alpha) < quotient(0.0));
    }

    #[test]
    fn the_exact_step_goes_to_the_minimum_from_above_too() {
        // d has the lower quotient: the step nearly replaces t by d.
        let alpha = minimiser([50.0, 1.0, 2.0], [1.0, 0.1, 1.0]).unwrap();
        let quotient =
            (50.0 - 2.0 * alpha + 2.0 * alpha * alpha) / (1.0 - 0.2 * alpha + alpha * alpha);
        assert!(quotient < 2.1, "{quotient}");
    }
}
