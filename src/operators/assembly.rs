//! All operators of one mesh, in the form that the store keeps.

use super::mass::{MassKind, mass, row_sums};
use super::{Sparse, adjacency::adjacency, stiffness::cotangent_stiffness};
use crate::mesh::{Area, TriMesh};

/// The discrete operators of a mesh with n vertices.
#[derive(Debug, Clone, PartialEq)]
pub struct Operators {
    /// The row-normalised adjacency W of (5), n×n.
    pub adjacency: Sparse,
    /// The cotangent stiffness L of (6), n×n, symmetric positive semi-definite, unit-free.
    pub stiffness: Sparse,
    /// The mass B of (6) or (11), n×n, symmetric positive definite, squared input units.
    pub mass: Sparse,
    /// Which mass `mass` is.
    pub mass_kind: MassKind,
}

impl Operators {
    /// Assembles the operators of `mesh`, in input units.
    pub fn assemble(mesh: &TriMesh, mass_kind: MassKind) -> Self {
        Self {
            adjacency: adjacency(mesh),
            stiffness: cotangent_stiffness(mesh),
            mass: mass(mesh, mass_kind),
            mass_kind,
        }
    }

    /// The number of vertices.
    pub fn n(&self) -> usize {
        self.stiffness.rows()
    }

    /// The surface area: the sum of all entries of the mass.
    pub fn area(&self) -> Area {
        Area(row_sums(&self.mass).iter().sum())
    }
}
