//! Which format a cache directory has: the marker file `chladni.format`.
//!
//! Its first line is `chladni store N`, in this and every later format, so that an older chladni recognises a newer
//! directory and leaves it alone. The number covers the layout of the directory, the trees and their records; types
//! have schemas of their own.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::{fs, str};

use super::{StoreError, files};

/// The format that this code reads and writes.
pub(super) const FORMAT: u32 = 2;

/// The marker file within a cache directory.
const FILE: &str = "chladni.format";

/// Where the marker of `dir` is.
pub(super) fn path(dir: &Path) -> PathBuf {
    dir.join(FILE)
}

const PREFIX: &str = "chladni store ";

/// What the marker of a directory says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Marker {
    /// Our format.
    Ours,
    /// A format that this code no longer reads.
    Older(u32),
    /// There is none: a new directory, unless there is a database.
    Absent,
    /// It is there and does not say a format.
    Unreadable,
}

/// Reads the marker of `dir`.
///
/// # Errors
/// [`StoreError::NewerFormat`], or [`StoreError::Directory`] when the system refuses to read it.
pub(super) fn read(dir: &Path) -> Result<Marker, StoreError> {
    let path = path(dir);
    let content = match fs::read(&path) {
        Ok(content) => content,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Marker::Absent),
        Err(error) => return Err(files::refused("read", &path)(error)),
    };
    match version(&content) {
        None => Ok(Marker::Unreadable),
        Some(FORMAT) => Ok(Marker::Ours),
        Some(found) if found < FORMAT => Ok(Marker::Older(found)),
        Some(found) => Err(StoreError::NewerFormat { dir: dir.to_owned(), found, known: FORMAT }),
    }
}

/// Marks `dir` as ours.
pub(super) fn write(dir: &Path) -> Result<(), StoreError> {
    files::replace(&path(dir), &format!("{PREFIX}{FORMAT}"))
}

fn version(content: &[u8]) -> Option<u32> {
    let line = content.split(|&byte| byte == b'\n').next()?;
    let number = str::from_utf8(line).ok()?.strip_prefix(PREFIX)?;
    number.trim_end().parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_marker_is_ours_older_newer_or_no_marker() {
        let dir = tempfile::tempdir().unwrap();
        assert_eq!(read(dir.path()).unwrap(), Marker::Absent);
        write(dir.path()).unwrap();
        assert_eq!(read(dir.path()).unwrap(), Marker::Ours);
        let with = |text: &str| {
            fs::write(dir.path().join(FILE), text).unwrap();
            read(dir.path())
        };
        assert_eq!(with("chladni store 0\n").unwrap(), Marker::Older(0));
        assert_eq!(with("").unwrap(), Marker::Unreadable);
        assert_eq!(with("chladni store one").unwrap(), Marker::Unreadable);
        assert!(matches!(
            with("chladni store 3\nand more\n"),
            Err(StoreError::NewerFormat { found: 3, known: 2, .. })
        ));
    }
}
