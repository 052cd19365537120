//! `chladni explain PIPELINE.toml [MESH]`, and `chladni run --dry-run`.

use super::exit::Exit;
use super::task::{Switch, Task, given_model};
use super::{Format, Refusal, cache, print, print_json};
use crate::pipeline::Pipeline;
use crate::stages::intake::Job;
use crate::stages::plan::{Request, plan};
use crate::store::Store;

#[derive(Debug, clap::Args)]
#[command(after_help = super::exit::HELP)]
pub struct Arguments {
    #[command(flatten)]
    task: Task,
    /// One mesh of the pipeline: its file, or its name in reports [default: all]
    mesh: Option<String>,
    /// How the result is shown
    #[arg(long, value_enum, default_value = "human")]
    format: Format,
}

pub fn execute(arguments: &Arguments) -> Result<Exit, Refusal> {
    let (pipeline, mut jobs) = arguments.task.read()?;
    if let Some(mesh) = &arguments.mesh {
        let names: Vec<String> = jobs.iter().take(8).map(|job| job.name.clone()).collect();
        jobs.retain(|job| is_called(job, mesh));
        if jobs.is_empty() {
            return Err(Refusal::usage(format!(
                "{mesh}: the pipeline has no such mesh; it has {}, …",
                names.join(", ")
            )));
        }
    }
    show(&arguments.task, pipeline, jobs, arguments.format, true)
}

/// Shows what a run would do: `everything`, or only what it would compute.
pub fn show(
    task: &Task,
    pipeline: Pipeline,
    jobs: Vec<Job>,
    format: Format,
    everything: bool,
) -> Result<Exit, Refusal> {
    // A cache that is not there is not made.
    let dir = &task.cache.dir;
    let store = if Store::exists(dir) { cache::open_or_do_without(dir)? } else { None };
    let model = given_model(&pipeline, store.as_ref())?;
    let (out, lineage) = (task.out.clone(), task.laid.lineage == Switch::On);
    let plan = plan(Request { pipeline, model, jobs, out, store, lineage });
    match format {
        Format::Json => print_json(&plan)?,
        Format::Human => print(&plan.text(everything))?,
    }
    let failing = plan.meshes.iter().any(|mesh| mesh.failure.is_some());
    Ok(if failing { Exit::MeshFailed } else { Exit::Success })
}

fn is_called(job: &Job, mesh: &str) -> bool {
    let same_file = || Some(job.source.canonicalize().ok()? == std::fs::canonicalize(mesh).ok()?);
    job.name == mesh || same_file() == Some(true)
}
