//! Whether the disk of a cache has room for an entry.
//!
//! A database whose disk is full refuses all writes until it is opened again. One that is never asked goes on as soon as
//! there is room.

use std::path::Path;

use super::StoreError;

/// What stays free beside the entry itself, for the database: it writes segments of 512 KiB, and rewrites pages.
const RESERVE: u64 = 4 << 20;

/// Refuses an entry of `bytes` for which the disk of `dir` has no room.
pub(super) fn check(dir: &Path, bytes: u64) -> Result<(), StoreError> {
    match free(dir) {
        // The chunks are written once, and pages of them again when they merge.
        Some(free) if free < RESERVE + 2 * bytes => {
            Err(StoreError::Full { dir: dir.to_owned(), bytes, free })
        }
        _ => Ok(()),
    }
}

/// The bytes that this user may still write to the disk of `dir`, where the system says so.
#[cfg(unix)]
fn free(dir: &Path) -> Option<u64> {
    let disk = rustix::fs::statvfs(dir).ok()?;
    Some(disk.f_bavail.saturating_mul(disk.f_frsize))
}

#[cfg(not(unix))]
fn free(_dir: &Path) -> Option<u64> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_no_disk_holds_is_refused_and_a_little_is_not() {
        let dir = tempfile::tempdir().unwrap();
        assert!(check(dir.path(), 10).is_ok());
        if cfg!(unix) {
            let error = check(dir.path(), u64::MAX / 4).unwrap_err().to_string();
            assert!(error.contains("has no room"), "{error}");
        }
    }
}
