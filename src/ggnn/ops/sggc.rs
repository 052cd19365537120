//! SGGC layers of (29), one after the other: x ↦ σ(x^I), σ = sin in the paper, with
//! x^{i+1} = x^i − [x^i w₁ᵀ + 2 (I − W) x^i w₂ᵀ].
//!
//! One iteration is a single dense product: x^{i+1} = [x^i | W x^i] M with M = [I − w₁ᵀ − 2w₂ᵀ ; 2w₂ᵀ], 2h×h.
//! Backward, with P the gradient of x^{i+1}: dMᵀ = Pᵀ [x | Wx], and [dx | u] = P Mᵀ with Wᵀu added to dx.
//!
//! A layer may do without its neighbours, w₂ = 0: then M = I − w₁ᵀ, h×h, and x stands in the place of [x | Wx]. (I − W) x is
//! small where vertices are close together and large where they are far apart, so that what is learned of it on one
//! sampling misleads on another; see `docs/training.md` for what that costs. Without it a feature is a function of the
//! place alone.

use std::sync::Arc;

use dfdx::prelude::*;
use faer::Accum;

use super::activation::Activation;
use super::dealt::{self, ROWS, rows_of_sum};
use super::graph::Graph;
use super::loan::Loan;
use super::product::Panels;
use super::real::{Real, add, multiply, widely};
use super::{Matrix, entries, lent};

/// The weights of one layer in the form its products want, made once for many forward passes.
#[derive(Debug, Clone)]
pub struct Mixing<E: Real> {
    w1: Matrix<E>,
    /// None where a vertex does not read its neighbours.
    w2: Option<Matrix<E>>,
    /// M and Mᵀ, for the ways forward and backward.
    matrices: Arc<[Panels<E>; 2]>,
}

/// What the way back through a layer needs.
struct Passed<E: Real> {
    /// [x^i | W x^i], or x^i, of every iteration.
    inputs: Vec<Loan<E>>,
    /// σ′.
    slopes: Loan<E>,
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
        Self::of(w1, Some(w2.clone()), &matrix)
    }

    /// M from Mᵀ = I − w₁, h×h.
    pub fn alone(w1: &Matrix<E>) -> Self {
        let &(h, _) = w1.shape();
        let mut matrix: Vec<E> = entries(w1).into_iter().map(|w| -w).collect();
        (0..h).for_each(|i| matrix[i * h + i] += E::round(1.0));
        Self::of(w1, None, &matrix)
    }

    fn of(w1: &Matrix<E>, w2: Option<Matrix<E>>, matrix: &[E]) -> Self {
        let &(h, _) = w1.shape();
        let k = matrix.len() / h;
        let matrices = [E::pack_transposed(matrix, h, k), E::pack(matrix, h, k)];
        Self { w1: w1.clone(), w2, matrices: Arc::new(matrices) }
    }

    /// h, and the columns of [x | Wx] or of x.
    fn sizes(&self) -> (usize, usize) {
        (self.matrices[0].columns(), self.matrices[0].rows())
    }

    /// σ(x^I) of x, n×h.
    fn forward(
        &self,
        mut x: Loan<E>,
        graph: &Graph<E>,
        iterations: usize,
        activation: Activation,
    ) -> (Loan<E>, Passed<E>) {
        let (h, k) = self.sizes();
        let mut slopes = Loan::of(x.len());
        let mut inputs = Vec::with_capacity(iterations);
        for iteration in 1..=iterations {
            let mut next = Loan::of(x.len());
            let mut joined = self.w2.as_ref().map(|_| Loan::of(2 * x.len()));
            let mut rows_joined = joined.as_deref_mut().map(|joined| joined.chunks_mut(ROWS * k));
            let rows = next.chunks_mut(ROWS * h).zip(slopes.chunks_mut(ROWS * h)).enumerate();
            let rows = rows.map(|(chunk, (next, slopes))| {
                (chunk * ROWS, next, slopes, rows_joined.as_mut().and_then(Iterator::next))
            });
            dealt::for_each(rows, |(first, next, slopes, joined)| {
                let input = match joined {
                    Some(joined) => beside_neighbours(&x, graph, h, first, joined),
                    None => &x[first * h..][..next.len()],
                };
                if iteration < iterations {
                    E::multiply(next, input, next.len() / h, &self.matrices[0]);
                } else {
                    let mut phase = Loan::of(next.len());
                    E::multiply(&mut phase, input, next.len() / h, &self.matrices[0]);
                    activation.apply_to(&phase, next, slopes);
                }
            });
            inputs.push(joined.unwrap_or(x));
            x = next;
        }
        (x, Passed { inputs, slopes })
    }

    /// The gradient of x from that of σ(x^I), n×h; adds those of the weights.
    fn backward(
        &self,
        passed: &Passed<E>,
        mut gradient: Loan<E>,
        graph: &Graph<E>,
        grads: &mut Gradients<E, Cpu>,
    ) -> Result<Loan<E>, CpuError> {
        let (h, k) = self.sizes();
        let rows = rows_of_sum(gradient.len() / h);
        // dMᵀ, a part for each of these.
        let mut sums: Vec<_> = gradient.chunks(rows * h).map(|_| Loan::of(h * k)).collect();
        for (step, input) in passed.inputs.iter().rev().enumerate() {
            let mut d_input = Loan::of(input.len());
            let accum = if step == 0 { Accum::Replace } else { Accum::Add };
            let parts = gradient.chunks_mut(rows * h).zip(d_input.chunks_mut(rows * k));
            let parts = parts.zip(&mut sums).enumerate();
            dealt::for_each(parts, |(part, ((gradient, d_input), sum))| {
                if step == 0 {
                    multiply(&passed.slopes[part * rows * h..][..gradient.len()], gradient);
                }
                let (n, input) = (gradient.len() / h, &input[part * rows * k..][..d_input.len()]);
                E::multiply(d_input, gradient, n, &self.matrices[1]);
                E::transposed_product(sum, gradient, input, n, accum);
            });
            if self.w2.is_none() {
                gradient = d_input;
                continue;
            }
            let rows = gradient.chunks_mut(ROWS * h).enumerate();
            dealt::for_each(rows, |(chunk, dx)| fold_neighbours(&d_input, graph, h, chunk, dx));
        }
        for d_matrix in &sums {
            let d_w1 = grads.get_or_alloc_mut(&self.w1)?;
            add_weight_gradient(d_matrix, k, d_w1, |own, _| -own);
            if let Some(w2) = &self.w2 {
                let d_w2 = grads.get_or_alloc_mut(w2)?;
                add_weight_gradient(d_matrix, k, d_w2, |own, near| (near - own) + (near - own));
            }
        }
        Ok(gradient)
    }
}

/// Applies `layers` to x, n×h, each with I = `iterations` ≥ 1: n×h.
pub fn sggc<E: Real, T: Tape<E, Cpu>>(
    x: Matrix<E, T>,
    graph: &Arc<Graph<E>>,
    layers: &Arc<[Mixing<E>]>,
    iterations: usize,
    activation: Activation,
) -> Matrix<E, T> {
    let (x, mut tape) = x.split_tape();
    let mut state = lent(&x);
    let mut all_passed = Vec::with_capacity(layers.len());
    for layer in layers.iter() {
        let (next, passed) = layer.forward(state, graph, iterations, activation);
        state = next;
        if T::OWNS_TAPE {
            all_passed.push(passed);
        }
    }
    let out = x.device().tensor_from_vec(state.into_vec(), *x.shape());
    let (out_ghost, x_ghost) = (out.ghost(), x.ghost());
    let (graph, layers) = (graph.clone(), layers.clone());
    tape.add_backward_op(move |grads| {
        let mut gradient = Loan::from(std::mem::take(&mut **grads.get_or_alloc_mut(&out_ghost)?));
        for (layer, passed) in layers.iter().zip(&all_passed).rev() {
            gradient = layer.backward(passed, gradient, &graph, grads)?;
        }
        add(&gradient, grads.get_or_alloc_mut(&x_ghost)?);
        Ok(())
    });
    out.put_tape(tape)
}

/// The rows of [x | Wx] from `first` on, as many as `joined` holds.
fn beside_neighbours<'j, E: Real>(
    x: &[E],
    graph: &Graph<E>,
    h: usize,
    first: usize,
    joined: &'j mut [E],
) -> &'j [E] {
    graph.for_rows(
        first..first + joined.len() / (2 * h),
        x,
        h,
        #[inline(always)]
        |i, neighbours| {
            let (own, near) = joined[2 * h * (i - first)..][..2 * h].split_at_mut(h);
            own.copy_from_slice(&x[i * h..][..h]);
            near.copy_from_slice(neighbours);
        },
    );
    joined
}

/// dx + Wᵀu for [dx | u]: chunk number `chunk` of its rows.
fn fold_neighbours<E: Real>(joined: &[E], graph: &Graph<E>, h: usize, chunk: usize, dx: &mut [E]) {
    let first = chunk * ROWS;
    graph.for_transposed_rows(
        first..first + dx.len() / h,
        joined,
        2 * h,
        h..2 * h,
        #[inline(always)]
        |i, sum| {
            let own = &joined[2 * h * i..][..h];
            let dx = &mut dx[(i - first) * h..][..h];
            for ((dx, &own), &near) in dx.iter_mut().zip(own).zip(sum) {
                *dx = own + near;
            }
        },
    );
}

/// dw += f(dMᵀ_own, dMᵀ_near) for dMᵀ with k columns; where it has no part for neighbours, f gets the first one twice.
fn add_weight_gradient<E: Real>(d_matrix: &[E], k: usize, dw: &mut [E], f: impl Fn(E, E) -> E) {
    let h = d_matrix.len() / k;
    widely(
        #[inline(always)]
        || {
            for (dw, row) in dw.chunks_exact_mut(h).zip(d_matrix.chunks_exact(k)) {
                let (own, near) = (&row[..h], &row[k - h..]);
                for ((dw, &own), &near) in dw.iter_mut().zip(own).zip(near) {
                    *dw += f(own, near);
                }
            }
        },
    );
}

#[cfg(test)]
mod tests {
    use super::super::dealt::deal_rows;
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
            // Two layers, of which the second has no neighbours.
            check(&[values(n * H, 1), scaled(2), scaled(3), scaled(4)], |dev, p, tape| {
                let x = dev.tensor_from_vec(p[0].clone(), (n, H));
                let w = [1, 2, 3].map(|i| dev.tensor_from_vec(p[i].clone(), (H, H)));
                let layers = [Mixing::new(&w[0], &w[1]), Mixing::alone(&w[2])].into();
                let x_taped = x.clone().put_tape(tape);
                let loss =
                    weighted_sum(sggc(x_taped, &graph, &layers, iterations, Activation::Sin));
                let read = move |g: &Gradients<f64, Cpu>| {
                    let weights = w.iter().map(|w| g.get(w).as_vec());
                    [g.get(&x).as_vec()].into_iter().chain(weights).collect()
                };
                (loss, Box::new(read))
            });
        }
    }

    #[test]
    fn dealt_to_all_threads_it_has_the_same_bits() {
        let graph = Arc::new(Graph::<f32>::new(&adjacency(&Pattern::of_mesh(&icosphere(3)))));
        let n = graph.n();
        let rounded = |len, seed| values(len, seed).iter().map(|&v| 0.3 * v as f32).collect();
        let pass = || {
            let dev = Cpu::default();
            let x = dev.tensor_from_vec(rounded(n * H, 1), (n, H));
            let w = [2, 3, 4].map(|seed| dev.tensor_from_vec(rounded(H * H, seed), (H, H)));
            let layers = [Mixing::new(&w[0], &w[1]), Mixing::alone(&w[2])].into();
            let taped = x.clone().put_tape(OwnedTape::default());
            let y = sggc(taped, &graph, &layers, 2, Activation::Sin);
            let values = y.as_vec();
            let gradients = (y.square().sum::<(), _>()).backward();
            let of_weights = w.iter().map(|w| gradients.get(w).as_vec());
            (values, gradients.get(&x).as_vec(), of_weights.collect::<Vec<_>>())
        };
        let alone = pass();
        deal_rows();
        assert!(pass() == alone);
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
            &[Mixing::new(&w1, &w2)].into(),
            1,
            Activation::Sin,
        );
        for (found, phase) in y.as_vec().iter().zip(expected) {
            assert!((found - phase.sin()).abs() < 1e-13);
        }
    }
}
