//! The graph attention layer of Veličković et al. with one head: x ↦ σ(Σ_j α_ij z_j) with z = x wᵀ.
//!
//! "Graph attention networks", ICLR 2018, (1)–(4). The sum runs over the neighbours j of vertex i and i itself, and
//! α_i = softmax_j e_ij with e_ij = LeakyReLU(a₁·z_i + a₂·z_j), slope 0.2 below zero. The paper compares with it in
//! its Table 2.
//!
//! Backward, with g the gradient of y_i = Σ_j α_ij z_j: dα_ij = g_i·z_j, de_ij = α_ij (dα_ij − Σ_k α_ik dα_ik), q_ij
//! = LeakyReLU′ de_ij, and with s_i = Σ_j q_ij, t_j = Σ_i q_ij:
//! dz_j = Σ_i α_ij g_i + s_j a₁ + t_j a₂, da₁ = Σ s_i z_i, da₂ = Σ t_j z_j, dw = dzᵀ x, dx = dz w.

use std::sync::Arc;

use dfdx::prelude::*;
use faer::Accum;

use super::activation::{Activated, Activation};
use super::graph::Graph;
use super::real::{Real, axpy, gemm, multiply, view, widely};
use super::{Matrix, entries};

/// LeakyReLU's slope below zero.
const LEAK: f64 = 0.2;

/// Applies one layer to x, n×h, with w, h×h, and a = [a₁ ; a₂], 2×h, along the edges of the adjacency W: n×h.
pub fn gat<E: Real, T: Tape<E, Cpu>>(
    x: Matrix<E, T>,
    graph: &Arc<Graph<E>>,
    w: &Matrix<E>,
    a: &Matrix<E>,
    activation: Activation,
) -> Matrix<E, T> {
    let (x, mut tape) = x.split_tape();
    let &(n, h) = x.shape();
    let (xs, weights, a_entries) = (entries(&x), entries(w), entries(a));
    let mut z = vec![E::default(); n * h];
    gemm(&mut z, view(&xs, n, h), view(&weights, h, h).transpose(), Accum::Replace);
    let attention = Attention::new(&z, &a_entries, graph);
    let Activated { values, slopes } = activation.apply(&attention.averages(&z, graph, h));
    let out = x.device().tensor_from_vec(values, (n, h));
    let (out_ghost, x_ghost) = (out.ghost(), x.ghost());
    let (w_ghost, a_ghost, graph) = (w.ghost(), a.ghost(), graph.clone());
    tape.add_backward_op(move |grads| {
        let mut gradient = std::mem::take(&mut **grads.get_or_alloc_mut(&out_ghost)?);
        multiply(&slopes, &mut gradient);
        let (mut dz, st) = attention.backward(&z, &gradient, &graph, h);
        gemm(&mut dz, view(&st, n, 2), view(&a_entries, 2, h), Accum::Add);
        let da = grads.get_or_alloc_mut(&a_ghost)?;
        gemm(da, view(&st, n, 2).transpose(), view(&z, n, h), Accum::Add);
        let dz = view(&dz, n, h);
        gemm(grads.get_or_alloc_mut(&w_ghost)?, dz.transpose(), view(&xs, n, h), Accum::Add);
        gemm(grads.get_or_alloc_mut(&x_ghost)?, dz, view(&weights, h, h), Accum::Add);
        Ok(())
    });
    out.put_tape(tape)
}

/// For every vertex i in order, what belongs to i itself and then to its neighbours, ascending.
struct Attention<E> {
    /// α_ij.
    shares: Vec<E>,
    /// LeakyReLU′ where e_ij was taken.
    slopes: Vec<E>,
}

impl<E: Real> Attention<E> {
    /// α from z, n×h, and a, 2×h.
    fn new(z: &[E], a: &[E], graph: &Graph<E>) -> Self {
        let (n, h) = (graph.n(), a.len() / 2);
        // [a₁·z_i | a₂·z_i], n×2.
        let mut scores = vec![E::default(); 2 * n];
        gemm(&mut scores, view(z, n, h), view(a, 2, h).transpose(), Accum::Replace);
        let (mut shares, mut slopes) = (Vec::new(), Vec::new());
        for i in 0..n {
            let first = shares.len();
            for j in with_itself(graph, i) {
                let score = scores[2 * i] + scores[2 * j + 1];
                let slope = E::round(if score > E::default() { 1.0 } else { LEAK });
                shares.push(slope * score);
                slopes.push(slope);
            }
            softmax(&mut shares[first..]);
        }
        Self { shares, slopes }
    }

    /// Σ_j α_ij z_j, n×h.
    fn averages(&self, z: &[E], graph: &Graph<E>, h: usize) -> Vec<E> {
        let mut averages = vec![E::default(); z.len()];
        let mut shares = self.shares.iter();
        widely(
            #[inline(always)]
            || {
                for (i, average) in averages.chunks_exact_mut(h).enumerate() {
                    for (j, &share) in with_itself(graph, i).zip(&mut shares) {
                        axpy(share, &z[j * h..(j + 1) * h], average);
                    }
                }
            },
        );
        averages
    }

    /// Σ_i α_ij g_i for every j, n×h, and [s | t], n×2.
    fn backward(&self, z: &[E], g: &[E], graph: &Graph<E>, h: usize) -> (Vec<E>, Vec<E>) {
        let n = graph.n();
        let (mut dz, mut st) = (vec![E::default(); n * h], vec![E::default(); 2 * n]);
        let mut d_shares = Vec::new();
        let mut at = 0;
        widely(
            #[inline(always)]
            || {
                for (i, g) in g.chunks_exact(h).enumerate() {
                    d_shares.clear();
                    let shares = &self.shares[at..];
                    for (j, &share) in with_itself(graph, i).zip(shares) {
                        d_shares.push(product(g, &z[j * h..(j + 1) * h]));
                        axpy(share, g, &mut dz[j * h..(j + 1) * h]);
                    }
                    let mean = product(&d_shares, shares);
                    for (k, j) in with_itself(graph, i).enumerate() {
                        let q = self.slopes[at + k] * shares[k] * (d_shares[k] - mean);
                        st[2 * i] += q;
                        st[2 * j + 1] += q;
                    }
                    at += d_shares.len();
                }
            },
        );
        (dz, st)
    }
}

/// Vertex i and its neighbours.
fn with_itself<E: Real>(graph: &Graph<E>, i: usize) -> impl Iterator<Item = usize> {
    std::iter::once(i).chain(graph.neighbours(i).iter().map(|&j| j as usize))
}

/// e ← exp(e)/Σ exp(e), from the largest down, so that nothing overflows.
fn softmax<E: Real>(e: &mut [E]) {
    let largest = e.iter().fold(f64::NEG_INFINITY, |largest, e| largest.max(e.wide()));
    let powers = e.iter().map(|e| (e.wide() - largest).exp());
    let sum: f64 = powers.clone().sum();
    let shares: Vec<E> = powers.map(|power| E::round(power / sum)).collect();
    e.copy_from_slice(&shares);
}

/// Σ x y over the entries that both have.
#[inline(always)]
fn product<E: Real>(x: &[E], y: &[E]) -> E {
    x.iter().zip(y).fold(E::default(), |sum, (&x, &y)| sum + x * y)
}

#[cfg(test)]
mod tests {
    use super::super::finite_differences::{check, values, weighted_sum};
    use super::*;
    use crate::mesh::sample::icosphere;
    use crate::operators::{Pattern, adjacency::adjacency};

    const H: usize = 4;

    fn graph() -> Arc<Graph<f64>> {
        Arc::new(Graph::new(&adjacency(&Pattern::of_mesh(&icosphere(0)))))
    }

    #[test]
    fn gradients_match_finite_differences() {
        let graph = graph();
        let n = graph.n();
        for activation in Activation::ALL {
            check(&[values(n * H, 1), values(H * H, 2), values(2 * H, 3)], |dev, p, tape| {
                let x = dev.tensor_from_vec(p[0].clone(), (n, H));
                let w = dev.tensor_from_vec(p[1].clone(), (H, H));
                let a = dev.tensor_from_vec(p[2].clone(), (2, H));
                let y = gat(x.clone().put_tape(tape), &graph, &w, &a, activation);
                let read = move |g: &Gradients<f64, Cpu>| {
                    vec![g.get(&x).as_vec(), g.get(&w).as_vec(), g.get(&a).as_vec()]
                };
                (weighted_sum(y), Box::new(read))
            });
        }
    }

    #[test]
    fn shares_add_up_to_one_and_large_scores_do_not_overflow() {
        let graph = graph();
        let z: Vec<f64> = values(graph.n() * H, 1).iter().map(|v| 1e4 * v).collect();
        let Attention { shares, .. } = Attention::new(&z, &values(2 * H, 2), &graph);
        assert!(shares.iter().all(|share| share.is_finite()));
        let mut shares = shares.into_iter();
        for i in 0..graph.n() {
            let sum: f64 = shares.by_ref().take(1 + graph.neighbours(i).len()).sum();
            assert!((sum - 1.0).abs() < 1e-14);
        }
    }
}
