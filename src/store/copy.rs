//! How a cache that cannot be written is of use all the same: from a copy of it.
//!
//! The database cannot be opened for reading alone. So it is copied to the system's temporary folder, where it is a store
//! like any other: its entries are found, and what is put is found too, until the store is dropped and the copy removed.
//! The cache itself is left as it is. While the copy is made, the lock of the cache is shared, so that nobody writes to it.

use std::fs::{self, File};
use std::io;
use std::path::Path;

use super::lock::DirectoryLock;
use super::open::Store;
use super::recovery::suspect_path;
use super::{StoreError, files, format, generation, stat, tally};

/// The largest database that is copied: a few seconds of copying.
const LARGEST: u64 = 4 << 30;

impl Store {
    /// Opens a copy of the cache at `dir`, for when it cannot be written: with its entries, and without any consequence for it.
    ///
    /// # Errors
    /// As for [`open`](Self::open); [`StoreError::TooLarge`]; when the copy cannot be written either.
    pub fn open_copy(dir: impl AsRef<Path>) -> Result<Self, StoreError> {
        let dir = dir.as_ref();
        format::read(dir)?;
        let place = std::env::temp_dir();
        let copy = tempfile::Builder::new()
            .prefix("chladni-cache-")
            .tempdir()
            .map_err(files::refused("create a folder in", &place))?;
        {
            let _shared = DirectoryLock::share(dir)?;
            let database = generation::database(dir, generation::present(dir));
            let bytes = stat::disk_bytes_of(&database)?;
            if bytes > LARGEST {
                return Err(StoreError::TooLarge { dir: dir.to_owned(), bytes, most: LARGEST });
            }
            copy_files(dir, copy.path(), &database)?;
        }
        let path = copy.path().to_owned();
        Self::at(&path, Some(copy))
    }
}

/// Copies what an opening looks at, with the permissions of new files.
fn copy_files(from: &Path, to: &Path, database: &Path) -> Result<(), StoreError> {
    let files = [format::path(from), generation::path(from), suspect_path(from), tally::path(from)];
    for file in &files {
        copy_to(file, to)?;
    }
    let mut folders = vec![(database.to_owned(), to.to_owned())];
    while let Some((folder, to)) = folders.pop() {
        let Some(name) = folder.file_name().filter(|_| folder.is_dir()) else { continue };
        let to = to.join(name);
        fs::create_dir(&to).map_err(files::refused("create", &to))?;
        for item in fs::read_dir(&folder).map_err(files::refused("read", &folder))? {
            let path = item.map_err(files::refused("read", &folder))?.path();
            if path.is_dir() {
                folders.push((path, to.clone()));
            } else {
                copy_to(&path, &to)?;
            }
        }
    }
    Ok(())
}

/// Copies a file into a folder, if it is there.
fn copy_to(file: &Path, folder: &Path) -> Result<(), StoreError> {
    let mut source = match File::open(file) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        source => source.map_err(files::refused("read", file))?,
    };
    let target = folder.join(file.file_name().unwrap_or_default());
    // Not `fs::copy`, which copies the permissions too.
    File::create(&target)
        .and_then(|mut target| io::copy(&mut source, &mut target))
        .map_err(files::refused("write", &target))?;
    Ok(())
}
