//! The SGGC layer of (29): x ↦ sin(x^I) with x^{i+1} = x^i − [x^i w₁ᵀ + 2 (I − W) x^i w₂ᵀ].
//!
//! One iteration is a single dense product: x^{i+1} = [x^i | W x^i] M with M = [I − w₁ᵀ − 2w₂ᵀ ; 2w₂ᵀ], 2h×h.
//! Backward, with P the gradient of x^{i+1}: dM = [x | Wx]ᵀ P, and [dx | u] = P Mᵀ with Wᵀu added to dx.

use std::sync::Arc;

use dfdx::prelude::*;
use faer::Accum;

use super::Matrix;
use super::graph::Graph;
use super::real::{Real, gemm, view};

/// Applies one layer to x, n×h, with w₁ and w₂, h×h, and I = `iterations`: n×h.
pub fn sggc<E: Real, T: Tape<E, Cpu>>(
    x: Matrix<E, T>,
    graph: &Arc<Graph<E>>,
    w1: &Matrix<E>,
    w2: &Matrix<E>,
    iterations: usize,
) -> Matrix<E, T> {
    let (x, mut tape) = x.split_tape();
    let &(n, h) = x.shape();
    let mixing = mixing_matrix(&w1.as_vec(), &w2.as_vec(), h);
    let mut state = x.as_vec();
    // What the backward pass needs of every iteration: [x | Wx].
    let mut inputs = Vec::with_capacity(if T::OWNS_TAPE { iterations } else { 0 });
    for _ in 0..iterations {
        let joined = beside_neighbours(&state, graph, h);
        gemm(&mut state, view(&joined, n, 2 * h), view(&mixing, 2 * h, h), Accum::Replace);
        if T::OWNS_TAPE {
            inputs.push(joined);
        }
    }
    let (mut sin, mut cos) = (vec![E::default(); n * h], state.clone());
    E::sin_cos_all(&state, &mut sin, &mut cos);
    let out = x.device().tensor_from_vec(sin, (n, h));
    let (out_ghost, x_ghost, w1_ghost, w2_ghost) = (out.ghost(), x.ghost(), w1.ghost(), w2.ghost());
    let graph = graph.clone();
    tape.add_backward_op(move |grads| {
        let mut gradient = std::mem::take(&mut **grads.get_or_alloc_mut(&out_ghost)?);
        gradient.iter_mut().zip(&cos).for_each(|(g, &c)| *g *= c);
        let mut d_mixing = vec![E::default(); 2 * h * h];
        let mut d_joined = vec![E::default(); n * 2 * h];
        for joined in inputs.iter().rev() {
            let p = view(&gradient, n, h);
            gemm(&mut d_mixing, view(joined, n, 2 * h).transpose(), p, Accum::Add);
            gemm(&mut d_joined, p, view(&mixing, 2 * h, h).transpose(), Accum::Replace);
            fold_neighbours(&d_joined, &graph, h, &mut gradient);
        }
        add_weight_gradient(&d_mixing, h, grads.get_or_alloc_mut(&w1_ghost)?, |own, _| -own);
        add_weight_gradient(&d_mixing, h, grads.get_or_alloc_mut(&w2_ghost)?, |own, near| {
            (near - own) + (near - own)
        });
        let d_x = grads.get_or_alloc_mut(&x_ghost)?;
        d_x.iter_mut().zip(&gradient).for_each(|(d, &g)| *d += g);
        Ok(())
    });
    out.put_tape(tape)
}

/// M = [I − w₁ᵀ − 2w₂ᵀ ; 2w₂ᵀ].
fn mixing_matrix<E: Real>(w1: &[E], w2: &[E], h: usize) -> Vec<E> {
    let two = E::round(2.0);
    let mut m = vec![E::default(); 2 * h * h];
    let (own, near) = m.split_at_mut(h * h);
    for i in 0..h {
        for j in 0..h {
            let (a, b) = (w1[j * h + i], two * w2[j * h + i]);
            let one = if i == j { E::round(1.0) } else { E::default() };
            own[i * h + j] = one - a - b;
            near[i * h + j] = b;
        }
    }
    m
}

/// [x | Wx], n×2h.
fn beside_neighbours<E: Real>(x: &[E], graph: &Graph<E>, h: usize) -> Vec<E> {
    let mut joined = Vec::with_capacity(2 * x.len());
    graph.for_each_row(x, h, |i, neighbours| {
        joined.extend_from_slice(&x[i * h..(i + 1) * h]);
        joined.extend_from_slice(neighbours);
    });
    joined
}

/// dx + Wᵀu for [dx | u].
fn fold_neighbours<E: Real>(joined: &[E], graph: &Graph<E>, h: usize, dx: &mut [E]) {
    let near: Vec<E> = joined.chunks_exact(2 * h).flat_map(|row| &row[h..]).copied().collect();
    graph.for_each_transposed_row(&near, h, |i, sum| {
        let own = &joined[2 * h * i..2 * h * i + h];
        for ((dx, &own), &near) in dx[i * h..(i + 1) * h].iter_mut().zip(own).zip(sum) {
            *dx = own + near;
        }
    });
}

/// dw += f(dM_own, dM_near)ᵀ.
fn add_weight_gradient<E: Real>(d_mixing: &[E], h: usize, dw: &mut [E], f: impl Fn(E, E) -> E) {
    let (own, near) = d_mixing.split_at(h * h);
    for i in 0..h {
        for j in 0..h {
            dw[i * h + j] += f(own[j * h + i], near[j * h + i]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::finite_differences::{check, values, weighted_sum};
    use super::*;
    use crate::mesh::sample::icosphere;
    use crate::operators::adjacency::{adjacency, graph_laplacian};

    const H: usize = 4;

    #[test]
    fn gradients_match_finite_differences_for_one_two_and_three_iterations() {
        let graph = Arc::new(Graph::new(&adjacency(&icosphere(0))));
        let n = graph.n();
        for iterations in 1..=3 {
            let scaled = |seed| values(H * H, seed).iter().map(|v| 0.3 * v).collect();
            check(&[values(n * H, 1), scaled(2), scaled(3)], |dev, p, tape| {
                let x = dev.tensor_from_vec(p[0].clone(), (n, H));
                let [w1, w2] = [1, 2].map(|i| dev.tensor_from_vec(p[i].clone(), (H, H)));
                let y = sggc(x.clone().put_tape(tape), &graph, &w1, &w2, iterations);
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
        let w = adjacency(&icosphere(0));
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
        let y = sggc(
            dev.tensor_from_vec(x, (n, H)),
            &graph,
            &dev.tensor_from_vec(w1, (H, H)),
            &dev.tensor_from_vec(w2, (H, H)),
            1,
        );
        for (found, phase) in y.as_vec().iter().zip(expected) {
            assert!((found - phase.sin()).abs() < 1e-13);
        }
    }
}
