//! The mass matrix B: lumped (6) or consistent (11).

use serde::{Deserialize, Serialize};

use super::{Sparse, assemble};
use crate::mesh::TriMesh;

/// Which inner product of functions the mass matrix stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MassKind {
    /// Diagonal, b_i = ⅓ Σ|τ_j| over the triangles at vertex i (6).
    #[default]
    Lumped,
    /// The P1 finite-element mass (11), as sparse as the stiffness.
    Consistent,
}

impl MassKind {
    /// The name used in files, tables and keys.
    pub fn name(self) -> &'static str {
        match self {
            Self::Lumped => "lumped",
            Self::Consistent => "consistent",
        }
    }
}

/// The mass matrix B, n×n, symmetric positive definite, in squared input units. Its entries sum to the area.
pub fn mass(mesh: &TriMesh, kind: MassKind) -> Sparse {
    match kind {
        MassKind::Lumped => lumped(mesh),
        MassKind::Consistent => consistent(mesh),
    }
}

fn lumped(mesh: &TriMesh) -> Sparse {
    let n = mesh.n();
    Sparse::new((n, n), (0..=n).collect(), (0..n).collect(), mesh.vertex_areas())
}

/// (11) with positive entries: |τ|/12 off the diagonal and |τ|/6 on it, for every triangle.
fn consistent(mesh: &TriMesh) -> Sparse {
    let entries = mesh.faces().iter().zip(mesh.face_areas()).flat_map(|(&face, area)| {
        face.into_iter()
            .flat_map(move |i| face.map(|j| (i, j, if i == j { area / 6.0 } else { area / 12.0 })))
    });
    assemble(mesh.n(), entries)
}

/// The row sums of a mass matrix: the vertex areas, whichever its kind. Length n.
pub fn row_sums(mass: &Sparse) -> Vec<f64> {
    mass.outer_iterator().map(|row| row.data().iter().sum()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::sample::icosphere;

    #[test]
    fn both_kinds_have_the_same_row_sums_and_add_up_to_the_area() {
        let mesh = icosphere(2);
        let [lumped, consistent] =
            [MassKind::Lumped, MassKind::Consistent].map(|kind| row_sums(&mass(&mesh, kind)));
        for (a, b) in lumped.iter().zip(&consistent) {
            assert!((a - b).abs() < 1e-15);
        }
        assert!((lumped.iter().sum::<f64>() - mesh.area().0).abs() < 1e-12);
    }

    #[test]
    fn consistent_mass_integrates_products_of_linear_functions() {
        // ∫ x² over the triangle (0,0), (1,0), (0,1) is 1/12.
        let mesh =
            TriMesh::new(vec![[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]], vec![[0, 1, 2]]).unwrap();
        let b = mass(&mesh, MassKind::Consistent);
        assert!((b.get(1, 1).unwrap() - 1.0 / 12.0).abs() < 1e-16);
    }
}
