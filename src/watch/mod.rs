//! From a folder that people work in to files that are ready to be read.
//!
//! It knows nothing of meshes: which files of the folder count, and which others belong to them, the caller says.
//!
//! Events of the system are hints, and a scan is the truth: they are lost when a queue overflows, when folders appear with
//! files in them, on network file systems; and one save is many of them. So a hint only says that it is time to look, and what
//! has changed is what two scans say. Without any hint there is a look now and then.
//!
//! ```text
//! system ─► hints ─┐
//!          timers ─┴─► scan ─► settling ─► changes: a file is ready, or gone
//! ```
//! - [`stamp`]: whether a file is the one that it was
//! - [`settling`]: when a file that has changed is ready
//! - [`departed`]: whether a file that is gone was renamed
//! - [`hints`]: when to look

pub mod departed;
pub mod hints;
pub mod settling;
pub mod stamp;
