//! Who holds a cache directory: one process at a time, by a lock on `chladni.lock`.
//!
//! The system drops the lock when its process ends, however it ends, so there are no stale locks to remove. The
//! file holds the number of the process for the message that others get. The database has a lock of its own, taken
//! after this one, whose message names nobody.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, ErrorKind, Write};
use std::path::Path;
use std::time::Duration;
use std::{fs, process, thread};

use super::{StoreError, files};

/// The lock file within a cache directory.
const FILE: &str = "chladni.lock";

/// A cache directory that is ours until this is dropped.
#[derive(Debug)]
pub(super) struct DirectoryLock {
    file: File,
}

impl DirectoryLock {
    /// Takes the directory, which must exist, or says who has it.
    pub fn take(dir: &Path) -> Result<Self, StoreError> {
        let path = dir.join(FILE);
        let mut file = OpenOptions::new()
            .write(true)
            .create(true)
            .truncate(false)
            .open(&path)
            .map_err(files::refused("open", &path))?;
        held(dir, file.try_lock())?;
        announce(&mut file).map_err(files::refused("write", &path))?;
        Ok(Self { file })
    }

    /// Keeps everybody from taking the directory for as long as the file is held, without writing to it. `None` if nobody
    /// has ever taken it.
    pub fn share(dir: &Path) -> Result<Option<File>, StoreError> {
        let path = dir.join(FILE);
        match File::open(&path) {
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
            file => {
                let file = file.map_err(files::refused("read", &path))?;
                held(dir, file.try_lock_shared())?;
                Ok(Some(file))
            }
        }
    }
}

impl Drop for DirectoryLock {
    fn drop(&mut self) {
        // A number that stays behind misleads nobody: it is read only while the lock is held. Closing the file would
        // unlock it too, but not while a process that is just being started holds a copy of the handle.
        if let Err(error) = self.file.set_len(0).and_then(|()| self.file.unlock()) {
            tracing::debug!(%error, "the lock file is left as it is");
        }
    }
}

/// What it means that the lock of `dir` was taken, or not.
fn held(dir: &Path, locked: Result<(), TryLockError>) -> Result<(), StoreError> {
    let path = dir.join(FILE);
    locked.map_err(|error| match error {
        TryLockError::WouldBlock => {
            StoreError::Locked { dir: dir.to_owned(), holder: holder(&path) }
        }
        TryLockError::Error(source) => files::refused("lock", &path)(source),
    })
}

fn announce(file: &mut File) -> io::Result<()> {
    file.set_len(0)?;
    file.write_all(format!("{}\n", process::id()).as_bytes())
}

/// The process that holds the lock. It may have taken it a moment ago and not yet written its number.
fn holder(path: &Path) -> Option<u32> {
    for _ in 0..20 {
        // Where locks are mandatory, the file cannot be read either.
        let text = fs::read_to_string(path).ok()?;
        if let Some(pid) = text.strip_suffix('\n').and_then(|line| line.parse().ok()) {
            return Some(pid);
        }
        thread::sleep(Duration::from_millis(5));
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_held_directory_is_refused_with_its_holder_and_free_again_after() {
        let dir = tempfile::tempdir().unwrap();
        let lock = DirectoryLock::take(dir.path()).unwrap();
        match DirectoryLock::take(dir.path()) {
            Err(StoreError::Locked { holder, .. }) => assert_eq!(holder, Some(process::id())),
            other => panic!("expected Locked, found {other:?}"),
        }
        drop(lock);
        assert!(DirectoryLock::take(dir.path()).is_ok());
    }

    #[test]
    fn a_number_left_by_a_dead_process_is_no_lock() {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join(FILE), "999999999 and more that is long\n").unwrap();
        let _lock = DirectoryLock::take(dir.path()).unwrap();
        let text = fs::read_to_string(dir.path().join(FILE)).unwrap();
        assert_eq!(text, format!("{}\n", process::id()));
    }
}
