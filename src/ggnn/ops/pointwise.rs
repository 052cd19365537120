//! The SGGC layer of (29) without its neighbours, w₂ = 0: x ↦ σ(x^I), x^{i+1} = x^i − x^i w₁ᵀ.
//!
//! (I − W) x is small where vertices are close together and large where they are far apart, so that what is learned of
//! it on one sampling misleads on another; see `docs/training.md` for what that costs. Without it a feature is a function
//! of the place alone.
//!
//! Backward, with P the gradient of x^{i+1} and M = I − w₁: dM = Pᵀx^i, dx = P M.

use std::sync::Arc;

use dfdx::prelude::*;

use super::activation::{Activated, Activation};
use super::loan::Loan;
use super::real::{Real, add, multiply};
use super::{Matrix, entries, lent};

/// The weights of one layer in the form its products want, made once for many forward passes.
#[derive(Debug, Clone)]
pub struct Remaining<E: Real> {
    w1: Matrix<E>,
    /// I − w₁ᵀ and I − w₁, h×h, for the ways forward and backward.
    matrices: Arc<[E::Packed; 2]>,
}

impl<E: Real> Remaining<E> {
    /// I − w₁.
    pub fn new(w1: &Matrix<E>) -> Self {
        let &(h, _) = w1.shape();
        let mut matrix: Vec<E> = entries(w1).into_iter().map(|w| -w).collect();
        (0..h).for_each(|i| matrix[i * h + i] += E::round(1.0));
        let matrices = [E::pack_transposed(&matrix, h, h), E::pack(&matrix, h, h)];
        Self { w1: w1.clone(), matrices: Arc::new(matrices) }
    }
}

/// Applies one layer to x, n×h, with I = `iterations`: n×h.
pub fn pointwise<E: Real, T: Tape<E, Cpu>>(
    x: Matrix<E, T>,
    weights: &Remaining<E>,
    iterations: usize,
    activation: Activation,
) -> Matrix<E, T> {
    let (x, mut tape) = x.split_tape();
    let &(n, h) = x.shape();
    let mut state = lent(&x);
    // x^i of every iteration, for the backward pass.
    let mut inputs = Vec::with_capacity(if T::OWNS_TAPE { iterations } else { 0 });
    for _ in 0..iterations {
        let mut next = Loan::of(n * h);
        E::multiply(&mut next, &state, n, &weights.matrices[0]);
        let input = std::mem::replace(&mut state, next);
        if T::OWNS_TAPE {
            inputs.push(input);
        }
    }
    let Activated { values, slopes } = activation.apply(&state);
    let out = x.device().tensor_from_vec(values, (n, h));
    let (out_ghost, x_ghost, w1_ghost) = (out.ghost(), x.ghost(), weights.w1.ghost());
    let matrices = weights.matrices.clone();
    tape.add_backward_op(move |grads| {
        let mut gradient = Loan::of(n * h);
        gradient.copy_from_slice(grads.get_or_alloc_mut(&out_ghost)?);
        multiply(&slopes, &mut gradient);
        let mut d_matrix = vec![E::default(); h * h];
        for input in inputs.iter().rev() {
            E::add_transposed_product(&mut d_matrix, &gradient, input, n);
            let mut d_input = Loan::of(n * h);
            E::multiply(&mut d_input, &gradient, n, &matrices[1]);
            gradient = d_input;
        }
        d_matrix.iter_mut().for_each(|d| *d = -*d);
        add(&d_matrix, grads.get_or_alloc_mut(&w1_ghost)?);
        add(&gradient, grads.get_or_alloc_mut(&x_ghost)?);
        Ok(())
    });
    out.put_tape(tape)
}

#[cfg(test)]
mod tests {
    use super::super::finite_differences::{check, values, weighted_sum};
    use super::*;

    #[test]
    fn gradients_match_finite_differences() {
        let (n, h) = (6, 4);
        for iterations in 1..=3 {
            let w = values(h * h, 2).iter().map(|v| 0.3 * v).collect();
            check(&[values(n * h, 1), w], |dev, p, tape| {
                let x = dev.tensor_from_vec(p[0].clone(), (n, h));
                let w = dev.tensor_from_vec(p[1].clone(), (h, h));
                let weights = Remaining::new(&w);
                let y = pointwise(x.clone().put_tape(tape), &weights, iterations, Activation::Sin);
                let loss = weighted_sum(y);
                (loss, Box::new(move |g| vec![g.get(&x).as_vec(), g.get(&w).as_vec()]))
            });
        }
    }
}
