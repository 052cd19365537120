//! `[train]`: how many eigenpairs, by which method, and the recipe that the options of a training make.

use serde::de::{Deserializer, Error, Unexpected};
use serde::{Deserialize, Serialize};

use super::Count;
use super::recipe_file::is_recipe_file;

use crate::ggnn::network::{Interval, Layer, Ranges, TrunkShape};
use crate::ggnn::ops::activation::Activation;
use crate::ggnn::paper::{Paper, ResidualRows, Warmup, Weights};
use crate::ggnn::recipe::{Recipe, Ritz, Trunks};
use crate::ggnn::sample::BOUNDARY_PENALTY;
use crate::ggnn::tune::Choice;

/// `[train]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Train {
    /// `lep-dpinn`: blocks are trained, and predict; `predict`: those of a trained model do; `fem`: the reference solver
    /// alone; `mpgd`: the paper's Algorithm 1.
    pub method: Method,
    /// The model of `predict`: a file, relative to the pipeline file, or a name in the cache. Empty for none.
    pub model: String,
    /// How blocks are trained: `ritz` or `paper`. A pipeline file may name a recipe file here, whose options are then among
    /// these.
    pub recipe: RecipeName,
    /// What is made of learned eigenfunctions.
    pub refine: Refine,
    /// K: eigenpairs, the constant included.
    pub k: Count,
    /// Seeds the initial weights and the order of batches.
    pub seed: u64,
    /// `per-eigenfunction`: each has a trunk of its own; `shared`: all are heads on one, trained together.
    pub trunk: Trunks,
    /// h_f: hidden features.
    pub width: usize,
    /// H: hidden layers.
    pub layers: usize,
    /// What a hidden layer is: `sggc` (29), `pointwise`, which is the same without its neighbours, `gcn` or `gat`.
    pub layer: Layer,
    /// I: iterations of (29) in a layer.
    pub iterations: usize,
    /// `sin`, `tanh` or `relu`, in the encoder and in every layer.
    pub activation: Activation,
    /// γ₁: the encoder's weights start in [−γ₁, γ₁] or [0, γ₁].
    pub encoder_range: f64,
    /// γ₂: the hidden weights start in [−γ₂, γ₂] or [0, γ₂].
    pub hidden_range: f64,
    /// Which of them: `symmetric`, with phases in [−π, π], or `positive`, with phases in [0, γ₁].
    pub initial_weights: Interval,
    /// Family members in one step.
    pub batch: usize,
    /// Adam's learning rate at the first step. By `ritz` it falls to zero along a half cosine.
    pub learning_rate: f64,
    /// `ritz`: Adam steps for a block.
    pub steps: usize,
    /// `ritz`: the head's ridge, relative to the trace of the features' stiffness: what keeps ill-conditioned combinations
    /// of features out.
    pub ridge: f64,
    /// `shared`: eigenfunctions beyond k that training goes down with the others, so that φ_k does not mix with them.
    pub spare: usize,
    /// `ritz`: how often variants are subdivided, and their vertices moved to the mesh, before the heads of a trunk are solved
    /// for the last time.
    pub head_subdivisions: usize,
    /// `ritz`: variants, the last ones, that training does not see: it ends when it becomes no better there.
    pub held_out: usize,
    /// `ritz`: how many recipes are tried, this one among them, before the best is trained by.
    pub tune: usize,
    /// `ritz`: the share of the steps that is taken when training goes on from the blocks of a mesh's previous version; 0: it
    /// never does.
    pub fine_tune: f64,
    /// What holds the network to 0 on a Dirichlet boundary, relative to the stiffness's own diagonal.
    pub boundary_penalty: f64,
    /// `ritz`: parallel tapes, at most one a member of a batch. The bits of a result depend on it, but not on the number
    /// of threads.
    pub shards: usize,
    /// `paper`: passes through the family for a block.
    pub epochs: usize,
    /// `paper`: after so many epochs the learning rate is multiplied by `decay`.
    pub milestones: Vec<usize>,
    /// `paper`: see `milestones`.
    pub decay: f64,
    /// `paper`: α₁ of (23), of the boundary condition (24).
    pub boundary_weight: f64,
    /// `paper`: α₂ of (23), of the residual (25).
    pub residual_weight: f64,
    /// `paper`: α₃ of (23), of orthogonality (26).
    pub orthogonality_weight: f64,
    /// `paper`: the share of α₂ in the first epoch.
    pub residual_start: f64,
    /// `paper`: the first epoch with all of α₂.
    pub residual_warmup: usize,
    /// `paper`: the rows of (25) that count under Dirichlet conditions.
    pub residual_rows: ResidualRows,
}

/// `train.recipe`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum RecipeName {
    /// The decoder is solved, Adam trains the trunk on the Rayleigh quotient.
    #[default]
    Ritz,
    /// Adam trains all weights on the loss (23), as the paper does.
    Paper,
}

impl<'de> Deserialize<'de> for RecipeName {
    /// The name of a recipe file reads as [`Self::Ritz`], whose options it holds unless it says otherwise: reading a
    /// pipeline file puts its options in its place.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let name = String::deserialize(deserializer)?;
        match name.as_str() {
            "ritz" => Ok(Self::Ritz),
            "paper" => Ok(Self::Paper),
            file if is_recipe_file(file) => Ok(Self::Ritz),
            other => Err(D::Error::invalid_value(
                Unexpected::Str(other),
                &"\"ritz\", \"paper\" or a recipe file, which ends in .toml",
            )),
        }
    }
}

/// `train.method`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// The paper's network, trained for every mesh.
    LepDpinn,
    /// Finite elements and an eigensolver, without any training.
    Fem,
    /// M-PGD, without any training.
    Mpgd,
    /// A trained model, without any training here.
    Predict,
}

/// `train.refine`: a second result beside the learned eigenpairs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Refine {
    /// None.
    #[default]
    None,
    /// The Ritz pairs on the span of the learned functions.
    RayleighRitz,
    /// The reference solver's iteration, started from the learned functions.
    Full,
}

impl Refine {
    /// The name used in files, tables and keys.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::RayleighRitz => "rayleigh-ritz",
            Self::Full => "full",
        }
    }
}

/// What `docs/lineage.md` arrives at.
const FINE_TUNE: f64 = 0.1;

impl Default for Train {
    fn default() -> Self {
        let Ritz { shape, ranges, steps, batch, learning_rate, ridge, spare, shards, held_out } =
            Ritz::default();
        let paper = Paper::default();
        Self {
            method: Method::LepDpinn,
            model: String::new(),
            recipe: RecipeName::Ritz,
            refine: Refine::None,
            k: Count::Number(8),
            seed: 0,
            trunk: Trunks::default(),
            width: shape.width,
            layers: shape.layers,
            layer: shape.layer,
            iterations: shape.iterations,
            activation: shape.activation,
            encoder_range: ranges.encoder,
            hidden_range: ranges.hidden,
            initial_weights: ranges.interval,
            steps,
            batch,
            learning_rate,
            ridge,
            spare,
            head_subdivisions: 0,
            held_out,
            tune: 0,
            fine_tune: FINE_TUNE,
            boundary_penalty: BOUNDARY_PENALTY,
            shards,
            epochs: paper.epochs,
            milestones: paper.milestones,
            decay: paper.decay,
            boundary_weight: paper.weights.boundary,
            residual_weight: paper.weights.residual,
            orthogonality_weight: paper.weights.orthogonality,
            residual_start: paper.warmup.start,
            residual_warmup: paper.warmup.epochs,
            residual_rows: paper.rows,
        }
    }
}

impl Train {
    /// These options with what a search has chosen.
    pub fn with(&self, choice: &Choice) -> Self {
        let &Choice { learning_rate, encoder_range, hidden_range, ridge, batch, spare, .. } =
            choice;
        let boundary_penalty = choice.boundary_penalty;
        Self {
            learning_rate,
            encoder_range,
            hidden_range,
            ridge,
            batch,
            spare,
            boundary_penalty,
            ..self.clone()
        }
    }

    /// The recipe that these options make for `inputs` features per vertex.
    pub fn recipe(&self, inputs: usize) -> Recipe {
        let shape = TrunkShape {
            inputs,
            width: self.width,
            layers: self.layers,
            iterations: self.iterations,
            layer: self.layer,
            activation: self.activation,
        };
        let ranges = Ranges {
            encoder: self.encoder_range,
            hidden: self.hidden_range,
            interval: self.initial_weights,
        };
        let Self { batch, learning_rate, .. } = *self;
        match self.recipe {
            RecipeName::Ritz => Recipe::Ritz(Ritz {
                shape,
                ranges,
                steps: self.steps,
                batch,
                learning_rate,
                ridge: self.ridge,
                spare: self.spare,
                shards: self.shards,
                held_out: self.held_out,
            }),
            RecipeName::Paper => Recipe::Paper(Paper {
                shape,
                ranges,
                epochs: self.epochs,
                batch,
                learning_rate,
                milestones: self.milestones.clone(),
                decay: self.decay,
                weights: Weights {
                    boundary: self.boundary_weight,
                    residual: self.residual_weight,
                    orthogonality: self.orthogonality_weight,
                },
                warmup: Warmup { start: self.residual_start, epochs: self.residual_warmup },
                rows: self.residual_rows,
            }),
        }
    }
}
