//! What a store holds, by stage, and what it takes on disk.
//!
//! Counted from the manifests alone: no artifact type is needed and no entry is read.

use std::collections::BTreeMap;
use std::path::Path;
use std::{fs, io};

use serde::Serialize;

use super::{Store, StoreError, files, recovery};

/// The contents of a store at one moment.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct StoreStat {
    /// By the name of the stage that made the entries.
    pub stages: BTreeMap<String, StageStat>,
    /// All entries.
    pub entries: u64,
    /// Their bytes, before the database's overhead.
    pub live_bytes: u64,
    /// The size of all files in the cache directory, quarantined databases included.
    pub disk_bytes: u64,
    /// Entries of this database that were dropped because of damage.
    pub quarantined_entries: u64,
    /// Databases that were set aside because they could not be used; the user may delete them.
    pub quarantined_databases: u64,
}

/// The entries of one stage.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct StageStat {
    /// How many there are.
    pub entries: u64,
    /// Their bytes, before the database's overhead.
    pub live_bytes: u64,
}

impl Store {
    /// Counts the entries of the store. A damaged manifest met on the way is quarantined.
    ///
    /// # Errors
    /// When the database or the directory cannot be read.
    pub fn stat(&self) -> Result<StoreStat, StoreError> {
        let mut stat = StoreStat::default();
        for (_, manifest) in self.blobs().manifests()? {
            stat.stages.entry(manifest.stage).or_default().count(manifest.length);
            stat.entries += 1;
            stat.live_bytes += manifest.length;
        }
        stat.quarantined_entries = self.quarantined()?.len() as u64;
        stat.disk_bytes = disk_bytes_of(self.dir())?;
        stat.quarantined_databases = recovery::set_aside_in(self.dir())?.len() as u64;
        Ok(stat)
    }
}

impl StageStat {
    /// Counts one more entry.
    pub(super) fn count(&mut self, bytes: u64) {
        self.entries += 1;
        self.live_bytes += bytes;
    }
}

/// The size of all files in a cache directory.
pub(super) fn disk_bytes_of(dir: &Path) -> Result<u64, StoreError> {
    disk_bytes(dir).map_err(files::refused("read", dir))
}

/// The length of all files below `dir`. A file that goes away meanwhile counts nothing; links are not followed.
pub(super) fn disk_bytes(dir: &Path) -> io::Result<u64> {
    let mut bytes = 0;
    let mut folders = vec![dir.to_owned()];
    while let Some(folder) = folders.pop() {
        let Some(listing) = if_there(fs::read_dir(folder))? else {
            continue;
        };
        for item in listing {
            let item = item?;
            match if_there(item.metadata())? {
                Some(found) if found.is_dir() => folders.push(item.path()),
                Some(found) if found.is_file() => bytes += found.len(),
                _ => {}
            }
        }
    }
    Ok(bytes)
}

fn if_there<T>(result: io::Result<T>) -> io::Result<Option<T>> {
    match result {
        Ok(value) => Ok(Some(value)),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
    }
}
