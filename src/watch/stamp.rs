//! Whether a file is the one that it was: its size, its times, and which file it is.
//!
//! Size and time of change alone miss a file that another one with the same of both was renamed over, and a write within the
//! clock's grain; a change of the inode's own time is seen whatever a program sets the file's time to.

use std::fs::Metadata;
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

/// What one look at a file and those that belong to it shows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stamp {
    own: Look,
    /// Of each file that belongs to it; one that is not there is part of what was seen.
    companions: Vec<(PathBuf, Option<Look>)>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Look {
    length: u64,
    modified: Option<SystemTime>,
    /// When the inode was changed, whatever a program sets the file's time to; where there are none, as `modified`.
    written: Option<SystemTime>,
    /// The inode's number.
    number: u64,
}

impl Stamp {
    /// Looks at a file, and at its `companions`. Links are followed: a change of what they point to is a change.
    ///
    /// # Errors
    /// What the system says of the file itself.
    pub fn of(path: &Path, companions: Vec<PathBuf>) -> io::Result<Self> {
        let own = look(path)?;
        let companions = companions.into_iter().map(|path| {
            let seen = look(&path).ok();
            (path, seen)
        });
        Ok(Self { own, companions: companions.collect() })
    }

    /// Whether it is the same file as at the time of another look, its companions aside.
    pub fn is_same_file(&self, other: &Self) -> bool {
        self.own == other.own
    }

    /// When the file became what it is: written, or put in its place.
    pub fn written(&self) -> Option<SystemTime> {
        self.own.written
    }

    /// The files that belong to it.
    pub fn companions(&self) -> impl Iterator<Item = &PathBuf> {
        self.companions.iter().map(|(path, _)| path)
    }
}

fn look(path: &Path) -> io::Result<Look> {
    let metadata = std::fs::metadata(path)?;
    let (written, number) = inode(&metadata);
    Ok(Look { length: metadata.len(), modified: metadata.modified().ok(), written, number })
}

#[cfg(unix)]
fn inode(metadata: &Metadata) -> (Option<SystemTime>, u64) {
    use std::os::unix::fs::MetadataExt;
    let since = Duration::new(metadata.ctime().max(0) as u64, metadata.ctime_nsec() as u32);
    (SystemTime::UNIX_EPOCH.checked_add(since), metadata.ino())
}

#[cfg(not(unix))]
fn inode(metadata: &Metadata) -> (Option<SystemTime>, u64) {
    (metadata.modified().ok(), 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn writing_renaming_over_and_a_companion_are_seen_and_reading_is_not() {
        let dir = tempfile::tempdir().unwrap();
        let [file, other, beside] = ["a.gltf", "b.tmp", "a.bin"].map(|name| dir.path().join(name));
        fs::write(&file, "one").unwrap();
        let stamp = || Stamp::of(&file, vec![beside.clone()]).unwrap();
        let mut seen = stamp();
        fs::read(&file).unwrap();
        assert_eq!(stamp(), seen);
        let mut changes = |change: &dyn Fn()| {
            change();
            let now = stamp();
            let differs = now != seen;
            seen = now;
            differs
        };
        assert!(changes(&|| fs::write(&file, "longer").unwrap()));
        // Of the same length and time.
        let modified = fs::metadata(&file).unwrap().modified().unwrap();
        let disguised = || {
            fs::write(&other, "shorty").unwrap();
            fs::File::options().write(true).open(&other).unwrap().set_modified(modified).unwrap();
            fs::rename(&other, &file).unwrap();
        };
        assert!(changes(&disguised));
        assert!(changes(&|| fs::write(&beside, "bytes").unwrap()));
        assert!(changes(&|| fs::remove_file(&beside).unwrap()));
        assert!(!changes(&|| ()));
        assert!(Stamp::of(&other, vec![]).is_err());
    }
}
