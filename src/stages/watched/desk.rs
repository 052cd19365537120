//! Which mesh of a watched folder is next: the one that was saved last, but everybody has a turn.
//!
//! Meshes whose work was given up because they were saved again go after those that have had no turn since they were saved:
//! one mesh that is saved every second does not keep the others waiting.

use std::collections::BTreeMap;

use crate::stages::intake::Job;
use crate::watch::stamp::Stamp;

/// A mesh that waits for its turn.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Waiting {
    /// Which one.
    pub job: Job,
    /// The file as it was found ready.
    pub stamp: Stamp,
    /// Its place in the order of saves.
    saved: u64,
}

/// All meshes that wait, by name.
#[derive(Debug, Default)]
pub struct Desk {
    waiting: BTreeMap<String, Waiting>,
    /// How often the work on a mesh has begun since it was last done.
    turns: BTreeMap<String, u32>,
    saves: u64,
}

impl Desk {
    /// A mesh is ready; an older version of it does not wait any more.
    pub fn put(&mut self, job: Job, stamp: Stamp) {
        self.saves += 1;
        let waiting = Waiting { stamp, saved: self.saves, job };
        self.waiting.insert(waiting.job.name.clone(), waiting);
    }

    /// The mesh whose turn it is; none of an older version that is still worked on, which `is_busy` tells: its results would
    /// come over those of the newer one.
    pub fn take(&mut self, is_busy: impl Fn(&str) -> bool) -> Option<Waiting> {
        let order = |waiting: &Waiting| {
            let turns = self.turns.get(&waiting.job.name).copied().unwrap_or(0);
            (turns, u64::MAX - waiting.saved)
        };
        let free = self.waiting.values().filter(|waiting| !is_busy(&waiting.job.name));
        let next = free.min_by_key(|waiting| order(waiting))?.job.name.clone();
        *self.turns.entry(next.clone()).or_default() += 1;
        self.waiting.remove(&next)
    }

    /// The work on a mesh has come to its end, whatever that was.
    pub fn is_done(&mut self, name: &str) {
        self.turns.remove(name);
    }

    /// A mesh is gone.
    pub fn drop(&mut self, name: &str) {
        self.waiting.remove(name);
        self.turns.remove(name);
    }

    /// Whether somebody waits who is not busy.
    pub fn has_free(&self, is_busy: impl Fn(&str) -> bool) -> bool {
        self.waiting.keys().any(|name| !is_busy(name))
    }

    /// Whether nobody waits.
    pub fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn put(desk: &mut Desk, name: &str) {
        let stamp = Stamp::of("Cargo.toml".as_ref(), vec![]).unwrap();
        desk.put(Job::whole(name.into(), name.into()), stamp);
    }

    fn take(desk: &mut Desk) -> String {
        desk.take(|_| false).unwrap().job.name
    }

    #[test]
    fn what_was_saved_last_comes_first_and_once() {
        let mut desk = Desk::default();
        ["a", "b", "c", "a"].iter().for_each(|name| put(&mut desk, name));
        assert_eq!([take(&mut desk), take(&mut desk), take(&mut desk)], ["a", "c", "b"]);
        assert!(desk.is_empty() && desk.take(|_| false).is_none());
    }

    #[test]
    fn a_mesh_that_is_saved_all_the_time_does_not_starve_the_others() {
        let mut desk = Desk::default();
        ["a", "b", "busy"].iter().for_each(|name| put(&mut desk, name));
        assert_eq!(take(&mut desk), "busy");
        // Saved again while it was worked on, again and again.
        put(&mut desk, "busy");
        assert_eq!(take(&mut desk), "b");
        put(&mut desk, "busy");
        assert_eq!(take(&mut desk), "a");
        assert_eq!(take(&mut desk), "busy");
        desk.is_done("busy");
        ["b", "busy"].iter().for_each(|name| put(&mut desk, name));
        desk.is_done("b");
        assert_eq!(take(&mut desk), "busy");
        put(&mut desk, "a");
        assert_eq!(desk.take(|name| name == "b").map(|next| next.job.name), Some("a".into()));
        assert!(!desk.has_free(|name| name == "b") && desk.has_free(|_| false));
        desk.drop("b");
        assert!(desk.is_empty());
    }
}
