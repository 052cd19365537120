//! LEP-dPINN: one graph neural network block per eigenfunction.
//!
//! - [`ops`]: the differentiable operations
//! - [`features`]: what the network reads at every vertex
//! - [`landmarks`]: points of a shape that are found again on every mesh of it
//! - [`network`]: encoder and hidden layers, (27)–(29)
//! - [`deflation`]: keeping a function away from the earlier eigenfunctions
//! - [`head`]: the decoder, solved by Rayleigh–Ritz
//! - [`heads`]: the decoders of a trunk, solved again on finer samplings
//! - [`sample`]: what training works on
//! - [`recipe`]: the hyperparameters
//! - [`train`]: one block, by recipe `ritz`; [`shards`] runs its tapes in parallel
//! - [`checkpoint`]: what an interrupted training goes on from
//! - [`held_out`]: the loss on members that training does not see, and the end of a training by it
//! - [`tune`]: a search for a better recipe, by the same loss
//! - [`paper`]: one block, by recipe `paper`
//! - [`block`]: what training makes
//! - [`forward`]: forward passes without a tape, on all threads
//! - [`orthonormal`]: Gram–Schmidt for many functions at once
//! - [`predict`]: eigenfunctions on any mesh
//! - [`model`]: a chain of blocks as a file, and which meshes it fits; [`likeness`]: whether they lie as the trained shape

pub mod block;
pub mod checkpoint;
pub mod deflation;
pub mod features;
pub mod forward;
pub mod head;
pub mod heads;
pub mod held_out;
pub mod landmarks;
pub mod likeness;
pub mod model;
pub mod network;
pub mod ops;
pub mod orthonormal;
pub mod paper;
pub mod predict;
pub mod recipe;
pub mod sample;
pub mod shards;
pub mod train;
pub mod tune;

pub use block::Block;
pub use model::Model;
