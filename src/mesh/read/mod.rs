//! From the bytes of a file to a [`RawMesh`](super::raw::RawMesh), one file a format.
//!
//! - [`format`]: which format the bytes are
//! - [`obj`]: Wavefront OBJ
//! - [`off`]: Geomview's OFF
//! - [`ply`]: Stanford's PLY
//! - [`stl`]: STL, triangles without indices
//! - [`vtk`]: legacy VTK
//! - [`vtp`]: VTK's XML files of `PolyData`
//! - [`gltf`]: glTF 2.0, as `.gltf` and as `.glb`
//! - [`scan`], [`values`]: the lines and the numbers of OFF, PLY, STL, VTK and VTP

pub mod format;
pub(super) mod gltf;
pub(super) mod obj;
pub(super) mod off;
pub(super) mod ply;
mod scan;
pub(super) mod stl;
mod values;
pub(super) mod vtk;
pub(super) mod vtp;
