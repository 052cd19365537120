//! The file of several objects that was read last: its objects come one after the other, and it is parsed once for all.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use crate::mesh::{MeshError, Opened, companions};
use crate::watch::stamp::Stamp;

/// One file, as it was when it was read.
#[derive(Debug, Default)]
pub struct LastOpened {
    last: Mutex<Option<Last>>,
}

#[derive(Debug)]
struct Last {
    path: PathBuf,
    stamp: Stamp,
    opened: Arc<Opened>,
}

impl LastOpened {
    /// The file at `path`, read anew unless it was the last one and has not changed.
    ///
    /// # Errors
    /// As [`Opened::read`].
    pub fn open(&self, path: &Path) -> Result<Arc<Opened>, MeshError> {
        // Whoever wants the same file waits for it.
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(last) = last.as_ref().filter(|last| last.path == path) {
            // As long as it is the same it names the same others.
            let others = last.stamp.companions().cloned().collect();
            if Stamp::of(path, others).is_ok_and(|stamp| stamp == last.stamp) {
                return Ok(last.opened.clone());
            }
        }
        // Looked at before it is read, and before it is asked for its others: a change in between is seen.
        let alone = Stamp::of(path, Vec::new());
        let stamp = Stamp::of(path, companions(path)).ok();
        let stamp = stamp.filter(|stamp| alone.is_ok_and(|alone| stamp.is_same_file(&alone)));
        let opened = Arc::new(Opened::read(path)?);
        *last = stamp.map(|stamp| Last { path: path.into(), stamp, opened: opened.clone() });
        Ok(opened)
    }

    /// It is not wanted again soon.
    pub fn forget(&self) {
        *self.last.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_read_again_when_it_or_the_wish_changes() {
        let dir = tempfile::tempdir().unwrap();
        let path = |name: &str| dir.path().join(name);
        let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\no a\nf 1 2 3\n";
        std::fs::write(path("a.obj"), text).unwrap();
        std::fs::write(path("b.obj"), text).unwrap();
        let last = LastOpened::default();
        let first = last.open(&path("a.obj")).unwrap();
        assert!(Arc::ptr_eq(&first, &last.open(&path("a.obj")).unwrap()));
        std::fs::write(path("a.obj"), format!("{text}o b\nf 2 1 3\n")).unwrap();
        assert_eq!(last.open(&path("a.obj")).unwrap().objects(), ["a", "b"]);
        assert_eq!(last.open(&path("b.obj")).unwrap().objects(), ["a"]);
        std::fs::remove_file(path("b.obj")).unwrap();
        assert!(last.open(&path("b.obj")).is_err());
    }
}
