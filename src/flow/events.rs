//! What was computed and what was reused: the log that resume and incremental runs are judged by.

use std::fs::{File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use serde::{Deserialize, Serialize};

/// One stage's work on one item is done.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Event {
    /// The number of the item in this run.
    pub item: usize,
    /// The stage, as its keys name it.
    pub stage: String,
    /// Which of several (the eigenfunction, for training), counted from 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part: Option<usize>,
    /// The cache key, in hex.
    pub key: String,
    /// The digests that went into the key, by role.
    pub inputs: Vec<(String, String)>,
    /// The digest of what came out.
    pub output: String,
    /// How it came about.
    pub how: How,
}

/// Where a stage's result came from.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum How {
    /// Computed in this run.
    Computed,
    /// Taken from the store.
    Reused,
}

/// Whoever listens to events. Called from worker threads.
pub trait EventSink: Send + Sync {
    /// Takes note of `event`.
    fn record(&self, event: &Event);
}

/// Nobody listens.
#[derive(Debug, Clone, Copy)]
pub struct Unheard;

impl EventSink for Unheard {
    fn record(&self, _event: &Event) {}
}

/// Appends events to a file, one JSON object a line, each in one write. That it cannot be written costs a warning, the first
/// time.
#[derive(Debug)]
pub struct EventFile {
    log: Mutex<Log>,
}

#[derive(Debug)]
struct Log {
    file: File,
    /// The last line may be there in part.
    is_torn: bool,
    has_warned: bool,
}

impl EventFile {
    /// Opens `path` for appending.
    ///
    /// # Errors
    /// What the system says.
    pub fn append(path: &Path) -> io::Result<Self> {
        let mut file = OpenOptions::new().create(true).append(true).read(true).open(path)?;
        let mut last = [b'\n'];
        if file.metadata()?.len() > 0 {
            // A process may have been killed in the middle of a line.
            file.seek(SeekFrom::End(-1))?;
            file.read_exact(&mut last)?;
        }
        Ok(Self { log: Mutex::new(Log { file, is_torn: last != [b'\n'], has_warned: false }) })
    }
}

impl EventSink for EventFile {
    fn record(&self, event: &Event) {
        let Ok(mut line) = serde_json::to_vec(event) else { return };
        line.push(b'\n');
        let mut log = self.log.lock().unwrap_or_else(PoisonError::into_inner);
        if log.is_torn {
            line.insert(0, b'\n');
        }
        let written = log.file.write_all(&line);
        log.is_torn = written.is_err();
        if let Err(error) = written
            && !std::mem::replace(&mut log.has_warned, true)
        {
            tracing::warn!(
                "events are missing from events.jsonl, which costs nothing else: {error}"
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_torn_line_does_not_take_the_next_one_with_it() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("events.jsonl");
        let event = Event {
            item: 1,
            stage: "stage".into(),
            part: None,
            key: "key".into(),
            inputs: vec![],
            output: "output".into(),
            how: How::Computed,
        };
        EventFile::append(&path).unwrap().record(&event);
        let whole = std::fs::read(&path).unwrap();
        std::fs::write(&path, [&whole[..], &whole[..20]].concat()).unwrap();
        EventFile::append(&path).unwrap().record(&event);
        let text = std::fs::read_to_string(&path).unwrap();
        let read: Vec<_> =
            text.lines().map(|line| serde_json::from_str::<Event>(line).ok()).collect();
        assert_eq!(read, [Some(event.clone()), None, Some(event)]);
    }
}
