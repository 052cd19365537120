//! chladni: verified Laplace–Beltrami eigenpairs of triangle meshes.

pub mod mesh;
pub mod store;
