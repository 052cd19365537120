//! Where every mesh of a run stands: the stages write it down, and the run tells others.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use tokio_util::sync::CancellationToken;
use tracing::Span;
use tracing::field::Empty;
use tracing_indicatif::span_ext::IndicatifSpanExt;
use tracing_indicatif::style::ProgressStyle;

use super::context::Context;
use crate::publish::report::Status;
use crate::publish::status::{RunState, RunStatus, RunStatusSchema, StatusFile, UnderWay};

/// How often others are told, and the terminal.
const EVERY: Duration = Duration::from_secs(1);
const EVERY_LINE: Duration = Duration::from_millis(250);

/// Where the meshes of a run stand.
#[derive(Debug)]
pub struct Board {
    began: Instant,
    started: u64,
    /// The folder that is watched.
    watches: Option<String>,
    entries: Mutex<Entries>,
}

#[derive(Debug, Default)]
struct Entries {
    /// How many meshes there are.
    meshes: usize,
    under_way: BTreeMap<usize, Entry>,
    /// Those that are no longer wanted, begun or not.
    dropped: BTreeSet<usize>,
    /// How every mesh ended for the last time.
    ended: BTreeMap<String, Status>,
    /// How often one did.
    endings: usize,
    /// Since when there is nothing to do, and how long there was not before.
    resting: Option<Instant>,
    rested: Duration,
}

#[derive(Debug)]
struct Entry {
    path: String,
    stage: String,
    since: Instant,
    began: Instant,
}

impl Board {
    /// For work on so many meshes, which begins now.
    pub fn new(meshes: usize) -> Self {
        let (began, started) = (Instant::now(), unix_now());
        let entries = Mutex::new(Entries { meshes, ..Entries::default() });
        Self { began, started, watches: None, entries }
    }

    /// Those of a `folder` that is watched.
    pub fn watching(self, folder: String) -> Self {
        Self { watches: Some(folder), ..self }
    }

    /// There are so many meshes now.
    pub fn expects(&self, meshes: usize) {
        self.entries().meshes = meshes;
    }

    /// The work on a mesh is no longer wanted: it ends at the next opportunity.
    pub fn drops(&self, item: usize) {
        self.entries().dropped.insert(item);
    }

    /// Whether the work on a mesh is no longer wanted.
    pub fn is_dropped(&self, item: usize) -> bool {
        self.entries().dropped.contains(&item)
    }

    /// There is no such mesh any more.
    pub fn forgets(&self, path: &str) {
        self.entries().ended.remove(path);
    }

    /// Work on a mesh begins.
    pub fn begins(&self, item: usize, path: &str) {
        let now = Instant::now();
        let entry = Entry { path: path.into(), stage: "ingest".into(), since: now, began: now };
        let mut entries = self.entries();
        entries.under_way.insert(item, entry);
        entries.rested = entries.rested();
        entries.resting = None;
    }

    /// There is nothing to do until the next mesh begins: that time does not count.
    pub fn rests(&self) {
        self.entries().resting.get_or_insert_with(Instant::now);
    }

    /// A mesh enters a stage.
    pub fn enters(&self, item: usize, stage: &str, part: Option<usize>) {
        if let Some(entry) = self.entries().under_way.get_mut(&item) {
            entry.stage = part.map_or(stage.into(), |part| format!("{stage} φ{part}"));
            entry.since = Instant::now();
        }
    }

    /// When work on a mesh began, while it is under way.
    pub fn began(&self, item: usize) -> Option<Instant> {
        Some(self.entries().under_way.get(&item)?.began)
    }

    /// A mesh has ended so; `None`: it is as it was before.
    pub fn ends(&self, item: usize, path: &str, status: Option<Status>) {
        let mut entries = self.entries();
        entries.under_way.remove(&item);
        entries.dropped.remove(&item);
        if let Some(status) = status {
            entries.ended.insert(path.into(), status);
            entries.endings += 1;
        }
    }

    /// How far the run is.
    pub fn status(&self, state: RunState) -> RunStatus {
        let entries = self.entries();
        let under_way: Vec<UnderWay> = entries
            .under_way
            .values()
            .map(|Entry { path, stage, since, .. }| UnderWay {
                path: path.clone(),
                stage: stage.clone(),
                seconds: since.elapsed().as_secs_f64(),
            })
            .collect();
        let with = |status| entries.ended.values().filter(|&&ended| ended == status).count();
        let meshes = entries.meshes;
        // One that is under way again has ended before.
        let again = |mesh: &&UnderWay| entries.ended.contains_key(&mesh.path);
        let done = entries.ended.len() - under_way.iter().filter(again).count();
        let busy = self.began.elapsed().saturating_sub(entries.rested());
        let each = busy.as_secs_f64() / entries.endings as f64;
        let has_ended = entries.endings > 0;
        RunStatus {
            schema: RunStatusSchema::V1,
            state,
            process: std::process::id(),
            started: self.started,
            updated: unix_now(),
            watches: self.watches.clone(),
            part: None,
            meshes,
            verified: with(Status::Verified),
            unverified: with(Status::Unverified),
            failed: with(Status::Failed),
            waiting: meshes.saturating_sub(done + under_way.len()),
            under_way,
            per_hour: if has_ended { 3600.0 / each } else { 0.0 },
            seconds_left: has_ended.then(|| each * meshes.saturating_sub(done) as f64),
        }
    }

    fn entries(&self) -> MutexGuard<'_, Entries> {
        self.entries.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Entries {
    /// How long there was nothing to do so far.
    fn rested(&self) -> Duration {
        self.rested + self.resting.map(|since| since.elapsed()).unwrap_or_default()
    }
}

/// Tells others how far the run of `context` is, again and again, until `ended`; `stop` is cancelled then where something is left to do.
/// That they cannot be told costs a warning.
pub async fn tell(context: Arc<Context>, ended: CancellationToken, stop: CancellationToken) {
    let out = &context.out;
    let file = match StatusFile::take(out) {
        Ok(Some(file)) => Arc::new(file),
        Ok(None) => {
            tracing::warn!(
                "another run writes to {}; `chladni status` tells of that one",
                out.display()
            );
            return;
        }
        Err(error) => {
            tracing::warn!("`chladni status` will not know of this run: {error}");
            return;
        }
    };
    let line = StatusLine::show();
    loop {
        let state = match (ended.is_cancelled(), stop.is_cancelled()) {
            (false, _) => RunState::Running,
            (true, true) => RunState::Interrupted,
            (true, false) => RunState::Finished,
        };
        let (file, status) = (file.clone(), context.board.status(state));
        let written = tokio::task::spawn_blocking(move || file.write(&status)).await;
        if let Ok(Err(error)) = written {
            tracing::warn!("`chladni status` will not know how far this run is: {error}");
            return;
        }
        if state != RunState::Running {
            return;
        }
        let next = Instant::now() + EVERY;
        while Instant::now() < next && !ended.is_cancelled() {
            line.says(&context.board.status(RunState::Running));
            tokio::select! {
                () = ended.cancelled() => {}
                () = tokio::time::sleep(EVERY_LINE) => {}
            }
        }
    }
}

/// The bar of a run: how many of the meshes are done, how fast it goes, and how long it will.
const BAR: &str = "{bar:20} {wide_msg}";

/// How far the run is, in one line on the terminal, above the bars of what is under way.
struct StatusLine {
    span: Span,
}

impl StatusLine {
    fn show() -> Self {
        let span = tracing::info_span!("meshes", indicatif.pb_show = Empty);
        if let Ok(style) = ProgressStyle::with_template(BAR) {
            span.pb_set_style(&style);
        }
        span.pb_start();
        Self { span }
    }

    fn says(&self, status: &RunStatus) {
        self.span.pb_set_length(status.meshes as u64);
        self.span.pb_set_position(status.done() as u64);
        self.span.pb_set_message(&status.line());
    }
}

fn unix_now() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_without_work_does_not_count() {
        let board = Board::new(2);
        board.begins(0, "a");
        board.ends(0, "a", Some(Status::Verified));
        board.rests();
        std::thread::sleep(Duration::from_millis(400));
        board.begins(1, "b");
        let status = board.status(RunState::Running);
        assert!(status.per_hour > 2.0 * 3600.0 / 0.4, "{status:?}");
        assert_eq!((status.verified, status.waiting, status.under_way.len()), (1, 0, 1));
        let line = status.line();
        assert!(line.starts_with("1 of 2 meshes done; ") && line.ends_with("b: ingest"), "{line}");
    }
}
