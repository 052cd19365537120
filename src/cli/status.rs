//! `chladni status`: how far a run is, from another process.

use std::fmt::Write;
use std::path::PathBuf;

use super::exit::Exit;
use super::{Format, Refusal, print, print_json};
use crate::publish::status::{RunState, RunStatus, read};

#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// The output folder of the run
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
    let RunStatus { meshes, verified, unverified, failed, waiting, under_way, .. } = status;
    let done = verified + unverified + failed;
    let state = match status.state {
        RunState::Running => format!("running (process {})", status.process),
        RunState::Finished => "finished".into(),
        RunState::Interrupted => {
            "interrupted; the same command goes on with what is missing".into()
        }
        RunState::Killed => "killed; the same command goes on with what is missing".into(),
    };
    let spent = duration(status.updated.saturating_sub(status.started) as f64);
    let mut text = format!(
        "{state}, {spent}\n\n{done} of {meshes} meshes done: {verified} verified, {unverified} not verified, {failed} failed; \
         {} under way, {waiting} waiting\n",
        under_way.len()
    );
    if let (RunState::Running, Some(left)) = (status.state, status.seconds_left) {
        let _ = writeln!(text, "{:.0} an hour, about {} left", status.per_hour, duration(left));
    }
    for mesh in under_way {
        let _ = writeln!(text, "  {}: {}, {}", mesh.path, mesh.stage, duration(mesh.seconds));
    }
    text
}

/// 75 s as "1 min 15 s".
fn duration(seconds: f64) -> String {
    let whole = seconds.max(0.0).round() as u64;
    match (whole / 3600, whole / 60 % 60, whole % 60) {
        (0, 0, seconds) => format!("{seconds} s"),
        (0, minutes, seconds) => format!("{minutes} min {seconds} s"),
        (hours, minutes, _) => format!("{hours} h {minutes} min"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_are_read_at_a_glance() {
        let texts = [0.2, 59.0, 75.0, 3600.0, 93_784.0].map(duration);
        assert_eq!(texts, ["0 s", "59 s", "1 min 15 s", "1 h 0 min", "26 h 3 min"]);
    }
}
