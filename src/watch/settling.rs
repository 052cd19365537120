//! When a file that has changed is ready: the memory of one look for the next.
//!
//! A file is ready when two looks, some time apart, show the same; exporters write large files slowly, and many programs
//! write in several goes. It is gone when two looks do not find it: a save may remove it for a moment. One that was ready and
//! could not be read is looked at again, after longer and longer times, and never dropped: it may be half of something.
//!
//! Nothing here touches a clock or a disk: the caller looks, and says when.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::stamp::Stamp;

/// How long a file has to stay as it is before it is ready.
pub const QUIET: Duration = Duration::from_millis(120);

/// The first and the longest wait before a file is tried again that could not be read.
const FIRST_RETRY: Duration = Duration::from_millis(500);
const LAST_RETRY: Duration = Duration::from_secs(30);

/// What has become of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Change {
    /// It is not as it was, and perhaps not yet as it will be.
    Moving(PathBuf),
    /// It is new, or another than it was, and ready to be read.
    Ready(PathBuf, Stamp),
    /// It is no longer there.
    Gone(PathBuf),
}

impl Change {
    /// The file, if it is ready to be read.
    pub fn ready(&self) -> Option<&PathBuf> {
        match self {
            Self::Ready(path, _) => Some(path),
            Self::Moving(_) | Self::Gone(_) => None,
        }
    }
}

/// All files that were seen, and how far they are.
#[derive(Debug, Default)]
pub struct Settling {
    files: BTreeMap<PathBuf, State>,
}

#[derive(Debug)]
enum State {
    /// It was seen so for the first time then.
    Moving { stamp: Stamp, since: Instant, was_known: bool },
    /// It was found ready.
    Known { stamp: Stamp, retry: Option<Retry> },
    /// It was not found, for the first time then.
    Missing { since: Instant, was_known: bool },
}

/// A file that could not be read.
#[derive(Debug, Clone, Copy)]
struct Retry {
    at: Instant,
    wait: Duration,
}

impl Settling {
    /// These files were known before the first look: those that it and another do not find are gone.
    pub fn remembers(&mut self, now: Instant, paths: impl IntoIterator<Item = PathBuf>) {
        let missing = || State::Missing { since: now, was_known: true };
        self.files.extend(paths.into_iter().map(|path| (path, missing())));
    }

    /// Takes note of a look at all files, and returns what has become of them since.
    pub fn look(&mut self, now: Instant, seen: BTreeMap<PathBuf, Stamp>) -> Vec<Change> {
        let mut changes = Vec::new();
        for (path, state) in &mut self.files {
            if !seen.contains_key(path) {
                state.not_found(now);
            }
        }
        self.files.retain(|path, state| match state {
            State::Missing { since, was_known } if *since + QUIET <= now => {
                if *was_known {
                    changes.push(Change::Gone(path.clone()));
                }
                false
            }
            _ => true,
        });
        for (path, stamp) in seen {
            let found = match self.files.entry(path.clone()) {
                Entry::Occupied(state) => state.into_mut().found(now, &stamp),
                Entry::Vacant(place) => {
                    let stamp = stamp.clone();
                    place.insert(State::Moving { stamp, since: now, was_known: false });
                    Found::Moving
                }
            };
            match found {
                Found::AsItWas => {}
                Found::Moving => changes.push(Change::Moving(path)),
                Found::Ready => changes.push(Change::Ready(path, stamp)),
            }
        }
        changes
    }

    /// The file that was ready with this stamp could not be read.
    pub fn unreadable(&mut self, now: Instant, path: &Path, read: &Stamp) {
        if let Some(State::Known { stamp, retry }) = self.files.get_mut(path)
            && stamp == read
        {
            let wait = retry.map_or(FIRST_RETRY, |retry| (2 * retry.wait).min(LAST_RETRY));
            *retry = Some(Retry { at: now + wait, wait });
        }
    }

    /// The file that was ready with this stamp was read, and is what it is.
    pub fn read(&mut self, path: &Path, read: &Stamp) {
        if let Some(State::Known { stamp, retry }) = self.files.get_mut(path)
            && stamp == read
        {
            *retry = None;
        }
    }

    /// When the next look is due, if nothing happens before.
    pub fn next_look(&self) -> Option<Instant> {
        let due = self.files.values().filter_map(|state| match state {
            State::Moving { since, .. } | State::Missing { since, .. } => Some(*since + QUIET),
            State::Known { retry, .. } => retry.map(|retry| retry.at),
        });
        due.min()
    }

    /// Whether every file was found ready, or could not be read so far.
    pub fn is_quiet(&self) -> bool {
        self.files.values().all(|state| matches!(state, State::Known { .. }))
    }
}

impl State {
    fn not_found(&mut self, now: Instant) {
        *self = match self {
            Self::Missing { .. } => return,
            Self::Known { .. } => Self::Missing { since: now, was_known: true },
            Self::Moving { was_known, .. } => Self::Missing { since: now, was_known: *was_known },
        };
    }

    /// What it means that the file is there, and is so.
    fn found(&mut self, now: Instant, seen: &Stamp) -> Found {
        match self {
            Self::Known { stamp, retry } if stamp == seen => match retry {
                Some(retry) if retry.at <= now => {
                    // Until it is tried, and found wanting again.
                    retry.at = now + LAST_RETRY;
                    Found::Ready
                }
                _ => Found::AsItWas,
            },
            Self::Moving { stamp, since, .. } if stamp == seen => {
                if now < *since + QUIET {
                    return Found::AsItWas;
                }
                *self = Self::Known { stamp: seen.clone(), retry: None };
                Found::Ready
            }
            Self::Moving { was_known, .. } => {
                *self = Self::Moving { stamp: seen.clone(), since: now, was_known: *was_known };
                // That was said when it began.
                Found::AsItWas
            }
            Self::Known { .. } => {
                *self = Self::Moving { stamp: seen.clone(), since: now, was_known: true };
                Found::Moving
            }
            Self::Missing { was_known, .. } => {
                *self = Self::Moving { stamp: seen.clone(), since: now, was_known: *was_known };
                Found::Moving
            }
        }
    }
}

/// What a file that is there is, beside the looks before.
enum Found {
    AsItWas,
    Moving,
    Ready,
}

#[cfg(test)]
mod tests {
    use super::*;
    use tempfile::TempDir;

    /// Files whose looks are told, not taken.
    struct Told {
        dir: TempDir,
        start: Instant,
        settling: Settling,
    }

    impl Told {
        fn new() -> Self {
            Self {
                dir: tempfile::tempdir().unwrap(),
                start: Instant::now(),
                settling: Settling::default(),
            }
        }

        /// A look after so many milliseconds at files with these contents: names of what is ready, `~` before what
        /// moves, `-` before what is gone.
        fn look(&mut self, after: u64, files: &[(&str, &str)]) -> Vec<String> {
            let seen = files.iter().map(|(name, text)| {
                // Files of one length are one stamp: the test needs no clock.
                let file = self.dir.path().join(text);
                if !file.exists() {
                    std::fs::write(&file, text).unwrap();
                }
                (PathBuf::from(name), Stamp::of(&file, vec![]).unwrap())
            });
            let seen = seen.collect();
            let now = self.start + Duration::from_millis(after);
            let changes = self.settling.look(now, seen);
            let named = changes.into_iter().map(|change| match change {
                Change::Moving(path) => format!("~{}", path.display()),
                Change::Ready(path, _) => path.display().to_string(),
                Change::Gone(path) => format!("-{}", path.display()),
            });
            named.collect()
        }

        fn unreadable(&mut self, after: u64, name: &str, text: &str) {
            let stamp = Stamp::of(&self.dir.path().join(text), vec![]).unwrap();
            let now = self.start + Duration::from_millis(after);
            self.settling.unreadable(now, Path::new(name), &stamp);
        }
    }

    const NOTHING: [String; 0] = [];

    #[test]
    fn a_file_is_ready_once_when_two_looks_agree() {
        let mut told = Told::new();
        assert_eq!(told.look(0, &[("a", "1")]), ["~a"]);
        assert_eq!(told.look(60, &[("a", "1")]), NOTHING);
        assert_eq!(told.look(120, &[("a", "1")]), ["a"]);
        assert_eq!(told.look(500, &[("a", "1")]), NOTHING);
        assert!(told.settling.is_quiet() && told.settling.next_look().is_none());
    }

    #[test]
    fn a_slow_write_is_waited_for() {
        let mut told = Told::new();
        for (step, text) in ["1", "12", "123", "1234"].into_iter().enumerate() {
            let said: &[&str] = if step == 0 { &["~a"] } else { &[] };
            assert_eq!(told.look(100 * step as u64, &[("a", text)]), said);
        }
        assert!(!told.settling.is_quiet());
        assert_eq!(told.look(420, &[("a", "1234")]), ["a"]);
    }

    #[test]
    fn a_save_that_removes_the_file_for_a_moment_is_a_change_and_a_deletion_is_one() {
        let mut told = Told::new();
        told.look(0, &[("a", "1"), ("b", "1")]);
        assert_eq!(told.look(150, &[("a", "1"), ("b", "1")]), ["a", "b"]);
        assert_eq!(told.look(200, &[("b", "1")]), NOTHING);
        assert_eq!(told.look(250, &[("a", "2"), ("b", "1")]), ["~a"]);
        assert_eq!(told.look(400, &[("a", "2"), ("b", "1")]), ["a"]);
        assert_eq!(told.look(500, &[("a", "2")]), NOTHING);
        assert_eq!(told.look(700, &[("a", "2")]), ["-b"]);
        // What was never ready is not gone either.
        assert_eq!(told.look(800, &[("a", "2"), ("c", "1")]), ["~c"]);
        assert_eq!(told.look(850, &[("a", "2")]), NOTHING);
        assert_eq!(told.look(1200, &[("a", "2")]), NOTHING);
    }

    #[test]
    fn what_was_known_before_is_gone_when_two_looks_do_not_find_it() {
        let mut told = Told::new();
        told.settling.remembers(told.start, ["a", "b"].map(PathBuf::from));
        assert_eq!(told.look(10, &[("b", "1")]), ["~b"]);
        assert!(!told.settling.is_quiet());
        assert_eq!(told.look(150, &[("b", "1")]), ["-a", "b"]);
        assert!(told.settling.is_quiet());
    }

    #[test]
    fn what_cannot_be_read_is_tried_again_later_and_later_and_at_once_when_it_changes() {
        let mut told = Told::new();
        told.look(0, &[("a", "1")]);
        assert_eq!(told.look(150, &[("a", "1")]), ["a"]);
        told.unreadable(200, "a", "1");
        assert_eq!(told.settling.next_look(), Some(told.start + Duration::from_millis(700)));
        assert_eq!(told.look(600, &[("a", "1")]), NOTHING);
        assert_eq!(told.look(700, &[("a", "1")]), ["a"]);
        told.unreadable(710, "a", "1");
        assert_eq!(told.look(1600, &[("a", "1")]), NOTHING);
        assert_eq!(told.look(1710, &[("a", "1")]), ["a"]);
        told.unreadable(1720, "a", "1");
        assert_eq!(told.look(1800, &[("a", "12")]), ["~a"]);
        assert_eq!(told.look(1950, &[("a", "12")]), ["a"]);
        assert!(told.settling.next_look().is_none());
    }
}
