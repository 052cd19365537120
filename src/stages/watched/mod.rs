//! A folder whose results are kept current: what settles there goes down the line, newest first.
//!
//! ```text
//! hints, timers ─► scan ─► settling ─► desk ─► line ─► results
//! ```
//! What a mesh is, is its content; so one that was renamed finds all its results in the cache, and one that was saved without
//! a change too. A mesh that is saved again while it is worked on ends at the next opportunity; blocks that were trained
//! by then are what its new version begins with ([`super::lineage`]).

mod account;
mod desk;
mod scan;

use std::collections::{BTreeMap, HashMap};
use std::io;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use rayon::prelude::*;
use tokio::task::JoinSet;
use tokio_util::sync::CancellationToken;

use account::Account;
use desk::{Desk, Waiting};
use scan::{Seen, scan};

use super::board::{self, Board};
use super::context::Context;
use super::intake::{self, Job, apart};
use super::line::{Line, failed};
use super::predict::GivenModel;
use super::{Failure, retention};
use crate::descriptors::Descriptor;
use crate::flow::{EventSink, Outcome};
use crate::mesh::policy::Objects;
use crate::pipeline::{OnDelete, Pipeline};
use crate::publish::export::shape_dna;
use crate::publish::kept_current::KeptCurrent;
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
    let account = Account::new(&watch.out, tell);
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
        objects: pipeline.ingest.objects,
        parts: BTreeMap::new(),
        compares: false,
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

fn is_busy(begun: &HashMap<usize, Begun>, name: &str) -> bool {
    begun.values().any(|begun| begun.waiting.job.name == name)
}

/// A mesh on the line.
struct Begun {
    waiting: Waiting,
    is_wanted: bool,
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
    /// Whether the objects of a file are meshes of their own.
    objects: Objects,
    /// What the meshes of such files are called.
    parts: BTreeMap<PathBuf, Vec<String>>,
    /// Whether there is a table of all fingerprints.
    compares: bool,
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
        let mut desk = Desk::default();
        // Under another pipeline every mesh is looked at again.
        let known: Vec<_> = self.account.begins(removes).collect();
        let as_before = self.objects == pipeline.ingest.objects;
        self.objects = pipeline.ingest.objects;
        self.compares = pipeline.publish.descriptors.contains(&Descriptor::ShapeDna);
        self.remember_the_last_watch(removes);
        let cancel = self.watch.cancel.child_token();
        let context = Arc::new(self.context(pipeline, model, cancel.clone()));
        let told = CancellationToken::new();
        let teller = tokio::spawn(board::tell(context.clone(), told.clone()));
        let (line, entrance, mut outcomes) =
            Line::start(&context, self.watch.workers, self.watch.memory)?;
        let (mut begun, mut next_item) = (HashMap::<usize, Begun>::new(), 0);
        if as_before {
            known.into_iter().for_each(|(job, stamp)| desk.put(job, stamp));
        } else {
            let files = known.into_iter().map(|(job, stamp)| (job.source, stamp));
            let files: BTreeMap<_, _> = files.collect();
            let mut jobs = self.jobs_of(files.keys().cloned().collect()).await;
            for (source, stamp) in files {
                let jobs = jobs.remove(&source).unwrap_or_default();
                self.is_whole(source, jobs, stamp, &context, &mut desk, &mut begun);
            }
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
                context.board.expects(self.meshes());
                if let Some(silent) = self.silent.take() {
                    let (folder, meshes) = (self.folder(), self.meshes());
                    let polled = silent.map(|silent| silent.to_string());
                    self.account.say(&Happened::Watching { folder, meshes, polled });
                }
                let ready = changes.iter().filter_map(Change::ready).cloned().collect();
                let mut jobs = self.jobs_of(ready).await;
                for change in changes {
                    self.take_note(change, &mut jobs, is_first, &context, &mut desk, &mut begun);
                }
                context.board.expects(self.meshes());
            }
            let all_is_read = self.silent.is_none()
                && desk.is_empty()
                && begun.is_empty()
                && self.settling.is_quiet();
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
                    self.settle(outcome, &context, &mut desk, &mut begun);
                }
                // Chosen only when there is a place, as the newest one then.
                place = entrance.place(), if desk.has_free(|name| is_busy(&begun, name)) => {
                    let Some(waiting) = desk.take(|name| is_busy(&begun, name)) else { continue };
                    let (entrance, item, job) = (entrance.clone(), next_item, waiting.job.clone());
                    entering.spawn(async move { entrance.enter(place, item, job).await });
                    begun.insert(item, Begun { waiting, is_wanted: true });
                    next_item += 1;
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
            self.settle(outcome, &context, &mut desk, &mut begun);
        }
        line.end().await;
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
        let mut files = Vec::new();
        for name in KeptCurrent::last(out, folder) {
            let path = folder.join(&name);
            // An object of a file that is still there is gone only when the file has no such object any more.
            let mut above = path.ancestors().skip(1).take_while(|above| above != folder);
            let file = above.find(|above| above.is_file()).map(Path::to_owned);
            match file.or_else(|| path.is_file().then(|| path.clone())) {
                Some(file) => self.parts.entry(file).or_default().push(name),
                None => files.push(path),
            }
        }
        files.extend(self.parts.keys().cloned());
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

    /// How many meshes there are, as far as is known.
    fn meshes(&self) -> usize {
        self.seen.len() + self.parts.values().map(|names| names.len() - 1).sum::<usize>()
    }

    /// The meshes of files, by file. Of one that cannot be read they are what they were: each fails with the reason.
    async fn jobs_of(&self, sources: Vec<PathBuf>) -> HashMap<PathBuf, Vec<Job>> {
        let whole = |source: PathBuf| {
            let job = Job::whole(source.clone(), self.name_of(&source));
            (source, job)
        };
        let files = sources.into_iter().map(whole);
        if self.objects == Objects::Merge {
            return files.map(|(source, job)| (source, vec![job])).collect();
        }
        let known = |(source, job): (PathBuf, Job)| {
            let names = self.parts.get(&source).map_or(&[][..], Vec::as_slice);
            let objects = names.iter().filter_map(|name| {
                let object = name.strip_prefix(&job.name)?.strip_prefix('/')?;
                Some(Job::object(source.clone(), &job.name, object.into()))
            });
            let objects: Vec<Job> = objects.collect();
            let otherwise = if objects.is_empty() { vec![job.clone()] } else { objects };
            (source, job, otherwise)
        };
        let files: Vec<_> = files.map(known).collect();
        let cancel = self.watch.cancel.clone();
        let read = tokio::task::spawn_blocking(move || {
            let of_file = |(source, job, otherwise): (PathBuf, Job, Vec<Job>)| {
                let is_over = cancel.is_cancelled();
                let objects = if is_over { None } else { apart(&job).ok() };
                (source, objects.unwrap_or(otherwise))
            };
            files.into_par_iter().map(of_file).collect()
        });
        read.await.unwrap_or_default()
    }

    fn name_of(&self, source: &Path) -> String {
        intake::name_of(&self.watch.folder, source)
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
        jobs: &mut HashMap<PathBuf, Vec<Job>>,
        is_first: bool,
        context: &Context,
        desk: &mut Desk,
        begun: &mut HashMap<usize, Begun>,
    ) {
        match change {
            Change::Moving(source) => self.account.moves(self.name_of(&source), is_first),
            Change::Ready(source, stamp) => {
                let jobs = jobs.remove(&source).unwrap_or_default();
                self.is_whole(source, jobs, stamp, context, desk, begun);
            }
            Change::Gone(source) => {
                let names = self.parts.remove(&source);
                for name in names.unwrap_or_else(|| vec![self.name_of(&source)]) {
                    self.is_gone(name, context, desk, begun);
                }
            }
        }
    }

    /// A file is whole and has these meshes; those that it had before and has no more are gone.
    fn is_whole(
        &mut self,
        source: PathBuf,
        jobs: Vec<Job>,
        stamp: Stamp,
        context: &Context,
        desk: &mut Desk,
        begun: &mut HashMap<usize, Begun>,
    ) {
        let file = self.name_of(&source);
        let unsaid = self.account.is_whole(&file);
        let names: Vec<String> = jobs.iter().map(|job| job.name.clone()).collect();
        let as_one = || self.account.knows(&file).then(|| file.clone()).into_iter().collect();
        let before = self.parts.remove(&source).unwrap_or_else(as_one);
        for name in before.into_iter().filter(|name| !names.contains(name)) {
            self.is_gone(name, context, desk, begun);
        }
        if jobs.iter().any(|job| job.object.is_some()) {
            self.parts.insert(source, names);
        }
        for job in jobs {
            if self.account.is_ready(&job, &stamp, unsaid) {
                self.give_up(&job.name, context, begun);
            } else if job.object.is_some() && !self.account.is_tried_again(&job.name) {
                // It is another object of the file that is tried again.
                continue;
            }
            desk.put(job, stamp.clone());
        }
    }

    /// There is no such mesh any more.
    fn is_gone(
        &mut self,
        name: String,
        context: &Context,
        desk: &mut Desk,
        begun: &mut HashMap<usize, Begun>,
    ) {
        self.give_up(&name, context, begun);
        desk.drop(&name);
        context.board.forgets(&name);
        self.account.leaves(name);
    }

    /// The work on an older version of a mesh is no longer wanted.
    fn give_up(&self, name: &str, context: &Context, begun: &mut HashMap<usize, Begun>) {
        for (&item, begun) in begun.iter_mut() {
            if begun.is_wanted && begun.waiting.job.name == name {
                begun.is_wanted = false;
                context.board.drops(item);
                self.account.say(&Happened::Superseded { path: name.into() });
            }
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
                self.account.is_done_too_late(&job.name);
            }
            Ok(report) => {
                context.board.ends(item, &job.name, Some(report.status));
                desk.is_done(&job.name);
                self.account.is_done(&job, &stamp, &report);
                let objects = self.parts.get(&job.source).into_iter().flatten();
                if !objects.clone().any(|name| self.account.is_tried_again(name)) {
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
                desk.is_done(&job.name);
                self.account.has_failed(report, again, is_defect);
            }
        }
    }

    /// The table of all fingerprints, where it is asked for; none of an earlier pipeline otherwise.
    async fn compare(&self) {
        let out = self.watch.out.clone();
        let report = self.compares.then(|| self.account.report());
        let written = tokio::task::spawn_blocking(move || match report {
            Some(report) => shape_dna::write(&out, &report),
            None => shape_dna::remove_files(&out),
        });
        if let Ok(Err(error)) = written.await {
            tracing::warn!("the table of ShapeDNA is not current: {error}");
        }
    }

    /// Everything is current: a moment to look after the cache.
    async fn is_current(&self) {
        if !self.account.is_current() {
            return;
        }
        self.leave_word().await;
        self.compare().await;
        let Some(store) = self.watch.store.clone() else { return };
        let kept = tokio::task::spawn_blocking(move || retention::keep_models(&store)).await;
        if let Ok(Err(error)) = kept {
            tracing::debug!("models of earlier versions stay for now: {error}");
        }
    }
}
