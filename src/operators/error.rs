//! Why a mesh has no operators.

use super::{Laplacian, MassKind};

/// Operators that cannot be assembled. Each message says what happened and what helps.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum OperatorError {
    /// A mass was asked for that the Laplacian cannot have.
    #[error(
        "the {} Laplacian has no {} mass; leave the mass out, or choose {}",
        .laplacian.name(), .mass.name(), choices(*.laplacian)
    )]
    Mass { laplacian: Laplacian, mass: MassKind },
    /// A face whose corners lie in a line or so close together that its angles are no numbers. Ingest drops those
    /// that are exactly so; what is left are triangles thinner than coordinates can resolve.
    #[error(
        "face {face} (vertices {}, {}, {}, counted from 0) is too thin for its angles to be numbers; \
         set operators.robust = true, or remove the face",
        .vertices[0], .vertices[1], .vertices[2]
    )]
    Degenerate { face: usize, vertices: [u32; 3] },
    /// A triangle of the intrinsic triangulation without angles: all lengths of the mesh are zero in double precision,
    /// or too large for it.
    #[error(
        "the intrinsic triangle between the vertices {}, {} and {}, counted from 0, has no angles in double precision; \
         scale the mesh to sensible units",
        .vertices[0], .vertices[1], .vertices[2]
    )]
    Collapsed { vertices: [u32; 3] },
    /// A form on the triangles was asked for of the graph Laplacian, which has edges alone.
    #[error(
        "the graph Laplacian knows edges and no triangles, so nothing can be summed over these; \
         assemble its matrices, or choose \"cotangent\" or \"fem\""
    )]
    NoTriangles,
}

fn choices(laplacian: Laplacian) -> String {
    let accepted = MassKind::ALL.into_iter().filter(|&mass| laplacian.accepts(mass));
    accepted.map(MassKind::name).collect::<Vec<_>>().join(", ")
}
