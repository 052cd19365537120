//! A block: one trained GGNN for one eigenfunction.

use std::sync::Arc;

use super::network::{Trunk, TrunkShape};

/// What became of one training.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainingRecord {
    /// The Rayleigh quotient of the batch at every step, in units of 1/area; of a shared trunk the geometric mean of all
    /// its heads'.
    pub history: Vec<f64>,
    /// The head's own Rayleigh quotient over the whole family before the first step: the untrained trunk.
    pub untrained: f64,
    /// The head's own Rayleigh quotient over the whole family with the final weights.
    pub trained: f64,
}

/// The weights of one block and how they came about.
#[derive(Debug, Clone, PartialEq)]
pub struct Block {
    /// The sizes and functions of the trunk.
    pub shape: TrunkShape,
    /// The trunk's weights, see [`Trunk::weights`]. The blocks of a shared trunk hold the same ones.
    pub weights: Arc<Vec<Vec<f32>>>,
    /// w_out, solved over the whole family.
    pub head: Vec<f64>,
    /// The training.
    pub record: TrainingRecord,
}

impl Block {
    /// The trunk with these weights.
    pub fn trunk(&self) -> Trunk<f32> {
        Trunk::from_weights(self.shape, self.weights.to_vec())
    }

    /// Whether both are heads on one trunk.
    pub fn shares_trunk(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.weights, &other.weights)
    }
}
