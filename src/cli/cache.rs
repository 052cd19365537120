//! `chladni cache stat`: what the cache holds.

use std::fmt::Write;

use super::exit::Exit;
use super::{CacheLocation, Format, Refusal, print, print_json};
use crate::store::{Store, StoreError, StoreStat};

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Say what the cache holds: entries and bytes by stage
    Stat(Arguments),
}

#[derive(Debug, clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    cache: CacheLocation,
    /// How the result is shown
    #[arg(long, value_enum, default_value = "human")]
    format: Format,
}

pub fn execute(command: &Command) -> Result<Exit, Refusal> {
    let Command::Stat(arguments) = command;
    if !Store::exists(&arguments.cache.dir) {
        return Err(Refusal::usage(format!(
            "{}: there is no cache; give the folder of a cache with --cache or CHLADNI_CACHE",
            arguments.cache.dir.display()
        )));
    }
    let stat = Store::open(&arguments.cache.dir).and_then(|store| store.stat()).map_err(refusal)?;
    match arguments.format {
        Format::Json => print_json(&stat)?,
        Format::Human => print(&text(&arguments.cache.dir.display().to_string(), &stat))?,
    }
    Ok(Exit::Success)
}

/// A cache that is locked, newer or unwritable is the user's to mend.
pub fn refusal(error: StoreError) -> Refusal {
    match error {
        StoreError::Directory { .. }
        | StoreError::Locked { .. }
        | StoreError::NewerFormat { .. } => Refusal::usage(error),
        _ => Refusal::internal(error),
    }
}

fn text(dir: &str, stat: &StoreStat) -> String {
    let mut text = format!("cache {dir}\n\n{:<12} {:>9} {:>12}\n", "stage", "entries", "size");
    let mut line = |name: &str, entries: u64, bytes: u64| {
        let _ = writeln!(text, "{name:<12} {entries:>9} {:>12}", size(bytes));
    };
    for (stage, part) in &stat.stages {
        line(stage, part.entries, part.live_bytes);
    }
    line("all", stat.entries, stat.live_bytes);
    let _ = writeln!(text, "\n{} on disk", size(stat.disk_bytes));
    if stat.quarantined_entries > 0 {
        let _ = writeln!(
            text,
            "{} damaged entries were dropped and will be computed again",
            stat.quarantined_entries
        );
    }
    if stat.quarantined_databases > 0 {
        let _ = writeln!(
            text,
            "{} unusable databases were set aside as quarantine-*; delete them when you like",
            stat.quarantined_databases
        );
    }
    text
}

fn size(bytes: u64) -> String {
    let bytes = bytes as f64;
    match bytes {
        b if b < 1e3 => format!("{b} B"),
        b if b < 1e6 => format!("{:.1} kB", b / 1e3),
        b if b < 1e9 => format!("{:.1} MB", b / 1e6),
        b => format!("{:.1} GB", b / 1e9),
    }
}
