//! All operators of one mesh, in the form that the store keeps.

use super::adjacency::{adjacency, graph_laplacian, graph_stiffness};
use super::gluing::Gluing;
use super::intrinsic::{IntrinsicTriangulation, Remedies};
use super::mass::mass;
use super::stiffness::cotangent_stiffness;
use super::{
    Laplacian, MassKind, OperatorError, OperatorOptions, Pattern, Quality, Robust, Sparse, Triangle,
};
use crate::mesh::{Area, TriMesh};

/// The discrete operators of a mesh with n vertices.
#[derive(Debug, Clone, PartialEq)]
pub struct Operators {
    /// The row-normalised adjacency W of (5), n×n.
    pub adjacency: Sparse,
    /// The stiffness L, n×n, symmetric positive semi-definite, unit-free: cotangents (6), or D − A for the graph
    /// Laplacian.
    pub stiffness: Sparse,
    /// The mass B, n×n, symmetric positive definite, in squared input units; the degrees D, without a unit, for the
    /// graph Laplacian.
    pub mass: Sparse,
    /// Which mass `mass` is.
    pub mass_kind: MassKind,
    /// The vertices on the boundary, ascending.
    pub boundary: Vec<u32>,
    /// The area of the triangles, whichever the mass.
    pub area: Area,
    /// How good the triangles are.
    pub quality: Quality,
}

impl Operators {
    /// Assembles the operators of `mesh`, in input units.
    ///
    /// # Errors
    /// When the mass does not go with the Laplacian, or a face has no angles: [`OperatorError`].
    pub fn assemble(
        mesh: &TriMesh,
        options: impl Into<OperatorOptions>,
    ) -> Result<Self, OperatorError> {
        let options = options.into();
        let mass_kind = options.mass_kind()?;
        let edges = Pattern::of_mesh(mesh);
        let (gluing, boundary) = Gluing::of(&edges, mesh.faces());
        let (triangles, gluing, remedies) = match options.robust {
            Robust::Off => (Triangle::of_mesh(mesh)?, gluing, None),
            robust => {
                let (intrinsic, remedies) = intrinsic(mesh, &edges, gluing, robust);
                (intrinsic.triangles()?, intrinsic.into_gluing(), Some(remedies))
            }
        };
        let sheets = sheets(options.robust);
        let adjacency = adjacency(&edges);
        let geometric = options.laplacian != Laplacian::Graph;
        let pattern = match remedies {
            Some(remedies) if geometric && (remedies.flips > 0 || sheets > 1.0) => {
                Pattern::of(mesh.n(), triangles.iter().map(|triangle| triangle.vertices))
            }
            _ => edges,
        };
        let shared = |sum: Sparse| if sheets > 1.0 { sum.map(|entry| entry / sheets) } else { sum };
        let (stiffness, mass) = match options.laplacian {
            Laplacian::Fem | Laplacian::Cotangent => (
                shared(cotangent_stiffness(&pattern, &triangles)),
                shared(mass(mass_kind, &pattern, &triangles)),
            ),
            Laplacian::Graph => (graph_stiffness(&pattern), mass(mass_kind, &pattern, &triangles)),
        };
        Ok(Self {
            adjacency,
            mass,
            mass_kind,
            boundary,
            area: Area(triangles.iter().map(|triangle| triangle.area).sum::<f64>() / sheets),
            quality: Quality::of(&triangles, &gluing, &stiffness, remedies),
            stiffness,
        })
    }

    /// The normalised graph Laplacian I − W of (5), n×n.
    pub fn graph_laplacian(&self) -> Sparse {
        graph_laplacian(&self.adjacency)
    }

    /// The number of vertices.
    pub fn n(&self) -> usize {
        self.stiffness.rows()
    }

    /// 1ᵀB1, the scale of the pencil: divided by it, the mass adds up to 1. To rounding it is the area, but for the
    /// graph Laplacian, where it is the sum of the degrees.
    pub fn total_mass(&self) -> f64 {
        super::mass::row_sums(&self.mass).iter().sum()
    }
}

/// The triangles that L and B are sums over, each sum divided by the number of their [`sheets`]: those of the mesh, or
/// those of an intrinsic triangulation.
///
/// # Errors
/// When a triangle has no angles: [`OperatorError`].
pub fn triangles(mesh: &TriMesh, robust: Robust) -> Result<Vec<Triangle>, OperatorError> {
    if robust == Robust::Off {
        return Triangle::of_mesh(mesh);
    }
    let edges = Pattern::of_mesh(mesh);
    let (gluing, _) = Gluing::of(&edges, mesh.faces());
    intrinsic(mesh, &edges, gluing, robust).0.triangles()
}

/// How often the triangles cover the surface.
pub fn sheets(robust: Robust) -> f64 {
    match robust {
        Robust::Off | Robust::Intrinsic => 1.0,
        Robust::Tufted => 2.0,
    }
}

/// `gluing`: of the mesh itself.
fn intrinsic(
    mesh: &TriMesh,
    edges: &Pattern,
    gluing: Gluing,
    robust: Robust,
) -> (IntrinsicTriangulation, Remedies) {
    match robust {
        Robust::Tufted => IntrinsicTriangulation::tufted(mesh, edges),
        Robust::Off | Robust::Intrinsic => IntrinsicTriangulation::robust(mesh, edges, gluing),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square_with_a_centre() -> TriMesh {
        let corners = [[0., 0., 0.], [2., 0., 0.], [2., 2., 0.], [0., 2., 0.], [1., 1., 0.]];
        let faces = vec![[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]];
        TriMesh::new(corners.to_vec(), faces).unwrap()
    }

    #[test]
    fn the_operators_of_a_square_with_a_centre() {
        let operators = Operators::assemble(&square_with_a_centre(), MassKind::Lumped).unwrap();
        assert_eq!(operators.boundary, [0, 1, 2, 3]);
        assert_eq!((operators.area, operators.total_mass()), (Area(4.0), 4.0));
        let laplacian = operators.graph_laplacian();
        assert_eq!(laplacian.get(4, 4), Some(&1.0));
        assert_eq!(laplacian.get(4, 0), Some(&-0.25));
        assert!((laplacian.get(0, 4).unwrap() + 1.0 / 3.0).abs() < 1e-15);
    }

    #[test]
    fn the_graph_pencil_has_degrees_for_a_mass_and_keeps_the_area_apart() {
        let operators = Operators::assemble(&square_with_a_centre(), MassKind::Degree).unwrap();
        assert_eq!(operators.mass.data(), [3.0, 3.0, 3.0, 3.0, 4.0]);
        assert_eq!((operators.area, operators.total_mass()), (Area(4.0), 16.0));
        assert_eq!(operators.stiffness.get(4, 4), Some(&4.0));
        assert_eq!(operators.stiffness.get(0, 1), Some(&-1.0));
        assert_eq!(operators.stiffness.get(0, 2), None);
    }

    #[test]
    fn fem_and_cotangent_with_one_mass_are_one() {
        let assemble = |laplacian, mass| {
            let options = OperatorOptions { laplacian, mass, ..Default::default() };
            Operators::assemble(&square_with_a_centre(), options)
        };
        let fem = assemble(Laplacian::Fem, None).unwrap();
        assert_eq!(fem.mass_kind, MassKind::Consistent);
        assert_eq!(assemble(Laplacian::Cotangent, Some(MassKind::Consistent)), Ok(fem));
        assert!(assemble(Laplacian::Fem, Some(MassKind::Degree)).is_err());
    }
}
