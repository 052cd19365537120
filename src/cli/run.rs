//! `chladni run PIPELINE.toml`.

use std::io::IsTerminal;
use std::num::NonZeroUsize;
use std::sync::Arc;
use std::time::{Duration, Instant};

use bytesize::ByteSize;
use tokio::runtime::Runtime;
use tokio_util::sync::CancellationToken;

use super::exit::Exit;
use super::paint::painted;
use super::signals::stop_on_signals;
use super::task::{Part, Task, given_model, refuse_among_meshes};
use super::{CacheLimit, Format, Refusal, cache, explain, print, print_json, runtime};
use crate::flow::events::EventFile;
use crate::pipeline::Pages;
use crate::pipeline::sweep::Comparison;
use crate::publish::overview::Overview;
use crate::publish::report::{RunReport, Status};
use crate::publish::sweep::{CaseReport, SweepReport};
use crate::publish::table::{run_table, summary, sweep_table};
use crate::publish::{atomic, page};
use crate::stages::run::{Ended, OnFailure, Run, run};
use crate::stages::weight::half_of_the_memory;
use crate::store::Store;

/// What a sweep leaves beside the results of its variants.
const SWEEP: &str = "sweep.json";
const SWEEP_TABLE: &str = "table.md";

#[derive(Debug, clap::Args)]
#[command(after_help = super::exit::help("\
  chladni run pipelines/spot.toml
  chladni run mine.toml --out spectra --cache ~/chladni-cache --set train.k=16
  chladni run mine.toml --dry-run
  chladni run mine.toml --format json | jq '.meshes[] | select(.status != \"verified\") | .path, .reason'
  chladni run pipelines/paper/table2.toml --quick --out out/table2"))]
pub struct Arguments {
    #[command(flatten)]
    task: Task,
    /// Only say what would be computed, and which option or content has changed since the last run
    #[arg(long)]
    dry_run: bool,
    #[command(flatten)]
    limit: CacheLimit,
    /// Worker threads, and meshes under way at once [default: one a core]
    #[arg(long, value_name = "N", value_parser = super::at_least_one)]
    jobs: Option<NonZeroUsize>,
    /// What the meshes under way may take of memory, for example 8GB: a mesh begins when there is room for it beside the others,
    /// told by the size of its file [default: half of what is available]
    #[arg(long, value_name = "SIZE", value_parser = super::size)]
    memory: Option<ByteSize>,
    /// How often a mesh is tried again when a file could not be read or written, or after an internal error
    #[arg(long, value_name = "N", default_value_t = 0)]
    retries: usize,
    /// Seconds that one mesh may take; what is finished then is kept [default: no limit]
    #[arg(long, value_name = "SECONDS", value_parser = seconds, allow_negative_numbers = true)]
    time_limit: Option<f64>,
    /// Seconds between two checkpoints of a training: a kill loses no more
    #[arg(long, value_name = "SECONDS", default_value_t = 20.0, value_parser = seconds, allow_negative_numbers = true)]
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
    let (comparison, parts) = arguments.task.read()?;
    if arguments.dry_run {
        return explain::show(&arguments.task, parts, arguments.format, false);
    }
    let store = cache::open_to_fill(&arguments.task.cache.dir, &arguments.limit)?;
    let (cancel, runtime) = (CancellationToken::new(), runtime()?);
    runtime.spawn(stop_on_signals(cancel.clone()));
    let runner = Runner { arguments: &arguments, store, cancel, runtime };
    let ended = match comparison {
        None => runner.one(parts),
        Some(comparison) => runner.sweep(&comparison, parts),
    };
    // The tasks are done; what is left waits for signals that no longer matter.
    runner.runtime.shutdown_background();
    ended
}

/// What the runs of a command share.
struct Runner<'a> {
    arguments: &'a Arguments,
    store: Option<Store>,
    cancel: CancellationToken,
    runtime: Runtime,
}

impl Runner<'_> {
    /// The run of a file without variants.
    fn one(&self, parts: Vec<Part>) -> Result<Exit, Refusal> {
        let mut exits = Vec::new();
        for part in parts {
            let Ended { report, defect } = self.run(part)?;
            match self.arguments.format {
                Format::Json => print_json(&report)?,
                Format::Human => {
                    print(&painted(&run_table(&report)))?;
                    print(&self.whereabouts())?;
                }
            }
            exits.push(self.exit(&report, defect));
        }
        Ok(Exit::gravest(exits))
    }

    /// One run after the other, and a table that compares them. What is finished when it is told to stop is compared; the others
    /// are missing.
    fn sweep(&self, comparison: &Comparison, parts: Vec<Part>) -> Result<Exit, Refusal> {
        let started = Instant::now();
        let (count, human) = (parts.len(), self.arguments.format == Format::Human);
        let (mut cases, mut exits) = (Vec::new(), Vec::new());
        for (i, part) in parts.into_iter().enumerate() {
            let (title, out) = (part.title(), part.out.display().to_string());
            let (variant, seed) = (part.variant.clone(), part.seed);
            let Ended { report, defect } = self.run(part)?;
            if human {
                print(&format!("[{}/{count}] {title}: {}", i + 1, summary(&report)))?;
            }
            exits.push(self.exit(&report, defect));
            if self.cancel.is_cancelled() {
                break;
            }
            let failed = report.meshes.iter().any(|mesh| mesh.status == Status::Failed);
            cases.push(CaseReport { variant, seed, out, run: report });
            if failed && self.arguments.fail_fast {
                break;
            }
        }
        let report = SweepReport::new(comparison, cases, started.elapsed().as_secs_f64());
        let out = &self.arguments.task.out;
        atomic::write(&out.join(SWEEP), &report.to_json())
            .and_then(|()| atomic::write(&out.join(SWEEP_TABLE), report.to_markdown().as_bytes()))
            .map_err(Refusal::usage)?;
        match self.arguments.format {
            Format::Json => print_json(&report)?,
            Format::Human => {
                print(&format!("\n{}", painted(&sweep_table(&report))))?;
                print(&format!("the table is {} too", out.join(SWEEP_TABLE).display()))?;
            }
        }
        Ok(Exit::gravest(exits))
    }

    fn run(&self, part: Part) -> Result<Ended, Refusal> {
        let Self { arguments, store, cancel, .. } = self;
        let lineage = arguments.task.lineage(&part);
        let Part { mut pipeline, jobs, out, .. } = part;
        if pipeline.publish.report == Pages::Auto && self.is_watched() {
            pipeline.publish.report = Pages::Written;
        }
        let overview = Overview::of(&pipeline.publish);
        refuse_among_meshes(&out, &jobs)?;
        let events = std::fs::create_dir_all(&out)
            .and_then(|()| EventFile::append(&out.join("events.jsonl")))
            .map_err(|error| {
                Refusal::usage(format!(
                    "{}: results cannot be written there ({error}); choose another folder with --out",
                    out.display()
                ))
            })?;
        let cores = || std::thread::available_parallelism().unwrap_or(NonZeroUsize::MIN);
        let request = Run {
            model: given_model(&pipeline, store.as_ref())?,
            pipeline,
            jobs,
            out: out.clone(),
            store: store.clone(),
            workers: arguments.jobs.unwrap_or_else(cores),
            memory: arguments.memory.map_or_else(half_of_the_memory, |size| size.as_u64()),
            on_failure: if arguments.fail_fast { OnFailure::Stop } else { OnFailure::GoOn },
            cancel: cancel.clone(),
            retries: arguments.retries,
            lineage,
            time_limit: arguments.time_limit.map(Duration::from_secs_f64),
            checkpoint_every: Duration::from_secs_f64(arguments.checkpoint),
            events: Arc::new(events),
        };
        let ended = self.runtime.block_on(run(request)).map_err(Refusal::internal)?;
        overview.write(&out, &ended.report).map_err(Refusal::usage)?;
        Ok(ended)
    }

    /// Where the results are.
    fn whereabouts(&self) -> String {
        let out = &self.arguments.task.out;
        let page = out.join(page::FILE);
        let page =
            if page::is_ours(&page) { format!("; open {}", page.display()) } else { String::new() };
        format!("results are in {}{page}", out.display())
    }

    /// Whether somebody sits at a terminal and sees how it goes.
    fn is_watched(&self) -> bool {
        self.arguments.format == Format::Human && std::io::stdout().is_terminal()
    }

    fn exit(&self, report: &RunReport, defect: bool) -> Exit {
        let exits = report.meshes.iter().map(|mesh| exit_of(mesh.status));
        Exit::gravest(
            exits
                .chain(defect.then_some(Exit::Internal))
                .chain(self.cancel.is_cancelled().then_some(Exit::Interrupted)),
        )
    }
}

/// What a mesh that has ended so means for the exit code.
pub fn exit_of(status: Status) -> Exit {
    match status {
        Status::Verified => Exit::Success,
        Status::Unverified => Exit::Unverified,
        Status::Failed => Exit::MeshFailed,
    }
}
