//! Which meshes there are: files, folders searched for them, and lists and patterns of either.
//!
//! - `list`: text files with a mesh a line
//! - `objects`: a file's objects as meshes of their own
//! - `pattern`: names with wildcards

mod list;
mod objects;
mod pattern;

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::path::{Path, PathBuf};

use ignore::WalkBuilder;

pub use self::objects::{apart, into_objects};
use self::pattern::Pattern;
use crate::mesh::Format;
use crate::mesh::sample::{SampleError, Set};
use crate::pipeline::Generate;
use crate::publish::mesh_file::{self, MeshFileError};

/// A folder with this file holds the results of a mesh. What lies in it is no input, although its `eigen.ply` ends as
/// meshes do: results may lie below the meshes that they are of.
const RESULTS: &str = "eigen.npz";

/// A file with this name says which files of its folder, and below, are no inputs.
const IGNORED: &str = ".chladniignore";

/// One mesh to be processed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Job {
    /// Where the file is.
    pub source: PathBuf,
    /// Its path relative to the input it was found under, with `/` between the parts: its name in reports, and
    /// the folder of its results.
    pub name: String,
    /// The object of the file that it is, where that has several and they are meshes of their own: the name ends with it.
    pub object: Option<String>,
}

impl Job {
    /// All of a file.
    pub fn whole(source: PathBuf, name: String) -> Self {
        Self { source, name, object: None }
    }

    /// An object of the file that is called so.
    pub fn object(source: PathBuf, file: &str, object: String) -> Self {
        Self { source, name: format!("{file}/{object}"), object: Some(object) }
    }

    /// What the file is called: the name without that of the object.
    pub fn file_name(&self) -> &str {
        let object = self.object.as_deref().and_then(|object| self.name.strip_suffix(object));
        object.map_or(&self.name, |file| file.trim_end_matches('/'))
    }
}

/// Why the inputs make no list of meshes.
#[derive(Debug, thiserror::Error)]
pub enum IntakeError {
    /// No input was given.
    #[error(
        "there is no input: name meshes or folders under [input] paths, or with --input, or surfaces under [input] generate"
    )]
    None,
    /// A surface has no such sampling.
    #[error("input.generate: {0}")]
    Sample(#[from] SampleError),
    /// Two generated meshes that are the same, or would have one name.
    #[error("input.generate: {} is asked for twice; give one of them another seed", .path.display())]
    Twice { path: PathBuf },
    /// A generated mesh that cannot be written.
    #[error("{path}: the generated mesh cannot be written: {source}", path = .path.display())]
    Generated { path: PathBuf, source: MeshFileError },
    /// Folders without a mesh.
    #[error(
        "no mesh was found under {searched}; meshes end in {}",
        Format::listed(Format::extension)
    )]
    Empty { searched: String },
    /// A folder that cannot be listed.
    #[error("{path}: the folder cannot be read ({source}); check its permissions")]
    Unreadable { path: PathBuf, source: io::Error },
    /// Wildcards that cannot be understood.
    #[error("{pattern} is no pattern ({reason}); wildcards are `*`, `?`, `**`, [ab] and {{a,b}}")]
    Pattern { pattern: String, reason: String },
    /// Wildcards that match nothing.
    #[error(
        "{pattern} matches no mesh; meshes end in {}, and what is hidden or under a .chladniignore is passed over",
        Format::listed(Format::extension)
    )]
    NoMatch { pattern: String },
    /// A list that cannot be read, or a line of it that cannot be meant.
    #[error("{}{}: {reason}", .list.display(), .line.map_or(String::new(), |line| format!(", line {line}")))]
    List { list: PathBuf, line: Option<usize>, reason: String },
    /// Two meshes whose results would go to the same place.
    #[error(
        "{first} and {second} would both write their results to {name}; \
         give their common folder as the input instead"
    )]
    Clash { first: PathBuf, second: PathBuf, name: String },
}

/// Lists the meshes of `inputs`, in the order of the inputs, folders sorted by name. An input is a mesh, a folder, a
/// pattern, or a list of these. A path that does not exist becomes a job too: it fails when it is read, with its reason,
/// and the others go on.
///
/// # Errors
/// [`IntakeError`].
pub fn jobs(inputs: &[PathBuf]) -> Result<Vec<Job>, IntakeError> {
    if inputs.is_empty() {
        return Err(IntakeError::None);
    }
    let mut jobs = Vec::new();
    for input in inputs {
        jobs.extend(if list::is_list(input) { list::jobs(input)? } else { of_input(input)? });
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
    check_names(&jobs)?;
    Ok(jobs)
}

/// Whether every mesh has a folder of its own for its results.
fn check_names(jobs: &[Job]) -> Result<(), IntakeError> {
    let mut seen: BTreeMap<&str, &Path> = BTreeMap::new();
    for job in jobs {
        if let Some(first) = seen.insert(&job.name, &job.source) {
            return Err(IntakeError::Clash {
                first: first.into(),
                second: job.source.clone(),
                name: job.name.clone(),
            });
        }
    }
    Ok(())
}

/// The meshes of an input that is no list.
fn of_input(input: &Path) -> Result<Vec<Job>, IntakeError> {
    if input.is_dir() {
        return search(input);
    }
    if let Some(pattern) = Pattern::of(input)? {
        return pattern.jobs();
    }
    let name = input.file_name().unwrap_or(input.as_os_str()).to_string_lossy();
    Ok(vec![Job::whole(input.to_owned(), name.into_owned())])
}

/// Makes the samplings that a pipeline asks for, as files in `folder`: `square-144.ply`, of another seed
/// `square-144-seed7.ply`, of several `square-144-07.ply`, of those that are trained on `square-144-training.ply`. They
/// depend on the entries alone, and one that is there already is not written again.
///
/// # Errors
/// [`IntakeError::Sample`] and [`IntakeError::Generated`].
pub fn generate(entries: &[Generate], folder: &Path) -> Result<Vec<PathBuf>, IntakeError> {
    let mut files = Vec::new();
    for Generate { shape, vertices, count, seed, set } in entries {
        for &n in vertices {
            let seeded = if *seed == 0 { String::new() } else { format!("-seed{seed}") };
            let trained = if *set == Set::Training { "-training" } else { "" };
            let plain = folder.join(format!("{}-{n}{trained}{seeded}.ply", shape.name()));
            for member in 0..*count {
                let path = mesh_file::numbered(&plain, member, *count);
                if files.contains(&path) {
                    return Err(IntakeError::Twice { path });
                }
                let mesh = shape.sample(n, *seed, set.number(member))?;
                mesh_file::write(&path, &mesh)
                    .map_err(|source| IntakeError::Generated { path: path.clone(), source })?;
                files.push(path);
            }
        }
    }
    Ok(files)
}

/// The meshes below a folder, sorted by name: not what is hidden, what a `.chladniignore` in it or in a folder below leaves
/// out (its lines are those of a `.gitignore`), nor folders of results. Links to files are followed, links to folders are not:
/// they may lead back up.
///
/// # Errors
/// [`IntakeError::Unreadable`].
pub fn search(root: &Path) -> Result<Vec<Job>, IntakeError> {
    let holds_results = |folder: &Path| folder.join(RESULTS).is_file();
    if holds_results(root) {
        return Ok(Vec::new());
    }
    let walk = WalkBuilder::new(root)
        .standard_filters(false)
        .hidden(true)
        .add_custom_ignore_filename(IGNORED)
        .sort_by_file_name(std::ffi::OsStr::cmp)
        .filter_entry(move |entry| {
            let is_folder = entry.file_type().is_some_and(|kind| kind.is_dir());
            !(is_folder && holds_results(entry.path()))
        })
        .build();
    let mut jobs = Vec::new();
    for entry in walk {
        let entry = match entry {
            // What goes away during the walk is not there.
            Err(error) if is_gone(&error) && root.is_dir() => continue,
            entry => entry.map_err(|error| IntakeError::of_walk(root, error))?,
        };
        if let Some(error) = entry.error() {
            tracing::warn!("{error}; what it was to leave out is not left out");
        }
        let path = entry.into_path();
        if is_mesh(&path) && may_be_read(&path) {
            let name = name_of(root, &path);
            jobs.push(Job::whole(path, name));
        }
    }
    Ok(jobs)
}

/// Whether it is a file, or cannot be looked at: then it fails when it is read, with the reason.
fn may_be_read(path: &Path) -> bool {
    match path.metadata() {
        Ok(metadata) => metadata.is_file(),
        Err(error) => error.kind() != io::ErrorKind::NotFound,
    }
}

/// The name of a mesh that was found below `root`.
pub fn name_of(root: &Path, path: &Path) -> String {
    let parts = path.strip_prefix(root).unwrap_or(path).components();
    parts.map(|part| part.as_os_str().to_string_lossy()).collect::<Vec<_>>().join("/")
}

impl IntakeError {
    fn of_walk(root: &Path, error: ignore::Error) -> Self {
        let path = path_of(&error).unwrap_or(root).to_owned();
        let reason = error.to_string();
        let source = error.into_io_error().unwrap_or_else(|| io::Error::other(reason));
        Self::Unreadable { path, source }
    }
}

fn is_gone(error: &ignore::Error) -> bool {
    error.io_error().is_some_and(|error| error.kind() == io::ErrorKind::NotFound)
}

/// Where a walk met an error.
fn path_of(error: &ignore::Error) -> Option<&Path> {
    match error {
        ignore::Error::WithPath { path, .. } => Some(path),
        ignore::Error::WithDepth { err, .. } | ignore::Error::WithLineNumber { err, .. } => {
            path_of(err)
        }
        _ => None,
    }
}

/// Whether the file could be a mesh, by its name.
pub fn is_mesh(path: &Path) -> bool {
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
    fn what_is_to_be_ignored_is_and_links_to_files_are_followed() {
        let dir = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| {
            let path = dir.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        };
        for name in ["a.obj", "old/b.obj", "new/c.obj", "new/c_lod1.obj", "new/keep/d_lod1.obj"] {
            write(name, "");
        }
        write(".chladniignore", "old/\n*_lod1.obj\n");
        write("new/keep/.chladniignore", "!d_lod1.obj\n");
        // Not ours.
        write(".gitignore", "a.obj\n");
        #[cfg(unix)]
        {
            let there = dir.path().join("old/b.obj");
            std::os::unix::fs::symlink(there, dir.path().join("linked.obj")).unwrap();
            std::os::unix::fs::symlink(dir.path(), dir.path().join("round")).unwrap();
        }
        let names: Vec<String> =
            search(dir.path()).unwrap().into_iter().map(|job| job.name).collect();
        let linked: &[&str] = if cfg!(unix) { &["linked.obj"] } else { &[] };
        let expected = [&["a.obj"], linked, &["new/c.obj", "new/keep/d_lod1.obj"]].concat();
        assert_eq!(names, expected);
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
