//! A pipeline file as types: every key with its default, unknown keys refused with the nearest known one.
//!
//! - `train`: `[train]`, and the recipe that its options make; `verify`: `[verify]`; `publish`: `[publish]`; `mpgd_step`, `pages`: options of
//!   several kinds
//! - `count`: how many eigenpairs
//! - `file`: from a file's text, the recipe's defaults and `--set` to a [`Pipeline`]
//! - `recipe_file`: options of `[train]` in a file of their own, which a search leaves
//! - `check`: which values can work, alone and together
//! - `sweep`: a file with variants of a pipeline, which are compared
//! - `error`: why a pipeline cannot be run

mod check;
mod count;
mod error;
mod file;
mod mpgd_step;
mod pages;
mod publish;
mod recipe_file;
pub mod sweep;
mod train;
mod verify;

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::ggnn::features::FeatureOptions;
use crate::mesh::IngestOptions;
use crate::mesh::sample::{Set, Shape};
use crate::operators::OperatorOptions;
use crate::remesh::FamilyRecipe;
pub use count::Count;
pub use error::PipelineError;
pub use file::{MODEL_EXTENSION, is_model_file};
pub use mpgd_step::MpgdStep;
pub use pages::Pages;
pub use publish::{ExportFormat, OnDelete, Publish};
pub use recipe_file::FoundRecipe;
pub use train::{Method, RecipeName, Refine, Train};
pub use verify::{Formula, MpgdDirection, Verify};

/// What to compute, for which meshes, and how to judge it.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct Pipeline {
    /// Where meshes come from.
    pub input: Input,
    /// `[ingest]`: which meshes are turned away.
    pub ingest: IngestOptions,
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
    /// Mesh files, folders that are searched for them, patterns and lists of either; relative to the pipeline file.
    pub paths: Vec<PathBuf>,
    /// Samplings of surfaces that have a formula.
    pub generate: Vec<Generate>,
}

/// An entry of `input.generate`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Generate {
    /// The surface.
    pub shape: Shape,
    /// How many vertices: one sampling or more for each number.
    pub vertices: Vec<usize>,
    /// How many samplings with each number of vertices.
    #[serde(default = "one")]
    pub count: u64,
    /// Another one makes other samplings.
    #[serde(default)]
    pub seed: u64,
    /// Whether they are those that a family with this seed is trained on.
    #[serde(default)]
    pub set: Set,
}

fn one() -> u64 {
    1
}
