//! How a block is trained: the hyperparameters, each a documented option.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::features::COORDINATES;
use super::network::{Interval, Layer, Ranges, TrunkShape};
use super::ops::activation::Activation;
use super::paper::Paper;

/// How blocks are trained.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Recipe {
    /// See [`super::train`].
    Ritz(Ritz),
    /// See [`super::paper`].
    Paper(Paper),
}

impl Recipe {
    /// The sizes and functions of the trunk.
    pub fn shape(&self) -> TrunkShape {
        match self {
            Self::Ritz(ritz) => ritz.shape,
            Self::Paper(paper) => paper.shape,
        }
    }

    /// How often an observer of the training hears of its progress.
    pub fn reports(&self) -> usize {
        match self {
            Self::Ritz(ritz) => ritz.steps,
            Self::Paper(paper) => paper.epochs,
        }
    }
}

/// `train.trunk`: what has a trunk of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Trunks {
    /// Every eigenfunction has a trunk of its own, trained after those before it; a larger k trains only what is missing.
    #[default]
    PerEigenfunction,
    /// There is one trunk with a head for each, trained together, so that prediction takes one forward pass for all; another k is
    /// another training, and k cannot exceed the width by more than the eigenfunctions of λ = 0.
    Shared,
}

impl Trunks {
    /// The name used in files, tables and keys.
    pub fn name(self) -> &'static str {
        match self {
            Self::PerEigenfunction => "per-eigenfunction",
            Self::Shared => "shared",
        }
    }
}

/// Recipe `ritz`: the head is solved, Adam trains the trunk on the Rayleigh quotient.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Ritz {
    /// The trunk's sizes and functions.
    pub shape: TrunkShape,
    /// Its initial weights.
    pub ranges: Ranges,
    /// Adam steps for a trunk.
    pub steps: usize,
    /// Family members in one step.
    pub batch: usize,
    /// Adam's learning rate at the first step; it falls to zero along a half cosine.
    pub learning_rate: f64,
    /// The head's ridge σ, relative to the trace of the features' stiffness: combinations of features that need
    /// weights so large that σ‖w‖² counts are cut off.
    pub ridge: f64,
    /// Eigenfunctions beyond the wanted ones that training goes down with them: the last of the wanted ones is then no
    /// longer free to mix with its next neighbour. They get no head.
    #[serde(default)]
    pub spare: usize,
    /// Parallel tapes, at most one a member of a batch; the bits of the result depend on it, not on the number of threads.
    pub shards: usize,
    /// Members, the last ones, that training does not see and is ended by.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub held_out: usize,
}

/// What holds nothing out is spelled as it was before anything could be: in the keys of what is in a cache.
fn is_zero(held_out: &usize) -> bool {
    *held_out == 0
}

/// The learning rate of a continued training, relative to that of one from nothing (`docs/lineage.md`).
const GENTLER: f64 = 1.0 / 3.0;

impl Default for Ritz {
    /// The values that `docs/training.md` arrives at.
    fn default() -> Self {
        Self {
            shape: TrunkShape {
                inputs: COORDINATES,
                width: 128,
                layers: 4,
                iterations: 1,
                layer: Layer::Pointwise,
                activation: Activation::Sin,
            },
            ranges: Ranges { encoder: 6.0, hidden: 0.005, interval: Interval::Symmetric },
            steps: 100,
            batch: 1,
            learning_rate: 6e-3,
            ridge: 1e-10,
            spare: 0,
            shards: 2,
            held_out: 0,
        }
    }
}

impl Ritz {
    /// What a trunk that all eigenfunctions share wants more of: steps for all of them, and spare ones.
    pub fn shared() -> Self {
        Self { steps: 600, spare: 4, ..Self::default() }
    }

    /// The recipe by which the training of a nearly right trunk goes on: a `share` of the steps, more gently.
    pub fn continued(&self, share: f64) -> Self {
        let steps = (share * self.steps as f64).ceil().max(1.0) as usize;
        Self { steps, learning_rate: GENTLER * self.learning_rate, ..*self }
    }

    /// How many of so many members are held out: one at least is left to train on.
    pub fn held_out_of(&self, members: usize) -> usize {
        self.held_out.min(members.saturating_sub(1))
    }

    /// The learning rate at `step`.
    pub fn learning_rate_at(&self, step: usize) -> f64 {
        let phase = step as f64 / self.steps.max(1) as f64;
        self.learning_rate * 0.5 * (1.0 + (std::f64::consts::PI * phase).cos())
    }
}
