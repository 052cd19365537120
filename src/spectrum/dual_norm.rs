//! Norms of residuals that bound eigenvalue errors: ‖r‖ in the B⁻¹ norm and in that of (L + θB)⁻¹.
//!
//! Both are rᵀA⁻¹r for a positive definite A that is applied often and factorised once at most: by preconditioned
//! conjugate gradients for eight residuals at a time, where the form −rᵀx decreases to its limit from the first step.

use super::Pencil;
use super::factor::Factor;
use super::panel::{Panel, Row, WIDTH, apply};

/// Conjugate gradients stop when the next step would change the square of the norm by less than this.
const PRECISION: f64 = 1e-14;

/// … or after so many steps. The preconditioners here need a few dozen at most.
const STEPS: usize = 500;

/// ‖r‖ in the B⁻¹ norm for every column.
pub fn inverse_mass_norms(pencil: Pencil<'_>, r: &Panel) -> Row {
    let n = pencil.n();
    let diagonal: Vec<f64> =
        pencil.mass.diag_iter().map(|b| b.copied().unwrap_or(f64::NAN)).collect();
    let divide = |x: &mut Panel| {
        for (row, b) in x.rows_mut().iter_mut().zip(&diagonal) {
            row.iter_mut().for_each(|value| *value /= b);
        }
    };
    if pencil.mass.nnz() == n {
        let mut x = r.clone();
        divide(&mut x);
        return dots(r, &x).map(f64::sqrt);
    }
    // The consistent mass is spectrally equivalent to its diagonal, whatever n.
    inverse_squares(|x, y| apply(pencil.mass, x, y), divide, r).map(f64::sqrt)
}

/// ‖r‖ in the norm of (L + θB)⁻¹ for every column, each with its θ > 0. `factor` is that of L + μB for some μ > 0; the
/// steps grow with the root of θ/μ.
pub fn energy_norms(pencil: Pencil<'_>, factor: &Factor<'_>, thetas: Row, r: &Panel) -> Row {
    let n = pencil.n();
    let mut bx = Panel::zeros(n);
    let mut workspace = factor.workspace();
    let shifted = |x: &Panel, y: &mut Panel| {
        apply(pencil.stiffness, x, y);
        apply(pencil.mass, x, &mut bx);
        for (y, b) in y.rows_mut().iter_mut().zip(bx.rows()) {
            for j in 0..WIDTH {
                y[j] += thetas[j] * b[j];
            }
        }
    };
    inverse_squares(shifted, |x| factor.solve_panel(x, &mut workspace), r).map(f64::sqrt)
}

/// rᵀA⁻¹r for every column.
fn inverse_squares(
    mut product: impl FnMut(&Panel, &mut Panel),
    mut precondition: impl FnMut(&mut Panel),
    r: &Panel,
) -> Row {
    let mut r = r.clone();
    let mut z = r.clone();
    precondition(&mut z);
    let mut p = z.clone();
    let mut q = Panel::zeros(r.rows().len());
    let mut rz = dots(&r, &z);
    let mut squares = [0.0; WIDTH];
    for _ in 0..STEPS {
        product(&p, &mut q);
        let pq = dots(&p, &q);
        // A column that has converged stays where it is.
        let alpha: Row = std::array::from_fn(|j| {
            let step = rz[j] * rz[j] / pq[j];
            if step > PRECISION * squares[j] { rz[j] / pq[j] } else { 0.0 }
        });
        if alpha == [0.0; WIDTH] {
            break;
        }
        for j in 0..WIDTH {
            // rᵀA⁻¹r is the sum of the squares of the steps in the energy norm.
            squares[j] += alpha[j] * rz[j];
        }
        for (r, q) in r.rows_mut().iter_mut().zip(q.rows()) {
            for j in 0..WIDTH {
                r[j] -= alpha[j] * q[j];
            }
        }
        z.rows_mut().copy_from_slice(r.rows());
        precondition(&mut z);
        let next = dots(&r, &z);
        for (p, z) in p.rows_mut().iter_mut().zip(z.rows()) {
            for j in 0..WIDTH {
                let beta = if rz[j] > 0.0 { next[j] / rz[j] } else { 0.0 };
                p[j] = z[j] + beta * p[j];
            }
        }
        rz = next;
    }
    squares
}

/// xᵀy for every column.
fn dots(x: &Panel, y: &Panel) -> Row {
    let mut sums = [0.0; WIDTH];
    for (x, y) in x.rows().iter().zip(y.rows()) {
        for j in 0..WIDTH {
            sums[j] += x[j] * y[j];
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::sample::icosphere;
    use crate::operators::{MassKind, Operators};
    use crate::spectrum::Dense;
    use crate::spectrum::factor::Analysis;
    use crate::spectrum::pencil::{column, dot};

    #[test]
    fn agree_with_factorisations() {
        for kind in [MassKind::Lumped, MassKind::Consistent] {
            let operators = Operators::assemble(&icosphere(2), kind).unwrap();
            let pencil = Pencil::from(&operators);
            let x = Dense::from_fn(pencil.n(), 8, |i, j| ((3 * i + j * j) as f64).sin());
            let panel = Panel::from_columns(&x, 0);
            let analysis = Analysis::new(pencil).unwrap();
            let thetas = [0.1, 0.5, 1.0, 2.0, 6.0, 12.0, 20.0, 1e3];
            let factor = analysis.positive(1.0).unwrap();
            let norms = energy_norms(pencil, &factor, thetas, &panel);
            for (j, theta) in thetas.into_iter().enumerate() {
                let mut y = x.clone();
                analysis.positive(theta).unwrap().solve_in_place(&mut y);
                let expected = dot(column(&x, j), column(&y, j)).sqrt();
                assert!((norms[j] / expected - 1.0).abs() < 1e-6, "{} {expected}", norms[j]);
            }
            // B by itself, from a stiffness of zeros.
            let zero = pencil.stiffness.map(|_| 0.0);
            let alone = Pencil { stiffness: &zero, mass: pencil.mass };
            let mut y = x.clone();
            Analysis::new(alone).unwrap().positive(1.0).unwrap().solve_in_place(&mut y);
            let norms = inverse_mass_norms(pencil, &panel);
            for (j, norm) in norms.into_iter().enumerate() {
                let expected = dot(column(&x, j), column(&y, j)).sqrt();
                assert!((norm / expected - 1.0).abs() < 1e-6, "{norm} {expected}");
            }
        }
    }
}
