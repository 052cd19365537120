//! DEC of (27): x ↦ x w_outᵀ + b_out.

use dfdx::prelude::*;

use super::real::Real;
use super::{Matrix, Vector, entries};

/// Applies DEC to features x, n×h, with w_out, 1×h, and b_out, 1×1: n.
pub fn decode<E: Real, T: Tape<E, Cpu>>(
    x: Matrix<E, T>,
    w: &Matrix<E>,
    b: &Matrix<E>,
) -> Vector<E, T> {
    let (x, mut tape) = x.split_tape();
    let &(n, h) = x.shape();
    let (xs, ws, bias) = (entries(&x), entries(w), entries(b)[0].wide());
    let value = |row: &[E]| row.iter().zip(&ws).map(|(x, w)| x.wide() * w.wide()).sum::<f64>();
    let values = xs.chunks_exact(h).map(|row| E::round(value(row) + bias)).collect();
    let out: Vector<E> = x.device().tensor_from_vec(values, (n,));
    let (out_ghost, x_ghost, w_ghost, b_ghost) = (out.ghost(), x.ghost(), w.ghost(), b.ghost());
    tape.add_backward_op(move |grads| {
        let g = std::mem::take(&mut **grads.get_or_alloc_mut(&out_ghost)?);
        grads.get_or_alloc_mut(&b_ghost)?[0] += E::round(g.iter().map(|g| g.wide()).sum());
        add_outer(grads.get_or_alloc_mut(&x_ghost)?, &g, &ws);
        let d_w = grads.get_or_alloc_mut(&w_ghost)?;
        for (row, &g) in xs.chunks_exact(h).zip(&g) {
            d_w.iter_mut().zip(row).for_each(|(d, &x)| *d += g * x);
        }
        Ok(())
    });
    out.put_tape(tape)
}

/// m += g wᵀ.
fn add_outer<E: Real>(m: &mut [E], g: &[E], w: &[E]) {
    for (row, &g) in m.chunks_exact_mut(w.len()).zip(g) {
        row.iter_mut().zip(w).for_each(|(m, &w)| *m += g * w);
    }
}

#[cfg(test)]
mod tests {
    use super::super::finite_differences::{check, values};
    use super::super::losses::boundary_loss;
    use super::*;

    #[test]
    fn gradients_match_finite_differences() {
        let (n, h) = (7, 5);
        let all = std::sync::Arc::new((0..n as u32).collect());
        check(&[values(n * h, 1), values(h, 2), values(1, 3)], |dev, p, tape| {
            let x = dev.tensor_from_vec(p[0].clone(), (n, h));
            let w = dev.tensor_from_vec(p[1].clone(), (1, h));
            let b = dev.tensor_from_vec(p[2].clone(), (1, 1));
            let loss = boundary_loss(decode(x.clone().put_tape(tape), &w, &b), &all);
            let read = move |g: &Gradients<f64, Cpu>| {
                vec![g.get(&x).as_vec(), g.get(&w).as_vec(), g.get(&b).as_vec()]
            };
            (loss, Box::new(read))
        });
    }
}
