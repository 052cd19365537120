//! Which meshes of a watched folder have results: `watched.json` in the output folder, for the next watch of that folder.
//!
//! What has results and is no longer there when that one begins was deleted meanwhile. Results that somebody else has left are
//! in no such list.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::json::document;
use super::{PublishError, write_if_changed};

const FILE: &str = "watched.json";

/// The list.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct KeptCurrent {
    /// The folder that is watched.
    pub folder: String,
    /// Which one it is to the system: where a file system is not mounted there is another one.
    pub identity: Option<(u64, u64)>,
    /// The meshes, by name.
    pub meshes: BTreeSet<String>,
}

impl KeptCurrent {
    /// Those of `folder`.
    pub fn of(folder: &Path, meshes: BTreeSet<String>) -> Self {
        Self { folder: folder.display().to_string(), identity: identity(folder), meshes }
    }

    /// The meshes of the last watch of `folder` into `out`; none where there was no such watch, or the folder is another one.
    pub fn last(out: &Path, folder: &Path) -> BTreeSet<String> {
        let bytes = fs::read(out.join(FILE)).unwrap_or_default();
        let list = serde_json::from_slice::<Self>(&bytes).ok();
        let now = Self::of(folder, BTreeSet::new());
        let same = |list: &Self| (&list.folder, list.identity) == (&now.folder, now.identity);
        list.filter(same).map(|list| list.meshes).unwrap_or_default()
    }

    /// Writes it into `out`.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn write(&self, out: &Path) -> Result<(), PublishError> {
        write_if_changed(&out.join(FILE), &document(self)).map(drop)
    }
}

#[cfg(unix)]
fn identity(folder: &Path) -> Option<(u64, u64)> {
    use std::os::unix::fs::MetadataExt;
    let metadata = fs::metadata(folder).ok()?;
    Some((metadata.dev(), metadata.ino()))
}

#[cfg(not(unix))]
fn identity(_folder: &Path) -> Option<(u64, u64)> {
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_list_is_that_of_the_folder_alone() {
        let [out, folder, other] = [(); 3].map(|()| tempfile::tempdir().unwrap());
        let meshes = BTreeSet::from(["a.obj".to_string()]);
        assert!(KeptCurrent::last(out.path(), folder.path()).is_empty());
        KeptCurrent::of(folder.path(), meshes.clone()).write(out.path()).unwrap();
        assert_eq!(KeptCurrent::last(out.path(), folder.path()), meshes);
        assert!(KeptCurrent::last(out.path(), other.path()).is_empty());
        // Another folder in its place.
        let path = folder.path().to_owned();
        fs::rename(&path, other.path().join("aside")).unwrap();
        fs::create_dir(&path).unwrap();
        assert!(KeptCurrent::last(out.path(), &path).is_empty());
    }
}
