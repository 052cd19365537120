//! Discrete Laplacians of a mesh: graph (5), cotangent (7) and finite elements (12), each as a pencil (L, B).
//!
//! - [`options`]: which Laplacian, with which mass
//! - [`triangle`]: angles and area of every triangle, which all geometry comes from
//! - [`pattern`]: where the entries of the matrices stand
//! - [`adjacency`]: W, I − W and D − A
//! - [`stiffness`]: the cotangent stiffness L
//! - [`mass`]: the mass matrices B
//! - [`gluing`]: which sides of triangles are one edge
//! - [`intrinsic`]: better triangles on the same surface
//! - [`quality`]: how good the triangles are
//! - [`assembly`]: all of them for one mesh, as the pipeline caches them
//! - [`error`]: why a mesh has none

pub mod adjacency;
pub mod assembly;
pub mod error;
pub mod gluing;
pub mod intrinsic;
pub mod mass;
pub mod options;
pub mod pattern;
pub mod quality;
pub mod stiffness;
pub mod triangle;

pub use assembly::Operators;
pub use error::OperatorError;
pub use mass::MassKind;
pub use options::{Boundary, Laplacian, OperatorOptions, Robust};
pub use pattern::Pattern;
pub use quality::Quality;
pub use triangle::Triangle;

/// A square sparse matrix in compressed rows, columns sorted within a row.
pub type Sparse = sprs::CsMat<f64>;

#[cfg(test)]
mod laws;
