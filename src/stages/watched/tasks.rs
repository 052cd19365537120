//! The meshes that wait and those that are under way: what is begun next, and what is no longer wanted.

use std::collections::HashMap;

use super::desk::{Desk, Waiting};
use crate::stages::intake::Job;
use crate::watch::stamp::Stamp;

/// What there is to do, and what is being done.
#[derive(Default)]
pub struct Tasks {
    desk: Desk,
    begun: HashMap<usize, Begun>,
    next: usize,
}

/// A mesh on the line.
pub struct Begun {
    /// Which one, as it was found ready.
    pub waiting: Waiting,
    /// No newer version of it has come since.
    pub is_wanted: bool,
}

impl Tasks {
    /// A mesh is ready; an older version of it does not wait any more.
    pub fn put(&mut self, job: Job, stamp: Stamp) {
        self.desk.put(job, stamp);
    }

    /// Whether nothing waits and nothing is under way.
    pub fn is_empty(&self) -> bool {
        self.desk.is_empty() && self.begun.is_empty()
    }

    /// Whether [`Self::begin`] has something.
    pub fn has_next(&self) -> bool {
        self.desk.has_free(|name| is_busy(&self.begun, name))
    }

    /// Begins with the mesh whose turn it is; with the number of its work.
    pub fn begin(&mut self) -> Option<(usize, Job)> {
        let waiting = self.desk.take(|name| is_busy(&self.begun, name))?;
        let (item, job) = (self.next, waiting.job.clone());
        self.begun.insert(item, Begun { waiting, is_wanted: true });
        self.next += 1;
        Some((item, job))
    }

    /// Work has come out of the line.
    pub fn end(&mut self, item: usize) -> Option<Begun> {
        self.begun.remove(&item)
    }

    /// The work on a mesh has come to its end, whatever that was.
    pub fn is_done(&mut self, name: &str) {
        self.desk.is_done(name);
    }

    /// The work on a mesh that has begun is no longer wanted; the numbers of what was until now.
    pub fn give_up(&mut self, name: &str) -> Vec<usize> {
        let own = |begun: &Begun| begun.is_wanted && begun.waiting.job.name == name;
        let given_up = self.begun.iter_mut().filter(|(_, begun)| own(begun));
        let numbers = given_up.map(|(&item, begun)| {
            begun.is_wanted = false;
            item
        });
        numbers.collect()
    }

    /// A mesh is gone: it does not wait any more.
    pub fn drop(&mut self, name: &str) {
        self.desk.drop(name);
    }
}

fn is_busy(begun: &HashMap<usize, Begun>, name: &str) -> bool {
    begun.values().any(|begun| begun.waiting.job.name == name)
}
