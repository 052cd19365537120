//! A pipeline file as types: every key with its default, unknown keys refused with the nearest known one.

mod mpgd_step;

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use crate::ggnn::features::{FeatureOptions, Normalise};
use crate::ggnn::network::{Interval, Layer, Ranges, TrunkShape};
use crate::ggnn::ops::activation::Activation;
use crate::ggnn::paper::{Paper, ResidualRows, Warmup, Weights};
use crate::ggnn::recipe::{Recipe, Ritz, Trunks};
use crate::ggnn::sample::BOUNDARY_PENALTY;
use crate::operators::{Boundary, Laplacian, OperatorOptions};
use crate::remesh::{FamilyRecipe, Operation, Resolution};
use crate::spectrum::mpgd::Stopping;
pub use mpgd_step::MpgdStep;

/// What to compute, for which meshes, and how to judge it.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Pipeline {
    /// Where meshes come from.
    pub input: Input,
    /// The variants that a model is trained on.
    pub family: FamilyRecipe,
    /// `[operators]`: which Laplacian, with which mass.
    pub operators: OperatorOptions,
    /// What the network reads.
    pub features: FeatureOptions,
    /// How many eigenpairs, and how blocks are trained.
    pub train: Train,
    /// The second opinions, and the tolerances of the verdict.
    pub verify: Verify,
    /// The files that are written.
    pub publish: Publish,
}

/// `[input]`
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Input {
    /// Mesh files, or folders that are searched for them; relative to the pipeline file.
    pub paths: Vec<PathBuf>,
}

/// `[train]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Train {
    /// `lep-dpinn`: blocks are trained, and predict; `predict`: those of a trained model do; `fem`: the reference solver
    /// alone; `mpgd`: the paper's Algorithm 1.
    pub method: Method,
    /// The model of `predict`: a file, relative to the pipeline file, or a name in the cache. Empty for none.
    pub model: String,
    /// How blocks are trained: `ritz` or `paper`.
    pub recipe: RecipeName,
    /// What is made of learned eigenfunctions.
    pub refine: Refine,
    /// K: eigenpairs, the constant included.
    pub k: usize,
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
    /// `shared`: how often variants are subdivided, and their vertices moved to the mesh, before the heads are solved for
    /// the last time.
    pub head_subdivisions: usize,
    /// What holds the network to 0 on a Dirichlet boundary, relative to the stiffness's own diagonal.
    pub boundary_penalty: f64,
    /// `ritz`: parallel tapes. The bits of a result depend on it, but not on the number of threads.
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
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RecipeName {
    /// The decoder is solved, Adam trains the trunk on the Rayleigh quotient.
    #[default]
    Ritz,
    /// Adam trains all weights on the loss (23), as the paper does.
    Paper,
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

impl Default for Train {
    fn default() -> Self {
        let Ritz { shape, ranges, steps, batch, learning_rate, ridge, spare, shards } =
            Ritz::default();
        let paper = Paper::default();
        Self {
            method: Method::LepDpinn,
            model: String::new(),
            recipe: RecipeName::Ritz,
            refine: Refine::None,
            k: 8,
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

    /// Refuses options of the recipe, or of the kind of trunk, that is not chosen: they would change nothing.
    fn check_recipe(&self) -> Result<(), PipelineError> {
        let unread: &[(&[&'static str], &'static str)] = match (self.recipe, self.trunk) {
            (RecipeName::Ritz, Trunks::PerEigenfunction) => &[
                (&PAPER_ONLY, "is for train.recipe = \"paper\"; set that, or leave it out"),
                (&SHARED_ONLY, "is for train.trunk = \"shared\"; set that, or leave it out"),
            ],
            (RecipeName::Ritz, Trunks::Shared) => {
                &[(&PAPER_ONLY, "is for train.recipe = \"paper\"; set that, or leave it out")]
            }
            (RecipeName::Paper, _) => {
                &[(&RITZ_ONLY, "is for train.recipe = \"ritz\"; set that, or leave it out")]
            }
        };
        let [given, defaults] = [self, &Self::default()].map(Table::try_from);
        let (given, defaults) = (given.unwrap_or_default(), defaults.unwrap_or_default());
        for (keys, rule) in unread {
            for key in *keys {
                let name = key.rsplit('.').next().unwrap_or(key);
                if let Some(value) =
                    given.get(name).filter(|value| defaults.get(name) != Some(value))
                {
                    return Err(PipelineError::Value { key, value: value.to_string(), rule });
                }
            }
        }
        Ok(())
    }

    fn check_layer(&self) -> Result<(), PipelineError> {
        if matches!(self.layer, Layer::Sggc | Layer::Pointwise) || self.iterations == 1 {
            return Ok(());
        }
        let value = self.iterations.to_string();
        let rule = "only \"sggc\" and \"pointwise\" layers iterate; set train.iterations = 1 beside train.layer = \"gcn\" or \"gat\"";
        Err(PipelineError::Value { key: "train.iterations", value, rule })
    }
}

/// `[verify]`
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Verify {
    /// The largest relative difference of λ from the reference.
    pub lambda_tolerance: f64,
    /// The largest principal angle to the reference cluster, radians.
    pub angle_tolerance: f64,
    /// The largest entry of ΦᵀBΦ − I.
    pub orthonormality_tolerance: f64,
    /// The largest ‖Lφ − λBφ‖ in the B⁻¹ norm, relative to λ, of a solved pair.
    pub residual_tolerance: f64,
    /// How far M-PGD goes in one step: `exact`, to the lowest quotient along its direction, or a fixed α.
    pub mpgd_step: MpgdStep,
    /// Which way M-PGD goes: `preconditioned` by a factorisation, or down the plain `gradient` as the paper prints
    /// it, which takes thousands of steps on ten thousand vertices.
    pub mpgd_direction: MpgdDirection,
    /// M-PGD's Tol of (22).
    pub mpgd_tolerance: f64,
    /// M-PGD's N_its of (22).
    pub mpgd_iterations: usize,
    /// Seeds M-PGD's start vectors.
    pub mpgd_seed: u64,
}

/// `verify.mpgd_direction`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum MpgdDirection {
    /// (L + μB)⁻¹ times the gradient.
    Preconditioned,
    /// The gradient (19).
    Gradient,
}

impl Default for Verify {
    fn default() -> Self {
        Self {
            lambda_tolerance: 0.01,
            angle_tolerance: 0.05,
            orthonormality_tolerance: 1e-8,
            residual_tolerance: 1e-6,
            mpgd_step: MpgdStep::Exact,
            mpgd_direction: MpgdDirection::Preconditioned,
            mpgd_tolerance: 1e-6,
            mpgd_iterations: 20_000,
            mpgd_seed: 1,
        }
    }
}

impl Verify {
    /// When M-PGD stops.
    pub fn stopping(&self) -> Stopping {
        Stopping { tolerance: self.mpgd_tolerance, max_iterations: self.mpgd_iterations }
    }

    fn check_step(&self) -> Result<(), PipelineError> {
        let MpgdStep::Fixed(alpha) = self.mpgd_step else { return Ok(()) };
        let refuse = |rule| {
            let value = alpha.to_string();
            Err(PipelineError::Value { key: "verify.mpgd_step", value, rule })
        };
        if !(alpha > 0.0 && alpha.is_finite()) {
            return refuse("must be \"exact\" or a positive number");
        }
        if self.mpgd_direction == MpgdDirection::Preconditioned {
            return refuse(
                "a fixed step goes down the plain gradient; set verify.mpgd_direction = \"gradient\" beside it, or take the \"exact\" step",
            );
        }
        Ok(())
    }
}

/// `[publish]`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct Publish {
    /// Write `eigen.ply`: the mesh with a property for every eigenfunction.
    pub ply: bool,
}

impl Default for Publish {
    fn default() -> Self {
        Self { ply: true }
    }
}

/// Sizes beyond these are slips of the keyboard, and would be found out by running out of memory.
const LARGEST: [(&str, usize); 9] = [
    ("train.k", 10_000),
    ("train.width", 8_192),
    ("train.layers", 64),
    ("train.iterations", 64),
    ("train.shards", 256),
    ("family.members", 10_000),
    ("features.landmarks", 1_024),
    ("train.spare", 1_024),
    ("train.head_subdivisions", MOST_SUBDIVISIONS),
];

/// Options that only one recipe reads.
const RITZ_ONLY: [&str; 6] = [
    "train.trunk",
    "train.steps",
    "train.ridge",
    "train.spare",
    "train.head_subdivisions",
    "train.shards",
];

/// Options that only a shared trunk reads.
const SHARED_ONLY: [&str; 2] = ["train.spare", "train.head_subdivisions"];
const PAPER_ONLY: [&str; 9] = [
    "train.epochs",
    "train.milestones",
    "train.decay",
    "train.boundary_weight",
    "train.residual_weight",
    "train.orthogonality_weight",
    "train.residual_start",
    "train.residual_warmup",
    "train.residual_rows",
];

/// `train.head_subdivisions` of a shared trunk, unless a file says otherwise.
const HEAD_SUBDIVISIONS: usize = 1;

/// More would make meshes of hundreds of times the size.
const MOST_SUBDIVISIONS: usize = 3;

/// Why a pipeline cannot be run. Each message says where and what to do.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PipelineError {
    /// The file is not there or not readable.
    #[error("{path}: {reason}; give the path of a pipeline file, such as pipelines/spot.toml")]
    Unreadable { path: String, reason: String },
    /// The file is not TOML, or a value has the wrong type.
    #[error("{path}: {reason}")]
    Malformed { path: String, reason: String },
    /// A key that no option has.
    #[error("{path}: there is no option `{key}`{}", hint(.nearest.as_deref()))]
    UnknownKey { path: String, key: String, nearest: Option<String> },
    /// `--set` without `=`.
    #[error("--set {argument}: write KEY=VALUE, for example --set train.k=10")]
    Assignment { argument: String },
    /// A value that cannot work.
    #[error("{key} = {value}: {rule}")]
    Value { key: &'static str, value: String, rule: &'static str },
}

fn hint(nearest: Option<&str>) -> String {
    nearest.map(|name| format!("; did you mean `{name}`?")).unwrap_or_default()
}

impl Pipeline {
    /// Reads a pipeline file, with `assignments` (`train.k=10`) laid over it. Input paths become relative to
    /// the current directory.
    ///
    /// # Errors
    /// [`PipelineError`].
    pub fn load(path: &Path, assignments: &[String]) -> Result<Self, PipelineError> {
        let name = path.display().to_string();
        let text = std::fs::read_to_string(path)
            .map_err(|e| PipelineError::Unreadable { path: name.clone(), reason: e.to_string() })?;
        let mut pipeline = Self::parse(&name, &text, assignments)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        pipeline.input.paths.iter_mut().for_each(|p| *p = folder.join(&*p));
        if is_model_file(&pipeline.train.model) {
            pipeline.train.model = folder.join(&pipeline.train.model).display().to_string();
        }
        Ok(pipeline)
    }

    /// Parses the text of a pipeline file; `name` is for messages.
    ///
    /// # Errors
    /// [`PipelineError`].
    pub fn parse(name: &str, text: &str, assignments: &[String]) -> Result<Self, PipelineError> {
        let malformed = |reason: String| PipelineError::Malformed {
            path: name.to_string(),
            reason: plain(&reason),
        };
        // Parsed as a pipeline first: the errors then carry line and column.
        toml::from_str::<Self>(text).map_err(|e| malformed(e.to_string()))?;
        let mut table: Table =
            text.parse().map_err(|e: toml::de::Error| malformed(e.to_string()))?;
        refuse_unknown(name, &table, &known_keys())?;
        for argument in assignments {
            assign(&mut table, argument)?;
            refuse_unknown("--set", &table, &known_keys())?;
            table.clone().try_into::<Self>().map_err(|e| PipelineError::Malformed {
                path: format!("--set {argument}"),
                reason: plain(&e.to_string()),
            })?;
        }
        lay_recipe_under(&mut table);
        let pipeline: Self = table.try_into().map_err(|e| malformed(e.to_string()))?;
        pipeline.check()?;
        Ok(pipeline)
    }

    /// Whether the values can work, alone and together.
    ///
    /// # Errors
    /// [`PipelineError::Value`].
    pub fn check(&self) -> Result<(), PipelineError> {
        self.check_method()?;
        self.check_operators()?;
        self.verify.check_step()?;
        self.train.check_layer()?;
        self.train.check_recipe()?;
        let Train { k, width, iterations, steps, batch, shards, .. } = self.train;
        for (key, value) in [
            ("train.k", k),
            ("train.width", width),
            ("train.iterations", iterations),
            ("train.steps", steps),
            ("train.batch", batch),
            ("train.epochs", self.train.epochs),
            ("train.shards", shards),
            ("family.members", self.family.members),
            ("features.landmarks", self.features.landmarks),
            ("verify.mpgd_iterations", self.verify.mpgd_iterations),
        ] {
            if value == 0 {
                return Err(PipelineError::Value {
                    key,
                    value: "0".into(),
                    rule: "must be at least 1",
                });
            }
        }
        let (members, landmarks) = (self.family.members, self.features.landmarks);
        let Train { layers, spare, head_subdivisions: finer, .. } = self.train;
        let sizes = [k, width, layers, iterations, shards, members, landmarks, spare, finer];
        for ((key, largest), value) in LARGEST.into_iter().zip(sizes) {
            if value > largest {
                let rule = "is more than can be meant; lower it";
                return Err(PipelineError::Value { key, value: value.to_string(), rule });
            }
        }
        self.check_family()?;
        for (key, value) in [
            ("train.learning_rate", self.train.learning_rate),
            ("train.encoder_range", self.train.encoder_range),
            ("train.decay", self.train.decay),
            ("train.boundary_penalty", self.train.boundary_penalty),
            ("verify.lambda_tolerance", self.verify.lambda_tolerance),
            ("verify.angle_tolerance", self.verify.angle_tolerance),
            ("verify.orthonormality_tolerance", self.verify.orthonormality_tolerance),
            ("verify.residual_tolerance", self.verify.residual_tolerance),
            ("verify.mpgd_tolerance", self.verify.mpgd_tolerance),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                let rule = "must be a positive number";
                return Err(PipelineError::Value { key, value: value.to_string(), rule });
            }
        }
        for (key, value) in [
            ("train.hidden_range", self.train.hidden_range),
            ("train.ridge", self.train.ridge),
            ("train.boundary_weight", self.train.boundary_weight),
            ("train.residual_weight", self.train.residual_weight),
            ("train.orthogonality_weight", self.train.orthogonality_weight),
            ("train.residual_start", self.train.residual_start),
            ("family.jitter", self.family.jitter),
            ("family.perturbation", self.family.perturbation),
            ("family.flips", self.family.flips),
        ] {
            if !(value >= 0.0 && value.is_finite()) {
                let rule = "must not be negative";
                return Err(PipelineError::Value { key, value: value.to_string(), rule });
            }
        }
        Ok(())
    }

    fn check_family(&self) -> Result<(), PipelineError> {
        let FamilyRecipe { operations, vertices, flips, .. } = &self.family;
        let refuse = |key, value: String, rule| Err(PipelineError::Value { key, value, rule });
        let Resolution { fewest, most } = *vertices;
        if fewest < 4 {
            let rule = "a closed surface has at least 4 vertices";
            return refuse("family.vertices", fewest.to_string(), rule);
        }
        if fewest > most {
            let rule = "write the smaller number first";
            return refuse("family.vertices", format!("[{fewest}, {most}]"), rule);
        }
        if operations.is_empty() {
            let rule = "name what makes a variant, such as \"simplify\"; family.members = 1 trains on the mesh alone";
            return refuse("family.operations", "[]".into(), rule);
        }
        let subdivisions = operations.iter().filter(|&&o| o == Operation::Subdivide).count();
        if subdivisions > MOST_SUBDIVISIONS {
            let rule = "each makes four triangles of one; \"subdivide\" at most three times";
            return refuse("family.operations", format!("{subdivisions} × subdivide"), rule);
        }
        if *flips > 1.0 {
            let rule = "is the share of edges that are tried, at most 1";
            return refuse("family.flips", flips.to_string(), rule);
        }
        Ok(())
    }

    fn check_method(&self) -> Result<(), PipelineError> {
        let Train { method, model, refine, .. } = &self.train;
        let refuse = |key, value: &str, rule| {
            Err(PipelineError::Value { key, value: format!("{value:?}"), rule })
        };
        match method {
            Method::Predict if model.is_empty() => refuse(
                "train.model",
                "",
                "train.method = \"predict\" needs a model: a file, or a name of `chladni model list`",
            ),
            Method::LepDpinn | Method::Fem | Method::Mpgd if !model.is_empty() => refuse(
                "train.model",
                model,
                "is for train.method = \"predict\"; set that, or leave it out",
            ),
            Method::Fem | Method::Mpgd if *refine != Refine::None => refuse(
                "train.refine",
                refine.name(),
                "is for learned eigenfunctions; solved ones are as good as they get",
            ),
            _ => Ok(()),
        }
    }

    fn check_operators(&self) -> Result<(), PipelineError> {
        let OperatorOptions { laplacian, mass, robust: _, boundary } = self.operators;
        if let (Some(mass), Err(_)) = (mass, self.operators.mass_kind()) {
            let rule = "\"degree\" belongs to the graph Laplacian, and the other masses to the others; \"auto\" always fits";
            return Err(PipelineError::Value {
                key: "operators.mass",
                value: mass.name().into(),
                rule,
            });
        }
        if matches!(self.train.method, Method::Fem | Method::Mpgd) {
            return Ok(());
        }
        let by_paper = self.train.recipe == RecipeName::Paper;
        if by_paper && self.train.method == Method::LepDpinn && boundary == Boundary::Dirichlet {
            let rule = "is not wired to train.recipe = \"paper\" yet; train by \"ritz\"";
            let value = boundary.name().into();
            return Err(PipelineError::Value { key: "operators.boundary", value, rule });
        }
        if laplacian == Laplacian::Graph {
            let rule = "cannot be trained: its spectrum belongs to the sampling of a mesh, which every variant changes; choose \"cotangent\" or \"fem\"";
            return Err(PipelineError::Value {
                key: "operators.laplacian",
                value: laplacian.name().into(),
                rule,
            });
        }
        Ok(())
    }
}

/// The ending of model files.
pub const MODEL_EXTENSION: &str = "safetensors";

/// Whether a model is named by its file: it ends as one, or has folders. Anything else is a name in the cache.
pub fn is_model_file(model: &str) -> bool {
    model.contains(['/', '\\']) || model.ends_with(&format!(".{MODEL_EXTENSION}"))
}

/// A message of the parser in words that are not Rust's.
fn plain(reason: &str) -> String {
    reason
        .trim_end()
        .replace("expected usize", "expected a whole number")
        .replace("expected u64", "expected a whole number")
        .replace("expected f64", "expected a number")
        .replace("expected a sequence", "expected a list")
}

/// Lays `section.key=value` over a table. The value is TOML, or else a plain string.
fn assign(table: &mut Table, argument: &str) -> Result<(), PipelineError> {
    let malformed = || PipelineError::Assignment { argument: argument.to_string() };
    let (key, text) = argument.split_once('=').ok_or_else(malformed)?;
    let value = format!("value = {text}")
        .parse::<Table>()
        .ok()
        .and_then(|mut parsed| parsed.remove("value"))
        .unwrap_or_else(|| Value::String(text.to_string()));
    let (section, name) = key.trim().split_once('.').ok_or_else(malformed)?;
    table
        .entry(section)
        .or_insert_with(|| Value::Table(Table::new()))
        .as_table_mut()
        .ok_or_else(malformed)?
        .insert(name.to_string(), value);
    Ok(())
}

/// Options whose default depends on the recipe or the kind of trunk: lays these under what a file says.
fn lay_recipe_under(table: &mut Table) {
    let train = |key| table.get("train").and_then(|train| train.get(key)).and_then(Value::as_str);
    let mut under = Vec::new();
    if train("recipe") == Some("paper") {
        let Paper { shape, ranges, batch, learning_rate, .. } = Paper::default();
        under.extend([
            ("train", "layer", Value::try_from(shape.layer)),
            ("train", "batch", Value::try_from(batch)),
            ("train", "learning_rate", Value::try_from(learning_rate)),
            ("train", "encoder_range", Value::try_from(ranges.encoder)),
            ("train", "initial_weights", Value::try_from(ranges.interval)),
            ("features", "normalise", Value::try_from(Normalise::None)),
        ]);
    } else if train("trunk") == Some(Trunks::Shared.name()) {
        let Ritz { steps, spare, .. } = Ritz::shared();
        under.extend([
            ("train", "steps", Value::try_from(steps)),
            ("train", "spare", Value::try_from(spare)),
            ("train", "head_subdivisions", Value::try_from(HEAD_SUBDIVISIONS)),
        ]);
    }
    for (section, key, value) in under {
        let options = table.entry(section).or_insert_with(|| Value::Table(Table::new()));
        if let (Some(options), Ok(value)) = (options.as_table_mut(), value) {
            options.entry(key).or_insert(value);
        }
    }
}

/// All options as `section.key`, from the defaults.
fn known_keys() -> Vec<String> {
    let defaults = Table::try_from(Pipeline::default()).unwrap_or_default();
    flatten(&defaults)
}

fn flatten(table: &Table) -> Vec<String> {
    table
        .iter()
        .flat_map(|(section, value)| match value {
            Value::Table(keys) => {
                keys.keys().map(|key| format!("{section}.{key}")).collect::<Vec<_>>()
            }
            _ => vec![section.clone()],
        })
        .collect()
}

fn refuse_unknown(name: &str, table: &Table, known: &[String]) -> Result<(), PipelineError> {
    let sections: Vec<&str> = known.iter().filter_map(|k| Some(k.split_once('.')?.0)).collect();
    let empty = table.iter().filter(|(section, value)| {
        value.as_table().is_some_and(Table::is_empty) && !sections.contains(&section.as_str())
    });
    let unknown = flatten(table)
        .into_iter()
        .chain(empty.map(|(section, _)| section.clone()))
        .find(|key| !known.contains(key) && !sections.contains(&key.as_str()));
    match unknown {
        None => Ok(()),
        Some(key) => Err(PipelineError::UnknownKey {
            path: name.to_string(),
            nearest: nearest(&key, known),
            key,
        }),
    }
}

/// The known key that looks most like `key`, unless none does.
fn nearest(key: &str, known: &[String]) -> Option<String> {
    // A right key in the wrong section is the nearest of all.
    let last = key.rsplit('.').next().unwrap_or(key);
    if let Some(moved) = known.iter().find(|k| k.rsplit('.').next() == Some(last)) {
        return Some(moved.clone());
    }
    let best = known
        .iter()
        .max_by(|a, b| strsim::jaro_winkler(key, a).total_cmp(&strsim::jaro_winkler(key, b)))?;
    (strsim::jaro_winkler(key, best) > 0.75).then(|| best.clone())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::operators::MassKind;

    fn parse(text: &str, set: &[&str]) -> Result<Pipeline, PipelineError> {
        let set: Vec<String> = set.iter().map(ToString::to_string).collect();
        Pipeline::parse("p.toml", text, &set)
    }

    #[test]
    fn every_key_has_a_default() {
        assert_eq!(parse("", &[]), Ok(Pipeline::default()));
    }

    #[test]
    fn assignments_win_over_the_file() {
        let pipeline =
            parse("[train]\nk = 4", &["train.k=10", "operators.mass=consistent"]).unwrap();
        assert_eq!((pipeline.train.k, pipeline.operators.mass), (10, Some(MassKind::Consistent)));
    }

    #[test]
    fn unknown_keys_name_the_nearest_known_one() {
        let message = |text, set: &[&str]| parse(text, set).unwrap_err().to_string();
        assert_eq!(
            message("[train]\nlearning_rat = 1e-3", &[]),
            "p.toml: there is no option `train.learning_rat`; did you mean `train.learning_rate`?"
        );
        assert_eq!(
            message("", &["train.lambda_tolerance=1"]),
            "--set: there is no option `train.lambda_tolerance`; did you mean `verify.lambda_tolerance`?"
        );
        assert_eq!(message("[zzz]", &[]), "p.toml: there is no option `zzz`");
        assert!(message("[zzz]\nq = 1", &[]).starts_with("p.toml: there is no option `zzz.q`"));
    }

    #[test]
    fn wrong_values_say_which_and_why() {
        assert_eq!(
            parse("", &["train.k=0"]).unwrap_err().to_string(),
            "train.k = 0: must be at least 1"
        );
        assert!(parse("[train]\nk = \"many\"", &[]).unwrap_err().to_string().contains("line 2"));
        assert!(parse("", &["train.k"]).unwrap_err().to_string().contains("KEY=VALUE"));
        assert!(parse("", &["verify.angle_tolerance=nan"]).is_err());
    }

    #[test]
    fn layers_and_activations_go_by_name_and_only_sggc_iterates() {
        let options =
            "[train]\nlayer = \"gat\"\nactivation = \"relu\"\ninitial_weights = \"positive\"";
        let recipe = parse(options, &[]).unwrap().train.recipe(3);
        let Recipe::Ritz(recipe) = recipe else { panic!("{recipe:?}") };
        assert_eq!(recipe.shape.layer, Layer::Gat);
        assert_eq!(recipe.shape.activation, Activation::Relu);
        assert_eq!(recipe.ranges.interval, Interval::Positive);
        let message = |set: &[&str]| parse("", set).unwrap_err().to_string();
        let refused = message(&["train.layer=gcn", "train.iterations=2"]);
        assert!(refused.starts_with("train.iterations = 2: only \"sggc\" and"), "{refused}");
        assert!(parse("", &["train.iterations=2"]).is_ok());
        let unknown = message(&["train.layer=gin"]);
        assert!(
            ["gin", "sggc", "gcn", "gat"].iter().all(|name| unknown.contains(name)),
            "{unknown}"
        );
    }

    #[test]
    fn the_papers_recipe_has_its_own_defaults_and_refuses_the_others_options() {
        let paper = parse("[train]\nrecipe = \"paper\"", &[]).unwrap();
        assert_eq!(paper.train.recipe(3), Recipe::Paper(Paper::default()));
        assert_eq!(paper.features.normalise, Normalise::None);
        let set = ["train.recipe=paper", "train.batch=3", "features.normalise=area"];
        let chosen = parse("", &set).unwrap();
        assert_eq!((chosen.train.batch, chosen.features.normalise), (3, Normalise::Area));
        let message = |set: &[&str]| parse("", set).unwrap_err().to_string();
        let refused = message(&["train.epochs=9"]);
        assert!(
            refused.starts_with("train.epochs = 9: is for train.recipe = \"paper\""),
            "{refused}"
        );
        let refused = message(&["train.recipe=paper", "train.steps=9"]);
        assert!(
            refused.starts_with("train.steps = 9: is for train.recipe = \"ritz\""),
            "{refused}"
        );
        assert!(message(&["train.recipe=papers"]).contains("paper"));
    }

    #[test]
    fn a_shared_trunk_has_its_own_defaults_and_its_options_are_for_it_alone() {
        let shared = parse("", &["train.trunk=shared"]).unwrap().train;
        let Ritz { steps, spare, .. } = Ritz::shared();
        let found = (shared.steps, shared.spare, shared.head_subdivisions);
        assert_eq!(found, (steps, spare, HEAD_SUBDIVISIONS));
        let chosen = parse("", &["train.trunk=shared", "train.spare=0", "train.steps=7"]).unwrap();
        assert_eq!((chosen.train.spare, chosen.train.steps), (0, 7));
        let message = |set: &[&str]| parse("", set).unwrap_err().to_string();
        let refused = message(&["train.spare=2"]);
        let rule = "train.spare = 2: is for train.trunk = \"shared\"";
        assert!(refused.starts_with(rule), "{refused}");
        let refused = message(&["train.trunk=shared", "train.head_subdivisions=4"]);
        assert!(refused.contains("more than can be meant"), "{refused}");
    }

    #[test]
    fn a_family_is_a_list_of_operations_and_a_number_of_vertices_or_a_range() {
        let text = "[family]\noperations = [\"subdivide\", \"flip\"]\nvertices = [400, 800]";
        let family = parse(text, &[]).unwrap().family;
        assert_eq!(family.operations, [Operation::Subdivide, Operation::Flip]);
        assert_eq!(family.vertices, Resolution { fewest: 400, most: 800 });
        assert_eq!(parse("", &["family.vertices=2000"]).unwrap(), Pipeline::default());
        let message = |set: &str| parse("", &[set]).unwrap_err().to_string();
        assert!(message("family.vertices=3").starts_with("family.vertices = 3: a closed"));
        assert!(message("family.vertices=[9, 8]").contains("the smaller number first"));
        assert!(message("family.operations=[]").contains("family.members = 1"));
        assert!(message("family.flips=2").contains("at most 1"));
        assert!(message("family.vertices=few").contains("the range [fewest, most]"));
        let four = "family.operations=[\"subdivide\", \"subdivide\", \"subdivide\", \"subdivide\"]";
        assert!(message(four).starts_with("family.operations = 4 × subdivide"));
        let unknown = message("family.operations=[\"smooth\"]");
        assert!(unknown.contains("smooth") && unknown.contains("perturb"), "{unknown}");
    }

    #[test]
    fn a_laplacian_takes_its_own_masses_only_and_the_graph_is_not_trained() {
        let message = |set: &[&str]| parse("", set).unwrap_err().to_string();
        let graph = "operators.laplacian=graph";
        assert!(message(&["operators.mass=degree"]).starts_with("operators.mass = degree: "));
        assert!(message(&[graph, "operators.mass=lumped"]).starts_with("operators.mass = lumped"));
        assert!(message(&[graph]).starts_with("operators.laplacian = graph: cannot be trained"));
        assert!(parse("", &["operators.laplacian=fem", "operators.mass=voronoi"]).is_ok());
    }

    #[test]
    fn a_fixed_step_goes_down_the_plain_gradient_only() {
        let message = |set: &[&str]| parse("", set).unwrap_err().to_string();
        let gradient = "verify.mpgd_direction=gradient";
        let fixed = parse("[verify]\nmpgd_step = 0.001", &[gradient]).unwrap();
        assert_eq!(fixed.verify.mpgd_step, MpgdStep::Fixed(0.001));
        let exact = parse("[verify]\nmpgd_step = 0.001", &["verify.mpgd_step=exact"]).unwrap();
        assert_eq!(exact.verify.mpgd_step, MpgdStep::Exact);
        let refused = message(&["verify.mpgd_step=0.001"]);
        assert!(refused.starts_with("verify.mpgd_step = 0.001: "), "{refused}");
        assert!(refused.contains("verify.mpgd_direction = \"gradient\""), "{refused}");
        for alpha in ["0", "-1.0", "nan", "inf"] {
            let refused = message(&[&format!("verify.mpgd_step={alpha}"), gradient]);
            assert!(refused.contains("\"exact\" or a positive number"), "{refused}");
        }
        let unknown = parse("[verify]\nmpgd_step = \"exakt\"", &[]).unwrap_err().to_string();
        let expected = "invalid value: string \"exakt\", expected \"exact\" or a positive number";
        assert!(unknown.contains("line 2") && unknown.contains(expected), "{unknown}");
    }
}
