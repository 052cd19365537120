//! A mesh alone as a file: binary PLY or text OBJ, either of which reads back to the same numbers.

use std::fmt::Write;
use std::io;
use std::path::Path;

use super::PublishError;
use super::ply::to_ply;
use crate::mesh::TriMesh;
use crate::spectrum::{Dense, Eigenpairs};

/// Why a mesh was not written.
#[derive(Debug, thiserror::Error)]
pub enum MeshFileError {
    /// Its name says no format that is written.
    #[error("a mesh is written as .ply or .obj; end the name in one of these")]
    Ending,
    /// Its folder cannot be made.
    #[error("its folder cannot be made ({0})")]
    Folder(#[from] io::Error),
    /// The system refuses.
    #[error(transparent)]
    File(#[from] PublishError),
}

/// Writes a mesh in the format that the name of the file ends in, and makes its folder where there is none.
///
/// # Errors
/// [`MeshFileError`].
pub fn write(file: &Path, mesh: &TriMesh) -> Result<(), MeshFileError> {
    let ending = file.extension().unwrap_or_default().to_ascii_lowercase();
    let bytes = match ending.to_str() {
        Some("ply") => to_ply(mesh, &no_eigenpairs(mesh)),
        Some("obj") => to_obj(mesh).into_bytes(),
        _ => return Err(MeshFileError::Ending),
    };
    if let Some(folder) = file.parent() {
        std::fs::create_dir_all(folder)?;
    }
    Ok(super::write(file, &bytes)?)
}

fn no_eigenpairs(mesh: &TriMesh) -> Eigenpairs {
    Eigenpairs { values: Vec::new(), vectors: Dense::zeros(mesh.n(), 0) }
}

/// The text of an OBJ file; the shortest decimals that are the same doubles.
pub fn to_obj(mesh: &TriMesh) -> String {
    let mut text = String::new();
    let mut line = |line: std::fmt::Arguments<'_>| {
        writeln!(text, "{line}").expect("a string takes any text");
    };
    for [x, y, z] in mesh.vertices() {
        line(format_args!("v {x:?} {y:?} {z:?}"));
    }
    for [a, b, c] in mesh.faces() {
        line(format_args!("f {} {} {}", a + 1, b + 1, c + 1));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::load;
    use crate::mesh::sample::Shape;

    #[test]
    fn what_is_written_reads_back_to_the_same_numbers() {
        let dir = tempfile::tempdir().unwrap();
        let mesh = Shape::Vase.sample(200, 1, 0).unwrap();
        for name in ["a.ply", "deep/er/a.OBJ"] {
            let file = dir.path().join(name);
            write(&file, &mesh).unwrap();
            assert_eq!(load(&file).unwrap().mesh, mesh, "{name}");
        }
        let error = write(&dir.path().join("a.stl"), &mesh).unwrap_err();
        assert!(matches!(error, MeshFileError::Ending));
    }
}
