//! Whether a file that is gone was renamed: what has left, until that is known.
//!
//! A rename is a file that goes and another of the same content that comes; what the content is, is known only once the other
//! was read. So nothing is said of a file that is gone until all that has come is read, and for no longer than a while.
//!
//! Nothing here touches a clock or a disk: the caller says when.

use std::time::{Duration, Instant};

/// How long a file that is gone may have been renamed.
const PATIENCE: Duration = Duration::from_secs(10);

/// Files that have left, with what their content is known by.
#[derive(Debug)]
pub struct Departed<Content> {
    left: Vec<Left<Content>>,
}

#[derive(Debug)]
struct Left<Content> {
    name: String,
    content: Content,
    at: Instant,
}

impl<Content> Default for Departed<Content> {
    fn default() -> Self {
        Self { left: Vec::new() }
    }
}

impl<Content: PartialEq> Departed<Content> {
    /// A file is gone.
    pub fn leaves(&mut self, now: Instant, name: String, content: Content) {
        self.left.push(Left { name, content, at: now });
    }

    /// A file of this name is there again: whatever it is, it was not renamed.
    pub fn is_back(&mut self, name: &str) {
        self.left.retain(|left| left.name != name);
    }

    /// A file of this content has come: the name of one that has left with it.
    pub fn claim(&mut self, content: &Content) -> Option<String> {
        let found = self.left.iter().position(|left| left.content == *content)?;
        Some(self.left.remove(found).name)
    }

    /// The names of those that were not renamed: of all when everything that has come is read.
    pub fn deleted(&mut self, now: Instant, all_is_read: bool) -> Vec<String> {
        let is_over = |left: &mut Left<_>| all_is_read || left.at + PATIENCE <= now;
        self.left.extract_if(.., is_over).map(|left| left.name).collect()
    }

    /// When the next one is known to be deleted, if nothing happens before.
    pub fn due(&self) -> Option<Instant> {
        self.left.iter().map(|left| left.at + PATIENCE).min()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_left_was_renamed_is_back_or_was_deleted() {
        let start = Instant::now();
        let mut departed = Departed::default();
        for (name, content) in [("a", 1), ("b", 2), ("c", 3), ("d", 1)] {
            departed.leaves(start, name.into(), content);
        }
        assert_eq!(departed.due(), Some(start + PATIENCE));
        assert_eq!(departed.claim(&1).as_deref(), Some("a"));
        assert_eq!(departed.claim(&4), None);
        departed.is_back("b");
        assert!(departed.deleted(start, false).is_empty());
        departed.leaves(start + PATIENCE / 2, "e".into(), 5);
        assert_eq!(departed.deleted(start + PATIENCE, false), ["c", "d"]);
        assert_eq!(departed.deleted(start + PATIENCE, true), ["e"]);
        assert_eq!(departed.due(), None);
    }
}
