//! Variants of a mesh: what one model is trained on.
//!
//! - [`simplify`]: fewer vertices
//! - [`perturb`]: vertices elsewhere on the surface
//! - [`flip`]: other triangles between the same vertices
//! - [`refined`]: a finer sampling of a variant
//! - [`relax`]: even triangles on the same surface
//! - [`edges`]: the triangles at every edge
//! - [`thickness`]: which triangles are too thin
//! - [`resolution`]: how many vertices
//! - [`family`]: a seeded set of variants that keep the topology

pub mod edges;
pub mod family;
pub mod flip;
pub mod perturb;
pub mod refined;
pub mod relax;
pub mod resolution;
pub mod simplify;
pub mod thickness;

pub use family::{Family, FamilyError, FamilyRecipe, Of, Operation};
pub use refined::refined;
pub use resolution::Resolution;
