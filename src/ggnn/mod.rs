//! LEP-dPINN: one graph neural network block per eigenfunction.
//!
//! - [`ops`]: the differentiable operations
//! - [`deflation`]: keeping a function away from the earlier eigenfunctions

pub mod deflation;
pub mod ops;
