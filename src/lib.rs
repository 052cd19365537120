//! chladni: verified Laplace–Beltrami eigenpairs of triangle meshes.
//!
//! Layers, each knowing only those to its left:
//!
//! ```text
//! mesh ─► operators, remesh ─► spectrum ─┬─► ggnn ───────────────────┐
//!                                        └─► descriptors ─► publish ─┼─► stages ─► cli
//! store, flow, watch (know nothing of meshes) ───────────────────────┘
//! ```
//! `schema` helps enums to say in JSON Schema what is written for them; it knows nothing of any.
//!
//! A program starts at [`stages::run`]; a single mesh and its spectrum at [`mesh::load`] and [`spectrum::fem`].

pub mod cli;
pub mod descriptors;
pub mod flow;
pub mod ggnn;
pub mod mesh;
pub mod operators;
pub mod pipeline;
pub mod publish;
pub mod remesh;
mod schema;
pub mod spectrum;
pub mod stages;
pub mod store;
pub mod watch;
