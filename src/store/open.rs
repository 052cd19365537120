//! The store itself: how a directory becomes one.

use std::fmt;
use std::fs;
use std::path::Path;
use std::sync::Arc;

use tempfile::TempDir;

use super::blob::Blobs;
use super::lock::DirectoryLock;
use super::{Quarantined, StoreError, files, recovery};

/// An open cache directory. Clones share it, and it may be used from any number of threads; the directory is
/// released when the last clone is dropped.
///
/// ```
/// # use std::time::Duration;
/// use chladni::store::{Artifact, Store};
///
/// #[derive(rkyv::Archive, rkyv::Serialize, rkyv::Deserialize)]
/// struct Spectrum {
///     eigenvalues: Vec<f64>,
/// }
///
/// impl Artifact for Spectrum {
///     const STAGE: &'static str = "fem";
///     const VERSION: u32 = 1;
///     const SCHEMA: u32 = 1;
/// }
///
/// # let dir = tempfile::tempdir()?;
/// let store = Store::open(dir.path())?;
/// let key = Spectrum::key().param("k", "2").finish(0, "f64");
/// assert!(store.get::<Spectrum>(&key).is_none());
///
/// let spectrum = Spectrum { eigenvalues: vec![0.0, 2.0] };
/// let digest = store.put(&key, &spectrum, Duration::from_secs(3))?;
///
/// let cached = store.get::<Spectrum>(&key).ok_or("absent")?;
/// assert_eq!(cached.artifact.eigenvalues, [0.0, 2.0]);
/// assert_eq!(cached.digest, digest);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone)]
pub struct Store {
    open: Arc<Open>,
}

/// Fields drop in this order: the database closes before the directory is released, and then removed if it was a copy.
struct Open {
    blobs: Blobs,
    _lock: DirectoryLock,
    _temporary: Option<TempDir>,
}

impl Drop for Open {
    fn drop(&mut self) {
        self.blobs.tally();
    }
}

impl Store {
    /// Whether there is a cache at `dir`, of whatever format.
    pub fn exists(dir: impl AsRef<Path>) -> bool {
        super::format::path(dir.as_ref()).is_file()
    }

    /// Opens `dir` as a cache, creating it where needed. A damaged database is set aside with a warning and an
    /// empty one started.
    ///
    /// # Errors
    /// [`StoreError::Locked`] while another process, or another `Store` of this one, has the directory;
    /// [`StoreError::NewerFormat`] for the directory of a newer chladni, which is left as it is;
    /// [`StoreError::Directory`] or [`StoreError::Database`] when the system refuses to create or write it.
    pub fn open(dir: impl AsRef<Path>) -> Result<Self, StoreError> {
        let dir = dir.as_ref();
        fs::create_dir_all(dir).map_err(files::refused("create", dir))?;
        Self::at(dir, None)
    }

    /// Opens `dir`, which exists; a `temporary` one is removed when the store is dropped.
    pub(super) fn at(dir: &Path, temporary: Option<TempDir>) -> Result<Self, StoreError> {
        let lock = DirectoryLock::take(dir)?;
        let trees = recovery::open_trees(dir)?;
        let blobs = Blobs::new(dir.to_owned(), trees);
        Ok(Self { open: Arc::new(Open { blobs, _lock: lock, _temporary: temporary }) })
    }

    /// The cache directory, as it was given to [`open`](Self::open).
    pub fn dir(&self) -> &Path {
        self.blobs().dir()
    }

    /// The entries that were dropped because of damage since the database was created, by key.
    ///
    /// # Errors
    /// When the database cannot be read.
    pub fn quarantined(&self) -> Result<Vec<Quarantined>, StoreError> {
        self.blobs().quarantined()
    }

    pub(super) fn blobs(&self) -> &Blobs {
        &self.open.blobs
    }
}

impl fmt::Debug for Store {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Store").field("dir", &self.dir()).finish()
    }
}
