//! Inputs with wildcards: `scans/*.obj`, `scans/**/left_*`, `scans/{a,b}/*.ply`.
//!
//! `*` and `?` stay within a folder, `**` goes through any number of them. A pattern that matches a folder means all
//! meshes below it, as it would from a shell. Names are relative to the folder before the first wildcard.

use std::path::{Path, PathBuf};

use globset::{GlobBuilder, GlobMatcher};

use super::{IntakeError, Job, search};

/// A pattern, and the folder that is searched for what matches it.
#[derive(Debug)]
pub struct Pattern {
    folder: PathBuf,
    matcher: GlobMatcher,
    text: String,
}

impl Pattern {
    /// `input` as a pattern; none where it has no wildcard, or is there under this very name.
    ///
    /// # Errors
    /// [`IntakeError::Pattern`].
    pub fn of(input: &Path) -> Result<Option<Self>, IntakeError> {
        if input.symlink_metadata().is_ok() {
            return Ok(None);
        }
        let parts: Vec<_> = input.components().collect();
        // A folder whose own name has a bracket is no pattern.
        let literal = |end: &usize| {
            let folder: PathBuf = parts.iter().take(*end).collect();
            has_wildcard(folder.as_os_str()) && !folder.is_dir()
        };
        let Some(end) = (1..=parts.len()).find(literal) else { return Ok(None) };
        let (before, after) = parts.split_at(end - 1);
        let after: PathBuf = after.iter().collect();
        let text = input.display().to_string();
        let glob = GlobBuilder::new(&after.to_string_lossy()).literal_separator(true).build();
        let matcher = glob
            .map_err(|error| IntakeError::Pattern {
                pattern: text.clone(),
                reason: error.kind().to_string(),
            })?
            .compile_matcher();
        Ok(Some(Self { folder: before.iter().collect(), matcher, text }))
    }

    /// The meshes that match, sorted by name: of what [`search`] finds below the folder.
    ///
    /// # Errors
    /// [`IntakeError::NoMatch`] when there is none, and as [`search`].
    pub fn jobs(&self) -> Result<Vec<Job>, IntakeError> {
        let here = Path::new(".");
        let folder = if self.folder.as_os_str().is_empty() { here } else { &self.folder };
        let mut jobs = if folder.is_dir() { search(folder)? } else { Vec::new() };
        jobs.retain(|job| Path::new(&job.name).ancestors().any(|path| self.matcher.is_match(path)));
        if jobs.is_empty() {
            return Err(IntakeError::NoMatch { pattern: self.text.clone() });
        }
        Ok(jobs)
    }
}

fn has_wildcard(text: &std::ffi::OsStr) -> bool {
    text.to_string_lossy().contains(['*', '?', '[', '{'])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(files: &[&str]) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        for name in files {
            let path = dir.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        }
        dir
    }

    fn matched(dir: &tempfile::TempDir, pattern: &str) -> Result<Vec<String>, IntakeError> {
        let pattern = Pattern::of(&dir.path().join(pattern))?.unwrap();
        Ok(pattern.jobs()?.into_iter().map(|job| job.name).collect())
    }

    #[test]
    fn wildcards_match_files_and_folders_within_what_is_searched() {
        let files = ["a.obj", "b.ply", "s/a.obj", "s/t/a.obj", "s/t/c.off", "u1/d.stl", "n.txt"];
        let dir =
            folder(&[&files[..], &["r/a.obj/eigen.npz", "r/a.obj/eigen.ply", ".h/a.obj"]].concat());
        let matched = |pattern| matched(&dir, pattern).unwrap();
        assert_eq!(matched("*.obj"), ["a.obj"]);
        assert_eq!(matched("**/a.obj"), ["a.obj", "s/a.obj", "s/t/a.obj"]);
        assert_eq!(matched("s/**/*.{off,obj}"), ["a.obj", "t/a.obj", "t/c.off"]);
        assert_eq!(matched("u?"), ["u1/d.stl"]);
        assert_eq!(matched("[ab].*"), ["a.obj", "b.ply"]);
        assert_eq!(matched("*").len(), 6);
    }

    #[test]
    fn what_matches_nothing_or_is_no_pattern_says_so() {
        let dir = folder(&["a.obj", "n.txt"]);
        let message = |pattern| matched(&dir, pattern).unwrap_err().to_string();
        for pattern in ["*.ply", "no/*.obj", "*.txt"] {
            let message = message(pattern);
            assert!(message.contains(pattern) && message.contains("matches no mesh"), "{message}");
        }
        assert!(message("a[").contains("is no pattern"));
    }

    #[test]
    fn a_name_that_is_there_is_no_pattern() {
        let dir = folder(&["[1]/a[2].obj", "[1]/b.obj"]);
        assert!(Pattern::of(&dir.path().join("[1]/a[2].obj")).unwrap().is_none());
        assert_eq!(matched(&dir, "[1]/*.obj").unwrap(), ["a[2].obj", "b.obj"]);
        assert!(Pattern::of(Path::new("none.obj")).unwrap().is_none());
    }
}
