//! `chladni status`: how far a run is, from another process.

use std::fmt::Write;
use std::path::PathBuf;

use super::exit::Exit;
use super::{Format, Refusal, print, print_json};
use crate::publish::status::{RunState, RunStatus, duration, read, read_sweep};

#[derive(Debug, clap::Args)]
#[command(after_help = super::exit::help("\
  chladni status --out spectra
  chladni status --out spectra --format json | jq .seconds_left"))]
pub struct Arguments {
    /// The output folder of the run; of a sweep, the variant that was under way last is shown
    #[arg(long, value_name = "DIR", default_value = "out")]
    out: PathBuf,
    /// How the result is shown
    #[arg(long, value_enum, default_value = "human")]
    format: Format,
}

pub fn execute(arguments: &Arguments) -> Result<Exit, Refusal> {
    let out = arguments.out.display();
    let status = read(&arguments.out)
        .map_err(|error| Refusal::usage(format!("{out}: the status cannot be read: {error}")))?
        .or_else(|| read_sweep(&arguments.out))
        .ok_or_else(|| {
            Refusal::usage(format!(
                "{out}: no run has written there yet; give the folder that its --out names"
            ))
        })?;
    match arguments.format {
        Format::Json => print_json(&status)?,
        Format::Human => print(&text(&status))?,
    }
    Ok(Exit::Success)
}

fn text(status: &RunStatus) -> String {
    let RunStatus { waiting, under_way, process, .. } = status;
    let spent = duration(status.updated.saturating_sub(status.started) as f64);
    let go_on = "the same command goes on with what is missing";
    let state = match (status.state, &status.watches) {
        (RunState::Running, Some(folder)) => {
            format!("watching {folder} for {spent} (process {process})")
        }
        (RunState::Running, None) => format!("running for {spent} (process {process})"),
        (RunState::Finished, _) => format!("finished after {spent}"),
        (RunState::Interrupted, _) => format!("interrupted after {spent}; {go_on}"),
        (RunState::Killed, _) => format!("killed after {spent}; {go_on}"),
    };
    let part = status.part.as_ref().map(|part| format!("{part}: ")).unwrap_or_default();
    let mut text = format!(
        "{part}{state}\n\n{}; {} under way, {waiting} waiting\n",
        status.summary(),
        under_way.len()
    );
    if let Some(rate) = status.rate() {
        let _ = writeln!(text, "{rate}");
    }
    for mesh in under_way {
        let _ = writeln!(text, "  {}: {}, {}", mesh.path, mesh.stage, duration(mesh.seconds));
    }
    text
}
