//! ENC of (28): x ↦ σ(x w_inᵀ + b_in), with σ = sin in the paper.

use dfdx::prelude::*;
use faer::Accum;

use super::activation::Activation;
use super::dealt::{self, ROWS};
use super::loan::Loan;
use super::product::Layout;
use super::real::{Real, multiply};
use super::{Matrix, entries};

/// Applies (28) to features x, n×d, with w_in, h×d, and b_in, 1×h: n×h. The features are data: no gradient goes to them.
pub fn encode<E: Real, T: Tape<E, Cpu>>(
    x: Matrix<E, T>,
    w: &Matrix<E>,
    b: &Matrix<E>,
    activation: Activation,
) -> Matrix<E, T> {
    let (x, mut tape) = x.split_tape();
    let &(n, d) = x.shape();
    let &(h, _) = w.shape();
    let (xs, bs) = (entries(&x), entries(b));
    let packed = E::pack_transposed(&entries(w), h, d);
    let (mut values, mut slopes) = (Loan::of(n * h), Loan::of(n * h));
    let rows = values.chunks_mut(ROWS * h).zip(slopes.chunks_mut(ROWS * h));
    dealt::for_each(rows.zip(xs.chunks(ROWS * d)), |((values, slopes), x)| {
        let mut phase = Loan::of(values.len());
        phase.chunks_exact_mut(h).for_each(|row| row.copy_from_slice(&bs));
        packed.multiply(&mut phase, h, Layout::Rows(x, d), values.len() / h, Accum::Add);
        activation.apply_to(&phase, values, slopes);
    });
    let out = x.device().tensor_from_vec(values.into_vec(), (n, h));
    let (out_ghost, w_ghost, b_ghost) = (out.ghost(), w.ghost(), b.ghost());
    tape.add_backward_op(move |grads| {
        let mut d_phase = Loan::from(std::mem::take(&mut **grads.get_or_alloc_mut(&out_ghost)?));
        multiply(&slopes, &mut d_phase);
        // [x | 1]ᵀ d_phase: dwᵀ and below it db.
        let with_one: Vec<E> =
            xs.chunks_exact(d).flat_map(|x| x.iter().copied().chain([E::round(1.0)])).collect();
        let mut sums = Loan::of((d + 1) * h);
        E::transposed_product(&mut sums, &with_one, &d_phase, n, Accum::Replace);
        let d_w = grads.get_or_alloc_mut(&w_ghost)?;
        for (i, row) in d_w.chunks_exact_mut(d).enumerate() {
            row.iter_mut().enumerate().for_each(|(j, dw)| *dw += sums[j * h + i]);
        }
        let d_b = grads.get_or_alloc_mut(&b_ghost)?;
        d_b.iter_mut().zip(&sums[d * h..]).for_each(|(db, sum)| *db += *sum);
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
        let (n, d, h) = (7, 3, 5);
        for activation in Activation::ALL {
            check(&[values(h * d, 2), values(h, 3)], |dev, p, tape| {
                let x = dev.tensor_from_vec(values(n * d, 1), (n, d));
                let w = dev.tensor_from_vec(p[0].clone(), (h, d));
                let b = dev.tensor_from_vec(p[1].clone(), (1, h));
                let y = encode(x.put_tape(tape), &w, &b, activation);
                let loss = weighted_sum(y);
                let read =
                    move |g: &Gradients<f64, Cpu>| vec![g.get(&w).as_vec(), g.get(&b).as_vec()];
                (loss, Box::new(read))
            });
        }
    }
}
