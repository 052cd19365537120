//! The mass matrix B: lumped (6), Voronoi, consistent (11), or the degrees that belong to the graph Laplacian (5).

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Pattern, Sparse, Triangle};

/// Which inner product of functions the mass matrix stands for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum MassKind {
    /// Diagonal, b_i = ⅓ Σ|τ_j| (6): a third of the area of the triangles at a vertex.
    Lumped,
    /// Diagonal, b_i = the area nearest to vertex i: the mixed Voronoi area of Meyer, Desbrun, Schröder and Barr (2003).
    Voronoi,
    /// That of linear finite elements (11), as sparse as the stiffness.
    Consistent,
    /// Diagonal, b_i = the number of neighbours of vertex i: the D that makes (5) symmetric. For the graph Laplacian alone.
    Degree,
}

impl MassKind {
    /// All kinds.
    pub const ALL: [Self; 4] = [Self::Lumped, Self::Voronoi, Self::Consistent, Self::Degree];

    /// The name used in files, tables and keys.
    pub fn name(self) -> &'static str {
        match self {
            Self::Lumped => "lumped",
            Self::Voronoi => "voronoi",
            Self::Consistent => "consistent",
            Self::Degree => "degree",
        }
    }
}

/// The mass matrix B, n×n, symmetric positive definite. Its entries sum to the area, in squared input units; those
/// of [`MassKind::Degree`] to twice the number of edges. The pattern is that of the triangles.
pub fn mass(kind: MassKind, pattern: &Pattern, triangles: &[Triangle]) -> Sparse {
    match kind {
        MassKind::Lumped => diagonal(lumped_areas(pattern.n(), triangles)),
        MassKind::Voronoi => diagonal(voronoi_areas(pattern.n(), triangles)),
        MassKind::Consistent => consistent(pattern, triangles),
        MassKind::Degree => diagonal(pattern.degrees().collect()),
    }
}

/// b_i of [`MassKind::Lumped`], straight from the triangles. Length n.
pub fn lumped_areas(n: usize, triangles: &[Triangle]) -> Vec<f64> {
    shared(n, triangles, |triangle| [triangle.area / 3.0; 3])
}

/// b_i of [`MassKind::Voronoi`], straight from the triangles. Length n.
pub fn voronoi_areas(n: usize, triangles: &[Triangle]) -> Vec<f64> {
    shared(n, triangles, voronoi_shares)
}

/// What the corners of a triangle own of its area: the points nearest to each where no angle is obtuse, else a half
/// for the obtuse corner and a quarter for the others, with which the cells of all vertices still cover the surface.
///
/// The cell of the corner with angle α is ⅛(b² cot β + c² cot γ); with b² = 2|τ|(cot γ + cot α) and
/// cot α cot β + cot β cot γ + cot γ cot α = 1 that is ¼|τ|(1 + cot β cot γ).
fn voronoi_shares(&Triangle { cotangents: [a, b, c], area, .. }: &Triangle) -> [f64; 3] {
    let quarter = 0.25 * area;
    match [a, b, c].map(|cotangent| cotangent < 0.0) {
        [true, ..] => [2.0 * quarter, quarter, quarter],
        [_, true, _] => [quarter, 2.0 * quarter, quarter],
        [.., true] => [quarter, quarter, 2.0 * quarter],
        _ => [b * c, c * a, a * b].map(|product| quarter * (1.0 + product)),
    }
}

/// Every vertex's shares of its triangles, length n.
fn shared(n: usize, triangles: &[Triangle], share: fn(&Triangle) -> [f64; 3]) -> Vec<f64> {
    let mut sums = vec![0.0; n];
    for triangle in triangles {
        for (vertex, share) in triangle.vertices.into_iter().zip(share(triangle)) {
            sums[vertex as usize] += share;
        }
    }
    sums
}

fn diagonal(values: Vec<f64>) -> Sparse {
    let n = values.len();
    Sparse::new((n, n), (0..=n).collect(), (0..n).collect(), values)
}

/// (11) with positive entries: |τ|/12 off the diagonal and |τ|/6 on it, for every triangle.
fn consistent(pattern: &Pattern, triangles: &[Triangle]) -> Sparse {
    let entries = triangles.iter().enumerate().flat_map(|(face, &Triangle { area, .. })| {
        let value = move |i, j| if i == j { area / 6.0 } else { area / 12.0 };
        (0..3).flat_map(move |i| [0, 1, 2].map(|j| (face, i, j, value(i, j))))
    });
    pattern.assemble(entries)
}

/// The row sums of a mass matrix: the vertex areas, for the three kinds made of areas. Length n.
pub fn row_sums(mass: &Sparse) -> Vec<f64> {
    mass.outer_iterator().map(|row| row.data().iter().sum()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{TriMesh, sample::icosphere};

    fn mass_of(mesh: &TriMesh, kind: MassKind) -> Sparse {
        mass(kind, &Pattern::of_mesh(mesh), &Triangle::of_mesh(mesh).unwrap())
    }

    fn triangle(corners: [[f64; 3]; 3]) -> TriMesh {
        TriMesh::new(corners.to_vec(), vec![[0, 1, 2]]).unwrap()
    }

    #[test]
    fn lumped_mass_has_the_row_sums_of_the_consistent_one() {
        let mesh = icosphere(2);
        let [lumped, consistent] =
            [MassKind::Lumped, MassKind::Consistent].map(|kind| row_sums(&mass_of(&mesh, kind)));
        for (a, b) in lumped.iter().zip(&consistent) {
            assert!((a - b).abs() < 1e-15);
        }
    }

    #[test]
    fn masses_made_of_areas_add_up_to_the_area() {
        let mesh = icosphere(2);
        for kind in [MassKind::Lumped, MassKind::Voronoi, MassKind::Consistent] {
            let total: f64 = mass_of(&mesh, kind).data().iter().sum();
            assert!((total - mesh.area().0).abs() < 1e-12, "{kind:?}");
        }
    }

    #[test]
    fn consistent_mass_integrates_products_of_linear_functions() {
        // ∫ x² over the triangle (0,0), (1,0), (0,1) is 1/12.
        let mesh = triangle([[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]]);
        let b = mass_of(&mesh, MassKind::Consistent);
        assert!((b.get(1, 1).unwrap() - 1.0 / 12.0).abs() < 1e-16);
    }

    #[test]
    fn voronoi_cells_end_at_the_circumcentre() {
        // The circumcentre of (0,0), (4,0), (1,3) is (2,1): the cell of the origin is the quadrilateral
        // (0,0), (2,0), (2,1), (½,1½), of area 2¼.
        let mesh = triangle([[0., 0., 0.], [4., 0., 0.], [1., 3., 0.]]);
        let b = mass_of(&mesh, MassKind::Voronoi);
        for (found, expected) in b.data().iter().zip([2.25, 1.75, 2.0]) {
            assert!((found - expected).abs() < 1e-14, "{found}");
        }
    }

    #[test]
    fn an_obtuse_corner_owns_half_of_its_triangle() {
        let corners = [[0., 0., 0.], [4., 0., 0.], [2., 1., 0.]];
        for turn in 0..3 {
            let mut turned = corners;
            turned.rotate_left(turn);
            let mut expected = [0.5, 0.5, 1.0];
            expected.rotate_left(turn);
            assert_eq!(mass_of(&triangle(turned), MassKind::Voronoi).data(), expected);
        }
    }
}
