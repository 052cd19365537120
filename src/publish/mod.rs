//! Results as files and as text.
//!
//! - [`atomic`]: bytes into files that are whole at any time

pub mod atomic;

pub use atomic::{PublishError, Written, write, write_if_changed};
