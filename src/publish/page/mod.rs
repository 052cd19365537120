//! `report.html`: what was found, as a page for people. One for every mesh, one for a run.
//!
//! A page is one file that needs no network: the mesh turns by WebGL, and stands beside its eigenfunctions as pictures for who prints it or
//! has no WebGL. Light and dark follow the reader's setting.
//!
//! - [`mesh`]: the page of a mesh
//! - [`run`]: the page of a run
//! - `frame`: what both have in common
//! - `viewer`: the mesh that turns
//! - `plot`: spectrum, errors, training
//!
//! Pages hold times and what came from the cache, so that equal work does not give equal bytes.

mod frame;
pub mod mesh;
mod plot;
pub mod run;
mod viewer;

pub use frame::is_ours;
pub use mesh::{Curve, MeshPage};
pub use run::{FILE, run_page};
