//! How far a run is, for other processes: `status.json` in its output folder.
//!
//! The run renames a new one into place about once a second, and holds a lock on `status.lock` beside it for as long as it
//! lives, however it ends. Who finds the lock free knows that the file is the last word of a run that is over.

use std::fs::{File, OpenOptions, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::json::{document, null_is_nan};
use super::{PublishError, write};

const FILE: &str = "status.json";
const LOCK: &str = "status.lock";

/// The format of `status.json`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum RunStatusSchema {
    /// The one that [`RunStatus`] describes.
    #[default]
    #[serde(rename = "chladni-status-1")]
    V1,
}

/// How far a run is.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunStatus {
    /// The format.
    pub schema: RunStatusSchema,
    /// Whether it goes on.
    pub state: RunState,
    /// The number of its process.
    pub process: u32,
    /// When it began, in seconds since 1970.
    pub started: u64,
    /// When this was written, in seconds since 1970.
    pub updated: u64,
    /// The folder that it keeps current; absent for a run over a list.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub watches: Option<String>,
    /// Of a sweep: the folder of the variant and seed, below that of the sweep.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part: Option<String>,
    /// All meshes.
    pub meshes: usize,
    /// Those whose eigenpairs passed.
    pub verified: usize,
    /// Those of which some pair did not.
    pub unverified: usize,
    /// Those that could not be processed.
    pub failed: usize,
    /// Those that have not been begun.
    pub waiting: usize,
    /// Those that are being worked on, in the order of the input.
    pub under_way: Vec<UnderWay>,
    /// Meshes that were done in an hour, so far.
    #[serde(deserialize_with = "null_is_nan")]
    pub per_hour: f64,
    /// What is left at this rate; unknown before the first mesh is done.
    pub seconds_left: Option<f64>,
}

impl RunStatus {
    /// How many meshes are done.
    pub fn done(&self) -> usize {
        self.verified + self.unverified + self.failed
    }

    /// How many meshes are done, and how they ended.
    pub fn summary(&self) -> String {
        let Self { meshes, verified, unverified, failed, .. } = self;
        let done = self.done();
        format!(
            "{done} of {meshes} meshes done: {verified} verified, {unverified} unverified, {failed} failed"
        )
    }

    /// How fast it goes, and how long it will; `None` before that is known, and when nothing is left.
    pub fn rate(&self) -> Option<String> {
        let left =
            self.seconds_left.filter(|&left| self.state == RunState::Running && left > 0.0)?;
        Some(format!("{:.0} an hour, about {} left", self.per_hour, duration(left)))
    }

    /// What has to be known of it, in one line that may be cut at its end.
    pub fn line(&self) -> String {
        let Self { meshes, unverified, failed, .. } = self;
        let done = format!("{} of {meshes} meshes done", self.done());
        let but = [(unverified, "unverified"), (failed, "failed")];
        let but = but.into_iter().filter(|(count, _)| **count > 0);
        let but = but.map(|(count, how)| format!("{count} {how}"));
        let under_way = self.under_way.iter().map(|mesh| format!("{}: {}", mesh.path, mesh.stage));
        let parts = [done].into_iter().chain(but).chain(self.rate()).chain(under_way);
        parts.collect::<Vec<_>>().join("; ")
    }
}

/// 75 s as "1 min 15 s".
pub fn duration(seconds: f64) -> String {
    let whole = seconds.max(0.0).round() as u64;
    match (whole / 3600, whole / 60 % 60, whole % 60) {
        (0, 0, seconds) => format!("{seconds} s"),
        (0, minutes, seconds) => format!("{minutes} min {seconds} s"),
        (hours, minutes, _) => format!("{hours} h {minutes} min"),
    }
}

/// Whether a run goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RunState {
    /// It does.
    Running,
    /// What there was to do is done.
    Finished,
    /// It was stopped, and kept what was finished.
    Interrupted,
    /// Its process has ended without a word.
    Killed,
}

/// A mesh that is being worked on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct UnderWay {
    /// Which one, as in the report.
    pub path: String,
    /// The stage that it is in.
    pub stage: String,
    /// How long it has been in it.
    #[serde(deserialize_with = "null_is_nan")]
    pub seconds: f64,
}

/// The place where a run says how far it is, until it is dropped.
#[derive(Debug)]
pub struct StatusFile {
    path: PathBuf,
    _lock: File,
}

impl StatusFile {
    /// Takes the place in the output folder `out`, which must exist; `None` while another run has it.
    ///
    /// # Errors
    /// What the system says.
    pub fn take(out: &Path) -> io::Result<Option<Self>> {
        let lock = lock_file(out)?;
        match lock.try_lock() {
            Ok(()) => Ok(Some(Self { path: out.join(FILE), _lock: lock })),
            Err(TryLockError::WouldBlock) => Ok(None),
            Err(TryLockError::Error(error)) => Err(error),
        }
    }

    /// Says how far the run is.
    ///
    /// # Errors
    /// When the system refuses; what was said before stays.
    pub fn write(&self, status: &RunStatus) -> Result<(), PublishError> {
        write(&self.path, &document(status))
    }
}

/// What the last run into `out` has said, with [`RunState::Killed`] for one that has ended without saying so; `None` if there
/// was none.
///
/// # Errors
/// What the system says, or when the file is no status.
pub fn read(out: &Path) -> io::Result<Option<RunStatus>> {
    let bytes = match std::fs::read(out.join(FILE)) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        bytes => bytes?,
    };
    let mut status: RunStatus = serde_json::from_slice(&bytes)?;
    if status.state == RunState::Running && !is_held(out)? {
        // It may have ended between the two looks.
        status = serde_json::from_slice(&std::fs::read(out.join(FILE))?)?;
        if status.state == RunState::Running {
            status.state = RunState::Killed;
        }
    }
    Ok(Some(status))
}

/// Of a sweep, whose variants and seeds have folders below `out`: the status of the one that is under way, or was last. Folders
/// that tell of no run are passed over.
pub fn read_sweep(out: &Path) -> Option<RunStatus> {
    let seeds = folders(out).flat_map(|variant| folders(&variant));
    let of_seed = |seed: PathBuf| {
        let status = read(&seed).ok().flatten()?;
        let written = std::fs::metadata(seed.join(FILE)).and_then(|file| file.modified()).ok();
        let part = seed.strip_prefix(out).unwrap_or(&seed).display().to_string();
        Some((written, RunStatus { part: Some(part), ..status }))
    };
    let last = seeds.filter_map(of_seed);
    Some(last.max_by_key(|(written, status)| (status.state == RunState::Running, *written))?.1)
}

fn folders(folder: &Path) -> impl Iterator<Item = PathBuf> + use<> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.map(|entry| entry.path()).filter(|path| path.is_dir())
}

fn is_held(out: &Path) -> io::Result<bool> {
    // Sharing is enough to see, and two that look do not see one another.
    match lock_file(out)?.try_lock_shared() {
        Ok(()) => Ok(false),
        Err(TryLockError::WouldBlock) => Ok(true),
        Err(TryLockError::Error(error)) => Err(error),
    }
}

fn lock_file(out: &Path) -> io::Result<File> {
    OpenOptions::new().read(true).write(true).create(true).truncate(false).open(out.join(LOCK))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn status(state: RunState) -> RunStatus {
        RunStatus {
            schema: RunStatusSchema::V1,
            state,
            process: 1,
            started: 2,
            updated: 3,
            watches: None,
            part: None,
            meshes: 4,
            verified: 1,
            unverified: 0,
            failed: 1,
            waiting: 1,
            under_way: vec![UnderWay { path: "a".into(), stage: "train".into(), seconds: 0.5 }],
            per_hour: 7.0,
            seconds_left: None,
        }
    }

    #[test]
    fn a_run_that_ends_without_a_word_was_killed() {
        let dir = tempfile::tempdir().unwrap();
        assert_eq!(read(dir.path()).unwrap(), None);
        let file = StatusFile::take(dir.path()).unwrap().unwrap();
        assert!(StatusFile::take(dir.path()).unwrap().is_none());
        file.write(&status(RunState::Running)).unwrap();
        assert_eq!(read(dir.path()).unwrap(), Some(status(RunState::Running)));
        drop(file);
        assert_eq!(read(dir.path()).unwrap(), Some(status(RunState::Killed)));
        let file = StatusFile::take(dir.path()).unwrap().unwrap();
        file.write(&status(RunState::Finished)).unwrap();
        drop(file);
        assert_eq!(read(dir.path()).unwrap(), Some(status(RunState::Finished)));
    }

    #[test]
    fn a_status_is_one_line_and_durations_are_read_at_a_glance() {
        let status = RunStatus { seconds_left: Some(75.0), ..status(RunState::Running) };
        assert_eq!(
            status.line(),
            "2 of 4 meshes done; 1 failed; 7 an hour, about 1 min 15 s left; a: train"
        );
        let texts = [0.2, 59.0, 75.0, 3600.0, 93_784.0].map(duration);
        assert_eq!(texts, ["0 s", "59 s", "1 min 15 s", "1 h 0 min", "26 h 3 min"]);
    }
}
