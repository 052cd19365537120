//! The graph convolution of Kipf and Welling: x ↦ σ(Â x wᵀ), Â = (D + I)^(−½) (A + I) (D + I)^(−½).
//!
//! "Semi-supervised classification with graph convolutional networks", ICLR 2017, (2): neighbours with a loop at every
//! vertex, normalised symmetrically; no bias, as printed there. The paper compares with it in its Table 2.
//!
//! With C = (D + I)^(−½) and W = D⁻¹A, Â x = C (I + D W) C x: the adjacency at hand serves. Backward, with P the
//! gradient of Â x wᵀ: dw = Pᵀ (Âx), and dx = Â (P w), since Â is symmetric.

use std::sync::Arc;

use dfdx::prelude::*;
use faer::Accum;

use super::activation::{Activated, Activation};
use super::graph::Graph;
use super::real::{Real, add, gemm, multiply, view};
use super::{Matrix, entries};

/// Applies one layer to x, n×h, with w, h×h, along the adjacency W: n×h.
pub fn gcn<E: Real, T: Tape<E, Cpu>>(
    x: Matrix<E, T>,
    graph: &Arc<Graph<E>>,
    w: &Matrix<E>,
    activation: Activation,
) -> Matrix<E, T> {
    let (x, mut tape) = x.split_tape();
    let &(n, h) = x.shape();
    let weights = entries(w);
    let smoothed = smoothed(&entries(&x), graph, h);
    let mut state = vec![E::default(); n * h];
    let transposed = view(&weights, h, h).transpose();
    gemm(&mut state, view(&smoothed, n, h), transposed, Accum::Replace);
    let Activated { values, slopes } = activation.apply(&state);
    let out = x.device().tensor_from_vec(values, (n, h));
    let (out_ghost, x_ghost, w_ghost) = (out.ghost(), x.ghost(), w.ghost());
    let graph = graph.clone();
    tape.add_backward_op(move |grads| {
        let mut gradient = std::mem::take(&mut **grads.get_or_alloc_mut(&out_ghost)?);
        multiply(&slopes, &mut gradient);
        let p = view(&gradient, n, h);
        let dw = grads.get_or_alloc_mut(&w_ghost)?;
        gemm(dw, p.transpose(), view(&smoothed, n, h), Accum::Add);
        let mut d_smoothed = vec![E::default(); n * h];
        gemm(&mut d_smoothed, p, view(&weights, h, h), Accum::Replace);
        add(&self::smoothed(&d_smoothed, &graph, h), grads.get_or_alloc_mut(&x_ghost)?);
        Ok(())
    });
    out.put_tape(tape)
}

/// Â x = C (I + D W) C x, n×h.
fn smoothed<E: Real>(x: &[E], graph: &Graph<E>, h: usize) -> Vec<E> {
    let degree = |i: usize| graph.neighbours(i).len() as f64;
    let c: Vec<E> = (0..graph.n()).map(|i| E::round((degree(i) + 1.0).powf(-0.5))).collect();
    let mut scaled = x.to_vec();
    for (row, &c) in scaled.chunks_exact_mut(h).zip(&c) {
        row.iter_mut().for_each(|x| *x *= c);
    }
    let mut smoothed = Vec::with_capacity(x.len());
    graph.for_each_row(
        &scaled,
        h,
        #[inline(always)]
        |i, mean| {
            let (own, degree, c) = (&scaled[i * h..(i + 1) * h], E::round(degree(i)), c[i]);
            smoothed.extend(own.iter().zip(mean).map(|(&own, &mean)| c * (own + degree * mean)));
        },
    );
    smoothed
}

#[cfg(test)]
mod tests {
    use super::super::finite_differences::{check, values, weighted_sum};
    use super::*;
    use crate::mesh::sample::icosphere;
    use crate::operators::{Pattern, adjacency::adjacency};

    const H: usize = 4;

    #[test]
    fn gradients_match_finite_differences() {
        let graph = Arc::new(Graph::new(&adjacency(&Pattern::of_mesh(&icosphere(0)))));
        let n = graph.n();
        for activation in Activation::ALL {
            check(&[values(n * H, 1), values(H * H, 2)], |dev, p, tape| {
                let x = dev.tensor_from_vec(p[0].clone(), (n, H));
                let w = dev.tensor_from_vec(p[1].clone(), (H, H));
                let loss = weighted_sum(gcn(x.clone().put_tape(tape), &graph, &w, activation));
                (loss, Box::new(move |g| vec![g.get(&x).as_vec(), g.get(&w).as_vec()]))
            });
        }
    }

    /// (D + I)^(½) 1 is the eigenvector of Â for its largest eigenvalue, 1.
    #[test]
    fn square_roots_of_degrees_pass_unchanged() {
        let graph = Graph::new(&adjacency(&Pattern::of_mesh(&icosphere(1))));
        let roots: Vec<f64> =
            (0..graph.n()).map(|i| (graph.neighbours(i).len() as f64 + 1.0).sqrt()).collect();
        assert!(roots.iter().any(|r| *r != roots[0]), "the degrees differ");
        let passed = smoothed(&roots, &graph, 1);
        assert!(passed.iter().zip(&roots).all(|(a, b)| (a - b).abs() < 1e-14));
    }
}
