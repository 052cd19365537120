//! Which database of a directory is the present one, and how a slimmer one takes its place.
//!
//! sled does not give back all the room of what was replaced or removed. When the files take far more than the entries in
//! them, the entries are copied to a new database, the next generation, and the file `chladni.generation` is replaced, which
//! is one rename: before it the old database counts, after it the new one. What a crash leaves of either is removed at the
//! next opening. Generations have directories of their own, since a closed sled may write to its own for a moment more.

use std::fs;
use std::path::{Path, PathBuf};

use super::{StoreError, files};

/// Says which generation counts; the first one needs no file.
const FILE: &str = "chladni.generation";

/// The directory of the first generation; those of others have their number behind it.
const DATABASE: &str = "chladni.sled";

/// Where the number of the generation that counts stands.
pub(super) fn path(dir: &Path) -> PathBuf {
    dir.join(FILE)
}

/// The number of the generation that counts.
pub(super) fn present(dir: &Path) -> u64 {
    // A file that cannot be read costs a cache, as a damaged database does.
    let content = fs::read_to_string(path(dir)).ok();
    content.and_then(|text| text.trim_end().parse().ok()).unwrap_or(1)
}

/// Where the database of a generation lies.
pub(super) fn database(dir: &Path, generation: u64) -> PathBuf {
    match generation {
        1 => dir.join(DATABASE),
        _ => dir.join(format!("{DATABASE}-{generation}")),
    }
}

/// Makes `generation` the one that counts.
pub(super) fn promote(dir: &Path, generation: u64) -> Result<(), StoreError> {
    files::replace(&path(dir), &generation.to_string())
}

/// Removes the databases of all generations but the present one.
pub(super) fn remove_others(dir: &Path) -> Result<(), StoreError> {
    let kept = database(dir, present(dir));
    for item in fs::read_dir(dir).map_err(files::refused("read", dir))? {
        let path = item.map_err(files::refused("read", dir))?.path();
        let is_database = path.file_name().is_some_and(|name| is_database(&name.to_string_lossy()));
        if is_database && path != kept {
            files::remove_folder(&path)?;
        }
    }
    Ok(())
}

fn is_database(name: &str) -> bool {
    name.strip_prefix(DATABASE).is_some_and(|rest| {
        rest.is_empty()
            || rest.strip_prefix('-').is_some_and(|number| number.parse::<u64>().is_ok())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_present_generation_stays() {
        let dir = tempfile::tempdir().unwrap();
        assert_eq!(present(dir.path()), 1);
        for name in ["chladni.sled", "chladni.sled-2", "chladni.sled-3", "chladni.sled-x", "other"]
        {
            fs::create_dir(dir.path().join(name)).unwrap();
        }
        promote(dir.path(), 2).unwrap();
        assert_eq!(database(dir.path(), present(dir.path())), dir.path().join("chladni.sled-2"));
        remove_others(dir.path()).unwrap();
        let mut left: Vec<_> = fs::read_dir(dir.path())
            .unwrap()
            .map(|item| item.unwrap().file_name().into_string().unwrap())
            .collect();
        left.sort();
        assert_eq!(left, ["chladni.generation", "chladni.sled-2", "chladni.sled-x", "other"]);
        fs::write(dir.path().join("chladni.generation"), "two").unwrap();
        assert_eq!(present(dir.path()), 1);
    }
}
