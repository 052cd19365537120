//! A mesh alone as a file: binary PLY or text OBJ, either of which reads back to the same numbers.

use std::fmt::Write;
use std::io;
use std::path::{Path, PathBuf};

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

/// Writes a mesh in the format that the name of the file ends in, unless it is there already, and makes its folder where there
/// is none.
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
    super::write_if_changed(file, &bytes)?;
    Ok(())
}

fn no_eigenpairs(mesh: &TriMesh) -> Eigenpairs {
    Eigenpairs { values: Vec::new(), vectors: Dense::zeros(mesh.n(), 0) }
}

/// `dir/name.ply` as `dir/name-017.ply`, with as many digits as `count` needs; as it is where there is only one.
pub fn numbered(file: &Path, member: u64, count: u64) -> PathBuf {
    if count <= 1 {
        return file.into();
    }
    let digits = (count - 1).to_string().len();
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    let ending = file.extension().unwrap_or_default().to_string_lossy();
    file.with_file_name(format!("{stem}-{member:0digits$}.{ending}"))
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
    fn numbers_sort_as_names_do() {
        let names = [0, 17, 199].map(|member| numbered("a/b.c.ply".as_ref(), member, 200));
        assert_eq!(names, ["a/b.c-000.ply", "a/b.c-017.ply", "a/b.c-199.ply"].map(PathBuf::from));
        assert_eq!(numbered("b.ply".as_ref(), 0, 1), PathBuf::from("b.ply"));
    }

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
