//! A folder whose results are kept current: what settles there goes down the line, newest first.
//!
//! ```text
//! hints, timers ─► scan ─► settling ─► desk ─► line ─► results
//! ```
//! What a mesh is, is its content; so one that was renamed finds all its results in the cache, and one that was saved without
//! a change too. A mesh that is saved again while it is worked on ends at the next opportunity; blocks that were trained
//! by then are what its new version begins with ([`super::lineage`]).

use std::cell::Cell;
use std::collections::{BTreeMap, HashMap};
use std::io;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};

use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

use super::board::{self, Board};
use super::context::Context;
use super::desk::{Desk, Waiting};
use super::intake::{self, Job};
use super::line::{Line, failed};
use super::predict::GivenModel;
use super::{Failure, publish};
use crate::flow::{EventSink, Outcome};
use crate::mesh::{MeshHash, companions};
use crate::pipeline::{OnDelete, Pipeline};
use crate::publish::report::{MeshReport, Status};
use crate::publish::watched::Happened;
use crate::store::Store;
use crate::watch::hints::{Hints, Silent};
use crate::watch::settling::{Change, Settling};
use crate::watch::stamp::Stamp;

/// A folder to be watched.
pub struct Watch {
    /// Which one, as a path without links.
    pub folder: PathBuf,
    /// Where results go: one folder a mesh.
    pub out: PathBuf,
    /// The cache; without one everything is computed.
    pub store: Option<Store>,
    /// Worker threads, and meshes under way at once.
    pub workers: NonZeroUsize,
    /// What the meshes under way may take of memory, in bytes.
    pub memory: u64,
    /// Whether a mesh begins with the blocks of its previous version, where it has one.
    pub lineage: bool,
    /// A look every so often in place of the system's hints.
    pub poll: Option<Duration>,
    /// Ends when everything is current.
    pub once: bool,
    /// Cancelled to stop: finished work is kept.
    pub cancel: CancellationToken,
    /// Who hears what was computed and what reused.
    pub events: Arc<dyn EventSink>,
    /// How often a training leaves a checkpoint.
    pub checkpoint_every: Duration,
}

/// What is to be computed, and where it is read again when it has changed.
pub trait Source {
    /// What is to be computed, with the model that is given for it.
    ///
    /// # Errors
    /// Why it cannot be used.
    fn read(&self) -> Result<(Pipeline, Option<Arc<GivenModel>>), String>;
    /// The file that it is read from, if it is.
    fn file(&self) -> Option<&Path>;
}

/// What became of a watch.
#[derive(Debug, Clone, Default)]
pub struct Ended {
    /// How every mesh ended for the last time, by name.
    pub meshes: BTreeMap<String, Status>,
    /// Some failure was a defect of this program.
    pub defect: bool,
}

/// Keeps the results of a folder current until it is stopped, or, where that is asked for, until they are. `tell` hears what
/// happens.
///
/// # Errors
/// When the pipeline cannot be read, or the system refuses threads.
pub async fn watch(
    watch: Watch,
    source: &dyn Source,
    tell: &dyn Fn(&Happened),
) -> Result<Ended, WatchError> {
    let (hints, silent) = listen(&watch, source.file()).await;
    // Looked at before it is read: a change in between is seen.
    let used = source.file().and_then(|file| Stamp::of(file, Vec::new()).ok());
    let (mut pipeline, mut model) = source.read().map_err(WatchError::Pipeline)?;
    let mut house = House {
        watch,
        hints,
        silent: Some(silent),
        settling: Settling::default(),
        pipeline: Settling::default(),
        used,
        seen: BTreeMap::new(),
        known: BTreeMap::new(),
        left: Vec::new(),
        complaint: None,
        removes: false,
        ended: Ended::default(),
        tell,
        has_spoken: Cell::new(false),
    };
    loop {
        match house.keep_current(pipeline, model, source).await? {
            Next::End => return Ok(house.ended),
            Next::Pipeline(changed, given) => (pipeline, model) = (*changed, given),
        }
    }
}

/// Why a folder cannot be watched.
#[derive(Debug, thiserror::Error)]
pub enum WatchError {
    /// There is no pipeline to begin with.
    #[error("{0}")]
    Pipeline(String),
    /// The system refuses threads.
    #[error("the system refuses worker threads: {0}")]
    Threads(#[from] io::Error),
}

async fn listen(watch: &Watch, pipeline: Option<&Path>) -> (Hints, Option<Silent>) {
    if let Some(every) = watch.poll {
        return (Hints::polling(&watch.folder, every), None);
    }
    let pipeline = pipeline.and_then(|file| file.canonicalize().ok());
    let (folder, file, out) = (watch.folder.clone(), pipeline.clone(), watch.out.clone());
    let cache = watch.store.as_ref().and_then(|store| store.dir().canonicalize().ok());
    let counts = move |path: &Path| {
        let is_ours =
            path.starts_with(&out) || cache.as_ref().is_some_and(|cache| path.starts_with(cache));
        file.as_deref() == Some(path) || (path.starts_with(&folder) && !is_ours)
    };
    Hints::of(&watch.folder, pipeline.as_deref(), counts).await
}

/// How a watch goes on after a line has ended.
enum Next {
    End,
    Pipeline(Box<Pipeline>, Option<Arc<GivenModel>>),
}

/// Why the folder is looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Look {
    /// The system has said that something has happened.
    Hinted,
    /// It was time.
    Regular,
}

fn is_busy(begun: &HashMap<usize, Begun>, name: &str) -> bool {
    begun.values().any(|begun| begun.waiting.job.name == name)
}

/// A mesh on the line.
struct Begun {
    waiting: Waiting,
    is_wanted: bool,
}

/// A mesh of the folder.
struct Known {
    job: Job,
    stamp: Stamp,
    /// Of its content, once that was read.
    hash: Option<MeshHash>,
    /// Its last failure, which is told once.
    complaint: Option<String>,
}

/// A mesh that has left the folder a moment ago.
struct Left {
    name: String,
    hash: MeshHash,
    at: Instant,
}

/// A file that goes and another with its content that comes, within so long, is one that was renamed.
const RENAMED: Duration = Duration::from_secs(10);

/// A scan is followed by a pause of so many times its own time.
const PAUSE: u32 = 3;

/// What is known of a folder.
struct House<'t> {
    watch: Watch,
    hints: Hints,
    /// Why there are none, until that is told.
    silent: Option<Option<Silent>>,
    settling: Settling,
    /// The pipeline file, and what it was when it was read.
    pipeline: Settling,
    used: Option<Stamp>,
    /// The files of the last scan, for what belongs to them.
    seen: BTreeMap<PathBuf, Stamp>,
    known: BTreeMap<String, Known>,
    left: Vec<Left>,
    /// Why the folder could not be searched, which is told once.
    complaint: Option<String>,
    /// Results of meshes that are gone go too.
    removes: bool,
    ended: Ended,
    tell: &'t dyn Fn(&Happened),
    /// Something was said since everything was current.
    has_spoken: Cell<bool>,
}

impl House<'_> {
    /// Keeps everything current under one pipeline.
    async fn keep_current(
        &mut self,
        pipeline: Pipeline,
        model: Option<Arc<GivenModel>>,
        source: &dyn Source,
    ) -> Result<Next, WatchError> {
        self.removes = pipeline.publish.on_delete == OnDelete::Remove;
        let cancel = self.watch.cancel.child_token();
        let context = Arc::new(self.context(pipeline, model, cancel.clone()));
        let told = CancellationToken::new();
        let teller = tokio::spawn(board::tell(context.clone(), told.clone()));
        let (line, entrance, mut outcomes) =
            Line::start(&context, self.watch.workers, self.watch.memory)?;
        let (mut desk, mut begun) = (Desk::default(), HashMap::<usize, Begun>::new());
        // Under another pipeline every mesh is looked at again.
        self.known.values().for_each(|known| desk.put(known.job.clone(), known.stamp.clone()));
        let (to_line, mut chosen) = mpsc::channel::<(usize, Waiting)>(1);
        let let_in = {
            let entrance = entrance.clone();
            tokio::spawn(async move {
                while let Some((item, waiting)) = chosen.recv().await {
                    if entrance.enter(item, waiting.job).await.is_none() {
                        return;
                    }
                }
            })
        };
        drop(entrance);
        let mut next_item = 0;
        // Every look is followed by a pause, whatever hints come meanwhile.
        let (mut looked, mut pause_until) = (Instant::now(), Instant::now());
        let mut look = Some(Look::Regular);
        let next = loop {
            if Instant::now() >= pause_until
                && let Some(why) = look.take()
            {
                looked = Instant::now();
                if let Some(next) = self.pipeline_changed(source) {
                    break next;
                }
                let is_first = self.silent.is_some();
                let (changes, is_news) = self.scan().await?;
                pause_until = Instant::now() + PAUSE * looked.elapsed();
                if is_news && why == Look::Regular && !is_first {
                    self.hints.missed_something();
                }
                context.board.expects(self.seen.len());
                if let Some(silent) = self.silent.take() {
                    let folder = self.watch.folder.display().to_string();
                    let polled = silent.map(|silent| silent.to_string());
                    self.say(&Happened::Watching { folder, meshes: self.seen.len(), polled });
                }
                for change in changes {
                    self.take_note(change, &context, &mut desk, &mut begun);
                }
            }
            if desk.is_empty() && begun.is_empty() && self.settling.is_quiet() {
                self.tell_idle();
                if self.watch.once {
                    break Next::End;
                }
            }
            let due =
                [&self.settling, &self.pipeline].into_iter().filter_map(Settling::next_look).min();
            tokio::select! {
                biased;
                () = self.watch.cancel.cancelled() => break Next::End,
                Some(outcome) = outcomes.recv() => {
                    self.settle(outcome, &context, &mut desk, &mut begun);
                }
                Ok(permit) = to_line.reserve(), if desk.has_free(|name| is_busy(&begun, name)) => {
                    let Some(waiting) = desk.take(|name| is_busy(&begun, name)) else { continue };
                    begun.insert(next_item, Begun { waiting: waiting.clone(), is_wanted: true });
                    permit.send((next_item, waiting));
                    next_item += 1;
                }
                () = tokio::time::sleep_until(pause_until.into()), if look.is_some() => {}
                is_hint = self.hints.next(looked, due), if look.is_none() => {
                    look = Some(if is_hint { Look::Hinted } else { Look::Regular });
                }
            }
        };
        // What is under way ends at its next opportunity; what it has finished is kept.
        cancel.cancel();
        drop(to_line);
        let_in.abort();
        while let Some(outcome) = outcomes.recv().await {
            self.settle(outcome, &context, &mut desk, &mut begun);
        }
        line.end().await;
        told.cancel();
        drop(teller.await);
        Ok(next)
    }

    fn context(
        &self,
        pipeline: Pipeline,
        model: Option<Arc<GivenModel>>,
        cancel: CancellationToken,
    ) -> Context {
        let Watch { out, store, events, lineage, checkpoint_every, .. } = &self.watch;
        Context {
            store: store.clone(),
            events: events.clone(),
            cancel,
            lineage: *lineage,
            checkpoint_every: *checkpoint_every,
            board: Board::new(self.known.len()),
            ..Context::alone(pipeline, model, out.clone())
        }
    }

    /// What the files of the folder have become, and whether anything is not as it was at the last look.
    async fn scan(&mut self) -> io::Result<(Vec<Change>, bool)> {
        let (folder, before) = (self.watch.folder.clone(), self.seen.clone());
        let scanned = tokio::task::spawn_blocking(move || scan(&folder, &before)).await;
        let seen = match scanned.map_err(io::Error::other)? {
            Ok(seen) => {
                self.complaint = None;
                seen
            }
            Err(error) => {
                // A folder that cannot be read, or is gone, may be back soon: nothing has changed until it can be.
                let complaint = error.to_string();
                if self.complaint.as_ref() != Some(&complaint) {
                    tracing::warn!("{complaint}; it is looked at again");
                    self.complaint = Some(complaint);
                }
                return Ok((Vec::new(), false));
            }
        };
        let is_news = seen != self.seen;
        self.seen.clone_from(&seen);
        Ok((self.settling.look(Instant::now(), seen), is_news))
    }

    /// A pipeline file that has changed, is whole, and can be used.
    fn pipeline_changed(&mut self, source: &dyn Source) -> Option<Next> {
        let file = source.file()?;
        let seen = Stamp::of(file, Vec::new()).ok();
        let seen = seen.map(|stamp| (file.to_owned(), stamp)).into_iter().collect();
        let changes = self.pipeline.look(Instant::now(), seen);
        // One that is gone stays in force: a save may remove it for a moment.
        let Some(Change::Ready(_, stamp)) = changes.into_iter().next() else { return None };
        if self.used.replace(stamp.clone()) == Some(stamp) {
            return None;
        }
        match source.read() {
            Ok((pipeline, model)) => {
                self.say(&Happened::Pipeline { error: None });
                Some(Next::Pipeline(Box::new(pipeline), model))
            }
            Err(error) => {
                self.say(&Happened::Pipeline { error: Some(error) });
                None
            }
        }
    }

    fn take_note(
        &mut self,
        change: Change,
        context: &Context,
        desk: &mut Desk,
        begun: &mut HashMap<usize, Begun>,
    ) {
        match change {
            Change::Ready(source, stamp) => {
                let name = intake::name_of(&self.watch.folder, &source);
                let job = Job { source, name: name.clone() };
                let same = |known: &&Known| known.stamp == stamp;
                // Tried again, it is not saved again.
                let is_retry = self.known.get(&name).filter(same).is_some();
                if !is_retry {
                    self.say(&Happened::Saved { path: name.clone() });
                    self.give_up(&name, context, begun);
                    let hash = self.known.get(&name).and_then(|known| known.hash);
                    let known =
                        Known { job: job.clone(), stamp: stamp.clone(), hash, complaint: None };
                    self.known.insert(name, known);
                }
                desk.put(job, stamp);
            }
            Change::Gone(source) => {
                let name = intake::name_of(&self.watch.folder, &source);
                self.give_up(&name, context, begun);
                desk.drop(&name);
                context.board.forgets(&name);
                self.ended.meshes.remove(&name);
                if let Some(Known { hash: Some(hash), .. }) = self.known.remove(&name) {
                    self.left.retain(|left| left.at.elapsed() < RENAMED);
                    self.left.push(Left { name: name.clone(), hash, at: Instant::now() });
                }
                if self.removes {
                    self.remove_results(&name);
                }
                self.say(&Happened::Deleted { path: name, results_kept: !self.removes });
            }
        }
    }

    /// The work on an older version of a mesh is no longer wanted.
    fn give_up(&self, name: &str, context: &Context, begun: &mut HashMap<usize, Begun>) {
        for (&item, begun) in begun.iter_mut() {
            if begun.is_wanted && begun.waiting.job.name == name {
                begun.is_wanted = false;
                context.board.drops(item);
                self.say(&Happened::Superseded { path: name.into() });
            }
        }
    }

    fn remove_results(&self, name: &str) {
        if let Err(error) = publish::remove_results(&self.watch.out, name) {
            tracing::warn!("the results of {name} could not be removed: {error}");
        }
    }

    /// A mesh has come out of the line.
    fn settle(
        &mut self,
        Outcome { item, result }: Outcome<MeshReport, Failure>,
        context: &Context,
        desk: &mut Desk,
        begun: &mut HashMap<usize, Begun>,
    ) {
        context.ledger.take(item);
        let Some(Begun { waiting: Waiting { job, stamp, .. }, is_wanted }) = begun.remove(&item)
        else {
            return;
        };
        match result {
            // It was done before it could be dropped.
            Ok(_) if !is_wanted => {
                context.board.ends(item, &job.name, None);
                if !self.known.contains_key(&job.name) && self.removes {
                    self.remove_results(&job.name);
                }
            }
            Ok(report) => {
                context.board.ends(item, &job.name, Some(report.status));
                desk.is_done(&job.name);
                self.settling.read(&job.source, &stamp);
                self.done(&job, &stamp, &report);
            }
            Err(Failure::Superseded | Failure::Interrupted) => {
                context.board.ends(item, &job.name, None);
            }
            Err(_) if !is_wanted => context.board.ends(item, &job.name, None),
            Err(failure) => {
                let again = failure.is_of_the_moment() || matches!(failure, Failure::Mesh(_));
                if again {
                    self.settling.unreadable(Instant::now(), &job.source, &stamp);
                }
                self.ended.defect |= failure.is_internal();
                let report = failed(context, &job, failure, true);
                context.board.ends(item, &job.name, Some(report.status));
                desk.is_done(&job.name);
                self.failed(&job, report, again);
            }
        }
    }

    fn done(&mut self, job: &Job, stamp: &Stamp, report: &MeshReport) {
        self.ended.meshes.insert(job.name.clone(), report.status);
        let moved = report.hash.and_then(|hash| {
            let is_it = |left: &Left| left.hash == hash && left.at.elapsed() < RENAMED;
            let found = self.left.iter().position(is_it)?;
            Some(self.left.swap_remove(found).name)
        });
        if let Some(known) = self.known.get_mut(&job.name) {
            (known.hash, known.complaint) = (report.hash, None);
        }
        if let Some(from) = moved.filter(|from| *from != job.name && !self.known.contains_key(from))
        {
            self.remove_results(&from);
            self.say(&Happened::Moved { from, path: job.name.clone() });
        }
        // A file that says that it was written long ago was not saved just now.
        let saved =
            stamp.modified().and_then(|modified| SystemTime::now().duration_since(modified).ok());
        let seconds = match saved {
            Some(since) if since < LONG_AGO => since.as_secs_f64(),
            _ => report.seconds,
        };
        self.say(&Happened::done(report, seconds));
    }

    fn failed(&mut self, job: &Job, report: MeshReport, again: bool) {
        self.ended.meshes.insert(job.name.clone(), Status::Failed);
        let reason = report.reason.unwrap_or_default();
        let Some(known) = self.known.get_mut(&job.name) else { return };
        // Once: it may be tried a hundred times.
        if known.complaint.as_ref() != Some(&reason) {
            known.complaint = Some(reason.clone());
            self.say(&Happened::Failed { path: job.name.clone(), reason, again });
        }
    }

    fn say(&self, happened: &Happened) {
        self.has_spoken.set(true);
        (self.tell)(happened);
    }

    /// Once, until something else was said: a file that cannot be read is tried again and again.
    fn tell_idle(&self) {
        if !self.has_spoken.replace(false) {
            return;
        }
        let with = |status| self.ended.meshes.values().filter(|&&ended| ended == status).count();
        (self.tell)(&Happened::Idle {
            meshes: self.known.len(),
            verified: with(Status::Verified),
            unverified: with(Status::Unverified),
            failed: with(Status::Failed),
        });
    }
}

/// A save that is longer ago was not the reason.
const LONG_AGO: Duration = Duration::from_secs(3600);

/// All meshes of the folder as they are now. What belongs to a file is found out when the file has changed.
fn scan(
    folder: &Path,
    before: &BTreeMap<PathBuf, Stamp>,
) -> Result<BTreeMap<PathBuf, Stamp>, intake::IntakeError> {
    let look = |job: Job| {
        let alone = Stamp::of(&job.source, Vec::new()).ok()?;
        let stamp = match before.get(&job.source).filter(|before| before.is_same_file(&alone)) {
            Some(before) if before.companions().next().is_none() => alone,
            Some(before) => Stamp::of(&job.source, before.companions().cloned().collect()).ok()?,
            None if job
                .source
                .extension()
                .is_some_and(|ending| ending.eq_ignore_ascii_case("gltf")) =>
            {
                Stamp::of(&job.source, companions(&job.source)).ok()?
            }
            None => alone,
        };
        Some((job.source, stamp))
    };
    Ok(intake::search(folder)?.into_iter().filter_map(look).collect())
}
