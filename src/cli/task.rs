//! What `run` and `explain` are asked to do: a pipeline, its meshes, and where cache and results are.

use std::path::PathBuf;
use std::sync::Arc;

use super::model::given_by_name;
use super::{CacheLocation, Refusal};
use crate::ggnn::Model;
use crate::pipeline::{Method, Pipeline, Train, is_model_file};
use crate::stages::intake::{self, Job};
use crate::stages::predict::GivenModel;
use crate::store::Store;

#[derive(Debug, clap::Args)]
pub struct Task {
    /// The pipeline file
    pub pipeline: PathBuf,
    /// Meshes or folders, in place of the pipeline's own
    #[arg(long, value_name = "PATH")]
    pub input: Vec<PathBuf>,
    /// Where results go: one folder a mesh
    #[arg(long, value_name = "DIR", default_value = "out")]
    pub out: PathBuf,
    #[command(flatten)]
    pub cache: CacheLocation,
    #[command(flatten)]
    pub laid: Laid,
}

/// What is laid over a pipeline, and over how it is done.
#[derive(Debug, clap::Args)]
pub struct Laid {
    /// Lay an option over the pipeline's, for example train.k=10
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Whether a mesh that has changed begins with the blocks of its previous version; `off`: as if there had been none
    #[arg(
        long,
        value_enum,
        default_value = "on",
        value_name = "on|off",
        hide_possible_values = true
    )]
    pub lineage: Switch,
}

/// `on` or `off`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Switch {
    On,
    Off,
}

impl Task {
    /// The pipeline with what is laid over it, and the meshes.
    ///
    /// # Errors
    /// What the user has to mend in either.
    pub fn read(&self) -> Result<(Pipeline, Vec<Job>), Refusal> {
        let pipeline = Pipeline::load(&self.pipeline, &self.laid.set).map_err(Refusal::usage)?;
        let inputs = if self.input.is_empty() {
            let folder = self.out.join(GENERATED);
            let made = intake::generate(&pipeline.input.generate, &folder);
            pipeline.input.paths.iter().cloned().chain(made.map_err(Refusal::usage)?).collect()
        } else {
            self.input.clone()
        };
        let jobs = intake::jobs(&inputs).map_err(Refusal::usage)?;
        Ok((pipeline, jobs))
    }
}

/// Where generated meshes are, in the output folder.
const GENERATED: &str = "generated";

/// The model of `train.method = "predict"`.
///
/// # Errors
/// When there is no such model, or it does not answer the pipeline's problem.
pub fn given_model(
    pipeline: &Pipeline,
    store: Option<&Store>,
) -> Result<Option<Arc<GivenModel>>, Refusal> {
    let Train { method, model, k, .. } = &pipeline.train;
    let boundary = pipeline.operators.boundary;
    if *method != Method::Predict {
        return Ok(None);
    }
    let given = if is_model_file(model) {
        GivenModel::new(model.clone(), Model::load(model.as_ref()).map_err(Refusal::usage)?)
    } else {
        let store = store.ok_or_else(|| {
            Refusal::usage(format!(
                "there is no cache that could be used, so the model {model} is not found in it; give a model file (train.model)"
            ))
        })?;
        given_by_name(model, store)?
    };
    given.model.check_count(*k).map_err(Refusal::usage)?;
    given.model.check_boundary(boundary).map_err(Refusal::usage)?;
    Ok(Some(given))
}
