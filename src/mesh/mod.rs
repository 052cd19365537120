//! Triangle meshes: reading, repairing, measuring and naming them by content.
//!
//! - [`trimesh`]: the canonical, validated mesh that all other folders work on
//! - [`hash`]: its content hash
//! - [`topology`]: pieces, boundary, Euler characteristic, defects
//! - [`shape`]: edge lengths and angles
//! - [`closest`]: the point of a surface closest to a point of space
//! - [`geodesic`]: distances along the surface
//! - [`subdivide`]: every triangle becomes four
//! - [`ingest`]: from a file to all of these
//! - [`objects`]: the way there, through `read` (one file a format), `raw` and [`repair`], of all of a file or of one of its objects
//! - [`policy`]: which meshes are turned away
//! - [`error`]: why a file did not become a mesh
//! - [`sample`]: surfaces with known spectra

pub mod closest;
pub mod error;
pub mod geodesic;
pub mod hash;
pub mod ingest;
pub mod objects;
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
pub use ingest::{Ingested, load, load_bytes};
pub use objects::Opened;
pub use policy::IngestOptions;
pub use read::format::Format;
pub use read::gltf::companions;
pub use repair::Repairs;
pub use topology::Topology;
pub use trimesh::{Area, TriMesh};
