//! chladni: verified Laplace–Beltrami eigenpairs of triangle meshes.

pub mod ggnn;
pub mod mesh;
pub mod operators;
pub mod publish;
pub mod remesh;
pub mod spectrum;
pub mod store;
