//! A run for the terminal: one block a mesh, then one line for all.
//!
//! Numbers are rounded for reading; the documents hold all digits. λ stands with six digits and reads 0 where it is
//! zero to working precision; the angle, in radians, is the one to the reference (FEM) cluster; "s" are seconds; "–"
//! means not measured. Up to 80 columns fit. The text has no colours and ends with a newline.

use comfy_table::presets::NOTHING;
use comfy_table::{CellAlignment, LineStyle, Table};

use super::report::{MeshReport, PairReport, RunReport, Status};
use super::result::{Ancestor, Completeness, Eigenpair, RepairCounts, Source};
use super::sweep::{self, SweepReport};
use crate::spectrum::mpgd::StoppedBy;

/// Digits of a hash that the table shows.
const SHORT_HASH: usize = 12;

/// An eigenvalue below this multiple of the largest one shown is zero to working precision.
const ZERO: f64 = 1e-9;

/// A column: its title, how it is aligned, and its text for a pair.
struct Column {
    title: &'static str,
    alignment: CellAlignment,
    text: fn(&PairReport, &Scale) -> String,
}

/// What numbers of a table are shown relative to.
struct Scale {
    /// The largest λ.
    largest: f64,
    /// Some M-PGD values carry a mark.
    marks: bool,
}

impl Scale {
    fn lambda(&self, value: f64) -> String {
        zero_or_digits(value, self.largest)
    }

    fn is_zero(&self, lambda: f64) -> bool {
        lambda.abs() < ZERO * self.largest
    }

    /// The digits of a column stay below one another when some of its numbers carry a mark.
    fn marked(&self, report: &PairReport) -> String {
        let unmarked = if self.marks { " " } else { "" };
        let mark = if mpgd_fell_short(report) { "*" } else { unmarked };
        self.lambda(report.pair.lambda_mpgd) + mark
    }
}

const fn column(
    title: &'static str,
    alignment: CellAlignment,
    text: fn(&PairReport, &Scale) -> String,
) -> Column {
    Column { title, alignment, text }
}

const K: Column = column("k", CellAlignment::Right, |report, _| report.pair.k.to_string());
const LAMBDA: Column =
    column("λ", CellAlignment::Right, |report, scale| match report.pair.source {
        Source::Constant => "0".into(),
        _ => scale.lambda(report.pair.lambda),
    });
const LAMBDA_REFINED: Column = column("λ refined", CellAlignment::Right, |report, scale| {
    report.pair.lambda_refined.map_or("–".to_owned(), |value| scale.lambda(value))
});
const LAMBDA_MPGD: Column =
    column("λ M-PGD", CellAlignment::Right, |report, scale| scale.marked(report));
const LAMBDA_FEM: Column =
    column("λ FEM", CellAlignment::Right, |report, scale| scale.lambda(report.pair.lambda_fem));
const LAMBDA_AREA: Column = column("λ · area", CellAlignment::Right, |report, scale| {
    let zero = report.pair.source == Source::Constant || scale.is_zero(report.pair.lambda);
    measured(report.pair.lambda_area, |value| if zero { "0".into() } else { six_digits(value) })
});
const ANGLE: Column =
    column("angle", CellAlignment::Right, |report, _| two_digits(report.pair.angle_fem));
const RESIDUAL: Column =
    column("residual", CellAlignment::Right, |report, _| two_digits(report.pair.residual));
const RHO: Column = column("ρ", CellAlignment::Right, |report, _| two_digits(report.pair.rho));
const VERDICT: Column =
    column("verdict", CellAlignment::Left, |report, _| report.pair.verdict.name().to_owned());
const SOURCE: Column = column("source", CellAlignment::Left, |report, _| {
    // What an earlier version has given says more than that it was there.
    let is_own = matches!(report.pair.source, Source::Trained | Source::Fem | Source::Mpgd);
    if report.cached && is_own { "reused" } else { report.pair.source.name() }.to_owned()
});
const SECONDS: Column = column("s", CellAlignment::Right, |report, _| {
    measured(report.seconds, |seconds| format!("{seconds:.2}"))
});

/// What is shown of learned pairs, and of M-PGD's: how far they are from the references.
const COMPARED: [Column; 9] =
    [K, LAMBDA, LAMBDA_MPGD, LAMBDA_FEM, ANGLE, RHO, VERDICT, SOURCE, SECONDS];

/// What is shown of refined pairs: the learned λ and its angle, then what was made of it.
const REFINED: [Column; 9] =
    [K, LAMBDA, ANGLE, LAMBDA_REFINED, LAMBDA_FEM, RESIDUAL, VERDICT, SOURCE, SECONDS];

/// What is shown of predictions that were held against nothing.
const PREDICTED: [Column; 4] = [K, LAMBDA, LAMBDA_AREA, SOURCE];

/// The same, refined.
const PREDICTED_REFINED: [Column; 5] = [K, LAMBDA, LAMBDA_REFINED, LAMBDA_AREA, SOURCE];

/// What is shown of the reference solver's pairs: what proves them.
const SOLVED: [Column; 6] = [K, LAMBDA, LAMBDA_AREA, RESIDUAL, VERDICT, SOURCE];

/// The text of a run.
pub fn run_table(report: &RunReport) -> String {
    let mut text = String::new();
    for mesh in &report.meshes {
        text.push_str(&mesh_table(mesh));
        text.push('\n');
    }
    text.push_str(&summary(report));
    text.push('\n');
    text
}

/// One mesh, each line ended.
pub fn mesh_table(mesh: &MeshReport) -> String {
    let mut lines = vec![title(mesh)];
    if mesh.status == Status::Failed {
        let reason = mesh.reason.as_deref().unwrap_or("no reason is known");
        lines.push(format!("failed: {}", printable(reason)));
    } else {
        lines.push(pairs(&mesh.eigenpairs));
        let repairs = mesh.repairs.as_ref().and_then(RepairCounts::in_words);
        lines.extend(repairs.map(|repairs| format!("mended: {repairs}")));
        if mesh.eigenpairs.iter().any(mpgd_fell_short) {
            lines.push(
                "* M-PGD has not converged there, or not for a pair before; its opinion does not count"
                    .to_owned(),
            );
        }
        lines.extend(mesh.completeness.as_ref().map(completeness));
        lines.extend(
            mesh.reason.as_deref().map(|reason| format!("unverified: {}", printable(reason))),
        );
        lines.extend(mesh.grown_from.as_ref().map(ancestor));
        let blocks = match (mesh.trained, mesh.reused) {
            (0, 0) => String::new(),
            (trained, reused) => format!("{trained} trained, {reused} reused; "),
        };
        lines.push(blocks + &duration(mesh.seconds));
    }
    lines.iter().map(|line| format!("{line}\n")).collect()
}

fn title(mesh: &MeshReport) -> String {
    let mut title = printable(&mesh.path);
    if let Some(hash) = mesh.hash {
        title.push_str(&format!("  {:.SHORT_HASH$}", hash.to_string()));
    }
    if let Some(n) = mesh.vertices {
        title.push_str(&format!("  n = {n}"));
    }
    if let Some(area) = mesh.area {
        title.push_str(&format!("  area {}", six_digits(area)));
    }
    title
}

fn pairs(pairs: &[PairReport]) -> String {
    let columns = columns(pairs);
    let scale = Scale {
        largest: pairs.iter().fold(0.0_f64, |m, report| m.max(report.pair.lambda.abs())),
        marks: pairs.iter().any(mpgd_fell_short),
    };
    let mut table = Table::new();
    table.load_style(NOTHING.header_separator(LineStyle::none().fill('─').junction('─')));
    table.set_header(columns.iter().map(|column| column.title));
    for report in pairs {
        table.add_row(columns.iter().map(|column| (column.text)(report, &scale)));
    }
    for (shown, column) in table.column_iter_mut().zip(columns) {
        shown.set_cell_alignment(column.alignment);
        shown.set_padding((0, 1));
    }
    table.trim_fmt()
}

fn columns(pairs: &[PairReport]) -> &'static [Column] {
    let any = |holds: fn(&Eigenpair) -> bool| pairs.iter().any(|report| holds(&report.pair));
    let refined = any(|pair| pair.lambda_refined.is_some());
    let compared = any(|pair| !pair.lambda_fem.is_nan());
    // Where all are constants nothing was learned either.
    let constant = |report: &PairReport| report.pair.source == Source::Constant;
    let solved = any(|pair| pair.source == Source::Fem) || compared && pairs.iter().all(constant);
    match (solved, refined, compared) {
        (true, ..) => &SOLVED,
        (_, true, true) => &REFINED,
        (_, true, false) => &PREDICTED_REFINED,
        (_, false, true) => &COMPARED,
        (_, false, false) => &PREDICTED,
    }
}

fn mpgd_fell_short(report: &PairReport) -> bool {
    report.pair.mpgd.as_ref().is_some_and(|run| run.stopped_by != StoppedBy::Tolerance)
}

fn ancestor(ancestor: &Ancestor) -> String {
    format!("{}, {:.12}", ancestor.how.in_words(), ancestor.mesh.to_string())
}

/// Whether an eigenvalue was missed, in words.
pub fn completeness(counted: &Completeness) -> String {
    let Completeness { sigma, count, found, complete, cut_cluster } = counted;
    let sigma = six_digits(*sigma);
    let Some(count) = count else {
        return format!(
            "not known to be complete: the eigenvalues below σ = {sigma} cannot be counted in \
             double precision, {found} found"
        );
    };
    let verdict = if *complete { "complete" } else { "not complete" };
    let others = match count.saturating_sub(*found) {
        missing if *complete && *cut_cluster && missing > 0 => {
            format!("; k = {found} cuts a cluster and leaves {missing} of it out")
        }
        _ => String::new(),
    };
    let count = counted_noun(*count, "eigenvalue");
    format!("{verdict}: {count} below σ = {sigma}, {found} found{others}")
}

/// A sweep: the rows of its table, then one line.
pub fn sweep_table(report: &SweepReport) -> String {
    let mut table = Table::new();
    table.load_style(NOTHING.header_separator(LineStyle::none().fill('─').junction('─')));
    table.set_header(sweep::HEADER);
    let mut last = None;
    for row in &report.table {
        let mut cells = row.cells().map(|cell| printable(&cell));
        if last.replace(&row.variant) == Some(&row.variant) {
            cells[0].clear();
        }
        table.add_row(cells);
    }
    for (i, shown) in table.column_iter_mut().enumerate() {
        let is_number = (2..6).contains(&i);
        let alignment = if is_number { CellAlignment::Right } else { CellAlignment::Left };
        shown.set_cell_alignment(alignment);
        shown.set_padding((0, 2));
    }
    let runs = counted_noun(report.cases.len(), "run");
    format!("{}\n{}\n{runs}; {}\n", report.title, table.trim_fmt(), duration(report.seconds))
}

/// What became of the meshes of a run, in one line.
pub fn summary(report: &RunReport) -> String {
    let with = |status| report.meshes.iter().filter(|mesh| mesh.status == status).count();
    let sum = |of: fn(&MeshReport) -> usize| report.meshes.iter().map(of).sum::<usize>();
    let meshes = match report.meshes.len() {
        1 => "1 mesh".to_owned(),
        count => format!("{count} meshes"),
    };
    format!(
        "{meshes}: {} verified, {} unverified, {} failed; {} trained, {} reused; {}",
        with(Status::Verified),
        with(Status::Unverified),
        with(Status::Failed),
        sum(|mesh| mesh.trained),
        sum(|mesh| mesh.reused),
        duration(report.seconds)
    )
}

fn counted_noun(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}

/// Seconds with two decimals.
pub fn duration(seconds: f64) -> String {
    measured(seconds, |seconds| format!("{seconds:.2} s"))
}

/// An eigenvalue as it is shown where the largest beside it is `largest`: 0 where it is zero to working precision.
pub fn zero_or_digits(lambda: f64, largest: f64) -> String {
    if lambda.abs() < ZERO * largest { "0".into() } else { six_digits(lambda) }
}

/// Six significant digits, with an exponent where the number is far from 1.
pub fn six_digits(value: f64) -> String {
    measured(value, |value| {
        let exponent = value.abs().log10().floor();
        match exponent {
            _ if value == 0.0 => "0".to_owned(),
            -3.0..6.0 => format!("{value:.*}", (5.0 - exponent) as usize),
            _ => format!("{value:.5e}"),
        }
    })
}

/// Two significant digits, as of an error.
pub fn two_digits(value: f64) -> String {
    measured(value, |value| if value == 0.0 { "0".into() } else { format!("{value:.1e}") })
}

fn measured(value: f64, format: impl Fn(f64) -> String) -> String {
    if value.is_finite() { format(value) } else { "–".to_owned() }
}

/// A name or message without characters that could move the cursor.
pub fn printable(text: &str) -> String {
    text.chars()
        .flat_map(|c| {
            let escaped = c.is_control().then(|| c.escape_default());
            let plain = escaped.is_none().then_some(c);
            escaped.into_iter().flatten().chain(plain)
        })
        .collect()
}

#[cfg(test)]
mod tests;
