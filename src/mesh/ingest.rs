//! From a file to the canonical mesh, with everything that is to be said about the way.
//!
//! ```no_run
//! let ingested = chladni::mesh::ingest::load("bunny.obj".as_ref())?;
//! println!("{} vertices, {}", ingested.mesh.n(), ingested.mesh.hash());
//! # Ok::<(), chladni::mesh::MeshError>(())
//! ```

use std::path::Path;

use super::error::MeshError;
use super::objects::Opened;
use super::read::format::Format;
use super::repair::Repairs;
use super::topology::Topology;
use super::trimesh::TriMesh;

/// A file as a mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct Ingested {
    /// The canonical mesh.
    pub mesh: TriMesh,
    /// For each vertex of the file its row in `mesh`, or −1 where it was dropped. The vertices of an OBJ file
    /// are its `v` lines; those of OFF, PLY, VTK and VTP files are their lists of vertices or points; those of an STL
    /// file are the corners of its facets, three a facet; those of a glTF file are the elements of its position
    /// accessors, mesh by mesh in the order of the scene, each accessor once a node.
    pub vertex_map: Vec<i64>,
    /// What was changed on the way.
    pub repairs: Repairs,
    /// What kind of surface it is.
    pub topology: Topology,
    /// The format of the file.
    pub format: Format,
}

/// Reads the file at `path`, all of it as one mesh. [`Opened`] tells its objects apart.
///
/// # Errors
/// When the file cannot be read, is no mesh, or has nothing that repair can keep: see [`Fault`](super::Fault).
pub fn load(path: &Path) -> Result<Ingested, MeshError> {
    Opened::read(path)?.whole()
}

/// Reads a file whose content is already here. `path` names it in messages, gives its extension, and says
/// where the buffers of a `.gltf` are looked for.
///
/// # Errors
/// As [`load`].
pub fn load_bytes(path: &Path, bytes: &[u8]) -> Result<Ingested, MeshError> {
    Opened::of_bytes(path, bytes)?.whole()
}
