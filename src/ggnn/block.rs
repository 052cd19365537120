//! A block: one trained GGNN for one eigenfunction.

use std::sync::Arc;

use super::network::{Trunk, TrunkShape};
use super::ops::rayleigh::decode;

/// What became of one training.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TrainingRecord {
    /// The Rayleigh quotient of the batch at every step, in units of 1/area; of a shared trunk the geometric mean of all
    /// its heads'.
    pub history: Vec<f64>,
    /// The head's own Rayleigh quotient over the whole family before the first step: the untrained trunk.
    pub untrained: f64,
    /// The head's own Rayleigh quotient over the whole family with the final weights.
    pub trained: f64,
    /// What was found on members that were held out, in the order of the steps; the weights are those of the lowest loss.
    pub held_out: Vec<Check>,
}

/// What a training was worth on members that it does not see.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Check {
    /// After so many steps.
    pub step: usize,
    /// See [`super::held_out::loss`].
    pub loss: f64,
}

/// The weights of one block and how they came about.
#[derive(Debug, Clone, PartialEq)]
pub struct Block {
    /// The sizes and functions of the trunk.
    pub shape: TrunkShape,
    /// The trunk's weights, see [`Trunk::weights`]. The blocks of a shared trunk hold the same ones.
    pub weights: Arc<Vec<Vec<f32>>>,
    /// w_out, solved over the whole family; by recipe `paper` trained, and b_out after it.
    pub head: Vec<f64>,
    /// The training.
    pub record: TrainingRecord,
}

impl Block {
    /// The trunk with these weights.
    pub fn trunk(&self) -> Trunk<f32> {
        Trunk::from_weights(self.shape, self.weights.to_vec())
    }

    /// What the head makes of the last hidden features F, row-major n×h: F w_outᵀ + b_out, n.
    pub fn decode(&self, features: &[f32]) -> Vec<f64> {
        let (weights, bias) = self.head.split_at(self.shape.width);
        let mut u = decode(features, weights);
        bias.iter().for_each(|b| u.iter_mut().for_each(|u| *u += b));
        u
    }

    /// Whether both are heads on one trunk.
    pub fn shares_trunk(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.weights, &other.weights)
    }
}
