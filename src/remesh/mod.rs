//! Variants of a mesh: what one model is trained on.
//!
//! - [`simplify`]: one variant with fewer vertices
//! - [`family`]: a seeded set of variants that keep the topology

pub mod family;
pub mod simplify;

pub use family::{Family, FamilyError, FamilyRecipe};
