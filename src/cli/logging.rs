//! What goes to stderr: log lines by `RUST_LOG`, and progress bars that make way for them.

use std::io::{IsTerminal, stderr};

use tracing_indicatif::IndicatifLayer;
use tracing_indicatif::filter::IndicatifFilter;
use tracing_indicatif::style::ProgressStyle;
use tracing_subscriber::filter::EnvFilter;
use tracing_subscriber::fmt;
use tracing_subscriber::prelude::*;

/// Our warnings (the store tells what became of the database), unless `RUST_LOG` says otherwise.
const DEFAULT: &str = "warn,sled=off";

/// Starts logging. Bars are shown on a terminal only.
pub fn start() {
    let filter = || EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(DEFAULT));
    let coloured = stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none();
    let registry = tracing_subscriber::registry();
    if stderr().is_terminal() {
        let style = ProgressStyle::with_template("{msg} {wide_bar} {pos}/{len} {elapsed}")
            .unwrap_or_else(|_| ProgressStyle::default_bar());
        let bars = IndicatifLayer::new().with_progress_style(style);
        let lines = fmt::layer()
            .with_writer(bars.get_stderr_writer())
            .with_ansi(coloured)
            .with_target(false)
            .without_time();
        registry
            .with(lines.with_filter(filter()))
            .with(bars.with_filter(IndicatifFilter::new(false)))
            .init();
    } else {
        let lines = fmt::layer().with_writer(stderr).with_ansi(false).with_target(false);
        registry.with(lines.with_filter(filter())).init();
    }
}
