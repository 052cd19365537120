//! From what a file says to the canonical mesh, with everything that is to be said about the way.

use super::error::Failure;
use super::raw::RawMesh;
use super::read::format::Format;
use super::repair::{Repaired, Repairs, repair};
use super::topology::Topology;
use super::trimesh::TriMesh;

/// A file as a mesh, or one of its objects.
#[derive(Debug, Clone, PartialEq)]
pub struct Ingested {
    /// The canonical mesh.
    pub mesh: TriMesh,
    /// For each vertex of the file its row in `mesh`, or −1 where it was dropped. The vertices of an OBJ file
    /// are its `v` lines; those of OFF, PLY, VTK and VTP files are their lists of vertices or points; those of an STL
    /// file are the corners of its facets, three a facet; those of a glTF file are the elements of its position
    /// accessors, mesh by mesh in the order of the scene, each accessor once a node. Of an object: for each vertex of
    /// `file_vertices`.
    pub vertex_map: Vec<i64>,
    /// Of an object: the vertices of the file that its triangles name, in the order of the file.
    pub file_vertices: Option<Vec<u32>>,
    /// What was changed on the way.
    pub repairs: Repairs,
    /// What kind of surface it is.
    pub topology: Topology,
    /// The format of the file.
    pub format: Format,
}

impl Ingested {
    /// The mesh of what a file says, or of a part of it, which has these vertices of the file.
    pub(super) fn of(
        raw: &RawMesh,
        format: Format,
        file_vertices: Option<Vec<u32>>,
    ) -> Result<Self, Failure> {
        let Repaired { mesh, vertex_map, repairs } = repair(raw)?;
        tracing::debug!(
            vertices = mesh.n(),
            faces = mesh.faces().len(),
            mended = !repairs.is_empty(),
            "mesh read"
        );
        let topology = Topology::of(&mesh);
        Ok(Self { mesh, vertex_map, file_vertices, repairs, topology, format })
    }
}
