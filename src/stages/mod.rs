//! The stages of a run, and the run that joins them: thin joints between the numerics, the store and the engine.
//!
//! ```text
//! paths ─► ingest ─► remesh ─► assemble ─► train φ₂ ─► train φ₃ ─► … ─► verify ─► publish
//! ```
//! - [`intake`]: which meshes there are
//! - [`context`]: what all stages share; recalling a result or computing it
//! - [`artifacts`]: what the store keeps of each stage
//! - [`ingest`], [`remesh`], [`assemble`], [`train`], [`verify`], [`publish`]: one stage each
//! - [`verdict`]: a certificate against the tolerances
//! - [`failure`]: why a mesh could not be processed
//! - [`run`]: the whole chain

pub mod artifacts;
pub mod assemble;
pub mod context;
pub mod failure;
pub mod ingest;
pub mod intake;
pub mod publish;
pub mod remesh;
pub mod run;
pub mod train;
pub mod verdict;
pub mod verify;

pub use failure::Failure;
pub use run::{Run, run};
