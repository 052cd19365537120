//! Which meshes a folder has, what became of each, and what is said of that.

use std::cell::Cell;
use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use super::Ended;
use crate::mesh::MeshHash;
use crate::publish::report::{MeshReport, RunReport, Status};
use crate::publish::watched::Happened;
use crate::stages::intake::Job;
use crate::stages::publish;
use crate::watch::departed::Departed;
use crate::watch::stamp::Stamp;

/// The meshes of a watched folder.
pub struct Account<'t> {
    /// Where results go.
    out: PathBuf,
    tell: &'t dyn Fn(&Happened),
    known: BTreeMap<String, Known>,
    departed: Departed<MeshHash>,
    /// Results of meshes that are gone go too.
    removes: bool,
    /// Under this pipeline.
    since: SystemTime,
    /// Meshes of the first look, of which nothing is said before they are done.
    unsaid: HashSet<String>,
    /// Some failure was a defect of this program.
    defect: bool,
    /// How every mesh of this moment ended, by name.
    reports: BTreeMap<String, MeshReport>,
    /// Something was said since everything was current.
    has_spoken: Cell<bool>,
}

/// A mesh of the folder.
struct Known {
    job: Job,
    stamp: Stamp,
    /// Of its content, once that was read.
    hash: Option<MeshHash>,
    /// Its last failure, which is told once.
    complaint: Option<String>,
    /// It is tried again after that.
    again: bool,
}

impl<'t> Account<'t> {
    /// Of an empty folder; `tell` hears what happens, and `out` is where results go.
    pub fn new(out: &Path, tell: &'t dyn Fn(&Happened)) -> Self {
        Self {
            out: out.into(),
            tell,
            known: BTreeMap::new(),
            departed: Departed::default(),
            removes: false,
            since: SystemTime::now(),
            unsaid: HashSet::new(),
            defect: false,
            reports: BTreeMap::new(),
            has_spoken: Cell::new(false),
        }
    }

    /// Another pipeline is in force, under which results of meshes that are gone are removed or not. All meshes, which have no
    /// results under it.
    pub fn begins(&mut self, removes: bool) -> impl Iterator<Item = (Job, Stamp)> {
        (self.removes, self.since) = (removes, SystemTime::now());
        self.known.values().map(|known| (known.job.clone(), known.stamp.clone()))
    }

    /// How many meshes there are.
    pub fn len(&self) -> usize {
        self.known.len()
    }

    /// How the watch has ended.
    pub fn close(mut self) -> Ended {
        self.settle_departed(Instant::now(), true);
        let meshes = self.reports.into_iter().map(|(name, report)| (name, report.status));
        Ended { meshes: meshes.collect(), defect: self.defect }
    }

    /// A mesh is changing; one of the first look has always been there.
    pub fn moves(&mut self, name: String, is_first: bool) {
        if is_first {
            self.unsaid.insert(name);
        } else {
            self.say(&Happened::Saved { path: name });
        }
    }

    /// A file is whole. Whether nothing is to be said of its meshes before they are done.
    pub fn is_whole(&mut self, file: &str) -> bool {
        self.unsaid.remove(file)
    }

    /// Whether a mesh could not be processed, and is to be tried again as it is.
    pub fn is_tried_again(&self, name: &str) -> bool {
        self.known.get(name).is_some_and(|known| known.again)
    }

    /// A mesh is whole, and that is said unless `unsaid`. Whether it is another than it was: one may also be tried again.
    pub fn is_ready(&mut self, job: &Job, stamp: &Stamp, unsaid: bool) -> bool {
        let known = self.known.get(&job.name);
        if known.is_some_and(|known| known.stamp == *stamp) {
            return false;
        }
        self.departed.is_back(&job.name);
        let hash = known.and_then(|known| known.hash);
        let known =
            Known { job: job.clone(), stamp: stamp.clone(), hash, complaint: None, again: false };
        self.known.insert(job.name.clone(), known);
        if !unsaid {
            self.say(&Happened::Ready { path: job.name.clone() });
        }
        true
    }

    /// A mesh is gone, or was renamed.
    pub fn leaves(&mut self, name: String) {
        self.reports.remove(&name);
        match self.known.remove(&name) {
            Some(Known { hash: Some(hash), .. }) => {
                self.departed.leaves(Instant::now(), name, hash);
            }
            _ => self.is_deleted(name),
        }
    }

    /// Says of meshes that left a while ago, or of all where `all_is_read`, that they were deleted.
    pub fn settle_departed(&mut self, now: Instant, all_is_read: bool) {
        let deleted = self.departed.deleted(now, all_is_read);
        deleted.into_iter().for_each(|name| self.is_deleted(name));
    }

    /// When that is due.
    pub fn due(&self) -> Option<Instant> {
        self.departed.due()
    }

    /// A mesh is done that was dropped meanwhile.
    pub fn is_done_too_late(&self, name: &str) {
        if self.removes && !self.known.contains_key(name) {
            self.remove_results(name);
        }
    }

    /// A mesh is done that was ready with this stamp.
    pub fn is_done(&mut self, job: &Job, stamp: &Stamp, report: &MeshReport) {
        self.reports.insert(job.name.clone(), report.clone());
        let before = self.known.get(&job.name).and_then(|known| known.hash);
        if let Some(known) = self.known.get_mut(&job.name) {
            (known.hash, known.complaint, known.again) = (report.hash, None, false);
        }
        // What was there before did not come from elsewhere.
        let is_new = |hash: &MeshHash| Some(*hash) != before;
        if let Some(from) = report.hash.filter(is_new).and_then(|hash| self.departed.claim(&hash)) {
            if let Err(error) = publish::rename_results(&self.out, &from, &job.name) {
                tracing::warn!("the results of {from} could not be removed: {error}");
            }
            self.say(&Happened::Moved { from, path: job.name.clone() });
        }
        let seconds = self.since_saved(stamp).map_or(report.seconds, |since| since.as_secs_f64());
        self.say(&Happened::done(report, seconds));
    }

    /// A mesh could not be processed; it may be tried `again`.
    pub fn has_failed(&mut self, report: MeshReport, again: bool, is_defect: bool) {
        self.reports.insert(report.path.clone(), report.clone());
        let MeshReport { path, reason, .. } = report;
        self.defect |= is_defect;
        let reason = reason.unwrap_or_default();
        let Some(known) = self.known.get_mut(&path) else { return };
        known.again = again;
        // Once: it may be tried a hundred times.
        if known.complaint.as_ref() != Some(&reason) {
            known.complaint = Some(reason.clone());
            self.say(&Happened::Failed { path, reason, again });
        }
    }

    /// Says something.
    pub fn say(&self, happened: &Happened) {
        self.has_spoken.set(true);
        (self.tell)(happened);
    }

    /// As of a run over all meshes.
    pub fn report(&self) -> RunReport {
        let seconds = self.reports.values().map(|report| report.seconds).sum();
        RunReport::new(self.reports.values().cloned().collect(), seconds)
    }

    /// The meshes that have results.
    pub fn published(&self) -> BTreeSet<String> {
        let done = self.known.iter().filter(|(_, known)| known.hash.is_some());
        done.map(|(name, _)| name.clone()).collect()
    }

    /// Says that everything is current, and whether that was news: a file that cannot be read is tried again and again.
    pub fn is_current(&self) -> bool {
        if !self.has_spoken.replace(false) {
            return false;
        }
        let with = |status| self.reports.values().filter(|report| report.status == status).count();
        (self.tell)(&Happened::Idle {
            meshes: self.known.len(),
            verified: with(Status::Verified),
            unverified: with(Status::Unverified),
            failed: with(Status::Failed),
        });
        true
    }

    fn is_deleted(&self, name: String) {
        if self.removes {
            self.remove_results(&name);
        }
        self.say(&Happened::Deleted { path: name, results_kept: !self.removes });
    }

    fn remove_results(&self, name: &str) {
        if let Err(error) = publish::remove_results(&self.out, name) {
            tracing::warn!("the results of {name} could not be removed: {error}");
        }
    }

    /// How long ago a file was saved, if that was the reason to look at it.
    fn since_saved(&self, stamp: &Stamp) -> Option<Duration> {
        let saved = stamp.written().filter(|&saved| saved >= self.since)?;
        SystemTime::now().duration_since(saved).ok()
    }
}
