//! Rayleigh quotients of heads on features, deflated against earlier eigenfunctions: what `ritz` trains on.
//!
//! With u = P F w, P = I − Φ(ΦᵀBΦ)⁻¹ΦᵀB, R = uᵀLu/uᵀBu over the whole batch, the gradient of R with respect to
//! F is 2 Pᵀ(L − RB)u wᵀ / Σuᵀ Bu. R and the denominator belong to the batch, so they enter as numbers: the value
//! of this operation is uᵀ(L − RB)u / Σ uᵀBu, whose sum over the batch is zero and whose gradient is that of R.
//! Several heads are summed up, each with a weight of its own.

use std::sync::Arc;

use dfdx::prelude::*;
use faer::Accum;

use super::dealt::{self, ROWS};
use super::product::Layout;
use super::real::{Real, widely};
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
    let mut values = vec![0.0; features.len() / head.len()];
    widely(
        #[inline(always)]
        || {
            for (value, row) in values.iter_mut().zip(features.chunks_exact(head.len())) {
                *value = dot(row, head);
            }
        },
    );
    values
}

/// Σ fⱼ wⱼ, in as many partial sums as fill wide registers.
#[inline(always)]
fn dot<E: Real>(f: &[E], w: &[f64]) -> f64 {
    const PARTS: usize = 16;
    let mut parts = [0.0; PARTS];
    let (f, f_rest) = f.as_chunks::<PARTS>();
    let (w, w_rest) = w.as_chunks::<PARTS>();
    for (f, w) in f.iter().zip(w) {
        for i in 0..PARTS {
            parts[i] += f[i].wide() * w[i];
        }
    }
    let rest: f64 = f_rest.iter().zip(w_rest).map(|(f, w)| f.wide() * w).sum();
    parts.iter().sum::<f64>() + rest
}

/// P F w in double precision for every head w, n each.
fn deflated_predictions<E: Real>(
    features: &[E],
    terms: &[Term],
    deflation: &Deflation,
) -> Vec<Vec<f64>> {
    let prediction = |term: &Term| {
        let mut u = decode(features, &term.head);
        deflation.apply(&mut u);
        u
    };
    terms.iter().map(prediction).collect()
}

/// The share of some members in the linearised Rayleigh quotients, from the features of each; see the module's first lines.
pub fn rayleigh<E: Real, T: Tape<E, Cpu>>(
    members: Vec<(Matrix<E>, Arc<MemberPencil>)>,
    terms: &Arc<Vec<Term>>,
    mut tape: T,
) -> Scalar<E, T> {
    let mut value = 0.0;
    let mut shares = Vec::with_capacity(members.len());
    for (features, member) in members {
        let (share, residuals) = linearised(&features, terms, &member);
        value += share;
        shares.push((features.ghost(), residuals, member));
    }
    let out = Cpu::default().tensor_from_vec(vec![E::round(value)], ());
    let (out_ghost, terms) = (out.ghost(), terms.clone());
    tape.add_backward_op(move |grads| {
        let outer = grads.get_or_alloc_mut(&out_ghost)?[0].wide();
        for (features, residuals, member) in &mut shares {
            let d_features = grads.get_or_alloc_mut(features)?;
            add_gradient(d_features, residuals, &terms, &member.deflation, outer);
        }
        Ok(())
    });
    out.put_tape(tape)
}

/// Σ w uᵀ(L − RB)u of one member, and (L − RB)u for every head.
fn linearised<E: Real>(
    features: &Matrix<E>,
    terms: &[Term],
    member: &MemberPencil,
) -> (f64, Vec<Vec<f64>>) {
    let predictions = deflated_predictions(&lent(features), terms, &member.deflation);
    let mut value = 0.0;
    let mut residuals = Vec::with_capacity(terms.len());
    for (u, term) in predictions.iter().zip(terms) {
        let [mut residual, mut bu] = [vec![0.0; u.len()], vec![0.0; u.len()]];
        apply(&member.stiffness, u, &mut residual);
        apply(&member.mass, u, &mut bu);
        residual.iter_mut().zip(&bu).for_each(|(r, b)| *r -= term.quotient * b);
        value += term.weight * u.iter().zip(&residual).map(|(u, r)| u * r).sum::<f64>();
        residuals.push(residual);
    }
    (value, residuals)
}

/// Adds Σ 2w Pᵀ(L − RB)u wᵀ to the gradient of one member's features.
fn add_gradient<E: Real>(
    d_features: &mut [E],
    residuals: &mut [Vec<f64>],
    terms: &[Term],
    deflation: &Deflation,
    outer: f64,
) {
    let (heads, n) = (terms.len(), residuals.first().map_or(0, Vec::len));
    let h = d_features.len() / n.max(1);
    // Row i: what each head asks of vertex i; and the heads themselves.
    let (mut asked, mut weights) = (vec![E::default(); n * heads], Vec::with_capacity(heads * h));
    for (k, (residual, term)) in residuals.iter_mut().zip(terms).enumerate() {
        deflation.apply_transposed(residual);
        let scale = 2.0 * outer * term.weight;
        let places = asked.iter_mut().skip(k).step_by(heads);
        places.zip(&*residual).for_each(|(asked, r)| *asked = E::round(scale * r));
        weights.extend(term.head.iter().map(|&w| E::round(w)));
    }
    let weights = E::pack(&weights, heads, h);
    let chunks = d_features.chunks_mut(ROWS * h).zip(asked.chunks(ROWS * heads));
    dealt::for_each(chunks, |(d_features, asked)| {
        let rows = Layout::Rows(asked, heads);
        weights.multiply(d_features, h, rows, d_features.len() / h, Accum::Add);
    });
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
            let loss = rayleigh(vec![(f.clone(), member.clone())], &terms, tape);
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
        let members = vec![(tensor.clone(), member.clone())];
        let loss = rayleigh(members, &Arc::new(vec![term(&f)]), OwnedTape::default());
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
