//! What `run` and `explain` are asked to do: a pipeline, its meshes, and where cache and results are.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::model::given_by_name;
use super::{CacheLocation, Refusal};
use crate::ggnn::Model;
use crate::mesh::policy::Objects;
use crate::pipeline::sweep::{Asked, Case, Comparison, Effort, Sweep};
use crate::pipeline::{Count, Generate, Input, Method, Pipeline, Train, is_model_file};
use crate::stages::intake::{self, Job};
use crate::stages::predict::GivenModel;
use crate::store::Store;

#[derive(Debug, clap::Args)]
pub struct Task {
    /// The pipeline file
    pub pipeline: PathBuf,
    /// Of a file with variants only these, by their names
    #[arg(long, value_name = "NAME")]
    pub variant: Vec<String>,
    /// Lay what is under [quick] in the file over it, and take one seed of every variant: a rehearsal
    #[arg(long)]
    pub quick: bool,
    /// Meshes, folders, patterns such as 'scans/*.obj', or lists (.txt, .lst), in place of the pipeline's own
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

/// Entries of `input.generate`, and the files that were made of them.
type Made = (Vec<Generate>, Vec<PathBuf>);

/// The meshes of the inputs that were looked through last.
#[derive(Default)]
struct Found {
    inputs: Vec<PathBuf>,
    objects: Objects,
    jobs: Vec<Job>,
}

impl Found {
    /// Those of `inputs`, looked for unless they are these.
    fn of(&mut self, inputs: Vec<PathBuf>, objects: Objects) -> Result<Vec<Job>, Refusal> {
        if self.jobs.is_empty() || (&self.inputs, self.objects) != (&inputs, objects) {
            let jobs = intake::jobs(&inputs).map_err(Refusal::usage)?;
            let jobs = intake::into_objects(jobs, objects).map_err(Refusal::usage)?;
            *self = Self { inputs, objects, jobs };
        }
        Ok(self.jobs.clone())
    }
}

/// A pipeline with its meshes.
#[derive(Debug)]
pub struct Part {
    /// The variant that it is, with its seed; empty for a file without variants.
    pub variant: String,
    /// See `variant`.
    pub seed: u64,
    /// What to compute, with what is laid over it.
    pub pipeline: Pipeline,
    /// For which meshes.
    pub jobs: Vec<Job>,
    /// Where results go.
    pub out: PathBuf,
}

impl Task {
    /// The pipelines of the file with their meshes: one, or the variants that are compared.
    ///
    /// # Errors
    /// What the user has to mend in either.
    pub fn read(&self) -> Result<(Option<Comparison>, Vec<Part>), Refusal> {
        let effort = if self.quick { Effort::Quick } else { Effort::Full };
        let asked = Asked { assignments: &self.laid.set, effort, variants: &self.variant };
        let sweep = Sweep::load(&self.pipeline, asked).map_err(Refusal::usage)?;
        let Sweep { comparison, cases } = sweep;
        // Most variants have the same meshes.
        let (mut made, mut found) = (None, Found::default());
        let parts = cases.into_iter().map(|case| self.part(case, &mut made, &mut found));
        Ok((comparison, parts.collect::<Result<_, _>>()?))
    }

    /// Whether a mesh may begin with the blocks of its previous version. What is compared with others begins with nothing.
    pub fn lineage(&self, part: &Part) -> bool {
        part.variant.is_empty() && self.laid.lineage == Switch::On
    }

    /// A case with its meshes; `made` are those that were generated last, and what for, and `found` those of the last inputs.
    fn part(
        &self,
        case: Case,
        made: &mut Option<Made>,
        found: &mut Found,
    ) -> Result<Part, Refusal> {
        let out = self.out.join(case.folder());
        let Case { variant, seed, pipeline } = case;
        let inputs = if self.input.is_empty() {
            let Input { paths, generate } = &pipeline.input;
            let files = match made {
                Some((of, files)) if of == generate => files.clone(),
                _ => {
                    let folder = self.out.join(GENERATED);
                    let files = intake::generate(generate, &folder).map_err(Refusal::usage)?;
                    *made = Some((generate.clone(), files.clone()));
                    files
                }
            };
            paths.iter().cloned().chain(files).collect()
        } else {
            self.input.clone()
        };
        let jobs = found.of(inputs, pipeline.ingest.objects)?;
        Ok(Part { variant, seed, pipeline, jobs, out })
    }
}

impl Part {
    /// What it is called beside others.
    pub fn title(&self) -> String {
        format!("{}, seed {}", self.variant, self.seed)
    }
}

/// Refuses an output folder in which meshes lie: the folder of such a mesh would be called as its file is.
///
/// # Errors
/// Which one.
pub fn refuse_among_meshes<'a>(
    out: &Path,
    jobs: impl IntoIterator<Item = &'a Job>,
) -> Result<(), Refusal> {
    for Job { source, name, .. } in jobs {
        let folder = out.join(name);
        let mut within = folder.ancestors().take_while(|folder| *folder != out);
        let is_source = |file: &Path| same_file(file, source);
        if let Some(file) = within.find(|folder| folder.is_file() && is_source(folder)) {
            return Err(Refusal::usage(format!(
                "{}: the mesh lies there, and its results would be a folder of that name; choose another folder with --out",
                file.display()
            )));
        }
    }
    Ok(())
}

fn same_file(a: &Path, b: &Path) -> bool {
    a.canonicalize().is_ok_and(|a| b.canonicalize().is_ok_and(|b| a == b))
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
    // A share is held against the model for every mesh.
    if let Count::Number(k) = *k {
        given.model.check_count(k).map_err(Refusal::usage)?;
    }
    given.model.check_boundary(boundary).map_err(Refusal::usage)?;
    Ok(Some(given))
}
