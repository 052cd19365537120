//! The SGGC layer of (29): x ↦ σ(x^I), σ = sin in the paper, with x^{i+1} = x^i − [x^i w₁ᵀ + 2 (I − W) x^i w₂ᵀ].
//!
//! One iteration is a single dense product: x^{i+1} = [x^i | W x^i] M with M = [I − w₁ᵀ − 2w₂ᵀ ; 2w₂ᵀ], 2h×h.
//! Backward, with P the gradient of x^{i+1}: dMᵀ = Pᵀ [x | Wx], and [dx | u] = P Mᵀ with Wᵀu added to dx.

use std::sync::Arc;

use dfdx::prelude::*;

use super::activation::{Activated, Activation};
use super::graph::Graph;
use super::loan::Loan;
use super::real::{Real, add, multiply, widely};
use super::{Matrix, entries, lent};

/// The weights of one layer in the form its products want, made once for many forward passes.
#[derive(Debug, Clone)]
pub struct Mixing<E: Real> {
    w1: Matrix<E>,
    w2: Matrix<E>,
    /// M and Mᵀ, for the ways forward and backward.
    matrices: Arc<[E::Packed; 2]>,
}

impl<E: Real> Mixing<E> {
    /// M from Mᵀ = [I − w₁ − 2w₂ | 2w₂] for w₁ and w₂, h×h: without a transpose between it and the weights.
    pub fn new(w1: &Matrix<E>, w2: &Matrix<E>) -> Self {
        let &(h, _) = w1.shape();
        let mut matrix = Vec::with_capacity(2 * h * h);
        let (a, b) = (entries(w1), entries(w2));
        for (i, (a, b)) in a.chunks_exact(h).zip(b.chunks_exact(h)).enumerate() {
            matrix.extend(a.iter().zip(b).map(|(&a, &b)| -a - (b + b)));
            matrix[2 * h * i + i] += E::round(1.0);
            matrix.extend(b.iter().map(|&b| b + b));
        }
        let matrices = [E::pack_transposed(&matrix, h, 2 * h), E::pack(&matrix, h, 2 * h)];
        Self { w1: w1.clone(), w2: w2.clone(), matrices: Arc::new(matrices) }
    }
}

/// Applies one layer to x, n×h, with I = `iterations`: n×h.
pub fn sggc<E: Real, T: Tape<E, Cpu>>(
    x: Matrix<E, T>,
    graph: &Arc<Graph<E>>,
    mixing: &Mixing<E>,
    iterations: usize,
    activation: Activation,
) -> Matrix<E, T> {
    let (x, mut tape) = x.split_tape();
    let &(n, h) = x.shape();
    let mut state = lent(&x);
    // What the backward pass needs of every iteration: [x | Wx].
    let mut inputs = Vec::with_capacity(if T::OWNS_TAPE { iterations } else { 0 });
    for _ in 0..iterations {
        let joined = beside_neighbours(&state, graph, h);
        E::multiply(&mut state, &joined, n, &mixing.matrices[0]);
        if T::OWNS_TAPE {
            inputs.push(joined);
        }
    }
    let Activated { values, slopes } = activation.apply(&state);
    let out = x.device().tensor_from_vec(values, (n, h));
    let (out_ghost, x_ghost) = (out.ghost(), x.ghost());
    let (w1_ghost, w2_ghost) = (mixing.w1.ghost(), mixing.w2.ghost());
    let (graph, matrices) = (graph.clone(), mixing.matrices.clone());
    tape.add_backward_op(move |grads| {
        let mut gradient = std::mem::take(&mut **grads.get_or_alloc_mut(&out_ghost)?);
        multiply(&slopes, &mut gradient);
        let mut d_matrix = vec![E::default(); 2 * h * h];
        let mut d_joined = Loan::of(n * 2 * h);
        for joined in inputs.iter().rev() {
            E::add_transposed_product(&mut d_matrix, &gradient, joined, n);
            E::multiply(&mut d_joined, &gradient, n, &matrices[1]);
            fold_neighbours(&d_joined, &graph, h, &mut gradient);
        }
        add_weight_gradient(&d_matrix, h, grads.get_or_alloc_mut(&w1_ghost)?, |own, _| -own);
        add_weight_gradient(&d_matrix, h, grads.get_or_alloc_mut(&w2_ghost)?, |own, near| {
            (near - own) + (near - own)
        });
        add(&gradient, grads.get_or_alloc_mut(&x_ghost)?);
        Ok(())
    });
    out.put_tape(tape)
}

/// [x | Wx], n×2h.
fn beside_neighbours<E: Real>(x: &[E], graph: &Graph<E>, h: usize) -> Loan<E> {
    let mut joined = Loan::of(2 * x.len());
    graph.for_each_row(
        x,
        h,
        #[inline(always)]
        |i, neighbours| {
            let (own, near) = joined[2 * h * i..2 * h * (i + 1)].split_at_mut(h);
            own.copy_from_slice(&x[i * h..(i + 1) * h]);
            near.copy_from_slice(neighbours);
        },
    );
    joined
}

/// dx + Wᵀu for [dx | u].
fn fold_neighbours<E: Real>(joined: &[E], graph: &Graph<E>, h: usize, dx: &mut [E]) {
    graph.for_each_transposed_row(
        joined,
        2 * h,
        h..2 * h,
        #[inline(always)]
        |i, sum| {
            let own = &joined[2 * h * i..2 * h * i + h];
            for ((dx, &own), &near) in dx[i * h..(i + 1) * h].iter_mut().zip(own).zip(sum) {
                *dx = own + near;
            }
        },
    );
}

/// dw += f(dMᵀ_own, dMᵀ_near).
fn add_weight_gradient<E: Real>(d_matrix: &[E], h: usize, dw: &mut [E], f: impl Fn(E, E) -> E) {
    widely(
        #[inline(always)]
        || {
            for (dw, row) in dw.chunks_exact_mut(h).zip(d_matrix.chunks_exact(2 * h)) {
                let (own, near) = row.split_at(h);
                for ((dw, &own), &near) in dw.iter_mut().zip(own).zip(near) {
                    *dw += f(own, near);
                }
            }
        },
    );
}

#[cfg(test)]
mod tests {
    use super::super::finite_differences::{check, values, weighted_sum};
    use super::*;
    use crate::mesh::sample::icosphere;
    use crate::operators::Pattern;
    use crate::operators::adjacency::{adjacency, graph_laplacian};

    const H: usize = 4;

    #[test]
    fn gradients_match_finite_differences_for_one_two_and_three_iterations() {
        let graph = Arc::new(Graph::new(&adjacency(&Pattern::of_mesh(&icosphere(0)))));
        let n = graph.n();
        for iterations in 1..=3 {
            let scaled = |seed| values(H * H, seed).iter().map(|v| 0.3 * v).collect();
            check(&[values(n * H, 1), scaled(2), scaled(3)], |dev, p, tape| {
                let x = dev.tensor_from_vec(p[0].clone(), (n, H));
                let [w1, w2] = [1, 2].map(|i| dev.tensor_from_vec(p[i].clone(), (H, H)));
                let mixing = Mixing::new(&w1, &w2);
                let y =
                    sggc(x.clone().put_tape(tape), &graph, &mixing, iterations, Activation::Sin);
                let loss = weighted_sum(y);
                (
                    loss,
                    Box::new(move |g| {
                        vec![g.get(&x).as_vec(), g.get(&w1).as_vec(), g.get(&w2).as_vec()]
                    }),
                )
            });
        }
    }

    #[test]
    fn one_iteration_is_equation_29_written_out() {
        let w = adjacency(&Pattern::of_mesh(&icosphere(0)));
        let laplacian = graph_laplacian(&w);
        let (n, graph) = (w.rows(), Arc::new(Graph::<f64>::new(&w)));
        let (x, w1, w2) = (values(n * H, 1), values(H * H, 2), values(H * H, 3));
        let mut expected = x.clone();
        for i in 0..n {
            for a in 0..H {
                for b in 0..H {
                    let lx: f64 = (0..n)
                        .map(|j| laplacian.get(i, j).copied().unwrap_or(0.0) * x[j * H + b])
                        .sum();
                    expected[i * H + a] -= x[i * H + b] * w1[a * H + b] + 2.0 * lx * w2[a * H + b];
                }
            }
        }
        let dev = Cpu::default();
        let [w1, w2] = [w1, w2].map(|w| dev.tensor_from_vec(w, (H, H)));
        let y = sggc(
            dev.tensor_from_vec(x, (n, H)),
            &graph,
            &Mixing::new(&w1, &w2),
            1,
            Activation::Sin,
        );
        for (found, phase) in y.as_vec().iter().zip(expected) {
            assert!((found - phase.sin()).abs() < 1e-13);
        }
    }
}
