//! From the bytes of a file to a [`RawMesh`](super::raw::RawMesh), one file a format.
//!
//! - [`format`]: which format the bytes are
//! - [`obj`]: Wavefront OBJ
//! - [`gltf`]: glTF 2.0, as `.gltf` and as `.glb`

pub mod format;
pub(super) mod gltf;
pub(super) mod obj;
