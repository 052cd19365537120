//! Rayleigh quotients of heads on features, deflated against earlier eigenfunctions: what `ritz` trains on.
//!
//! With u = P F w, P = I − Φ(ΦᵀBΦ)⁻¹ΦᵀB, R = uᵀLu/uᵀBu over the whole batch, the gradient of R with respect to
//! F is 2 Pᵀ(L − RB)u wᵀ / Σuᵀ Bu. R and the denominator belong to the batch, so they enter as numbers: the value
//! of this operation is uᵀ(L − RB)u / Σ uᵀBu, whose sum over the batch is zero and whose gradient is that of R.
//! Several heads are summed up, each with a weight of its own.

use std::sync::Arc;

use dfdx::prelude::*;

use super::real::{Real, axpy, widely};
use super::{Matrix, Scalar, lent};
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

/// A head, and what the batch shares of its quotient.
#[derive(Debug, Clone, PartialEq)]
pub struct Term {
    /// w, h.
    pub head: Vec<f64>,
    /// R.
    pub quotient: f64,
    /// What the gradient of R is multiplied by, over Σ uᵀBu of the batch.
    pub weight: f64,
}

/// F w in double precision, n.
pub fn decode<E: Real>(features: &[E], head: &[f64]) -> Vec<f64> {
    features
        .chunks_exact(head.len())
        .map(|row| row.iter().zip(head).map(|(f, w)| f.wide() * w).sum())
        .collect()
}

/// P F w in double precision for every head w, n each.
fn deflated_predictions<E: Real>(
    features: &[E],
    terms: &[Term],
    deflation: &Deflation,
) -> Vec<Vec<f64>> {
    let (heads, h) = (terms.len(), terms.first().map_or(1, |term| term.head.len()));
    // The weights of all heads for one feature side by side.
    let mut weights = Vec::with_capacity(h * heads);
    (0..h).for_each(|j| weights.extend(terms.iter().map(|term| term.head[j])));
    let mut rows = vec![0.0; features.len() / h * heads];
    widely(
        #[inline(always)]
        || {
            for (row, features) in rows.chunks_exact_mut(heads).zip(features.chunks_exact(h)) {
                for (f, weights) in features.iter().zip(weights.chunks_exact(heads)) {
                    axpy(f.wide(), weights, row);
                }
            }
        },
    );
    let prediction = |k: usize| {
        let mut u: Vec<f64> = rows.iter().skip(k).step_by(heads).copied().collect();
        deflation.apply(&mut u);
        u
    };
    (0..heads).map(prediction).collect()
}

/// The share of one member in the linearised Rayleigh quotients; see the module's first lines.
pub fn rayleigh<E: Real, T: Tape<E, Cpu>>(
    features: Matrix<E, T>,
    terms: &Arc<Vec<Term>>,
    member: &Arc<MemberPencil>,
) -> Scalar<E, T> {
    let (features, mut tape) = features.split_tape();
    let predictions = deflated_predictions(&lent(&features), terms, &member.deflation);
    let mut value = 0.0;
    let mut residuals = Vec::with_capacity(terms.len());
    for (u, term) in predictions.iter().zip(&**terms) {
        let [mut residual, mut bu] = [vec![0.0; u.len()], vec![0.0; u.len()]];
        apply(&member.stiffness, u, &mut residual);
        apply(&member.mass, u, &mut bu);
        residual.iter_mut().zip(&bu).for_each(|(r, b)| *r -= term.quotient * b);
        value += term.weight * u.iter().zip(&residual).map(|(u, r)| u * r).sum::<f64>();
        residuals.push(residual);
    }
    let out = features.device().tensor_from_vec(vec![E::round(value)], ());
    let (out_ghost, f_ghost) = (out.ghost(), features.ghost());
    let (terms, member) = (terms.clone(), member.clone());
    tape.add_backward_op(move |grads| {
        let outer = grads.get_or_alloc_mut(&out_ghost)?[0].wide();
        let d_features = grads.get_or_alloc_mut(&f_ghost)?;
        for (residual, term) in residuals.iter_mut().zip(&*terms) {
            member.deflation.apply_transposed(residual);
            let scale = 2.0 * outer * term.weight;
            let weights: Vec<E> = term.head.iter().map(|&w| E::round(w)).collect();
            widely(
                #[inline(always)]
                || {
                    for (row, r) in d_features.chunks_exact_mut(weights.len()).zip(&*residual) {
                        axpy(E::round(scale * r), &weights, row);
                    }
                },
            );
        }
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
        let term = |seed, quotient, weight| Term { head: values(h, seed), quotient, weight };
        let terms = Arc::new(vec![term(9, 1.7, 0.4), term(11, 0.3, 1.9)]);
        check(&[values(n * h, 1)], |dev, p, tape| {
            let f = dev.tensor_from_vec(p[0].clone(), (n, h));
            let loss = rayleigh(f.clone().put_tape(tape), &terms, &member);
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
        let head = values(h, 9);
        let term = |f: &[f64]| {
            let mut u = decode(f, &head);
            member.deflation.apply(&mut u);
            let denominator = quadratic(&member.mass, &u);
            let quotient = quadratic(&member.stiffness, &u) / denominator;
            Term { head: head.clone(), quotient, weight: denominator.recip() }
        };
        let f = values(n * h, 1);
        let dev = Cpu::default();
        let tensor = dev.tensor_from_vec(f.clone(), (n, h));
        let loss = rayleigh(
            tensor.clone().put_tape(OwnedTape::default()),
            &Arc::new(vec![term(&f)]),
            &member,
        );
        let gradient = loss.backward().get(&tensor).as_vec();
        for entry in 0..n * h {
            let at = |delta: f64| {
                let mut moved = f.clone();
                moved[entry] += delta;
                term(&moved).quotient
            };
            let difference = (at(1e-5) - at(-1e-5)) / 2e-5;
            assert!((gradient[entry] - difference).abs() < 1e-7, "{entry}");
        }
    }
}
