//! `[train]`: how many eigenpairs, by which method, and the recipe that the options of a training make.

use schemars::{JsonSchema, Schema};
use serde::de::{Deserializer, Error, Unexpected};
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::Count;
use super::recipe_file::is_recipe_file;

use crate::ggnn::network::{Interval, Layer, Ranges, TrunkShape};
use crate::ggnn::ops::activation::Activation;
use crate::ggnn::paper::{Paper, ResidualRows, Warmup, Weights};
use crate::ggnn::recipe::{Recipe, Ritz, Trunks};
use crate::ggnn::sample::BOUNDARY_PENALTY;
use crate::ggnn::tune::Choice;
use crate::schema::choices;

/// How many eigenpairs, by which method, and how blocks are trained.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Train {
    /// Where eigenpairs come from.
    pub method: Method,
    /// The model of "predict": a file that `chladni model export` wrote, relative to this one, or a name of `chladni model list`.
    pub model: String,
    /// How blocks are trained. Where "paper" has another default, it is given in brackets. An option of one recipe that is changed
    /// beside the other is refused.
    pub recipe: RecipeName,
    /// A second result beside learned eigenpairs. λ and the angles stay those before.
    pub refine: Refine,
    /// Eigenpairs, the constant included: 8 trains 7 blocks on a mesh of one piece, and 8 where Dirichlet conditions leave no constant.
    /// Or a share of the vertices, k = "10%": every mesh then has its own number.
    pub k: Count,
    /// Seeds the initial weights and the order of batches.
    pub seed: u64,
    /// What has a trunk of its own.
    pub trunk: Trunks,
    /// Hidden features h_f.
    pub width: usize,
    /// Hidden layers H.
    pub layers: usize,
    /// What a hidden layer is. ["paper": "sggc"]
    pub layer: Layer,
    /// Iterations I of equation (29) in a layer; 1 for "gcn" and "gat", which do not iterate.
    pub iterations: usize,
    /// The function of encoder and layers.
    pub activation: Activation,
    /// γ₁: the encoder's weights start in [-encoder_range, encoder_range]: the band of frequencies it offers. ["paper": 1]
    pub encoder_range: f64,
    /// γ₂: the hidden weights start in [-hidden_range, hidden_range]. An "sggc" layer starts near σ(x) where this is small. "gcn" and
    /// "gat" have no such term, and shrink their features with it; sqrt(3/width) keeps their size.
    pub hidden_range: f64,
    /// Where initial weights lie. ["paper": "positive"]
    pub initial_weights: Interval,
    /// Family members in one step. ["paper": 10]
    pub batch: usize,
    /// Adam's learning rate at the first step; by "ritz" it falls to zero along a half cosine. ["paper": 1e-3]
    pub learning_rate: f64,
    /// "ritz": Adam steps for a trunk. [trunk = "shared": 600]
    pub steps: usize,
    /// "ritz": the ridge under which the head is solved, relative to the trace of the features' stiffness: it keeps combinations of
    /// features out that need huge weights.
    pub ridge: f64,
    /// trunk = "shared": eigenfunctions beyond k that training goes down with the others, so that φ_k does not mix with the next ones.
    /// ["shared": 4]
    pub spare: usize,
    /// "ritz": how often the variants are subdivided, with the new vertices on the mesh, before the heads are solved for the last
    /// time; at most 3. Each time takes a forward pass over four times the vertices, and makes the angles smaller. ["shared": 1]
    pub head_subdivisions: usize,
    /// "ritz": so many variants, the last ones, are held out: training does not see them, is checked on them ten times, ends when four
    /// checks in a row found nothing better, and keeps the weights of the best. docs/training.md has what that is worth. A mesh that
    /// is trained on alone has none to spare.
    pub held_out: usize,
    /// "ritz": try so many recipes, this one among them, before training, and train by the best: other learning rates, encoder and
    /// hidden ranges, ridges, batches, for a shared trunk spare eigenfunctions, under Dirichlet conditions boundary penalties. Judged
    /// by λ on a quarter of the variants, which the trials do not see. What was found is saved as recipe.toml beside the results. 0:
    /// none. A mesh that is trained on alone keeps its recipe. A search takes longer than the training of its mesh (docs/training.md).
    pub tune: usize,
    /// "ritz": a mesh that was trained before, and has changed, may begin with the blocks of its previous version (docs/lineage.md).
    /// Where they are trained on, this share of the steps is taken. 0: they are not trained on.
    pub fine_tune: f64,
    /// Under Dirichlet conditions: what holds the network's own values on the boundary to 0, as a multiple of the stiffness's diagonal
    /// there. docs/training.md says what it is for.
    pub boundary_penalty: f64,
    /// "ritz": parallel tapes, at most one for every variant of a batch; where there is one alone, all threads share the vertices of
    /// its variant. The bits of a result depend on this, but not on the number of threads. By "paper" they depend on neither.
    pub shards: usize,
    /// "paper": how often training goes through the family for a block.
    pub epochs: usize,
    /// "paper": after so many epochs the learning rate is multiplied by `decay`.
    pub milestones: Vec<usize>,
    /// "paper": see `milestones`.
    pub decay: f64,
    /// "paper": α₁ of (23), of the boundary condition (24), which closed surfaces and the Neumann condition do not have. This and the
    /// next two are for B scaled to unit area, so that they do not depend on units.
    pub boundary_weight: f64,
    /// "paper": α₂ of (23), of the residual (25).
    pub residual_weight: f64,
    /// "paper": α₃ of (23), of orthogonality to the earlier eigenfunctions (26).
    pub orthogonality_weight: f64,
    /// "paper": the share of α₂ in the first epoch.
    pub residual_start: f64,
    /// "paper": the first epoch that has all of α₂; until then its share changes by the same factor from epoch to epoch. 0: all of it
    /// from the start.
    pub residual_warmup: usize,
    /// "paper": the rows of (25) that count under Dirichlet conditions.
    pub residual_rows: ResidualRows,
}

/// `train.recipe`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
#[schemars(transform = RecipeName::or_a_file)]
pub enum RecipeName {
    /// The decoder is solved, and Adam trains the rest on the Rayleigh quotient.
    #[default]
    Ritz,
    /// Adam trains all weights on the loss (23)–(26), as the paper does (docs/training.md, "Recipe paper"). Dirichlet conditions are a
    /// term of the loss, and what it predicts has zeros on the boundary.
    Paper,
}

impl RecipeName {
    /// The schema of these names as one that lets a recipe file stand there too.
    fn or_a_file(schema: &mut Schema) {
        let file = json!({
            "type": "string",
            "pattern": r"(\.toml$)|/|\\",
            "description": "Or a recipe file, relative to this one, such as `tune` leaves: a file with [train] alone, whose options lie \
                            under those of this file.",
        });
        if let Some(names) = choices(schema) {
            names.push(file);
        }
    }
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
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// A network is trained for the eigenfunctions of a mesh, and predicts them.
    LepDpinn,
    /// The reference solver alone, for whole folders at once: no training, residuals and counts in place of second opinions.
    Fem,
    /// The paper's Algorithm 1, without any training.
    Mpgd,
    /// The blocks of a trained model predict (docs/predict.md).
    Predict,
}

/// `train.refine`: a second result beside the learned eigenpairs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Refine {
    /// No second result.
    #[default]
    None,
    /// The best pairs on the span of the learned functions.
    RayleighRitz,
    /// The reference solver's, started from the learned functions.
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
