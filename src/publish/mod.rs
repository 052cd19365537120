//! Results as files and as text.
//!
//! - [`result`]: `spectrum.json`, what was found of one mesh and how it was checked
//! - [`report`]: `run.json` and the document of `chladni run --format json`, what the work was
//! - [`json`]: these documents as bytes
//! - [`npz`]: `eigen.npz`, eigenpairs and mesh for numpy; `arrays`: such archives
//! - [`overview`]: what stands beside the folders of all meshes
//! - [`kept_current`]: which meshes of a watched folder have results
//! - [`mesh_file`]: a mesh alone
//! - [`page`]: `report.html`, for people
//! - [`picture`]: eigenfunctions with their nodal lines, as PNG
//! - [`ply`]: the mesh with its eigenfunctions, for viewers
//! - [`export`]: the results in all formats, and what is made of them
//! - [`plan`]: what a run would do, and why
//! - [`status`]: how far a run is, for other processes
//! - [`sweep`]: variants of a pipeline beside one another
//! - [`table`]: a run for the terminal
//! - [`watched`]: what happens in a watched folder
//! - [`atomic`]: bytes into files that are whole at any time

mod arrays;
pub mod atomic;
pub mod export;
pub mod json;
pub mod kept_current;
pub mod mesh_file;
pub mod npz;
pub mod overview;
pub mod page;
pub mod picture;
pub mod plan;
pub mod ply;
pub mod report;
pub mod result;
pub mod status;
pub mod sweep;
pub mod table;
pub mod watched;

pub use atomic::{PublishError, Written, write, write_if_changed};
pub use report::{MeshReport, RunRecord, RunReport};
pub use result::{Eigenpair, Spectrum};
