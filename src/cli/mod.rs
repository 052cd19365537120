//! The command line: one file a command.
//!
//! - [`exit`]: the exit codes, which are part of the contract
//! - [`logging`]: what goes to stderr
//! - [`task`]: what `run` and `explain` are asked to do
//! - `single`: what `solve` and `predict` are given
//! - [`signals`]: SIGINT and SIGTERM
//! - `run`, `watch`, `explain`, `status`, `solve`, `predict`, `model`, `generate`, `info`, `options`, `cache`:
//!   the commands
//! - `paint`: colours on a terminal
//! - `shell`: completions and manual pages, made of all of these

mod cache;
pub mod exit;
mod explain;
mod generate;
mod info;
mod logging;
mod model;
mod options;
mod paint;
mod predict;
mod run;
mod shell;
mod signals;
mod single;
mod solve;
mod status;
mod task;
mod watch;

use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::process::ExitCode;

use bytesize::ByteSize;
use clap::{CommandFactory, Parser, Subcommand, ValueEnum};
use tracing_indicatif::suspend_tracing_indicatif;

use exit::Exit;

/// Verified Laplace–Beltrami eigenpairs for folders of triangle meshes, kept up to date.
#[derive(Debug, Parser)]
#[command(name = "chladni", version, about, after_help = exit::help("\
  chladni run pipelines/spot.toml          train, predict and verify the eigenpairs of a cow
  chladni solve scans/a.obj -k 50          finite elements alone, one mesh, no pipeline
  chladni info scans/a.obj                 what is wrong with a mesh, and what to do about it
  chladni options train                    what can stand in a pipeline file"))]
struct Cli {
    /// How log lines on stderr are written: for people, or one JSON object a line; RUST_LOG says which are
    #[arg(
        long,
        value_enum,
        global = true,
        env = "CHLADNI_LOG",
        default_value = "human",
        value_name = "human|json",
        hide_possible_values = true
    )]
    log: Format,
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Run a pipeline: train, predict and verify the eigenpairs of its meshes
    Run(run::Arguments),
    /// Keep the results of a folder current while people work in it
    Watch(watch::Arguments),
    /// Say what a run would compute and what it would reuse, and which option or content has changed since the last one
    Explain(explain::Arguments),
    /// Say how far a run is: meshes done, under way, waiting and failed
    Status(status::Arguments),
    /// Solve for the eigenpairs of one mesh, and certify them
    Solve(solve::Arguments),
    /// Sample a surface that has a formula: meshes to train on and to test with
    Generate(generate::Arguments),
    /// Say what ingest sees of a mesh: counts, topology, defects, hash
    Info(info::Arguments),
    /// Print what can stand in a pipeline file: every option with its default and what it means
    Options(options::Arguments),
    /// Predict the eigenpairs of one mesh with a trained model, by forward passes alone
    Predict(predict::Arguments),
    /// Look after models: trained blocks that can predict on other samplings of a shape
    #[command(subcommand)]
    Model(model::Command),
    /// Look after the cache
    #[command(subcommand)]
    Cache(cache::Command),
    /// Print what a shell needs to complete these commands
    Completions(shell::Completions),
    /// Print the manual pages, or write them to a folder
    Man(shell::Man),
}

/// How results are shown on stdout, and log lines on stderr.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Format {
    /// For people
    Human,
    /// One JSON document and nothing else
    Json,
}

/// A number of things on the command line.
fn at_least_one(text: &str) -> Result<NonZeroUsize, String> {
    text.parse().map_err(|_| "a whole number, at least 1".into())
}

/// A number of bytes on the command line.
fn size(text: &str) -> Result<ByteSize, String> {
    text.parse().map_err(|_| "a size such as 500MB or 20GB".into())
}

/// Where the cache is.
#[derive(Debug, clap::Args)]
struct CacheLocation {
    /// The folder of the cache
    #[arg(long = "cache", value_name = "DIR", env = "CHLADNI_CACHE", default_value = "cache")]
    dir: PathBuf,
}

/// How large the cache may grow.
#[derive(Debug, clap::Args)]
struct CacheLimit {
    /// What the entries of the cache may take, for example 500MB or 20GB; what is cheapest to compute again goes first
    #[arg(
        long = "cache-size",
        value_name = "SIZE",
        env = "CHLADNI_CACHE_SIZE",
        default_value = "20GB",
        value_parser = size
    )]
    size: ByteSize,
}

/// Parses the arguments, does what they say, and returns the exit code.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    logging::start(cli.log);
    let exit = match cli.command {
        Command::Run(arguments) => run::execute(arguments),
        Command::Watch(arguments) => watch::execute(&arguments),
        Command::Explain(arguments) => explain::execute(&arguments),
        Command::Status(arguments) => status::execute(&arguments),
        Command::Solve(arguments) => solve::execute(&arguments),
        Command::Generate(arguments) => generate::execute(&arguments),
        Command::Info(arguments) => info::execute(&arguments),
        Command::Options(arguments) => options::execute(&arguments),
        Command::Predict(arguments) => predict::execute(&arguments),
        Command::Model(command) => model::execute(&command),
        Command::Cache(command) => cache::execute(&command),
        Command::Completions(arguments) => shell::completions(&arguments, Cli::command()),
        Command::Man(arguments) => shell::man(&arguments, Cli::command()),
    };
    exit.unwrap_or_else(|refusal| {
        logging::error(&refusal);
        refusal.exit()
    })
    .into()
}

/// Why a command could not be carried out at all.
#[derive(Debug, thiserror::Error)]
enum Refusal {
    /// The user can mend it.
    #[error("{0}")]
    Usage(String),
    /// The system or this program is to blame.
    #[error("{0}")]
    Internal(String),
}

impl Refusal {
    fn usage(reason: impl ToString) -> Self {
        Self::Usage(reason.to_string())
    }

    fn internal(reason: impl ToString) -> Self {
        Self::Internal(reason.to_string())
    }

    fn exit(&self) -> Exit {
        match self {
            Self::Usage(_) => Exit::Usage,
            Self::Internal(_) => Exit::Internal,
        }
    }
}

/// What carries orchestration, files and signals; the work itself has threads of its own.
fn runtime() -> Result<tokio::runtime::Runtime, Refusal> {
    tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .enable_all()
        .build()
        .map_err(Refusal::internal)
}

/// Prints to stdout, above any bars. A reader that has gone away (`| head`) is no error.
fn print(text: &str) -> Result<(), Refusal> {
    use std::io::{ErrorKind, Write};
    let printed = suspend_tracing_indicatif(|| {
        let mut out = std::io::stdout().lock();
        writeln!(out, "{}", text.trim_end()).and_then(|()| out.flush())
    });
    match printed {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(Refusal::Internal(format!("the result could not be printed: {error}")))
        }
        _ => Ok(()),
    }
}

/// Prints a JSON document.
fn print_json(document: &impl serde::Serialize) -> Result<(), Refusal> {
    print(&String::from_utf8_lossy(&crate::publish::json::document(document)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every command without commands below it.
    fn leaves(command: &clap::Command) -> Vec<&clap::Command> {
        let below = command.get_subcommands().filter(|below| below.get_name() != "help");
        let below: Vec<&clap::Command> = below.flat_map(leaves).collect();
        if below.is_empty() { vec![command] } else { below }
    }

    #[test]
    fn every_command_has_examples_and_they_are_commands() {
        let mut all = Cli::command();
        all.build();
        all.clone().debug_assert();
        for command in leaves(&all).into_iter().chain([&all]) {
            let name = command.get_display_name().unwrap_or(command.get_name());
            let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            let examples = help.lines().filter_map(|line| line.strip_prefix("  chladni "));
            // What follows is another program's, or says what it does.
            let examples = examples.map(|line| {
                let ends = [" | ", " > ", "   "].iter().filter_map(|end| line.find(end));
                &line[..ends.min().unwrap_or(line.len())]
            });
            let mut own = 0;
            for example in examples {
                let words = ["chladni"].into_iter().chain(example.split_whitespace());
                if let Err(error) = Cli::try_parse_from(words) {
                    panic!("{name}: {example}: {error}");
                }
                own += 1;
            }
            assert!(own > 0, "{name} has no examples");
        }
    }
}
