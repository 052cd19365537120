//! The Rayleigh quotient of a head on features, deflated against earlier eigenfunctions: what `ritz` trains on.
//!
//! With u = P F w, P = I − Φ(ΦᵀBΦ)⁻¹ΦᵀB, R = uᵀLu/uᵀBu over the whole batch, the gradient of R with respect to
//! F is 2 Pᵀ(L − RB)u wᵀ / Σuᵀ Bu. R and the denominator belong to the batch, so they enter as numbers: the value
//! of this operation is uᵀ(L − RB)u / Σ uᵀBu, whose sum over the batch is zero and whose gradient is that of R.

use std::sync::Arc;

use dfdx::prelude::*;
use pulp::Arch;

use super::real::{Real, axpy};
use super::{Matrix, Scalar, entries};
use crate::ggnn::deflation::Deflation;
use crate::operators::Sparse;
use crate::spectrum::pencil::apply;

/// The pencil of one family member, and the earlier eigenfunctions on it.
#[derive(Debug)]
pub struct MemberPencil {
    /// L, n×n.
    pub stiffness: Sparse,
    /// B, n×n.
    pub mass: Sparse,
    /// P of the earlier eigenfunctions.
    pub deflation: Deflation,
}

/// What the batch shares: R = uᵀLu/uᵀBu and Σ uᵀBu.
#[derive(Debug, Clone, Copy)]
pub struct Quotient {
    /// R.
    pub value: f64,
    /// Σ uᵀBu over the batch.
    pub denominator: f64,
}

/// u = P F w in double precision, n.
pub fn deflated_prediction<E: Real>(
    features: &[E],
    head: &[f64],
    deflation: &Deflation,
) -> Vec<f64> {
    let mut u = decode(features, head);
    deflation.apply(&mut u);
    u
}

/// F w in double precision, n.
pub fn decode<E: Real>(features: &[E], head: &[f64]) -> Vec<f64> {
    features
        .chunks_exact(head.len())
        .map(|row| row.iter().zip(head).map(|(f, w)| f.wide() * w).sum())
        .collect()
}

/// The share of one member in the linearised Rayleigh quotient; see the module's first lines.
pub fn rayleigh<E: Real, T: Tape<E, Cpu>>(
    features: Matrix<E, T>,
    head: &Arc<Vec<f64>>,
    member: &Arc<MemberPencil>,
    quotient: Quotient,
) -> Scalar<E, T> {
    let (features, mut tape) = features.split_tape();
    let u = deflated_prediction(&entries(&features), head, &member.deflation);
    let [mut residual, mut bu] = [vec![0.0; u.len()], vec![0.0; u.len()]];
    apply(&member.stiffness, &u, &mut residual);
    apply(&member.mass, &u, &mut bu);
    residual.iter_mut().zip(&bu).for_each(|(r, b)| *r -= quotient.value * b);
    let value: f64 = u.iter().zip(&residual).map(|(u, r)| u * r).sum();
    let out = features.device().tensor_from_vec(vec![E::round(value / quotient.denominator)], ());
    let (out_ghost, f_ghost) = (out.ghost(), features.ghost());
    let (head, member) = (head.clone(), member.clone());
    tape.add_backward_op(move |grads| {
        let outer = grads.get_or_alloc_mut(&out_ghost)?[0].wide();
        member.deflation.apply_transposed(&mut residual);
        let scale = 2.0 * outer / quotient.denominator;
        let d_features = grads.get_or_alloc_mut(&f_ghost)?;
        let weights: Vec<E> = head.iter().map(|&w| E::round(w)).collect();
        Arch::new().dispatch(
            #[inline(always)]
            || {
                for (row, r) in d_features.chunks_exact_mut(weights.len()).zip(&residual) {
                    axpy(E::round(scale * r), &weights, row);
                }
            },
        );
        Ok(())
    });
    out.put_tape(tape)
}

#[cfg(test)]
mod tests {
    use super::super::finite_differences::{check, values};
    use super::*;
    use crate::mesh::sample::icosphere;
    use crate::operators::{MassKind, Operators};
    use crate::spectrum::Dense;
    use crate::spectrum::pencil::quadratic;

    #[test]
    fn gradients_match_finite_differences() {
        let operators = Operators::assemble(&icosphere(0), MassKind::Consistent).unwrap();
        let (n, h) = (operators.n(), 3);
        // Two earlier "eigenfunctions" that are not B-orthonormal, as predictions are not.
        let phi = Dense::from_fn(n, 2, |i, j| values(n, j as u64 + 5)[i]);
        let member = Arc::new(MemberPencil {
            deflation: Deflation::new(&operators.mass, phi),
            stiffness: operators.stiffness,
            mass: operators.mass,
        });
        let head = Arc::new(values(h, 9));
        let quotient = Quotient { value: 1.7, denominator: 2.3 };
        check(&[values(n * h, 1)], |dev, p, tape| {
            let f = dev.tensor_from_vec(p[0].clone(), (n, h));
            let loss = rayleigh(f.clone().put_tape(tape), &head, &member, quotient);
            (loss, Box::new(move |g| vec![g.get(&f).as_vec()]))
        });
    }

    #[test]
    fn its_gradient_is_that_of_the_quotient_itself() {
        let operators = Operators::assemble(&icosphere(0), MassKind::Lumped).unwrap();
        let (n, h) = (operators.n(), 3);
        let deflation = Deflation::new(&operators.mass, Dense::from_fn(n, 1, |_, _| 1.0));
        let member = Arc::new(MemberPencil {
            deflation,
            stiffness: operators.stiffness,
            mass: operators.mass,
        });
        let head = Arc::new(values(h, 9));
        let quotient = |f: &[f64]| {
            let u = deflated_prediction(f, &head, &member.deflation);
            let denominator = quadratic(&member.mass, &u);
            Quotient { value: quadratic(&member.stiffness, &u) / denominator, denominator }
        };
        let f = values(n * h, 1);
        let dev = Cpu::default();
        let tensor = dev.tensor_from_vec(f.clone(), (n, h));
        let loss =
            rayleigh(tensor.clone().put_tape(OwnedTape::default()), &head, &member, quotient(&f));
        let gradient = loss.backward().get(&tensor).as_vec();
        for entry in 0..n * h {
            let at = |delta: f64| {
                let mut moved = f.clone();
                moved[entry] += delta;
                quotient(&moved).value
            };
            let difference = (at(1e-5) - at(-1e-5)) / 2e-5;
            assert!((gradient[entry] - difference).abs() < 1e-7, "{entry}");
        }
    }
}
