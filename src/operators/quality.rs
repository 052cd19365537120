//! How good the triangles are that operators were assembled from: what to look at when a spectrum looks wrong.

use serde::Serialize;

use super::gluing::{Gluing, Side};
use super::intrinsic::{Remedies, is_delaunay};
use super::{Sparse, Triangle};

/// Below this, relative to the diagonal, a negative weight is rounding.
const ROUNDING: f64 = 1e-10;

/// The quality of a triangulation, and of the stiffness made from it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Quality {
    /// The smallest angle of all triangles, in degrees.
    pub min_angle_degrees: f64,
    /// The number of pairs of vertices i, j with w_ij < 0: eigenfunctions may overshoot there, and heat flow from cold
    /// to warm.
    pub negative_weights: usize,
    /// The number of edges of two triangles with cot α + cot β < 0. The other negative weights are on the boundary, or
    /// where three and more triangles meet.
    pub non_delaunay_edges: usize,
    /// What `operators.robust` did.
    pub remedies: Option<Remedies>,
}

impl Quality {
    /// Examines a triangulation and its stiffness.
    pub fn of(
        triangles: &[Triangle],
        gluing: &Gluing,
        stiffness: &Sparse,
        remedies: Option<Remedies>,
    ) -> Self {
        let steepest = triangles.iter().flat_map(|t| t.cotangents).fold(0.0, f64::max);
        let opposite = |side: Side| triangles[side.face()].cotangents[side.previous().index()];
        let crossed = gluing.edges().filter(|&(a, b)| !is_delaunay(opposite(a), opposite(b)));
        Self {
            min_angle_degrees: (1.0 / steepest).atan().to_degrees(),
            negative_weights: negative_weights(stiffness),
            non_delaunay_edges: crossed.count(),
            remedies,
        }
    }
}

fn negative_weights(stiffness: &Sparse) -> usize {
    let diagonal = |i| stiffness.get(i, i).copied().unwrap_or(0.0);
    let rows = stiffness.outer_iterator().enumerate();
    rows.map(|(i, row)| {
        let (columns, entries) = (row.indices(), row.data());
        let positive = columns.iter().zip(entries).filter(|&(&j, &entry)| j > i && entry > 0.0);
        positive.filter(|&(&j, &w)| w > ROUNDING * diagonal(i).max(diagonal(j))).count()
    })
    .sum()
}

#[cfg(test)]
mod tests {
    use crate::mesh::TriMesh;
    use crate::operators::{MassKind, Operators};

    #[test]
    fn a_kite_cut_along_its_length_has_one_bad_edge() {
        let vertices = vec![[-2., 0., 0.], [2., 0., 0.], [0., 1., 0.], [0., -1., 0.]];
        let mesh = TriMesh::new(vertices, vec![[0, 1, 2], [1, 0, 3]]).unwrap();
        let quality = Operators::assemble(&mesh, MassKind::Lumped).unwrap().quality;
        assert_eq!((quality.negative_weights, quality.non_delaunay_edges), (1, 1));
        assert!((quality.min_angle_degrees - 0.5_f64.atan().to_degrees()).abs() < 1e-12);
        assert_eq!(quality.remedies, None);
    }

    #[test]
    fn an_obtuse_angle_at_the_boundary_makes_a_negative_weight_only() {
        let vertices = vec![[-2., 0., 0.], [2., 0., 0.], [0., 1., 0.]];
        let mesh = TriMesh::new(vertices, vec![[0, 1, 2]]).unwrap();
        let quality = Operators::assemble(&mesh, MassKind::Lumped).unwrap().quality;
        assert_eq!((quality.negative_weights, quality.non_delaunay_edges), (1, 0));
    }

    #[test]
    fn a_square_has_right_angles_and_no_negative_weight() {
        let vertices = vec![[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]];
        let mesh = TriMesh::new(vertices, vec![[0, 1, 2], [0, 2, 3]]).unwrap();
        let quality = Operators::assemble(&mesh, MassKind::Lumped).unwrap().quality;
        assert_eq!((quality.negative_weights, quality.non_delaunay_edges), (0, 0));
        assert!((quality.min_angle_degrees - 45.0).abs() < 1e-12);
    }
}
