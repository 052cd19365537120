//! Recipe `paper`: the training of section V-A, to the letter.
//!
//! The network is all of (27), decoder included; its prediction is scaled to unit B-norm; Adam goes down the loss
//! (23)–(26). Nothing is solved or projected in training: Dirichlet conditions (24) and orthogonality (26) are asked
//! for by weights alone. `docs/training.md` says what that leads to.
//!
//! - [`network`]: trunk and decoder
//! - [`loss`]: (23) on one mesh
//! - [`train`](mod@train): the epochs
//!
//! B is scaled to unit area, as everywhere in training, and L, λ and the loss with it: with B/A in place of B, (24) and (25)
//! are A times what they are in input units. So α₁ and α₂ do not depend on units; the paper does not give its own.

pub mod loss;
pub mod network;
pub mod train;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::features::COORDINATES;
use super::network::{Interval, Layer, Ranges, TrunkShape};
use super::ops::activation::Activation;

pub use loss::Sample;
pub use train::train_block;

/// The hyperparameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Paper {
    /// The trunk's sizes and functions.
    pub shape: TrunkShape,
    /// Its initial weights.
    pub ranges: Ranges,
    /// How often training goes through the whole family.
    pub epochs: usize,
    /// Family members in one step of Adam.
    pub batch: usize,
    /// Adam's learning rate in the first epoch.
    pub learning_rate: f64,
    /// After so many epochs the learning rate falls by `decay`.
    pub milestones: Vec<usize>,
    /// What it is multiplied by.
    pub decay: f64,
    /// α₁, α₂, α₃ of (23).
    pub weights: Weights,
    /// How α₂ starts.
    pub warmup: Warmup,
    /// Which rows of (25) count.
    pub rows: ResidualRows,
}

/// α₁, α₂, α₃ of (23).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Weights {
    /// α₁, of the boundary condition (24).
    pub boundary: f64,
    /// α₂, of the residual (25).
    pub residual: f64,
    /// α₃, of orthogonality (26).
    pub orthogonality: f64,
}

/// α₂ in the first epochs: it grows by the same factor from one to the next.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Warmup {
    /// Its share in the first epoch.
    pub start: f64,
    /// The first epoch that has all of it; 0 for no warm-up.
    pub epochs: usize,
}

/// `train.residual_rows`: which rows of (25) count under Dirichlet conditions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ResidualRows {
    /// Those of inner vertices; in the others stands the flux through the boundary, which is not zero.
    #[default]
    Interior,
    /// Every row, as (25) is printed.
    All,
}

impl Default for Paper {
    /// The paper's values, where it gives them.
    fn default() -> Self {
        Self {
            shape: TrunkShape {
                inputs: COORDINATES,
                width: 128,
                layers: 4,
                iterations: 1,
                layer: Layer::Sggc,
                activation: Activation::Sin,
            },
            ranges: Ranges { encoder: 1.0, hidden: 0.005, interval: Interval::Positive },
            epochs: 250,
            batch: 10,
            learning_rate: 1e-3,
            milestones: vec![20, 50, 100],
            decay: 0.1,
            weights: Weights { boundary: 1.0, residual: 1.0, orthogonality: 100.0 },
            warmup: Warmup { start: 1.0, epochs: 0 },
            rows: ResidualRows::Interior,
        }
    }
}

impl Paper {
    /// The learning rate in `epoch`, from 0.
    pub fn learning_rate_in(&self, epoch: usize) -> f64 {
        let passed = self.milestones.iter().filter(|&&milestone| epoch >= milestone).count();
        self.learning_rate * self.decay.powi(passed as i32)
    }

    /// The weights in `epoch`, from 0.
    pub fn weights_in(&self, epoch: usize) -> Weights {
        let Warmup { start, epochs } = self.warmup;
        let left = epochs.saturating_sub(epoch) as f64 / epochs.max(1) as f64;
        let share = if left > 0.0 { start.powf(left) } else { 1.0 };
        Weights { residual: share * self.weights.residual, ..self.weights }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_schedule_is_the_papers() {
        let recipe = Paper::default();
        for (epoch, rate) in
            [(0, 1e-3), (19, 1e-3), (20, 1e-4), (49, 1e-4), (50, 1e-5), (100, 1e-6), (249, 1e-6)]
        {
            assert!((recipe.learning_rate_in(epoch) / rate - 1.0).abs() < 1e-12, "{epoch}");
        }
    }

    #[test]
    fn the_residual_warms_up_geometrically() {
        let warmup = Warmup { start: 1e-4, epochs: 40 };
        let recipe = Paper { warmup, ..Paper::default() };
        for (epoch, share) in [(0, 1e-4), (10, 1e-3), (20, 1e-2), (40, 1.0), (99, 1.0)] {
            let weights = recipe.weights_in(epoch);
            assert!((weights.residual / (share * recipe.weights.residual) - 1.0).abs() < 1e-12);
            assert_eq!(weights.orthogonality, recipe.weights.orthogonality);
        }
        let held_back = Paper { warmup: Warmup { start: 0.0, epochs: 2 }, ..recipe };
        assert_eq!([0, 1, 2].map(|epoch| held_back.weights_in(epoch).residual), [0.0, 0.0, 1.0]);
    }
}
