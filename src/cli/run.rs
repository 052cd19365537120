//! `chladni run PIPELINE.toml`.

use std::num::NonZeroUsize;
use std::sync::Arc;
use std::time::Duration;

use bytesize::ByteSize;
use tokio_util::sync::CancellationToken;

use super::exit::Exit;
use super::signals::stop_on_signals;
use super::task::{Switch, Task, given_model};
use super::{CacheLimit, Format, Refusal, cache, explain, print, print_json, runtime};
use crate::flow::events::EventFile;
use crate::pipeline::Pipeline;
use crate::publish::report::Status;
use crate::publish::table::run_table;
use crate::stages::intake;
use crate::stages::run::{Ended, OnFailure, Run, run};
use crate::stages::weight::half_of_the_memory;

#[derive(Debug, clap::Args)]
#[command(after_help = super::exit::HELP)]
pub struct Arguments {
    #[command(flatten)]
    task: Task,
    /// Only say what would be computed, and which option or content has changed since the last run
    #[arg(long)]
    dry_run: bool,
    #[command(flatten)]
    limit: CacheLimit,
    /// Worker threads, and meshes under way at once [default: one a core]
    #[arg(long, value_name = "N")]
    jobs: Option<NonZeroUsize>,
    /// What the meshes under way may take of memory, for example 8GB: a mesh begins when there is room for it beside the others,
    /// told by the size of its file [default: half of what is available]
    #[arg(long, value_name = "SIZE")]
    memory: Option<ByteSize>,
    /// How often a mesh is tried again when a file could not be read or written, or after an internal error
    #[arg(long, value_name = "N", default_value_t = 0)]
    retries: usize,
    /// Seconds that one mesh may take; what is finished then is kept [default: no limit]
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    time_limit: Option<f64>,
    /// Seconds between two checkpoints of a training: a kill loses no more
    #[arg(long, value_name = "SECONDS", default_value_t = 20.0, value_parser = seconds)]
    checkpoint: f64,
    /// Go on with the other meshes when one fails (the default)
    #[arg(long, overrides_with = "fail_fast")]
    keep_going: bool,
    /// Stop when a mesh fails
    #[arg(long, overrides_with = "keep_going")]
    fail_fast: bool,
    /// How the result is shown
    #[arg(long, value_enum, default_value = "human")]
    format: Format,
}

/// A number of seconds on the command line.
pub fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(seconds) if (0.0..1e9).contains(&seconds) => Ok(seconds),
        _ => Err("a number of seconds, not negative".into()),
    }
}

pub fn execute(arguments: Arguments) -> Result<Exit, Refusal> {
    let (pipeline, jobs) = arguments.task.read()?;
    if arguments.dry_run {
        return explain::show(&arguments.task, pipeline, jobs, arguments.format, false);
    }
    let out = &arguments.task.out;
    std::fs::create_dir_all(out)
        .and_then(|()| EventFile::append(&out.join("events.jsonl")))
        .map_err(|error| {
            Refusal::usage(format!(
                "{}: results cannot be written there ({error}); choose another folder with --out",
                out.display()
            ))
        })
        .and_then(|events| start(&arguments, pipeline, jobs, events))
}

fn start(
    arguments: &Arguments,
    pipeline: Pipeline,
    jobs: Vec<intake::Job>,
    events: EventFile,
) -> Result<Exit, Refusal> {
    let store = cache::open_to_fill(&arguments.task.cache.dir, &arguments.limit)?;
    let model = given_model(&pipeline, store.as_ref())?;
    let cores = || std::thread::available_parallelism().unwrap_or(NonZeroUsize::MIN);
    let cancel = CancellationToken::new();
    let request = Run {
        pipeline,
        model,
        jobs,
        out: arguments.task.out.clone(),
        store,
        workers: arguments.jobs.unwrap_or_else(cores),
        memory: arguments.memory.map_or_else(half_of_the_memory, |size| size.as_u64()),
        on_failure: if arguments.fail_fast { OnFailure::Stop } else { OnFailure::GoOn },
        cancel: cancel.clone(),
        retries: arguments.retries,
        lineage: arguments.task.laid.lineage == Switch::On,
        time_limit: arguments.time_limit.map(Duration::from_secs_f64),
        checkpoint_every: Duration::from_secs_f64(arguments.checkpoint),
        events: Arc::new(events),
    };
    let runtime = runtime()?;
    let ended = runtime.block_on(async {
        tokio::spawn(stop_on_signals(cancel.clone()));
        run(request).await
    });
    // The tasks are done; what is left waits for signals that no longer matter.
    runtime.shutdown_background();
    let Ended { report, defect } = ended.map_err(Refusal::internal)?;
    match arguments.format {
        Format::Json => print_json(&report)?,
        Format::Human => print(&run_table(&report))?,
    }
    let exits = report.meshes.iter().map(|mesh| exit_of(mesh.status));
    Ok(Exit::gravest(
        exits
            .chain(defect.then_some(Exit::Internal))
            .chain(cancel.is_cancelled().then_some(Exit::Interrupted)),
    ))
}

/// What a mesh that has ended so means for the exit code.
pub fn exit_of(status: Status) -> Exit {
    match status {
        Status::Verified => Exit::Success,
        Status::Unverified => Exit::Unverified,
        Status::Failed => Exit::MeshFailed,
    }
}
