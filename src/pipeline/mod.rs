//! A pipeline file as types: every key with its default, unknown keys refused with the nearest known one.
//!
//! - `train`: `[train]`, and the recipe that its options make; `verify`: `[verify]`; `publish`: `[publish]`; `mpgd_step`, `pages`: options of
//!   several kinds
//! - `count`: how many eigenpairs
//! - `file`: from a file's text, the recipe's defaults and `--set` to a [`Pipeline`]
//! - `recipe_file`: options of `[train]` in a file of their own, which a search leaves
//! - `check`: which values can work, alone and together
//! - `reference`: what every option means
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
pub mod reference;
pub mod sweep;
mod train;
mod verify;

use std::path::PathBuf;

use schemars::JsonSchema;
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
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Pipeline {
    pub input: Input,
    pub ingest: IngestOptions,
    pub family: FamilyRecipe,
    pub operators: OperatorOptions,
    pub features: FeatureOptions,
    pub train: Train,
    pub verify: Verify,
    pub publish: Publish,
}

/// Where meshes come from.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct Input {
    /// Mesh files (.obj, .off, .ply, .stl, .vtk, .vtp, .gltf or .glb), or folders that are searched for them; relative to the
    /// pipeline file. Folders of results are passed over. Or patterns of either, "scans/*.obj", "scans/**/left_?.ply",
    /// "scans/{a,b}": `*` and `?` stay within a folder, `**` does not, and a name that is there as it is written is no pattern. Or
    /// lists: text files that end in .txt or .lst, with one of these a line, relative to the list; blank lines and those that begin
    /// with # say nothing.
    ///
    /// The results of a mesh lie in a folder of its name: the path below the folder that was searched, below the folder before the
    /// first wildcard, or below that of the list. `--input PATH…` on the command line takes their place.
    pub paths: Vec<PathBuf>,
    /// Surfaces that have a formula, sampled: for example generate = [{ shape = "square", vertices = [144, 932], count = 20, seed = 7 }],
    /// which is 20 meshes with 144 vertices and 20 with 932, as files in the folder `generated` of the output folder (`explain` and
    /// `--dry-run` make them too).
    pub generate: Vec<Generate>,
}

/// An entry of `input.generate`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Generate {
    /// The surface, as `chladni generate` makes it.
    pub shape: Shape,
    /// Numbers of vertices.
    pub vertices: Vec<usize>,
    /// How many samplings with each of them; 1 where it is not given.
    #[serde(default = "one")]
    pub count: u64,
    /// Another one makes other samplings; 0 where it is not given.
    #[serde(default)]
    pub seed: u64,
    /// What they are for; "test" where it is not given.
    #[serde(default)]
    pub set: Set,
}

fn one() -> u64 {
    1
}
