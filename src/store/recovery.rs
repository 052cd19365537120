//! How a store opens whatever state its database is in.
//!
//! The database is disposable: one that is damaged is renamed to `quarantine-<unix time>` and an empty one takes its
//! place. sled reports damage as an error or as a panic, so each operation on it runs in [`contained`]. The message
//! of such a panic still goes to the panic hook: replacing the hook is a race with every other thread.
//!
//! Damage is one thing, the state of the system another: permissions, a full disk or too many open files say
//! nothing of the database, and it stays where it is.

use std::any::Any;
use std::io::ErrorKind;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use std::{fs, thread};

use super::format::{self, Marker};
use super::interruption::point;
use super::manifest::{Manifest, unix_now};
use super::quarantine::Fault;
use super::{CacheKey, Digest, StoreError, chunk, files, generation, tally};

/// Left by a run that met damage after opening.
const SUSPECT: &str = "chladni.suspect";

/// The log within the directory of a database. Without it the database would be empty, and say nothing.
const LOG: &str = "db";

/// Databases set aside are named with this and the time.
const QUARANTINE: &str = "quarantine-";

/// What the database's pages in memory may take. Its default is 1 GiB; the artifacts in flight need that more, and a page that is
/// read again comes from the system.
const PAGE_CACHE: u64 = 4 << 20;

/// How long to wait for a lock on the database while the directory is ours: one that was just closed may stay locked
/// for a moment, through a copy of its handle in a process that is being started.
const PATIENCE: Duration = Duration::from_secs(2);

/// An open database and its three trees.
pub(super) struct Trees {
    pub database: sled::Db,
    pub manifests: sled::Tree,
    pub chunks: sled::Tree,
    pub quarantined: sled::Tree,
}

impl Trees {
    /// The record of every manifest, sound or not, with its key.
    pub fn records(&self) -> impl Iterator<Item = sled::Result<(CacheKey, sled::IVec)>> {
        self.manifests.iter().filter_map(|record| match record {
            Ok((key, record)) => {
                Some(Ok((CacheKey::from_bytes(key.as_ref().try_into().ok()?), record)))
            }
            Err(error) => Some(Err(error)),
        })
    }
}

/// A database that takes more than this times its entries, and as much beside, is copied at the next opening.
const SLACK: (u64, u64) = (3, 64 << 20);

/// Opens the database of `dir`, which is locked by us; sets a damaged one aside and starts anew, and copies one that takes
/// far more than its entries.
pub(super) fn open_trees(dir: &Path) -> Result<Trees, StoreError> {
    let marker = format::read(dir)?;
    generation::remove_others(dir)?;
    let database = generation::database(dir, generation::present(dir));
    if let Some(reason) = distrust(dir, marker, &database) {
        set_aside(dir, &database, &reason)?;
        files::remove_file(&suspect_path(dir))?;
        files::remove_file(&tally::path(dir))?;
    }
    if marker != Marker::Ours {
        format::write(dir)?;
    }
    let trees = match open_patiently(dir, &database) {
        Err(error) if is_damage(&error) => {
            set_aside(dir, &database, &error.to_string())?;
            files::remove_file(&tally::path(dir))?;
            return open_patiently(dir, &database);
        }
        opened => opened?,
    };
    tally::compare(dir, || contained(dir, "count the entries", || Ok(trees.manifests.len())))?;
    if !is_bloated(dir, &database, &trees) {
        return Ok(trees);
    }
    if let Err(error) = next_generation(dir, trees) {
        tracing::warn!(
            "the cache takes far more than what is in it, and cannot be copied: {error}"
        );
        // On a full disk half a copy is in the way.
        generation::remove_others(dir)?;
    }
    open_patiently(dir, &generation::database(dir, generation::present(dir)))
}

/// Whether the files take far more than the entries in them.
fn is_bloated(dir: &Path, database: &Path, trees: &Trees) -> bool {
    let (times, beside) = SLACK;
    let disk = super::stat::disk_bytes(database).unwrap_or(0);
    // The small ones need not be looked into.
    disk > beside
        && contained(dir, "measure the entries", || live_bytes(trees))
            .is_ok_and(|live| disk > times * live + beside)
}

fn live_bytes(trees: &Trees) -> sled::Result<u64> {
    let mut live = 0;
    for record in trees.records() {
        let (key, record) = record?;
        live += Manifest::decode(&key, &record).map_or(0, |manifest| manifest.length);
    }
    Ok(live)
}

/// Copies what is sound in `trees` to the next generation and makes that the present one.
pub(super) fn next_generation(dir: &Path, trees: Trees) -> Result<(), StoreError> {
    let next = generation::present(dir) + 1;
    let copy = open_patiently(dir, &generation::database(dir, next))?;
    contained(dir, "copy the database", || copy_all(&trees, &copy))?;
    drop((trees, copy));
    generation::promote(dir, next)?;
    contained(dir, "end the copy", point)?;
    generation::remove_others(dir)
}

/// Copies every entry whose bytes match their digests; what does not match is dropped, as a read would.
fn copy_all(from: &Trees, to: &Trees) -> sled::Result<()> {
    for record in from.records() {
        let (key, record) = record?;
        let Some(manifest) = Manifest::decode(&key, &record) else { continue };
        match chunk::read(&from.chunks, &key, manifest.length)? {
            Ok(bytes) if Digest::of(&bytes) == manifest.digest() => {
                chunk::write(&to.chunks, &key, &bytes)?;
                to.manifests.insert(key.as_bytes(), record)?;
                point()?;
            }
            Ok(_) => Fault::Whole.warn(&key),
            Err(fault) => Fault::Chunk(fault).warn(&key),
        }
    }
    for record in &from.quarantined {
        let (key, record) = record?;
        to.quarantined.insert(key, record)?;
    }
    to.database.flush()?;
    Ok(())
}

/// The databases of `dir` that were set aside.
pub(super) fn set_aside_in(dir: &Path) -> Result<Vec<PathBuf>, StoreError> {
    let mut found = Vec::new();
    for item in fs::read_dir(dir).map_err(files::refused("read", dir))? {
        let item = item.map_err(files::refused("read", dir))?;
        if item.file_name().to_string_lossy().starts_with(QUARANTINE) {
            found.push(item.path());
        }
    }
    Ok(found)
}

/// Removes the databases that were set aside, or only tells what they take.
pub(super) fn remove_set_aside(dir: &Path, remove: bool) -> Result<u64, StoreError> {
    let mut bytes = 0;
    for path in set_aside_in(dir)? {
        bytes += super::stat::disk_bytes_of(&path)?;
        if remove {
            files::remove_folder(&path)?;
        }
    }
    Ok(bytes)
}

/// Removes all databases of `dir`.
pub(super) fn remove_all(dir: &Path) -> Result<(), StoreError> {
    generation::remove_others(dir)?;
    files::remove_folder(&generation::database(dir, generation::present(dir)))?;
    files::remove_file(&suspect_path(dir))?;
    files::remove_file(&tally::path(dir))?;
    remove_set_aside(dir, true).map(drop)
}

/// Runs an operation of the database; a panic becomes [`StoreError::Panicked`].
pub(super) fn contained<T>(
    dir: &Path,
    doing: &'static str,
    operation: impl FnOnce() -> sled::Result<T>,
) -> Result<T, StoreError> {
    // What a panic may leave half done is on the far side of the digests, or in sled, which is then suspect.
    match catch_unwind(AssertUnwindSafe(operation)) {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(source)) => Err(StoreError::Database { doing, dir: dir.to_owned(), source }),
        Err(panic) => Err(StoreError::Panicked {
            doing,
            dir: dir.to_owned(),
            message: message(panic.as_ref()),
        }),
    }
}

/// Where the note of a run lies that met damage.
pub(super) fn suspect_path(dir: &Path) -> PathBuf {
    dir.join(SUSPECT)
}

/// If `error` is damage, leaves a note on which the next opening sets the database aside.
pub(super) fn suspect(dir: &Path, error: &StoreError) {
    if is_damage(error)
        && let Err(refused) = fs::write(suspect_path(dir), format!("{error}\n"))
    {
        tracing::warn!(%refused, %error, "the cache is damaged and cannot be marked so; delete it");
    }
}

/// Why the database must not be opened, if there is a reason.
fn distrust(dir: &Path, marker: Marker, database: &Path) -> Option<String> {
    if !database.exists() {
        return None;
    }
    match marker {
        Marker::Ours if !database.join(LOG).exists() => Some("its log is gone".to_owned()),
        Marker::Ours => {
            fs::read_to_string(suspect_path(dir)).ok().map(|note| note.trim_end().to_owned())
        }
        Marker::Older(version) => Some(format!("it has the old format {version}")),
        Marker::Absent => Some("its format is not marked".to_owned()),
        Marker::Unreadable => Some("its format marker cannot be read".to_owned()),
    }
}

/// Renames the database to a `quarantine-<unix time>` that does not exist yet.
fn set_aside(dir: &Path, database: &Path, reason: &str) -> Result<(), StoreError> {
    let now = unix_now();
    let names = (1..).map(|n| match n {
        1 => format!("{QUARANTINE}{now}"),
        n => format!("{QUARANTINE}{now}-{n}"),
    });
    let target: PathBuf = names
        .map(|name| dir.join(name))
        .find(|path| !path.exists())
        .unwrap_or_else(|| dir.join(QUARANTINE));
    fs::rename(database, &target).map_err(files::refused("set aside", database))?;
    tracing::warn!(
        reason,
        moved_to = %target.display(),
        "the cache cannot be used; it is set aside and a new one started",
    );
    Ok(())
}

fn open_patiently(dir: &Path, database: &Path) -> Result<Trees, StoreError> {
    let start = Instant::now();
    loop {
        match contained(dir, "open the database", || open(database)) {
            Err(error) if is_locked(&error) => {
                if start.elapsed() > PATIENCE {
                    return Err(StoreError::Locked { dir: dir.to_owned(), holder: None });
                }
                thread::sleep(Duration::from_millis(20));
            }
            opened => return opened,
        }
    }
}

fn open(path: &Path) -> sled::Result<Trees> {
    let database = sled::Config::new().path(path).cache_capacity(PAGE_CACHE).open()?;
    Ok(Trees {
        manifests: database.open_tree("manifests")?,
        chunks: database.open_tree("chunks")?,
        quarantined: database.open_tree("quarantined")?,
        database,
    })
}

/// Whether sled's own lock is held. It reports that as any other error, so its words have to tell.
fn is_locked(error: &StoreError) -> bool {
    matches!(
        error,
        StoreError::Database { source: sled::Error::Io(io), .. }
            if io.kind() == ErrorKind::Other && io.to_string().contains("could not acquire lock")
    )
}

/// Whether an error speaks of the database's files rather than of the system's state.
fn is_damage(error: &StoreError) -> bool {
    match error {
        StoreError::Panicked { .. } => true,
        StoreError::Database { source, .. } => match source {
            sled::Error::Io(io) => {
                // ENFILE and EMFILE, too many open files, have no kind of their own.
                !is_locked(error)
                    && !matches!(io.raw_os_error(), Some(23 | 24))
                    && !matches!(
                        io.kind(),
                        ErrorKind::PermissionDenied
                            | ErrorKind::ReadOnlyFilesystem
                            | ErrorKind::StorageFull
                            | ErrorKind::QuotaExceeded
                            | ErrorKind::OutOfMemory
                            | ErrorKind::Interrupted
                            | ErrorKind::TimedOut
                    )
            }
            _ => true,
        },
        _ => false,
    }
}

fn message(panic: &(dyn Any + Send)) -> String {
    let text = panic
        .downcast_ref::<&str>()
        .copied()
        .or_else(|| panic.downcast_ref::<String>().map(String::as_str));
    text.unwrap_or("no message").to_owned()
}
