//! Descriptors of shapes and of their points, from eigenpairs alone.
//!
//! - [`basis`]: eigenpairs, and which of them belong to λ = 0
//! - [`shape_dna`]: the eigenvalues of a shape as its fingerprint
//! - [`heat_kernel`]: HKS, the heat that stays at a point
//! - [`wave_kernel`]: WKS, where a quantum particle of some energy is met
//! - [`global_point`]: GPS, coordinates in which distances are those of Green's function
//! - [`diffusion`]: distances between points as heat sees them
//! - [`coordinates`]: the first eigenfunctions as coordinates
//! - [`projection`]: functions as coefficients of eigenfunctions, and back
//!
//! With n vertices, K pairs of which c belong to λ = 0. None of these depends on the signs of the eigenfunctions but GPS
//! and the coordinates, nor on their basis inside an eigenspace but these two; all work goes row by row, so that no matrix
//! is n×n.

pub mod basis;
pub mod coordinates;
pub mod diffusion;
pub mod global_point;
pub mod heat_kernel;
pub mod projection;
pub mod shape_dna;
pub mod wave_kernel;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use basis::Basis;

/// A descriptor that can be asked for.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "kebab-case")]
pub enum Descriptor {
    /// The heat kernel signature.
    Hks,
    /// The wave kernel signature.
    Wks,
    /// The global point signature.
    Gps,
    /// The eigenvalues, scaled to unit area. A run also leaves shape_dna.csv and shape_dna_distances.csv over all of its meshes.
    ShapeDna,
    /// The first eigenfunctions that are not constant, as coordinates.
    SpectralCoordinates,
}

impl Descriptor {
    /// All of them.
    pub const ALL: [Self; 5] =
        [Self::Hks, Self::Wks, Self::Gps, Self::ShapeDna, Self::SpectralCoordinates];

    /// As pipelines call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Hks => "hks",
            Self::Wks => "wks",
            Self::Gps => "gps",
            Self::ShapeDna => "shape-dna",
            Self::SpectralCoordinates => "spectral-coordinates",
        }
    }
}

/// There are too few eigenpairs for a descriptor: those of λ = 0 say nothing but how many pieces a mesh has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "{:?} takes {needed} {} λ > 0, and there are {found} among {k} eigenpairs; ask for more (train.k, or -k), or leave it out of \
     publish.descriptors",
    .descriptor.name(), .what.in_words()
)]
pub struct TooFew {
    /// What was asked for.
    pub descriptor: Descriptor,
    /// How many it takes, and of what.
    pub needed: usize,
    /// What is counted.
    pub what: Counted,
    /// How many there are.
    pub found: usize,
    /// Among how many pairs.
    pub k: usize,
}

/// What [`TooFew`] counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Counted {
    /// Eigenfunctions.
    Functions,
    /// Eigenvalues, each once.
    Different,
}

impl Counted {
    fn in_words(self) -> &'static str {
        match self {
            Self::Functions => "eigenfunctions of",
            Self::Different => "different",
        }
    }
}

#[cfg(test)]
mod laws;
