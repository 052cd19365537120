//! Triangle meshes: reading, repairing, measuring and naming them by content.
//!
//! - [`trimesh`]: the canonical, validated mesh that all other folders work on
//! - [`hash`]: its content hash
//! - [`topology`]: pieces, boundary, Euler characteristic, defects
//! - [`shape`]: edge lengths and angles
//! - [`closest`]: the point of a surface closest to a point of space
//! - [`geodesic`]: distances along the surface
//! - [`subdivide`]: every triangle becomes four
//! - [`opened`]: a file that was read, by `read` (one file a format) as `raw`; [`ingest`]: all of it, or one of its objects, as all
//!   of these, through [`repair`]
//! - [`policy`]: which meshes are turned away
//! - [`error`]: why a file did not become a mesh
//! - [`sample`]: surfaces with known spectra

pub mod closest;
pub mod error;
pub mod geodesic;
pub mod hash;
pub mod ingest;
pub mod opened;
pub mod policy;
mod raw;
mod read;
pub mod repair;
pub mod sample;
pub mod shape;
pub mod subdivide;
pub mod topology;
pub mod trimesh;

pub use error::{Fault, MeshError, Place};
pub use hash::MeshHash;
pub use ingest::Ingested;
pub use opened::{Opened, load, load_bytes};
pub use policy::IngestOptions;
pub use read::format::Format;
pub use read::gltf::companions;
pub use repair::Repairs;
pub use topology::Topology;
pub use trimesh::{Area, TriMesh};
