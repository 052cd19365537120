//! `chladni cache stat|verify|gc|clear`: what the cache holds, whether it is sound, and what may go.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

use bytesize::ByteSize;
use serde::Serialize;

use super::exit::Exit;
use super::{CacheLimit, CacheLocation, Format, Refusal, print, print_json};
use crate::stages::retention;
use crate::store::{Compacted, Mode, StageStat, Store, StoreError, StoreStat, Swept, Verified};

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Say what the cache holds: entries and bytes by stage
    #[command(after_help = super::exit::help("  chladni cache stat --cache ~/chladni-cache"))]
    Stat(Arguments),
    /// Read every entry and check its digests; damaged ones are dropped, and computed again when they are needed
    #[command(after_help = super::exit::help("  chladni cache verify --dry-run"))]
    Verify(Changing),
    /// Make room: what this chladni cannot use, what is beyond the size, and what the database has not given back.
    /// Models and their blocks stay
    #[command(after_help = super::exit::help("  chladni cache gc --cache-size 5GB --dry-run"))]
    Gc {
        #[command(flatten)]
        changing: Changing,
        #[command(flatten)]
        limit: CacheLimit,
    },
    /// Remove everything that the cache holds, models too
    #[command(after_help = super::exit::help("  chladni cache clear --dry-run"))]
    Clear(Changing),
}

#[derive(Debug, clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    cache: CacheLocation,
    /// How the result is shown
    #[arg(long, value_enum, default_value = "human")]
    format: Format,
}

#[derive(Debug, clap::Args)]
pub struct Changing {
    #[command(flatten)]
    arguments: Arguments,
    /// Only say what would be done
    #[arg(long)]
    dry_run: bool,
}

impl Changing {
    fn mode(&self) -> Mode {
        if self.dry_run { Mode::DryRun } else { Mode::Apply }
    }
}

pub fn execute(command: &Command) -> Result<Exit, Refusal> {
    let (arguments, changed) = match command {
        Command::Stat(arguments) => (arguments, None),
        Command::Verify(changing) | Command::Clear(changing) | Command::Gc { changing, .. } => {
            (&changing.arguments, Some(changing))
        }
    };
    let dir = &arguments.cache.dir;
    if !Store::exists(dir) {
        return Err(Refusal::usage(format!(
            "{}: there is no cache; give the folder of a cache with --cache or CHLADNI_CACHE",
            dir.display()
        )));
    }
    let mode = changed.map_or(Mode::DryRun, Changing::mode);
    let show = Shown { format: arguments.format, dir: dir.display().to_string(), mode };
    match command {
        Command::Stat(_) => {
            let stat = open(dir)?.stat().map_err(refusal)?;
            show.one(&stat, || text(&show.dir, &stat))
        }
        Command::Verify(_) => {
            let found = Store::open(dir).and_then(|store| store.verify(mode)).map_err(refusal)?;
            show.one(&found, || show.verified(&found))
        }
        Command::Gc { limit, .. } => {
            let collected = collect(dir, limit.size.as_u64(), mode)?;
            show.one(&collected, || show.collected(&collected))
        }
        Command::Clear(_) => {
            let bytes = Store::clear(dir, mode).map_err(refusal)?;
            show.one(&Cleared { bytes }, || {
                let verb = show.verb("was removed", "would be removed");
                format!("cache {}\n\n{} {verb}\n", show.dir, size(bytes))
            })
        }
    }?;
    Ok(Exit::Success)
}

/// What `gc` has removed, or would remove.
#[derive(Debug, Serialize)]
struct Collected {
    #[serde(flatten)]
    swept: Swept,
    /// Of databases that were set aside.
    set_aside_bytes: u64,
    /// Of the files; none in a dry run.
    disk: Option<Compacted>,
}

#[derive(Debug, Serialize)]
struct Cleared {
    bytes: u64,
}

fn collect(dir: &Path, limit: u64, mode: Mode) -> Result<Collected, Refusal> {
    let store = Store::open(dir).map_err(refusal)?;
    retention::keep_models(&store).map_err(refusal)?;
    let swept = store.sweep(&retention::kinds(), limit, mode).map_err(refusal)?;
    drop(store);
    let set_aside_bytes = Store::remove_set_aside(dir, mode).map_err(refusal)?;
    let disk = match mode {
        Mode::DryRun => None,
        Mode::Apply => Some(Store::compact(dir).map_err(refusal)?),
    };
    Ok(Collected { swept, set_aside_bytes, disk })
}

/// How a result is shown.
struct Shown {
    format: Format,
    dir: String,
    mode: Mode,
}

impl Shown {
    fn one(&self, result: &impl Serialize, text: impl FnOnce() -> String) -> Result<(), Refusal> {
        match self.format {
            Format::Json => print_json(result),
            Format::Human => print(&text()),
        }
    }

    fn verb(&self, done: &'static str, would: &'static str) -> &'static str {
        match self.mode {
            Mode::Apply => done,
            Mode::DryRun => would,
        }
    }

    fn verified(&self, found: &Verified) -> String {
        let mut text = format!(
            "cache {}\n\n{} entries, {}, match their digests\n",
            self.dir,
            found.sound_entries,
            size(found.sound_bytes)
        );
        if found.damaged.is_empty() {
            return text;
        }
        let verb = self.verb("were dropped and will be", "would be dropped and");
        let _ = writeln!(text, "{} are damaged; they {verb} computed again:", found.damaged.len());
        for damaged in &found.damaged {
            let _ = writeln!(text, "  {:.12}  {}", damaged.key, damaged.reason);
        }
        text
    }

    fn collected(&self, collected: &Collected) -> String {
        let Collected { swept, set_aside_bytes, disk } = collected;
        let mut text = format!("cache {}\n\n", self.dir);
        let removed = self.verb("removed", "would be removed");
        table(&mut text, &format!("of another version of chladni, {removed}"), &swept.outdated);
        table(&mut text, &format!("to make room, {removed}"), &swept.evicted);
        for (what, bytes) in [
            ("chunks without an entry", swept.orphaned_bytes),
            ("databases that were set aside", *set_aside_bytes),
        ] {
            if bytes > 0 {
                let _ = writeln!(text, "{what}: {} {removed}", size(bytes));
            }
        }
        let _ = writeln!(
            text,
            "{} of entries {}",
            size(swept.live_bytes),
            self.verb("stay", "would stay")
        );
        if let Some(Compacted { before, after }) = disk {
            let _ = writeln!(text, "{} on disk, {} before", size(*after), size(*before));
        }
        text
    }
}

fn table(text: &mut String, title: &str, stages: &BTreeMap<String, StageStat>) {
    if stages.is_empty() {
        return;
    }
    let _ = writeln!(text, "{title}:");
    for (stage, part) in stages {
        line(text, stage, part.entries, part.live_bytes);
    }
    text.push('\n');
}

fn line(text: &mut String, name: &str, entries: u64, bytes: u64) {
    let _ = writeln!(text, "{name:<16} {entries:>9} {:>12}", size(bytes));
}

/// Opens the cache at `dir`; a copy of one that is there and cannot be written.
pub fn open(dir: &Path) -> Result<Store, Refusal> {
    open_or_copy(dir).map_err(refusal)
}

/// As [`open`]; `None` where a cache is there, or was to be, and neither it nor a copy can be written.
pub fn open_or_do_without(dir: &Path) -> Result<Option<Store>, Refusal> {
    match open_or_copy(dir) {
        // A path that was misspelt is not a reason to compute everything.
        Err(error) if error.is_full() || (error.is_unwritable() && Store::exists(dir)) => {
            tracing::warn!("nothing is cached, and what is in the cache is not used: {error}");
            Ok(None)
        }
        opened => opened.map(Some).map_err(refusal),
    }
}

/// As [`open_or_do_without`], for results that are to come: models stay, and the rest keeps to the limit.
pub fn open_to_fill(dir: &Path, limit: &CacheLimit) -> Result<Option<Store>, Refusal> {
    let store = open_or_do_without(dir)?;
    if let Some(store) = &store {
        retention::keep_models(store)
            .and_then(|()| store.limit(limit.size.as_u64()))
            .map_err(refusal)?;
    }
    Ok(store)
}

fn open_or_copy(dir: &Path) -> Result<Store, StoreError> {
    Store::open(dir).or_else(|unwritable| {
        if !unwritable.is_unwritable() || !Store::exists(dir) {
            return Err(unwritable);
        }
        let copy = Store::open_copy(dir)?;
        tracing::warn!("what is in the cache is used, and nothing new is kept: {unwritable}");
        Ok(copy)
    })
}

/// A cache that is locked, newer or unwritable is the user's to mend.
pub fn refusal(error: StoreError) -> Refusal {
    match error {
        StoreError::Directory { .. }
        | StoreError::Full { .. }
        | StoreError::TooLarge { .. }
        | StoreError::Locked { .. }
        | StoreError::NewerFormat { .. } => Refusal::usage(error),
        _ => Refusal::internal(error),
    }
}

fn text(dir: &str, stat: &StoreStat) -> String {
    let mut text = format!("cache {dir}\n\n{:<16} {:>9} {:>12}\n", "stage", "entries", "size");
    for (stage, part) in &stat.stages {
        line(&mut text, stage, part.entries, part.live_bytes);
    }
    line(&mut text, "all", stat.entries, stat.live_bytes);
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
            "{} unusable databases were set aside as quarantine-*; `chladni cache gc` removes them",
            stat.quarantined_databases
        );
    }
    text
}

fn size(bytes: u64) -> String {
    ByteSize::b(bytes).display().si().to_string()
}
