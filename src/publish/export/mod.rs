//! The results of one mesh in the formats that a pipeline asks for.
//!
//! - `eigen_json`: `eigen.json`, eigenpairs and mesh as one document
//! - `vtk` and `vtu`: the mesh with its eigenfunctions for VTK and ParaView
//! - `glb`: the same in colours, for anything that shows glTF
//! - `csv`: `spectrum.csv`, and tables as text
//! - `mat`: `eigen.mat` for MATLAB
//! - `sparse_npz` and `matrix_market`: the matrices that the eigenpairs are of
//! - `descriptors`: `descriptors.npz`
//! - `shape_dna`: the ShapeDNA of all meshes of a run, with their distances
//!
//! [`super::npz`] and [`super::ply`] are what is written by default. Nothing in any of these files depends on when or where
//! it was written: equal results are equal bytes.

mod csv;
pub mod descriptors;
mod eigen_json;
mod glb;
mod mat;
mod matrix_market;
pub mod shape_dna;
mod sparse_npz;
mod vtk;
mod vtu;

use std::borrow::Cow;
use std::path::Path;

use super::atomic::{PublishError, remove, write_if_changed};
use super::npz::EigenArrays;
use super::ply::to_ply;
use super::result::Spectrum;
use crate::operators::{Operators, Sparse};
use crate::pipeline::ExportFormat;
use matrix_market::Symmetry;

/// What was found of one mesh.
#[derive(Debug, Clone, Copy)]
pub struct Results<'a> {
    /// Mesh, eigenpairs and masses.
    pub arrays: EigenArrays<'a>,
    /// The eigenpairs with their certificate.
    pub spectrum: &'a Spectrum,
    /// What the eigenpairs are of; only for the formats that hold it ([`ExportFormat::takes_operators`]).
    pub operators: Option<&'a Operators>,
}

/// The names of the files of a format, in the folder of the mesh.
pub fn files(format: ExportFormat) -> &'static [&'static str] {
    match format {
        ExportFormat::Npz => &["eigen.npz"],
        ExportFormat::Json => &["eigen.json"],
        ExportFormat::Ply => &["eigen.ply"],
        ExportFormat::Vtk => &["eigen.vtk"],
        ExportFormat::Vtu => &["eigen.vtu"],
        ExportFormat::Glb => &["eigen.glb"],
        ExportFormat::Csv => &["spectrum.csv"],
        ExportFormat::Mat => &["eigen.mat"],
        ExportFormat::Operators => &["stiffness.npz", "mass.npz", "graph_laplacian.npz"],
        ExportFormat::Mtx => &["stiffness.mtx", "mass.mtx", "graph_laplacian.mtx"],
    }
}

/// Writes the files of a format into `folder`, those that hold these bytes already excepted.
///
/// # Errors
/// When the system refuses, or the format cannot hold so much.
pub fn write(
    format: ExportFormat,
    results: &Results<'_>,
    folder: &Path,
) -> Result<(), PublishError> {
    let arrays = &results.arrays;
    let too_large = |TooLarge { bytes }| {
        let path = folder.join(files(format)[0]);
        PublishError::TooLarge { path, bytes }
    };
    let bytes = match format {
        ExportFormat::Npz => arrays.to_npz(),
        ExportFormat::Json => eigen_json::to_json(arrays),
        ExportFormat::Ply => to_ply(arrays.mesh, arrays.pairs),
        ExportFormat::Vtk => vtk::to_vtk(arrays.mesh, arrays.pairs),
        ExportFormat::Vtu => vtu::to_vtu(arrays.mesh, arrays.pairs),
        ExportFormat::Glb => glb::to_glb(arrays.mesh, arrays.pairs).map_err(too_large)?,
        ExportFormat::Csv => csv::to_csv(results.spectrum).into_bytes(),
        ExportFormat::Mat => mat::to_mat(arrays).map_err(too_large)?,
        ExportFormat::Operators | ExportFormat::Mtx => {
            return write_matrices(format, results.operators, folder);
        }
    };
    write_if_changed(&folder.join(files(format)[0]), &bytes).map(drop)
}

fn write_matrices(
    format: ExportFormat,
    operators: Option<&Operators>,
    folder: &Path,
) -> Result<(), PublishError> {
    let Some(operators) = operators else { return remove_files(format, folder) };
    type Matrix = fn(&Operators) -> Cow<'_, Sparse>;
    let matrices: [(Matrix, Symmetry); 3] = [
        (|operators| Cow::Borrowed(&operators.stiffness), Symmetry::Symmetric),
        (|operators| Cow::Borrowed(&operators.mass), Symmetry::Symmetric),
        (|operators| Cow::Owned(operators.graph_laplacian()), Symmetry::General),
    ];
    for (name, (matrix, symmetry)) in files(format).iter().zip(matrices) {
        let matrix = matrix(operators);
        let bytes = match format {
            ExportFormat::Mtx => matrix_market::to_mtx(&matrix, symmetry).into_bytes(),
            _ => sparse_npz::to_npz(&matrix),
        };
        write_if_changed(&folder.join(name), &bytes)?;
    }
    Ok(())
}

/// Removes the files of a format from `folder`.
///
/// # Errors
/// When the system refuses.
pub fn remove_files(format: ExportFormat, folder: &Path) -> Result<(), PublishError> {
    files(format).iter().try_for_each(|name| remove(&folder.join(name)))
}

/// A format does not count so many bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct TooLarge {
    bytes: u64,
}

#[cfg(test)]
mod fixture;
