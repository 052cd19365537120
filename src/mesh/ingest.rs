//! From a file to the canonical mesh, with everything that is to be said about the way.
//!
//! ```no_run
//! let ingested = chladni::mesh::ingest::load("bunny.obj".as_ref())?;
//! println!("{} vertices, {}", ingested.mesh.n(), ingested.mesh.hash());
//! # Ok::<(), chladni::mesh::MeshError>(())
//! ```

use std::io;
use std::path::Path;

use super::error::{Failure, Fault, MeshError};
use super::raw::RawMesh;
use super::read::format::Format;
use super::read::{gltf, obj, off, ply, stl, vtk, vtp};
use super::repair::{Repaired, Repairs, repair};
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

/// Reads the file at `path`.
///
/// # Errors
/// When the file cannot be read, is no mesh, or has nothing that repair can keep: see [`Fault`].
pub fn load(path: &Path) -> Result<Ingested, MeshError> {
    // A pipe or a device would be read for ever.
    let regular = || match path.metadata() {
        Ok(metadata) if !metadata.is_file() => Err(io::Error::other("it is not a regular file")),
        _ => Ok(()),
    };
    let bytes = regular()
        .and_then(|()| std::fs::read(path))
        .map_err(|error| Failure::from(Fault::Unreadable(error)).in_file(path))?;
    load_bytes(path, &bytes)
}

/// Reads a file whose content is already here. `path` names it in messages, gives its extension, and says
/// where the buffers of a `.gltf` are looked for.
///
/// # Errors
/// As [`load`].
pub fn load_bytes(path: &Path, bytes: &[u8]) -> Result<Ingested, MeshError> {
    ingest(path, bytes).map_err(|failure| failure.in_file(path))
}

fn ingest(path: &Path, bytes: &[u8]) -> Result<Ingested, Failure> {
    let format = Format::of(bytes, path.extension().and_then(|e| e.to_str()))?;
    let raw: RawMesh = match format {
        Format::Obj => obj::read(bytes)?,
        Format::Off => off::read(bytes)?,
        Format::Ply => ply::read(bytes)?,
        Format::Stl => stl::read(bytes)?,
        Format::Vtk => vtk::read(bytes)?,
        Format::Vtp => vtp::read(bytes)?,
        Format::Gltf | Format::Glb => gltf::read(bytes, path)?,
    };
    let Repaired { mesh, vertex_map, repairs } = repair(&raw)?;
    tracing::debug!(
        path = %path.display(),
        vertices = mesh.n(),
        faces = mesh.faces().len(),
        mended = !repairs.is_empty(),
        "mesh read"
    );
    let topology = Topology::of(&mesh);
    Ok(Ingested { mesh, vertex_map, repairs, topology, format })
}
