//! All operators of one mesh, in the form that the store keeps.

use super::adjacency::{adjacency, graph_laplacian};
use super::mass::{MassKind, mass, row_sums};
use super::{Sparse, stiffness::cotangent_stiffness};
use crate::mesh::{Area, Topology, TriMesh};

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
    /// The vertices on the boundary, ascending.
    pub boundary: Vec<u32>,
}

impl Operators {
    /// Assembles the operators of `mesh`, in input units.
    pub fn assemble(mesh: &TriMesh, mass_kind: MassKind) -> Self {
        Self {
            adjacency: adjacency(mesh),
            stiffness: cotangent_stiffness(mesh),
            mass: mass(mesh, mass_kind),
            mass_kind,
            boundary: Topology::of(mesh).boundary_vertices,
        }
    }

    /// The normalised graph Laplacian I − W of (5), n×n.
    pub fn graph_laplacian(&self) -> Sparse {
        graph_laplacian(&self.adjacency)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_operators_of_a_square_with_a_centre() {
        let corners = [[0., 0., 0.], [2., 0., 0.], [2., 2., 0.], [0., 2., 0.], [1., 1., 0.]];
        let faces = vec![[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]];
        let operators =
            Operators::assemble(&TriMesh::new(corners.to_vec(), faces).unwrap(), MassKind::Lumped);
        assert_eq!(operators.boundary, [0, 1, 2, 3]);
        assert_eq!(operators.area(), Area(4.0));
        let laplacian = operators.graph_laplacian();
        assert_eq!(laplacian.get(4, 4), Some(&1.0));
        assert_eq!(laplacian.get(4, 0), Some(&-0.25));
        assert!((laplacian.get(0, 4).unwrap() + 1.0 / 3.0).abs() < 1e-15);
    }
}
