//! `chladni watch FOLDER`.

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use tokio_util::sync::CancellationToken;

use super::exit::Exit;
use super::run::{exit_of, seconds};
use super::signals::stop_on_signals;
use super::task::{Laid, Switch, given_model};
use super::{CacheLimit, CacheLocation, Format, Refusal, cache, print, runtime};
use crate::flow::events::EventFile;
use crate::pipeline::Pipeline;
use crate::publish::watched::Happened;
use crate::stages::predict::GivenModel;
use crate::stages::watched::{self, Source, Watch, WatchError, watch};
use crate::stages::weight::half_of_the_memory;
use crate::store::Store;

#[derive(Debug, clap::Args)]
#[command(after_help = super::exit::help("\
  chladni watch scans --pipeline mine.toml --out spectra
  chladni watch scans --once --format json"))]
pub struct Arguments {
    /// The folder that people work in; meshes in folders below it count too
    folder: PathBuf,
    /// The pipeline file, read again when it changes; its own [input] does not count [default: all options as they are]
    #[arg(long, value_name = "PIPELINE.toml")]
    pipeline: Option<PathBuf>,
    /// Where results go: one folder a mesh
    #[arg(long, value_name = "DIR", default_value = "out")]
    out: PathBuf,
    #[command(flatten)]
    cache: CacheLocation,
    #[command(flatten)]
    limit: CacheLimit,
    #[command(flatten)]
    laid: Laid,
    /// Worker threads, and meshes under way at once [default: one a core]
    #[arg(long, value_name = "N", value_parser = super::at_least_one)]
    jobs: Option<NonZeroUsize>,
    /// Do what there is to do, and end
    #[arg(long)]
    once: bool,
    /// Look at the folder every so many seconds, in place of waiting for what the system says of it
    #[arg(long, value_name = "SECONDS", value_parser = pause, allow_negative_numbers = true)]
    poll: Option<f64>,
    /// How events are shown; `json`: one JSON object a line
    #[arg(long, value_enum, default_value = "human")]
    format: Format,
}

/// A number of seconds between two looks.
fn pause(text: &str) -> Result<f64, String> {
    seconds(text)
        .ok()
        .filter(|&seconds| seconds > 0.0)
        .ok_or_else(|| "a number of seconds, above 0".into())
}

/// A pipeline file with what is laid over it.
struct PipelineFile<'a> {
    file: Option<&'a Path>,
    set: &'a [String],
    store: Option<&'a Store>,
}

impl Source for PipelineFile<'_> {
    fn read(&self) -> Result<(Pipeline, Option<Arc<GivenModel>>), String> {
        let pipeline = match self.file {
            Some(file) => Pipeline::load(file, self.set),
            None => Pipeline::parse("the defaults", "", self.set),
        };
        let pipeline = pipeline.map_err(|error| error.to_string())?;
        let model = given_model(&pipeline, self.store).map_err(|refusal| refusal.to_string())?;
        Ok((pipeline, model))
    }

    fn file(&self) -> Option<&Path> {
        self.file
    }
}

pub fn execute(arguments: &Arguments) -> Result<Exit, Refusal> {
    let shown = arguments.folder.display();
    let folder = arguments.folder.canonicalize().map_err(|error| {
        Refusal::usage(format!(
            "{shown}: the folder cannot be watched ({error}); give one that is there"
        ))
    })?;
    if !folder.is_dir() {
        return Err(Refusal::usage(format!(
            "{shown}: it is no folder; give the one that the mesh is in"
        )));
    }
    let unwritable = |error: std::io::Error| {
        let out = arguments.out.display();
        Refusal::usage(format!(
            "{out}: results cannot be written there ({error}); choose another folder with --out"
        ))
    };
    std::fs::create_dir_all(&arguments.out).map_err(unwritable)?;
    let out = arguments.out.canonicalize().map_err(unwritable)?;
    if out == folder {
        return Err(Refusal::usage(format!(
            "{}: the meshes lie there, and results would be folders called as their files are; choose another folder with --out",
            arguments.out.display()
        )));
    }
    let events = EventFile::append(&out.join("events.jsonl")).map_err(unwritable)?;
    let store = cache::open_to_fill(&arguments.cache.dir, &arguments.limit)?;
    let cores = || std::thread::available_parallelism().unwrap_or(NonZeroUsize::MIN);
    let cancel = CancellationToken::new();
    let request = Watch {
        folder,
        out,
        store: store.clone(),
        workers: arguments.jobs.unwrap_or_else(cores),
        memory: half_of_the_memory(),
        lineage: arguments.laid.lineage == Switch::On,
        poll: arguments.poll.map(Duration::from_secs_f64),
        once: arguments.once,
        cancel: cancel.clone(),
        events: Arc::new(events),
        checkpoint_every: CHECKPOINT,
    };
    let (file, set) = (arguments.pipeline.as_deref(), arguments.laid.set.as_slice());
    let source = PipelineFile { file, set, store: store.as_ref() };
    let runtime = runtime()?;
    let ended = runtime.block_on(async {
        tokio::spawn(stop_on_signals(cancel.clone()));
        watch(request, &source, &|happened| tell(happened, arguments.format)).await
    });
    supervisor::stopping();
    // The tasks are done; what is left waits for signals that no longer matter.
    runtime.shutdown_background();
    let watched::Ended { meshes, defect } = ended.map_err(|error| match error {
        WatchError::Pipeline(_) | WatchError::Folder(_) => Refusal::usage(error),
        WatchError::Threads(_) => Refusal::internal(error),
    })?;
    Ok(Exit::gravest(
        meshes
            .into_values()
            .map(exit_of)
            .chain(defect.then_some(Exit::Internal))
            .chain(cancel.is_cancelled().then_some(Exit::Interrupted)),
    ))
}

/// Between two checkpoints of a training.
const CHECKPOINT: Duration = Duration::from_secs(20);

/// Prints an event. A reader that has gone away does not end the watch.
fn tell(happened: &Happened, format: Format) {
    if matches!(happened, Happened::Watching { .. }) {
        supervisor::ready();
    }
    let line = match format {
        Format::Human => happened.line(),
        Format::Json => serde_json::to_string(happened).unwrap_or_default(),
    };
    if let Err(error) = print(&line) {
        tracing::warn!("{error}");
    }
}

/// What systemd is told, where it has started the watch.
#[cfg(unix)]
mod supervisor {
    use sd_notify::NotifyState;

    pub fn ready() {
        tell(NotifyState::Ready);
    }

    pub fn stopping() {
        tell(NotifyState::Stopping);
    }

    fn tell(state: NotifyState<'_>) {
        if let Err(error) = sd_notify::notify(false, &[state]) {
            tracing::debug!("systemd could not be told: {error}");
        }
    }
}

#[cfg(not(unix))]
mod supervisor {
    pub fn ready() {}

    pub fn stopping() {}
}
