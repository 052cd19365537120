//! What can go wrong with the store that the caller should hear about.
//!
//! Damage is not among it: a damaged entry reads as absent and a damaged database is set aside, both with a
//! warning. What is left are the cases where the user has to decide.

use std::io::{self, ErrorKind};
use std::path::PathBuf;

/// Why the store cannot be opened or written. The message says what happened, where, and what to do.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The system refuses something in the cache directory: usually permissions, a read-only or full disk, or a
    /// file system without locks.
    #[error(
        "cannot {doing} {}: {source}; the cache needs a writable directory with free space on a local disk \
         (choose one with --cache DIR or CHLADNI_CACHE)",
        path.display()
    )]
    Directory { doing: &'static str, path: PathBuf, source: io::Error },
    /// Another process, or another `Store` of this one, holds the directory. `holder` is its process number,
    /// where it could be read.
    #[error(
        "the cache in {} is in use by {}; wait until it ends, or use another directory \
         (--cache DIR or CHLADNI_CACHE)",
        dir.display(),
        holder.map_or("another process".to_owned(), |pid| format!("process {pid}"))
    )]
    Locked { dir: PathBuf, holder: Option<u32> },
    /// A newer chladni wrote this directory. Nothing in it was touched.
    #[error(
        "the cache {} has format {found}, and this chladni knows formats up to {known}; update chladni, or use \
         another directory (--cache DIR or CHLADNI_CACHE)",
        dir.display()
    )]
    NewerFormat { dir: PathBuf, found: u32, known: u32 },
    /// The database refuses an operation.
    #[error(
        "cannot {doing} in the cache {}: {source}; check the disk and its free space: if the database is \
         damaged, the next run sets it aside and starts a new one",
        dir.display()
    )]
    Database { doing: &'static str, dir: PathBuf, source: sled::Error },
    /// The database panicked, which it does on some kinds of damage to its files.
    #[error(
        "cannot {doing} in the cache {}: the database panicked ({message}); the next run sets it aside and \
         starts a new one",
        dir.display()
    )]
    Panicked { doing: &'static str, dir: PathBuf, message: String },
    /// The disk is full, or this user's part of it.
    #[error(
        "the disk of the cache {} has no room for {bytes} bytes more ({free} are free); make room there, or use another \
         directory (--cache DIR or CHLADNI_CACHE)",
        dir.display()
    )]
    Full { dir: PathBuf, bytes: u64, free: u64 },
    /// A cache that cannot be written would have to be copied, and is too large for that.
    #[error(
        "the cache {} takes {bytes} bytes, and at most {most} are copied to the temporary folder; copy it to a place \
         that can be written and name that with --cache DIR or CHLADNI_CACHE",
        dir.display()
    )]
    TooLarge { dir: PathBuf, bytes: u64, most: u64 },
    /// An artifact cannot be written as bytes: more than 2 GiB, or a type that rkyv cannot serialize.
    #[error("the result of stage {stage} cannot be encoded for the cache: {source}")]
    Encode { stage: &'static str, source: rkyv::rancor::Error },
}

impl StoreError {
    /// Whether the cache cannot be written as things are, though it may well be read: permissions, a read-only file system, a
    /// full disk.
    pub fn is_unwritable(&self) -> bool {
        let kinds = [ErrorKind::PermissionDenied, ErrorKind::ReadOnlyFilesystem];
        self.is_full() || self.kind().is_some_and(|kind| kinds.contains(&kind))
    }

    /// Whether there is no room: on the disk, for this user, or for a copy.
    pub fn is_full(&self) -> bool {
        let kinds = [ErrorKind::StorageFull, ErrorKind::QuotaExceeded];
        matches!(self, Self::Full { .. } | Self::TooLarge { .. })
            || self.kind().is_some_and(|kind| kinds.contains(&kind))
    }

    /// What the system says.
    fn kind(&self) -> Option<ErrorKind> {
        match self {
            Self::Directory { source, .. } => Some(source.kind()),
            Self::Database { source: sled::Error::Io(source), .. } => Some(source.kind()),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_say_where_and_what_to_do() {
        let locked = StoreError::Locked { dir: "work/cache".into(), holder: Some(4711) };
        assert_eq!(
            locked.to_string(),
            "the cache in work/cache is in use by process 4711; wait until it ends, or use another directory \
             (--cache DIR or CHLADNI_CACHE)"
        );
        let unknown = StoreError::Locked { dir: "work/cache".into(), holder: None };
        assert!(unknown.to_string().contains("in use by another process;"));
        let refused = StoreError::Directory {
            doing: "create",
            path: "work/cache".into(),
            source: ErrorKind::PermissionDenied.into(),
        };
        assert!(refused.to_string().starts_with("cannot create work/cache: permission denied; "));
    }
}
