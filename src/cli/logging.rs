//! What goes to stderr: log lines by `RUST_LOG`, progress bars that make way for them, and where a defect came from.

use std::backtrace::Backtrace;
use std::fmt::Display;
use std::io::{IsTerminal, stderr};
use std::panic::{self, PanicHookInfo};
use std::sync::OnceLock;
use std::thread;

use tracing_indicatif::IndicatifLayer;
use tracing_indicatif::filter::IndicatifFilter;
use tracing_indicatif::style::ProgressStyle;
use tracing_subscriber::filter::EnvFilter;
use tracing_subscriber::fmt;
use tracing_subscriber::prelude::*;

use super::Format;
use super::paint::is_coloured;
use crate::publish::table::printable;

/// Our warnings (the store tells what became of the database), unless `RUST_LOG` says otherwise.
const DEFAULT: &str = "warn,sled=off";

/// What is done, how far it is and how fast, the time that it took and the time that is left.
const BAR: &str = "{msg} {wide_bar} {pos}/{len} {per_sec} {elapsed} < {eta}";

/// How lines are written, once that is known.
static LINES: OnceLock<Format> = OnceLock::new();

/// Says why something did not happen: to people after "error:", to programs as a log line. What a file says moves no cursor.
pub fn error(reason: &impl Display) {
    let reason = reason.to_string();
    // Lines and tabs are ours: an editor's line with a caret below it is of them.
    let line = |line: &str| line.split('\t').map(printable).collect::<Vec<_>>().join("\t");
    let reason = reason.lines().map(line).collect::<Vec<_>>().join("\n");
    match LINES.get() {
        Some(Format::Json) => tracing::error!("{reason}"),
        _ => eprintln!("error: {reason}"),
    }
}

/// Starts logging. Bars are shown on a terminal only, and not among lines for programs.
pub fn start(format: Format) {
    let _ = LINES.set(format);
    let otherwise = panic::take_hook();
    panic::set_hook(Box::new(move |panic| match thread::current().name() {
        Some("main") => otherwise(panic),
        name => log_panic(name.unwrap_or("without name"), panic),
    }));
    let filter = || EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(DEFAULT));
    let registry = tracing_subscriber::registry();
    if format == Format::Json {
        let lines = fmt::layer().json().flatten_event(true).with_writer(stderr);
        // Why a command has failed is said whatever RUST_LOG asks for.
        let reasons = concat!(module_path!(), "=error").parse();
        let filter = reasons.map_or_else(|_| filter(), |reasons| filter().add_directive(reasons));
        registry.with(lines.with_filter(filter)).init();
    } else if stderr().is_terminal() {
        let style =
            ProgressStyle::with_template(BAR).unwrap_or_else(|_| ProgressStyle::default_bar());
        let bars = IndicatifLayer::new().with_progress_style(style);
        let lines = fmt::layer()
            .with_writer(bars.get_stderr_writer())
            .with_ansi(is_coloured(&stderr()))
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

/// A panic of a thread that works for others is caught, and becomes one mesh's failure, or a cache without an entry. Where it
/// happened is known here alone.
fn log_panic(thread: &str, panic: &PanicHookInfo<'_>) {
    let message = panic.payload_as_str().unwrap_or("a panic without a message");
    let place = panic.location().map(ToString::to_string).unwrap_or_default();
    // The database panics on damaged files; the store says what that means.
    if panic.location().is_some_and(|location| location.file().contains("/sled-")) {
        tracing::debug!(thread, place, "the database panicked: {message}");
        return;
    }
    let backtrace = Backtrace::force_capture();
    tracing::error!(
        thread,
        place,
        "internal error, of which we would like to hear: {message}\n{backtrace}"
    );
}

#[cfg(test)]
mod tests {
    use std::num::NonZeroUsize;
    use std::process::Command;

    use super::*;
    use crate::flow::Workers;

    const CHILD: &str = "CHLADNI_TEST_PANIC";

    #[inline(never)]
    fn stage_with_a_defect(corner: usize) -> usize {
        [1, 2, 3][corner]
    }

    /// Not a test by itself: the hook is the process's, so it is set in one of its own.
    #[tokio::test]
    async fn child_process() {
        if std::env::var_os(CHILD).is_none() {
            return;
        }
        start(Format::Human);
        let workers = Workers::start(NonZeroUsize::MIN).unwrap();
        let corner = std::hint::black_box(7);
        assert!(workers.run(move || stage_with_a_defect(corner)).await.is_err());
    }

    #[test]
    fn a_panic_of_a_worker_is_logged_with_its_backtrace_and_not_printed() {
        let output = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "cli::logging::tests::child_process", "--nocapture"])
            .env(CHILD, "1")
            .env_remove("RUST_LOG")
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{said}");
        assert!(said.contains("ERROR internal error"), "{said}");
        assert!(said.contains("the len is 3 but the index is 7"), "{said}");
        assert!(said.contains("thread=\"worker-0\""), "{said}");
        assert!(said.contains("stage_with_a_defect"), "{said}");
        assert!(!said.contains("panicked at"), "{said}");
    }
}
