//! The stages of a run, and the run that joins them: thin joints between the numerics, the store and the engine.
//!
//! ```text
//! paths ─► ingest ─► assemble ─┬─► inherit ─► remesh ─► family ─► tune ─► train φ₁ ─► … ─► predict ─► refine ─┬─► verify ─► publish
//!                              ├─► predict with a given model ──────────────────────────────────────► refine ─┤
//!                              └─► solve ─────────────────────────────────────────────────────────────────────┘
//! ```
//! - [`intake`]: which meshes there are; `opened`: the file whose objects are under way
//! - [`context`]: what all stages share; recalling a result or computing it; [`work`]: what a result depends on
//! - [`board`]: where every mesh stands
//! - [`artifacts`]: what the store keeps of each stage
//! - [`ingest`], [`assemble`], [`remesh`], [`family`], [`tune`], [`train`], [`verify`], [`publish`]: one stage each
//! - [`lineage`]: which mesh grew from which; [`inherit`]: what becomes of the blocks of a previous version
//! - [`checkpoints`]: trainings that are not finished; `trials`: searches that are not
//! - [`models`]: trained chains of blocks by name
//! - [`retention`]: which entries of the store are of use
//! - [`candidates`]: the stages `predict` and `solve`, which make what is verified
//! - [`predict`]: prediction with a given model, for which nothing is assembled
//! - [`refine`]: what a solver makes of learned functions
//! - [`reference`]: what it is held against; [`warm`]: a solver that begins with the previous version
//! - [`verdict`]: a certificate against the tolerances
//! - [`failure`]: why a mesh could not be processed
//! - [`weight`]: what a mesh takes of memory
//! - [`line`]: the whole chain; [`run`]: a list of meshes on it; [`watched`]: a folder on it; [`plan`]: what a run would do

pub mod artifacts;
pub mod assemble;
pub mod board;
pub mod candidates;
pub mod checkpoints;
pub mod context;
pub mod failure;
pub mod family;
pub mod ingest;
pub mod inherit;
pub mod intake;
pub mod line;
pub mod lineage;
pub mod models;
mod opened;
pub mod plan;
pub mod predict;
pub mod publish;
pub mod reference;
pub mod refine;
pub mod remesh;
pub mod retention;
pub mod run;
mod stand_in;
pub mod train;
mod trials;
pub mod tune;
pub mod verdict;
pub mod verify;
pub mod warm;
pub mod watched;
pub mod weight;
pub mod work;

pub use failure::Failure;
pub use run::{Run, run};
