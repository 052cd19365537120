//! ENC of (28): x ↦ σ(x w_inᵀ + b_in), with σ = sin in the paper.

use dfdx::prelude::*;

use super::activation::{Activated, Activation};
use super::loan::Loan;
use super::real::{Real, add, gemm, multiply, view};
use super::{Matrix, entries};

/// Applies (28) to features x, n×d, with w_in, h×d, and b_in, 1×h: n×h.
pub fn encode<E: Real, T: Tape<E, Cpu>>(
    x: Matrix<E, T>,
    w: &Matrix<E>,
    b: &Matrix<E>,
    activation: Activation,
) -> Matrix<E, T> {
    let (x, mut tape) = x.split_tape();
    let &(n, d) = x.shape();
    let &(h, _) = w.shape();
    let (xs, ws, bs) = (entries(&x), entries(w), entries(b));
    let mut phase = Loan::of(n * h);
    phase.chunks_exact_mut(h).for_each(|row| row.copy_from_slice(&bs));
    gemm(&mut phase, view(&xs, n, d), view(&ws, h, d).transpose(), faer::Accum::Add);
    let Activated { values, slopes } = activation.apply(&phase);
    let out = x.device().tensor_from_vec(values, (n, h));
    let (out_ghost, x_ghost, w_ghost, b_ghost) = (out.ghost(), x.ghost(), w.ghost(), b.ghost());
    tape.add_backward_op(move |grads| {
        let mut d_phase = std::mem::take(&mut **grads.get_or_alloc_mut(&out_ghost)?);
        multiply(&slopes, &mut d_phase);
        let d_phase_view = view(&d_phase, n, h);
        gemm(grads.get_or_alloc_mut(&w_ghost)?, d_phase_view.transpose(), view(&xs, n, d), ADD);
        let d_b = grads.get_or_alloc_mut(&b_ghost)?;
        for row in d_phase.chunks_exact(h) {
            add(row, d_b);
        }
        gemm(grads.get_or_alloc_mut(&x_ghost)?, d_phase_view, view(&ws, h, d), ADD);
        Ok(())
    });
    out.put_tape(tape)
}

const ADD: faer::Accum = faer::Accum::Add;

#[cfg(test)]
mod tests {
    use super::super::finite_differences::{check, values, weighted_sum};
    use super::*;

    #[test]
    fn gradients_match_finite_differences() {
        let (n, d, h) = (7, 3, 5);
        for activation in Activation::ALL {
            check(&[values(n * d, 1), values(h * d, 2), values(h, 3)], |dev, p, tape| {
                let x = dev.tensor_from_vec(p[0].clone(), (n, d));
                let w = dev.tensor_from_vec(p[1].clone(), (h, d));
                let b = dev.tensor_from_vec(p[2].clone(), (1, h));
                let y = encode(x.clone().put_tape(tape), &w, &b, activation);
                let loss = weighted_sum(y);
                let read = move |g: &Gradients<f64, Cpu>| {
                    vec![g.get(&x).as_vec(), g.get(&w).as_vec(), g.get(&b).as_vec()]
                };
                (loss, Box::new(read))
            });
        }
    }
}
