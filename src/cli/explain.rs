//! `chladni explain PIPELINE.toml [MESH]`, and `chladni run --dry-run`.

use super::exit::Exit;
use super::task::{Part, Task, given_model};
use super::{Format, Refusal, cache, print, print_json};
use crate::mesh::error::listed;
use crate::publish::plan::{PlannedCase, SweepPlan};
use crate::stages::intake::Job;
use crate::stages::plan::{Request, plan};
use crate::store::Store;

#[derive(Debug, clap::Args)]
#[command(after_help = super::exit::help("\
  chladni explain mine.toml
  chladni explain mine.toml a.obj --set train.learning_rate=5e-4"))]
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
    let (_, mut parts) = arguments.task.read()?;
    if let Some(mesh) = &arguments.mesh {
        let named = |part: &Part| -> Vec<_> { part.jobs.iter().map(|j| j.name.clone()).collect() };
        let names: Vec<String> = parts.first().map(named).unwrap_or_default();
        parts.iter_mut().for_each(|part| part.jobs.retain(|job| is_called(job, mesh)));
        parts.retain(|part| !part.jobs.is_empty());
        if parts.is_empty() {
            return Err(Refusal::usage(format!(
                "{mesh}: the pipeline has no such mesh; it has {}",
                listed(&names)
            )));
        }
    }
    show(&arguments.task, parts, arguments.format, true)
}

/// Shows what a run would do: `everything`, or only what it would compute.
pub fn show(
    task: &Task,
    parts: Vec<Part>,
    format: Format,
    everything: bool,
) -> Result<Exit, Refusal> {
    // A cache that is not there is not made.
    let dir = &task.cache.dir;
    let store = if Store::exists(dir) { cache::open_or_do_without(dir)? } else { None };
    let mut plans = Vec::new();
    for part in parts {
        let (lineage, title) = (task.lineage(&part), part.title());
        let Part { variant, seed, pipeline, jobs, out } = part;
        let model = given_model(&pipeline, store.as_ref())?;
        let plan = plan(Request { pipeline, model, jobs, out, store: store.clone(), lineage });
        if let Format::Human = format {
            let text = plan.text(everything);
            print(&if variant.is_empty() { text } else { format!("{title}\n\n{text}\n") })?;
        }
        plans.push(PlannedCase { variant, seed, plan });
    }
    let failing = plans.iter().any(|case| case.plan.meshes.iter().any(|m| m.failure.is_some()));
    if let Format::Json = format {
        match &plans[..] {
            [PlannedCase { variant, plan, .. }] if variant.is_empty() => print_json(plan)?,
            _ => print_json(&SweepPlan::new(plans))?,
        }
    }
    Ok(if failing { Exit::MeshFailed } else { Exit::Success })
}

fn is_called(job: &Job, mesh: &str) -> bool {
    let same_file = || Some(job.source.canonicalize().ok()? == std::fs::canonicalize(mesh).ok()?);
    job.name == mesh || job.file_name() == mesh || same_file() == Some(true)
}
