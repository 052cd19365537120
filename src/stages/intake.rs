//! Which meshes there are: files, and folders searched for them.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::{Path, PathBuf};

use crate::mesh::Format;

/// A folder with this file holds the results of a mesh. What lies in it is no input, although its `eigen.ply` ends as
/// meshes do: results may lie below the meshes that they are of.
const RESULTS: &str = "eigen.npz";

/// One mesh to be processed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Job {
    /// Where the file is.
    pub source: PathBuf,
    /// Its path relative to the input it was found under, with `/` between the parts: its name in reports, and
    /// the folder of its results.
    pub name: String,
}

/// Why the inputs make no list of meshes.
#[derive(Debug, thiserror::Error)]
pub enum IntakeError {
    /// No input was given.
    #[error("there is no input: name meshes or folders under [input] paths, or with --input")]
    None,
    /// Folders without a mesh.
    #[error(
        "no mesh was found under {searched}; meshes end in {}",
        Format::listed(Format::extension)
    )]
    Empty { searched: String },
    /// A folder that cannot be listed.
    #[error("{path}: the folder cannot be read ({source}); check its permissions")]
    Unreadable { path: PathBuf, source: io::Error },
    /// Two meshes whose results would go to the same place.
    #[error(
        "{first} and {second} would both write their results to {name}; \
         give their common folder as the input instead"
    )]
    Clash { first: PathBuf, second: PathBuf, name: String },
}

/// Lists the meshes of `inputs`, in the order of the inputs, folders sorted by name. A path that does not exist
/// becomes a job too: it fails when it is read, with its reason, and the others go on.
///
/// # Errors
/// [`IntakeError`].
pub fn jobs(inputs: &[PathBuf]) -> Result<Vec<Job>, IntakeError> {
    if inputs.is_empty() {
        return Err(IntakeError::None);
    }
    let mut jobs = Vec::new();
    for input in inputs {
        if input.is_dir() {
            search(input, input, &mut jobs)?;
        } else {
            let name = input.file_name().unwrap_or(input.as_os_str()).to_string_lossy();
            jobs.push(Job { source: input.clone(), name: name.into_owned() });
        }
    }
    if jobs.is_empty() {
        let searched = inputs.iter().map(|p| p.display().to_string()).collect::<Vec<_>>();
        return Err(IntakeError::Empty { searched: searched.join(", ") });
    }
    // The same file by two ways is one mesh.
    let mut files = BTreeSet::new();
    jobs.retain(|job| {
        files.insert(job.source.canonicalize().unwrap_or_else(|_| job.source.clone()))
    });
    let mut seen: BTreeMap<&str, &Path> = BTreeMap::new();
    for job in &jobs {
        if let Some(first) = seen.insert(&job.name, &job.source) {
            return Err(IntakeError::Clash {
                first: first.into(),
                second: job.source.clone(),
                name: job.name.clone(),
            });
        }
    }
    Ok(jobs)
}

fn search(root: &Path, folder: &Path, jobs: &mut Vec<Job>) -> Result<(), IntakeError> {
    let unreadable = |source| IntakeError::Unreadable { path: folder.into(), source };
    let mut entries = std::fs::read_dir(folder)
        .and_then(|entries| entries.collect::<io::Result<Vec<_>>>())
        .map_err(unreadable)?;
    if entries.iter().any(|entry| entry.file_name() == RESULTS) {
        return Ok(());
    }
    entries.sort_by_key(std::fs::DirEntry::file_name);
    for entry in entries {
        let path = entry.path();
        if entry.file_name().to_string_lossy().starts_with('.') {
            continue;
        }
        // A link to a folder is not followed: it may lead back up.
        if entry.file_type().map_err(unreadable)?.is_dir() {
            search(root, &path, jobs)?;
        } else if is_mesh(&path) && path.is_file() {
            let parts = path.strip_prefix(root).unwrap_or(&path).components();
            let name: Vec<_> = parts.map(|c| c.as_os_str().to_string_lossy()).collect();
            jobs.push(Job { name: name.join("/"), source: path });
        }
    }
    Ok(())
}

fn is_mesh(path: &Path) -> bool {
    path.extension().and_then(|e| e.to_str()).and_then(Format::of_extension).is_some()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_are_searched_in_order_and_names_are_relative() {
        let dir = tempfile::tempdir().unwrap();
        let results = ["out/b.obj/eigen.ply", "out/b.obj/eigen.npz"];
        let others = ["b.obj", "a/c.GLB", "a/notes.txt", ".hidden/d.obj", "a/.e.obj"];
        for name in results.into_iter().chain(others).chain(["d.off", "e.ply", "f.stl", "g.vtk"]) {
            let path = dir.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        }
        let found = jobs(&[dir.path().into(), "missing.obj".into()]).unwrap();
        let names: Vec<&str> = found.iter().map(|job| job.name.as_str()).collect();
        assert_eq!(names, ["a/c.GLB", "b.obj", "d.off", "e.ply", "f.stl", "g.vtk", "missing.obj"]);
    }

    #[test]
    fn what_cannot_be_a_list_says_why() {
        let dir = tempfile::tempdir().unwrap();
        assert!(matches!(jobs(&[]), Err(IntakeError::None)));
        assert!(matches!(jobs(&[dir.path().into()]), Err(IntakeError::Empty { .. })));
        let twice = jobs(&["x/a.obj".into(), "y/a.obj".into()]);
        assert!(matches!(twice, Err(IntakeError::Clash { .. })));
        assert_eq!(jobs(&["a.obj".into(), "a.obj".into()]).unwrap().len(), 1);
    }
}
