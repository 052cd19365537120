//! A folder whose results are kept current: what settles there goes down the line, newest first.
//!
//! ```text
//! hints, timers ─► scan ─► settling ─► desk ─► line ─► results
//! ```
//! What a mesh is, is its content; so one that was renamed finds all its results in the cache, and one that was saved without
//! a change too. A mesh that is saved again while it is worked on ends at the next opportunity; blocks that were trained
//! by then are what its new version begins with ([`super::lineage`]).

//!
//! - `scan`: what the folder looks like; `parts`: which meshes its files are
//! - `tasks`: what waits and what is under way; `desk`: which of them is next
//! - `account`: what became of each mesh, and what is said of that

mod account;
mod desk;
mod parts;
mod scan;
mod tasks;

use std::collections::{BTreeMap, HashMap};
use std::io;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::task::JoinSet;
use tokio_util::sync::CancellationToken;

use account::Account;
use desk::Waiting;
use parts::Parts;
use scan::{Seen, scan};
use tasks::{Begun, Tasks};

use super::board::{self, Board};
use super::context::Context;
use super::intake::Job;
use super::line::{Line, failed};
use super::predict::GivenModel;
use super::{Failure, retention};
use crate::flow::{EventSink, Outcome};
use crate::pipeline::{OnDelete, Pipeline};
use crate::publish::kept_current::KeptCurrent;
use crate::publish::overview::Overview;
use crate::publish::report::{MeshReport, RunReport, Status};
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
    let (account, parts) = (Account::new(&watch.out, tell), Parts::new(&watch.folder));
    let mut house = House {
        watch,
        hints,
        silent: Some(silent),
        settling: Settling::default(),
        pipeline: Settling::default(),
        used,
        seen: Seen::new(),
        complaint: None,
        account,
        parts,
        overview: Overview::default(),
    };
    loop {
        match house.keep_current(pipeline, model, source).await? {
            Next::End => return Ok(house.account.close()),
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
    /// All was to be done once, and the folder cannot be searched.
    #[error("{0}")]
    Folder(String),
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
    // What lies above the folder is not below it.
    let ours: Vec<PathBuf> =
        [Some(out), cache].into_iter().flatten().filter(|own| !folder.starts_with(own)).collect();
    let counts = move |path: &Path| {
        let is_ours = ours.iter().any(|own| path.starts_with(own));
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

/// Before a folder that could not be searched is looked at again.
const UNREADABLE: Duration = Duration::from_secs(1);

/// A scan is followed by a pause of so many times its own time.
const PAUSE: u32 = 3;

/// A folder, and what is known of it.
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
    seen: Seen,
    /// Why the folder could not be searched, which is told once.
    complaint: Option<String>,
    account: Account<'t>,
    parts: Parts,
    /// What stands beside the folders of all meshes.
    overview: Overview,
}

impl House<'_> {
    /// Keeps everything current under one pipeline.
    async fn keep_current(
        &mut self,
        pipeline: Pipeline,
        model: Option<Arc<GivenModel>>,
        source: &dyn Source,
    ) -> Result<Next, WatchError> {
        let removes = pipeline.publish.on_delete == OnDelete::Remove;
        let mut tasks = Tasks::default();
        // Under another pipeline every mesh is looked at again.
        let known: Vec<_> = self.account.begins(removes).collect();
        let is_cut_otherwise = self.parts.cut(pipeline.ingest.objects);
        self.overview = Overview::of(&pipeline.publish);
        self.remember_the_last_watch(removes);
        let cancel = self.watch.cancel.child_token();
        let context = Arc::new(self.context(pipeline, model, cancel.clone()));
        let (told, stop) = (CancellationToken::new(), self.watch.cancel.child_token());
        let teller = tokio::spawn(board::tell(context.clone(), told.clone(), stop.clone()));
        let (line, entrance, mut outcomes) =
            Line::start(&context, self.watch.workers, self.watch.memory)?;
        if is_cut_otherwise {
            let files = known.into_iter().map(|(job, stamp)| (job.source, stamp));
            let files: BTreeMap<_, _> = files.collect();
            let mut jobs = self.jobs(files.keys()).await;
            for (source, stamp) in files {
                self.is_whole(&source, stamp, &mut jobs, &context, &mut tasks);
            }
        } else {
            known.into_iter().for_each(|(job, stamp)| tasks.put(job, stamp));
        }
        let mut entering = JoinSet::new();
        // Every look is followed by a pause, whatever hints come meanwhile.
        let (mut looked, mut pause_until) = (Instant::now(), Instant::now());
        let mut look = Some(Look::Regular);
        let next = loop {
            if Instant::now() >= pause_until
                && let Some(why) = look.take()
            {
                looked = Instant::now();
                if let Some(next) = self.pipeline_changed(source) {
                    break Ok(next);
                }
                let is_first = self.silent.is_some();
                let looked_at = self.look().await?;
                pause_until = Instant::now() + PAUSE * looked.elapsed();
                let Some((changes, is_news)) = looked_at else {
                    // Nothing is known of it until it can be searched again.
                    if self.watch.once {
                        break Err(WatchError::Folder(self.complaint.take().unwrap_or_default()));
                    }
                    pause_until += UNREADABLE;
                    look = Some(Look::Regular);
                    continue;
                };
                if is_news && why == Look::Regular && !is_first {
                    self.hints.missed_something();
                }
                context.board.expects(self.parts.count(&self.seen));
                if let Some(silent) = self.silent.take() {
                    let (folder, meshes) = (self.folder(), self.parts.count(&self.seen));
                    let polled = silent.map(|silent| silent.to_string());
                    self.account.say(&Happened::Watching { folder, meshes, polled });
                }
                let mut jobs = self.jobs(changes.iter().filter_map(Change::ready)).await;
                for change in changes {
                    self.take_note(change, is_first, &mut jobs, &context, &mut tasks);
                }
                context.board.expects(self.parts.count(&self.seen));
            }
            let all_is_read = self.silent.is_none() && tasks.is_empty() && self.settling.is_quiet();
            self.account.settle_departed(Instant::now(), all_is_read);
            if all_is_read {
                context.board.rests();
                context.opened.forget();
                self.is_current().await;
                if self.watch.once {
                    break Ok(Next::End);
                }
            }
            let looks =
                [&self.settling, &self.pipeline].into_iter().filter_map(Settling::next_look);
            let due = looks.chain(self.account.due()).min();
            tokio::select! {
                biased;
                () = self.watch.cancel.cancelled() => break Ok(Next::End),
                Some(outcome) = outcomes.recv() => {
                    self.settle(outcome, &context, &mut tasks);
                }
                // Chosen only when there is a place, as the newest one then.
                place = entrance.place(), if tasks.has_next() => {
                    let Some((item, job)) = tasks.begin() else { continue };
                    let entrance = entrance.clone();
                    entering.spawn(async move { entrance.enter(place, item, job).await });
                }
                Some(_) = entering.join_next() => {}
                () = tokio::time::sleep_until(pause_until.into()), if look.is_some() => {}
                is_hint = self.hints.next(looked, due), if look.is_none() => {
                    look = Some(if is_hint { Look::Hinted } else { Look::Regular });
                }
            }
        };
        // What is under way ends at its next opportunity; what it has finished is kept.
        cancel.cancel();
        entering.shutdown().await;
        drop(entrance);
        while let Some(outcome) = outcomes.recv().await {
            self.settle(outcome, &context, &mut tasks);
        }
        line.end().await;
        if next.is_err() {
            stop.cancel();
        }
        told.cancel();
        drop(teller.await);
        if self.silent.is_none() {
            self.leave_word().await;
        }
        next
    }

    /// Before the first look: where results go with their meshes, those of the last watch of this folder are remembered.
    fn remember_the_last_watch(&mut self, removes: bool) {
        let Watch { out, folder, .. } = &self.watch;
        if !removes || self.silent.is_none() {
            return;
        }
        // An object of a file that is still there is gone only when the file has no such object any more.
        let last = KeptCurrent::last(out, folder).into_iter();
        let files: Vec<PathBuf> = last.map(|name| self.parts.remember(name)).collect();
        self.settling.remembers(Instant::now(), files);
    }

    /// Leaves word to the next watch of which meshes have results.
    async fn leave_word(&self) {
        let list = KeptCurrent::of(&self.watch.folder, self.account.published());
        let out = self.watch.out.clone();
        if let Ok(Err(error)) = tokio::task::spawn_blocking(move || list.write(&out)).await {
            tracing::warn!("the next watch will not know what was deleted before it: {error}");
        }
    }

    /// The meshes that files are now, by file.
    async fn jobs(&self, files: impl Iterator<Item = &PathBuf>) -> HashMap<PathBuf, Vec<Job>> {
        self.parts.jobs(files.cloned().collect(), self.watch.cancel.clone()).await
    }

    fn folder(&self) -> String {
        self.watch.folder.display().to_string()
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
            board: Board::new(self.account.len()).watching(self.folder()),
            ..Context::alone(pipeline, model, out.clone())
        }
    }

    /// What the files of the folder have become, and whether anything is not as it was at the last look; `None` when it cannot
    /// be searched.
    async fn look(&mut self) -> io::Result<Option<(Vec<Change>, bool)>> {
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
                return Ok(None);
            }
        };
        let is_news = seen != self.seen;
        self.seen.clone_from(&seen);
        Ok(Some((self.settling.look(Instant::now(), seen), is_news)))
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
                self.account.say(&Happened::Pipeline { error: None });
                Some(Next::Pipeline(Box::new(pipeline), model))
            }
            Err(error) => {
                self.account.say(&Happened::Pipeline { error: Some(error) });
                None
            }
        }
    }

    fn take_note(
        &mut self,
        change: Change,
        is_first: bool,
        jobs: &mut HashMap<PathBuf, Vec<Job>>,
        context: &Context,
        tasks: &mut Tasks,
    ) {
        match change {
            Change::Moving(file) => self.account.moves(self.parts.name_of(&file), is_first),
            Change::Ready(file, stamp) => self.is_whole(&file, stamp, jobs, context, tasks),
            Change::Gone(file) => {
                let names = self.parts.remove(&file);
                names.into_iter().for_each(|name| self.is_gone(name, context, tasks));
            }
        }
    }

    /// A file is whole and has the meshes that `jobs` has of it; those that it had before and has no more are gone.
    fn is_whole(
        &mut self,
        file: &Path,
        stamp: Stamp,
        jobs: &mut HashMap<PathBuf, Vec<Job>>,
        context: &Context,
        tasks: &mut Tasks,
    ) {
        let Some(jobs) = jobs.remove(file) else { return };
        let unsaid = self.account.is_whole(&self.parts.name_of(file));
        for name in self.parts.replace(file, &jobs) {
            self.is_gone(name, context, tasks);
        }
        for job in jobs {
            if self.account.is_ready(&job, &stamp, unsaid) {
                self.give_up(&job.name, context, tasks);
            } else if job.object.is_some() && !self.account.is_tried_again(&job.name) {
                // It is another object of the file that is tried again.
                continue;
            }
            tasks.put(job, stamp.clone());
        }
    }

    /// There is no such mesh any more.
    fn is_gone(&mut self, name: String, context: &Context, tasks: &mut Tasks) {
        self.give_up(&name, context, tasks);
        tasks.drop(&name);
        context.board.forgets(&name);
        self.account.leaves(name);
    }

    /// The work on an older version of a mesh is no longer wanted.
    fn give_up(&self, name: &str, context: &Context, tasks: &mut Tasks) {
        for item in tasks.give_up(name) {
            context.board.drops(item);
            self.account.say(&Happened::Superseded { path: name.into() });
        }
    }

    /// A mesh has come out of the line.
    fn settle(
        &mut self,
        Outcome { item, result }: Outcome<MeshReport, Failure>,
        context: &Context,
        tasks: &mut Tasks,
    ) {
        context.ledger.take(item);
        let Some(Begun { waiting: Waiting { job, stamp, .. }, is_wanted }) = tasks.end(item) else {
            return;
        };
        match result {
            // It was done before it could be dropped.
            Ok(_) if !is_wanted => {
                context.board.ends(item, &job.name, None);
                self.account.is_done_too_late(&job.name);
            }
            Ok(report) => {
                context.board.ends(item, &job.name, Some(report.status));
                tasks.is_done(&job.name);
                self.account.is_done(&job, &stamp, &report);
                let mut objects = self.parts.of(&job.source);
                if !objects.any(|name| self.account.is_tried_again(name)) {
                    self.settling.read(&job.source, &stamp);
                }
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
                let is_defect = failure.is_internal();
                let report = failed(context, &job, failure, true);
                context.board.ends(item, &job.name, Some(report.status));
                tasks.is_done(&job.name);
                self.account.has_failed(report, again, is_defect);
            }
        }
    }

    /// What stands beside the folders of all meshes, where it is asked for; nothing of an earlier pipeline otherwise.
    async fn look_over_all(&self) {
        let (out, overview) = (self.watch.out.clone(), self.overview);
        let report = match overview.is_empty() {
            true => RunReport::new(Vec::new(), 0.0),
            false => self.account.report(),
        };
        let written = tokio::task::spawn_blocking(move || overview.write(&out, &report));
        let failed = match written.await {
            Ok(written) => written.err().map(|error| error.to_string()),
            Err(defect) => Some(defect.to_string()),
        };
        if let Some(error) = failed {
            tracing::warn!("the page and the tables of all meshes are not current: {error}");
        }
    }

    /// Everything is current: a moment to look after the cache.
    async fn is_current(&self) {
        if !self.account.is_current() {
            return;
        }
        self.leave_word().await;
        self.look_over_all().await;
        let Some(store) = self.watch.store.clone() else { return };
        let kept = tokio::task::spawn_blocking(move || retention::keep_models(&store)).await;
        if let Ok(Err(error)) = kept {
            tracing::debug!("models of earlier versions stay for now: {error}");
        }
    }
}
