//! Where a crash may fall: between any two operations on the database.
//!
//! Whoever does several in a row calls [`point`] in between. It does nothing, except in tests of the store, which can have
//! it fail as if the process had ended there.

/// A place where the process may end.
#[cfg(not(test))]
#[inline(always)]
pub(super) fn point() -> sled::Result<()> {
    Ok(())
}

#[cfg(test)]
pub(super) use for_tests::{after, point};

#[cfg(test)]
mod for_tests {
    use std::cell::Cell;
    use std::io;

    thread_local! {
        static LEFT: Cell<Option<usize>> = const { Cell::new(None) };
    }

    /// What comes after so many points of this thread does not happen; `None`: all does.
    pub fn after(points: Option<usize>) {
        LEFT.set(points);
    }

    pub fn point() -> sled::Result<()> {
        match LEFT.get() {
            // A kind that says nothing of the database's files.
            Some(0) => Err(sled::Error::Io(io::ErrorKind::Interrupted.into())),
            Some(left) => {
                LEFT.set(Some(left - 1));
                Ok(())
            }
            None => Ok(()),
        }
    }
}
