//! Triangle meshes: reading, repairing, measuring and naming them by content.
//!
//! - [`trimesh`]: the canonical, validated mesh that all other folders work on
//! - [`hash`]: its content hash
//! - [`topology`]: pieces, boundary, Euler characteristic, defects
//! - [`sample`]: surfaces with known spectra

pub mod hash;
pub mod sample;
pub mod topology;
pub mod trimesh;

pub use hash::MeshHash;
pub use topology::Topology;
pub use trimesh::{Area, TriMesh};
