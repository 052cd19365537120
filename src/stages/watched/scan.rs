//! What a folder looks like now: every mesh with the stamp of its file and of those that belong to it.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use crate::mesh::companions;
use crate::stages::intake::{self, IntakeError, Job};
use crate::watch::stamp::Stamp;

/// Files and what a look at them showed.
pub type Seen = BTreeMap<PathBuf, Stamp>;

/// All meshes of the folder as they are now. What belongs to a file is found out when the file has changed.
///
/// # Errors
/// When the folder cannot be searched.
pub fn scan(folder: &Path, before: &Seen) -> Result<Seen, IntakeError> {
    let look = |job: Job| {
        let alone = match Stamp::of(&job.source, Vec::new()) {
            Ok(alone) => alone,
            Err(error) if error.kind() == ErrorKind::NotFound => return None,
            // It is there, and cannot be looked at: as far as anybody knows it is what it was.
            Err(_) => return Some((job.source.clone(), before.get(&job.source)?.clone())),
        };
        // As long as it is the same file it names the same others.
        let others = match before.get(&job.source).filter(|before| before.is_same_file(&alone)) {
            Some(before) => before.companions().cloned().collect(),
            None => companions(&job.source),
        };
        let stamp = match others.is_empty() {
            true => alone,
            false => Stamp::of(&job.source, others).ok()?,
        };
        Some((job.source, stamp))
    };
    Ok(intake::search(folder)?.into_iter().filter_map(look).collect())
}
