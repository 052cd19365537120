//! The constraint (18), B-orthogonality to the eigenfunctions found so far, and its projection (21).

use crate::spectrum::Pencil;
use crate::spectrum::eigenpairs::normalise;
use crate::spectrum::pencil::{apply, dot};

/// The eigenfunctions found so far, of unit B-norm as in (20), each with its product with B.
pub struct Constraint<'a> {
    pencil: Pencil<'a>,
    phi: Vec<Vec<f64>>,
    b_phi: Vec<Vec<f64>>,
}

impl<'a> Constraint<'a> {
    /// No constraint yet, with room for `capacity` eigenfunctions.
    pub fn new(pencil: Pencil<'a>, capacity: usize) -> Self {
        Self { pencil, phi: Vec::with_capacity(capacity), b_phi: Vec::with_capacity(capacity) }
    }

    /// The pencil whose eigenfunctions they are.
    pub fn pencil(&self) -> Pencil<'a> {
        self.pencil
    }

    /// The eigenfunctions, in the order they were found.
    pub fn functions(&self) -> &[Vec<f64>] {
        &self.phi
    }

    /// Adds an eigenfunction, normalised as in (20).
    pub fn push(&mut self, phi: &[f64]) {
        let mut phi = phi.to_vec();
        normalise(&mut phi, self.pencil.mass);
        let mut b_phi = vec![0.0; phi.len()];
        apply(self.pencil.mass, &phi, &mut b_phi);
        self.phi.push(phi);
        self.b_phi.push(b_phi);
    }

    /// x ← P x, (21), column by column: P is never formed.
    pub fn project(&self, x: &mut [f64]) {
        for (phi, b_phi) in self.phi.iter().zip(&self.b_phi) {
            let c = dot(b_phi, x);
            x.iter_mut().zip(phi).for_each(|(x, p)| *x -= c * p);
        }
    }
}
