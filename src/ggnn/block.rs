//! A block: one trained GGNN for one eigenfunction.

use super::network::{Trunk, TrunkShape};

/// What became of one training.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainingRecord {
    /// The Rayleigh quotient of the batch at every step, in units of 1/area.
    pub history: Vec<f64>,
    /// The head's Rayleigh quotient over the whole family before the first step: the untrained trunk.
    pub untrained: f64,
    /// The head's Rayleigh quotient over the whole family with the final weights.
    pub trained: f64,
}

/// The weights of one block and how they came about.
#[derive(Debug, Clone, PartialEq)]
pub struct Block {
    /// The sizes and functions of the trunk.
    pub shape: TrunkShape,
    /// The trunk's weights, see [`Trunk::weights`].
    pub weights: Vec<Vec<f32>>,
    /// w_out, solved over the whole family.
    pub head: Vec<f64>,
    /// The training.
    pub record: TrainingRecord,
}

impl Block {
    /// The trunk with these weights.
    pub fn trunk(&self) -> Trunk<f32> {
        Trunk::from_weights(self.shape, self.weights.clone())
    }
}
