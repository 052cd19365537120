//! Files and folders of a cache directory: replaced as a whole, and removed whether or not they are there.

use std::fs;
use std::io::{self, ErrorKind, Write};
use std::path::Path;

use super::StoreError;

/// Writes one line as the content of `path`: a temporary file renamed into place, so that the file is whole or as before.
pub(super) fn replace(path: &Path, line: &str) -> Result<(), StoreError> {
    let folder = path.parent().unwrap_or(Path::new("."));
    let mut builder = tempfile::Builder::new();
    // Others may read a cache that is shared; temporary files are private unless told otherwise. The umask takes its part.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let written = builder.tempfile_in(folder).and_then(|mut file| {
        writeln!(file, "{line}")?;
        file.as_file().sync_all()?;
        file.persist(path)?;
        Ok(())
    });
    written.map_err(refused("write", path))
}

/// Removes a file, if it is there.
pub(super) fn remove_file(path: &Path) -> Result<(), StoreError> {
    if_there(fs::remove_file(path)).map_err(refused("remove", path))
}

/// Removes a folder with all that is in it, if it is there.
pub(super) fn remove_folder(path: &Path) -> Result<(), StoreError> {
    if_there(fs::remove_dir_all(path)).map_err(refused("remove", path))
}

/// What it means that the system refuses to do something with `path`.
pub(super) fn refused(doing: &'static str, path: &Path) -> impl FnOnce(io::Error) -> StoreError {
    move |source| StoreError::Directory { doing, path: path.to_owned(), source }
}

fn if_there(removed: io::Result<()>) -> io::Result<()> {
    match removed {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}
