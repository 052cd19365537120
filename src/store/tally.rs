//! How many entries a database had when it was closed: the file `chladni.entries`, from one closing to the next opening.
//!
//! A damaged log often opens without a word, as a shorter one: to the database its end looks like that of a crash. The number
//! tells the two apart, since a crash leaves none.

use std::fs;
use std::path::{Path, PathBuf};

use super::{StoreError, files};

/// Where the number is.
pub(super) fn path(dir: &Path) -> PathBuf {
    dir.join("chladni.entries")
}

/// Writes the number of entries down, as the last thing before the database is closed. Without it nothing is compared.
pub(super) fn write(dir: &Path, entries: usize) {
    if let Err(error) = files::replace(&path(dir), &entries.to_string()) {
        tracing::debug!("the number of entries is not written down: {error}");
    }
}

/// Takes the number back and warns if the database has fewer `entries` than that.
pub(super) fn compare(
    dir: &Path,
    entries: impl FnOnce() -> Result<usize, StoreError>,
) -> Result<(), StoreError> {
    let path = path(dir);
    let Some(before) = fs::read_to_string(&path).ok() else { return Ok(()) };
    files::remove_file(&path)?;
    let Ok(before) = before.trim_end().parse::<usize>() else { return Ok(()) };
    let lost = before.saturating_sub(entries()?);
    if lost > 0 {
        tracing::warn!(
            lost,
            "the files of the cache are damaged: of {before} results {lost} are lost, and computed again when they are needed"
        );
    }
    Ok(())
}
