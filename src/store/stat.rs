//! What a store holds, by stage, and what it takes on disk.
//!
//! Counted from the manifests alone: no artifact type is needed and no entry is read.

use std::collections::BTreeMap;
use std::path::Path;
use std::{fs, io};

use serde::Serialize;

use super::recovery::QUARANTINE;
use super::{Store, StoreError};

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
        for key in self.blobs().keys()? {
            let Some(manifest) = self.blobs().manifest(&key) else {
                continue;
            };
            let stage = stat.stages.entry(manifest.stage).or_default();
            stage.entries += 1;
            stage.live_bytes += manifest.length;
            stat.entries += 1;
            stat.live_bytes += manifest.length;
        }
        stat.quarantined_entries = self.quarantined()?.len() as u64;
        let unreadable =
            |source| StoreError::Directory { doing: "read", path: self.dir().to_owned(), source };
        stat.disk_bytes = disk_bytes(self.dir()).map_err(unreadable)?;
        stat.quarantined_databases = quarantined_databases(self.dir()).map_err(unreadable)?;
        Ok(stat)
    }
}

/// The length of all files below `dir`. A file that goes away meanwhile counts nothing; links are not followed.
fn disk_bytes(dir: &Path) -> io::Result<u64> {
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

fn quarantined_databases(dir: &Path) -> io::Result<u64> {
    let mut count = 0;
    for item in fs::read_dir(dir)? {
        let name = item?.file_name();
        count += u64::from(name.to_string_lossy().starts_with(QUARANTINE));
    }
    Ok(count)
}

fn if_there<T>(result: io::Result<T>) -> io::Result<Option<T>> {
    match result {
        Ok(value) => Ok(Some(value)),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
    }
}
