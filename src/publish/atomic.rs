//! Bytes into files that are whole at any time: whoever opens the target sees the old bytes or the new ones.
//!
//! The bytes go to a hidden file `.chladni-….tmp` beside the target, reach the disk, and are then renamed over the
//! target. Only a killed process leaves the hidden file behind; nothing reads it. A target that is a symbolic link
//! is replaced, not followed.

use std::fs::{self, File};
use std::io::{self, BufRead, BufReader, Write};
use std::path::{Path, PathBuf};

/// Why a result is not on disk.
#[derive(Debug, thiserror::Error)]
pub enum PublishError {
    /// A folder on the way to the file cannot be created: usually permissions, or a file of that name.
    #[error(
        "cannot create the folder {}: {source}; results need a writable place (choose one with --out DIR)",
        path.display()
    )]
    Folder { path: PathBuf, source: io::Error },
    /// The file cannot be written or put in its place: usually permissions, a full disk, or a folder of that name.
    #[error(
        "cannot write {}: {source}; check that its folder is writable, that the disk has space and that no \
         folder has this name, or choose another place with --out DIR",
        path.display()
    )]
    File { path: PathBuf, source: io::Error },
    /// The format of the file cannot hold so much.
    #[error(
        "{}: {bytes} bytes are more than this format can count; leave it out of publish.formats, or ask for fewer eigenpairs \
         (train.k, or -k)",
        path.display()
    )]
    TooLarge { path: PathBuf, bytes: u64 },
}

impl PublishError {
    /// Whether another try may succeed: the system has refused something.
    pub fn is_of_the_moment(&self) -> bool {
        match self {
            Self::Folder { .. } | Self::File { .. } => true,
            Self::TooLarge { .. } => false,
        }
    }
}

/// What [`write_if_changed`] did.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Written {
    /// The file holds new bytes.
    Changed,
    /// The file held these bytes already and was not touched.
    Unchanged,
}

/// Makes `path` a file of exactly these bytes, with the permissions of any new file. Folders on the way are created.
///
/// # Errors
/// When the system refuses; the target is then as it was.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), PublishError> {
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let written = || {
        fs::create_dir_all(folder)
            .map_err(|source| PublishError::Folder { path: folder.to_owned(), source })?;
        replace(folder, path, bytes)
            .map_err(|source| PublishError::File { path: path.to_owned(), source })
    };
    match written() {
        // Somebody has removed the folder meanwhile.
        Err(PublishError::File { source, .. }) if source.kind() == io::ErrorKind::NotFound => {
            written()
        }
        result => result,
    }
}

/// Makes sure that there is no file at `path`.
///
/// # Errors
/// When the system refuses.
pub fn remove(path: &Path) -> Result<(), PublishError> {
    match fs::remove_file(path) {
        Err(source) if source.kind() != io::ErrorKind::NotFound => {
            Err(PublishError::File { path: path.to_owned(), source })
        }
        _ => Ok(()),
    }
}

/// As [`write()`], but leaves a file alone that holds these bytes already, so that it keeps its time stamp.
///
/// # Errors
/// As [`write()`].
pub fn write_if_changed(path: &Path, bytes: &[u8]) -> Result<Written, PublishError> {
    // A file that cannot be read is no reason to give up: replacing it may well succeed.
    if holds(path, bytes).unwrap_or(false) {
        return Ok(Written::Unchanged);
    }
    write(path, bytes)?;
    Ok(Written::Changed)
}

fn replace(folder: &Path, path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".chladni-").suffix(".tmp");
    // Temporary files are private unless told otherwise; the umask still takes its part.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let mut temporary = builder.tempfile_in(folder)?;
    temporary.write_all(bytes)?;
    temporary.as_file().sync_all()?;
    temporary.persist(path)?;
    Ok(())
}

fn holds(path: &Path, bytes: &[u8]) -> io::Result<bool> {
    let file = File::open(path)?;
    if file.metadata()?.len() != bytes.len() as u64 {
        return Ok(false);
    }
    let mut reader = BufReader::with_capacity(1 << 16, file);
    let mut rest = bytes;
    loop {
        let read = reader.fill_buf()?;
        let length = read.len();
        if length == 0 {
            return Ok(rest.is_empty());
        }
        match rest.strip_prefix(read) {
            Some(after) => rest = after,
            None => return Ok(false),
        }
        reader.consume(length);
    }
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, SystemTime};

    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> = fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn folders_are_created_and_old_bytes_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a/b.obj/spectrum.json");
        write(&path, b"a longer text").unwrap();
        write(&path, b"short").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"short");
        assert_eq!(names(path.parent().unwrap()), ["spectrum.json"]);
    }

    #[test]
    fn equal_bytes_keep_their_time() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("eigen.npz");
        let long_ago = SystemTime::UNIX_EPOCH + Duration::from_secs(1_000_000_000);
        let mut bytes = vec![7; 200_000];
        assert_eq!(write_if_changed(&path, &bytes).unwrap(), Written::Changed);
        File::options().write(true).open(&path).unwrap().set_modified(long_ago).unwrap();
        assert_eq!(write_if_changed(&path, &bytes).unwrap(), Written::Unchanged);
        assert_eq!(fs::metadata(&path).unwrap().modified().unwrap(), long_ago);
        bytes[199_999] = 8;
        assert_eq!(write_if_changed(&path, &bytes).unwrap(), Written::Changed);
        assert_eq!(fs::read(&path).unwrap(), bytes);
        assert_eq!(write_if_changed(&path, b"").unwrap(), Written::Changed);
        assert_eq!(write_if_changed(&path, b"").unwrap(), Written::Unchanged);
    }

    #[cfg(unix)]
    #[test]
    fn permissions_are_those_of_any_new_file() {
        use std::os::unix::fs::PermissionsExt;
        let dir = tempfile::tempdir().unwrap();
        let (ours, usual) = (dir.path().join("ours"), dir.path().join("usual"));
        write(&ours, b"x").unwrap();
        fs::write(&usual, b"x").unwrap();
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode();
        assert_eq!(mode(&ours), mode(&usual));
    }

    #[test]
    fn a_refusal_names_the_place_and_leaves_nothing_behind() {
        let dir = tempfile::tempdir().unwrap();
        let taken = dir.path().join("taken");
        fs::create_dir_all(taken.join("inside")).unwrap();
        let error = write(&taken, b"x").unwrap_err();
        assert!(matches!(&error, PublishError::File { path, .. } if *path == taken));
        assert!(error.to_string().contains("--out DIR"), "{error}");
        assert_eq!(names(dir.path()), ["taken"]);

        let file = dir.path().join("file");
        fs::write(&file, b"kept").unwrap();
        let error = write(&file.join("spectrum.json"), b"x").unwrap_err();
        assert!(matches!(&error, PublishError::Folder { path, .. } if *path == file));
        assert_eq!(fs::read(&file).unwrap(), b"kept");
    }
}
