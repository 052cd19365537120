//! `[publish]`: which files are written of every mesh.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Pages;
use crate::descriptors::Descriptor;

/// The files that are written.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Publish {
    /// The files of every mesh (docs/outputs.md). "npz" is always written; the files of a format that is taken out of the list are
    /// removed.
    pub formats: Vec<ExportFormat>,
    /// What descriptors.npz holds; without any it is not written.
    pub descriptors: Vec<Descriptor>,
    /// Write report.html, a page for people with the mesh to turn, nodal lines, checks, times and where all of it comes from: one
    /// beside the results of every mesh, and one for all of them in the output folder.
    pub report: Pages,
    /// What `chladni watch` does with the results of a mesh that was deleted.
    pub on_delete: OnDelete,
}

impl Default for Publish {
    fn default() -> Self {
        let formats = vec![ExportFormat::Npz, ExportFormat::Ply];
        Self { formats, descriptors: Vec::new(), report: Pages::Auto, on_delete: OnDelete::Keep }
    }
}

impl Publish {
    /// Whether results are written in this format.
    pub fn writes(&self, format: ExportFormat) -> bool {
        format == ExportFormat::Npz || self.formats.contains(&format)
    }
}

/// An entry of `publish.formats`. What each of its files holds is said where it is written, in [`crate::publish::export`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum ExportFormat {
    /// Eigenpairs and mesh for numpy.
    Npz,
    /// The same as one JSON document.
    Json,
    /// The mesh with its eigenfunctions, for viewers and mesh libraries.
    Ply,
    /// The same as legacy VTK.
    Vtk,
    /// The same as VTK's XML.
    Vtu,
    /// The same in colours, as binary glTF.
    Glb,
    /// Eigenvalues and their certificate as a table.
    Csv,
    /// Eigenpairs and mesh for MATLAB.
    Mat,
    /// Stiffness, mass and graph Laplacian for SciPy.
    Operators,
    /// The same as Matrix Market files.
    Mtx,
}

impl ExportFormat {
    /// All formats.
    pub const ALL: [Self; 10] = [
        Self::Npz,
        Self::Json,
        Self::Ply,
        Self::Vtk,
        Self::Vtu,
        Self::Glb,
        Self::Csv,
        Self::Mat,
        Self::Operators,
        Self::Mtx,
    ];

    /// Whether it holds the matrices that the eigenpairs are of.
    pub fn takes_operators(self) -> bool {
        matches!(self, Self::Operators | Self::Mtx)
    }
}

/// `publish.on_delete`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum OnDelete {
    /// They stay.
    #[default]
    Keep,
    /// They are removed.
    Remove,
}
