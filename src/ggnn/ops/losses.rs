//! The paper's loss: normalisation to unit B-norm, and the terms (24), (25), (26), each for a vector z of
//! length n on one mesh.

use std::sync::Arc;

use dfdx::prelude::*;

use super::real::Real;
use super::{Scalar, Vector};
use crate::operators::Sparse;
use crate::spectrum::Dense;
use crate::spectrum::pencil::{apply, column, dot};

/// z/‖z‖_B: step 2 of the training procedure.
pub fn b_normalise<E: Real, T: Tape<E, Cpu>>(z: Vector<E, T>, mass: &Arc<Sparse>) -> Vector<E, T> {
    let (z, mut tape) = z.split_tape();
    let (values, bz) = with_product(&z, mass);
    let norm = dot(&values, &bz).sqrt();
    let unit: Vec<E> = values.iter().map(|v| E::round(v / norm)).collect();
    let out = z.device().tensor_from_vec(unit, (values.len(),));
    let (out_ghost, z_ghost) = (out.ghost(), z.ghost());
    tape.add_backward_op(move |grads| {
        let g = widen(grads.get_or_alloc_mut(&out_ghost)?);
        // d(z/‖z‖) = dz/‖z‖ − z (zᵀB dz)/‖z‖³.
        let along = dot(&g, &values) / norm.powi(3);
        let dz = grads.get_or_alloc_mut(&z_ghost)?;
        for (d, (g, bz)) in dz.iter_mut().zip(g.iter().zip(&bz)) {
            *d += E::round(g / norm - along * bz);
        }
        Ok(())
    });
    out.put_tape(tape)
}

/// (24): ‖z_b‖² over the boundary vertices.
pub fn boundary_loss<E: Real, T: Tape<E, Cpu>>(
    z: Vector<E, T>,
    boundary: &Arc<Vec<u32>>,
) -> Scalar<E, T> {
    let (z, mut tape) = z.split_tape();
    let values = widen(&z.as_vec());
    let loss = boundary.iter().map(|&i| values[i as usize].powi(2)).sum();
    let out = z.device().tensor_from_vec(vec![E::round(loss)], ());
    let (out_ghost, z_ghost, boundary) = (out.ghost(), z.ghost(), boundary.clone());
    tape.add_backward_op(move |grads| {
        let outer = grads.get_or_alloc_mut(&out_ghost)?[0].wide();
        let dz = grads.get_or_alloc_mut(&z_ghost)?;
        for &i in boundary.iter() {
            dz[i as usize] += E::round(2.0 * outer * values[i as usize]);
        }
        Ok(())
    });
    out.put_tape(tape)
}

/// (25): ‖Lz − (zᵀLz) Bz‖², over the rows that `rows` names (all, or the interior ones, since rows at Dirichlet
/// vertices hold boundary flux).
pub fn residual_loss<E: Real, T: Tape<E, Cpu>>(
    z: Vector<E, T>,
    stiffness: &Arc<Sparse>,
    mass: &Arc<Sparse>,
    rows: &Rows,
) -> Scalar<E, T> {
    let (z, mut tape) = z.split_tape();
    let (values, lz) = with_product(&z, stiffness);
    let mut bz = vec![0.0; values.len()];
    apply(mass, &values, &mut bz);
    let lambda = dot(&values, &lz);
    let mut residual: Vec<f64> = lz.iter().zip(&bz).map(|(l, b)| l - lambda * b).collect();
    rows.mask(&mut residual);
    let loss = dot(&residual, &residual);
    let out = z.device().tensor_from_vec(vec![E::round(loss)], ());
    let (out_ghost, z_ghost) = (out.ghost(), z.ghost());
    let (stiffness, mass) = (stiffness.clone(), mass.clone());
    tape.add_backward_op(move |grads| {
        let outer = grads.get_or_alloc_mut(&out_ghost)?[0].wide();
        // d‖r‖² = 2 rᵀ(L dz − λ B dz − 2 (Lz)ᵀdz Bz); L and B are symmetric.
        let [mut lr, mut br] = [vec![0.0; residual.len()], vec![0.0; residual.len()]];
        apply(&stiffness, &residual, &mut lr);
        apply(&mass, &residual, &mut br);
        let along = 2.0 * dot(&residual, &bz);
        let dz = grads.get_or_alloc_mut(&z_ghost)?;
        for (i, d) in dz.iter_mut().enumerate() {
            *d += E::round(2.0 * outer * (lr[i] - lambda * br[i] - along * lz[i]));
        }
        Ok(())
    });
    out.put_tape(tape)
}

/// (26): ‖zᵀB[φ₁ | … | φ_k]‖², with BΦ given, n×k.
pub fn orthogonality_loss<E: Real, T: Tape<E, Cpu>>(
    z: Vector<E, T>,
    b_phi: &Arc<Dense>,
) -> Scalar<E, T> {
    let (z, mut tape) = z.split_tape();
    let values = widen(&z.as_vec());
    let overlaps: Vec<f64> = (0..b_phi.ncols()).map(|k| dot(column(b_phi, k), &values)).collect();
    let out = z.device().tensor_from_vec(vec![E::round(dot(&overlaps, &overlaps))], ());
    let (out_ghost, z_ghost, b_phi) = (out.ghost(), z.ghost(), b_phi.clone());
    tape.add_backward_op(move |grads| {
        let outer = grads.get_or_alloc_mut(&out_ghost)?[0].wide();
        let dz = grads.get_or_alloc_mut(&z_ghost)?;
        for (k, c) in overlaps.iter().enumerate() {
            for (d, b) in dz.iter_mut().zip(column(&b_phi, k)) {
                *d += E::round(2.0 * outer * c * b);
            }
        }
        Ok(())
    });
    out.put_tape(tape)
}

/// (23): Σ αᵢ ℒᵢ, the terms all on `tape`.
pub fn weighted<E: Real, T: Tape<E, Cpu>, const N: usize>(
    terms: [(Scalar<E>, f64); N],
    mut tape: T,
) -> Scalar<E, T> {
    let sum = terms.iter().map(|(term, weight)| weight * term.as_vec()[0].wide()).sum();
    let out = Cpu::default().tensor_from_vec(vec![E::round(sum)], ());
    let out_ghost = out.ghost();
    let parts = terms.map(|(term, weight)| (term.ghost(), weight));
    tape.add_backward_op(move |grads| {
        let outer = grads.get_or_alloc_mut(&out_ghost)?[0].wide();
        for (term, weight) in &parts {
            grads.get_or_alloc_mut(term)?[0] += E::round(weight * outer);
        }
        Ok(())
    });
    out.put_tape(tape)
}

/// Which rows of (25) count.
#[derive(Debug, Clone)]
pub enum Rows {
    /// Every vertex.
    All,
    /// All but the given boundary vertices.
    Interior(Arc<Vec<u32>>),
}

impl Rows {
    fn mask(&self, residual: &mut [f64]) {
        if let Self::Interior(boundary) = self {
            for &i in boundary.iter() {
                residual[i as usize] = 0.0;
            }
        }
    }
}

fn widen<E: Real>(x: &[E]) -> Vec<f64> {
    x.iter().map(|v| v.wide()).collect()
}

fn with_product<E: Real>(z: &Vector<E>, a: &Sparse) -> (Vec<f64>, Vec<f64>) {
    let values = widen(&z.as_vec());
    let mut product = vec![0.0; values.len()];
    apply(a, &values, &mut product);
    (values, product)
}

#[cfg(test)]
mod tests {
    use super::super::finite_differences::{ReadGradients, check, values};
    use super::*;
    use crate::mesh::sample::icosphere;
    use crate::operators::Boundary;
    use crate::operators::{MassKind, Operators};
    use crate::spectrum::factor::Analysis;
    use crate::spectrum::{Problem, fem};

    type Traced = Vector<f64, OwnedTape<f64, Cpu>>;

    fn check_vector(n: usize, loss: impl Fn(Traced) -> Scalar<f64, OwnedTape<f64, Cpu>>) {
        check(&[values(n, 1)], |dev, p, tape| {
            let z = dev.tensor_from_vec(p[0].clone(), (n,));
            let value = loss(z.clone().put_tape(tape));
            let read: ReadGradients = Box::new(move |g| vec![g.get(&z).as_vec()]);
            (value, read)
        });
    }

    #[test]
    fn every_term_matches_finite_differences() {
        for kind in [MassKind::Lumped, MassKind::Consistent] {
            let operators = Operators::assemble(&icosphere(0), kind).unwrap();
            let n = operators.n();
            let (l, b) = (Arc::new(operators.stiffness), Arc::new(operators.mass));
            let boundary = Arc::new(vec![1, 4, 5]);
            let b_phi = Arc::new(Dense::from_fn(n, 2, |i, j| values(n, 3 + j as u64)[i]));
            check_vector(n, |z| boundary_loss(z, &boundary));
            check_vector(n, |z| residual_loss(z, &l, &b, &Rows::All));
            check_vector(n, |z| residual_loss(z, &l, &b, &Rows::Interior(boundary.clone())));
            check_vector(n, |z| orthogonality_loss(z, &b_phi));
            check_vector(n, |z| orthogonality_loss(b_normalise(z, &b), &b_phi));
            check_vector(n, |z| residual_loss(b_normalise(z, &b), &l, &b, &Rows::All));
        }
    }

    #[test]
    fn an_exact_eigenfunction_has_no_residual() {
        let operators = Operators::assemble(&icosphere(1), MassKind::Lumped).unwrap();
        let labels = vec![0; operators.n()];
        let problem = Problem::new(&operators, Boundary::Neumann, &labels).unwrap();
        let analysis = Analysis::new(problem.pencil()).unwrap();
        let pairs = fem::lowest(&problem, &analysis, 3).unwrap().pairs;
        let (l, b) = (Arc::new(operators.stiffness.clone()), Arc::new(operators.mass.clone()));
        let dev = Cpu::default();
        let z = dev.tensor_from_vec(column(&pairs.vectors, 2).to_vec(), (operators.n(),));
        assert!(residual_loss(z, &l, &b, &Rows::All).as_vec()[0] < 1e-20);
    }
}
