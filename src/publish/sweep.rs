//! What a sweep over variants of a pipeline has found: its document, and the table that compares them.
//!
//! A row is a variant and a column of the file: the median over the seeds with the least and the largest, what finite elements
//! have on the same meshes, what somebody else printed, and how the two compare. An error at or below the printed one surpasses
//! it; up to three times as large it reproduces it.

use serde::{Deserialize, Serialize};

use super::json::document;
use super::report::{RunReport, Status};
use super::result::{AgainstFormula, Eigenpair, FromFormula};
use crate::pipeline::sweep::{Column, Comparison, Quantity, Whose};

/// The format of the document of a sweep.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum SweepSchema {
    /// The one that [`SweepReport`] describes.
    #[default]
    #[serde(rename = "chladni-sweep-1")]
    V1,
}

/// `sweep.json`, and the document of `chladni run --format json` over a file with variants.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SweepReport {
    /// The format.
    pub schema: SweepSchema,
    /// What is compared.
    pub title: String,
    /// One entry a variant and seed that was run, in the order of the file.
    pub cases: Vec<CaseReport>,
    /// One row a variant and column.
    pub table: Vec<Row>,
    /// The whole sweep.
    pub seconds: f64,
}

/// A variant with one seed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CaseReport {
    /// The name of the variant.
    pub variant: String,
    /// `train.seed`.
    pub seed: u64,
    /// The folder of its results.
    pub out: String,
    /// What became of its meshes.
    pub run: RunReport,
}

/// A cell of the comparison, with what it is compared with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// The name of the variant.
    pub variant: String,
    /// The name of the column.
    pub column: String,
    /// How many seeds have a value.
    pub seeds: usize,
    /// The median over the seeds; null where none has a value.
    pub median: Option<f64>,
    /// The least and the largest.
    pub range: Option<[f64; 2]>,
    /// The same of finite elements, where the column is not of theirs.
    pub fem: Option<f64>,
    /// What somebody else printed.
    pub printed: Option<f64>,
    /// How the median compares with it.
    pub verdict: Option<Outcome>,
}

/// How an error compares with a printed one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outcome {
    /// At or below it.
    Surpassed,
    /// Up to three times as large.
    Reproduced,
    /// Larger.
    NotReproduced,
}

/// An error that is so many times a printed one still reproduces it.
const FACTOR: f64 = 3.0;

impl Outcome {
    fn of(error: f64, printed: f64) -> Self {
        if error <= printed {
            Self::Surpassed
        } else if error <= FACTOR * printed {
            Self::Reproduced
        } else {
            Self::NotReproduced
        }
    }

    /// In tables.
    pub fn in_words(self) -> &'static str {
        match self {
            Self::Surpassed => "surpassed",
            Self::Reproduced => "reproduced",
            Self::NotReproduced => "not reproduced",
        }
    }
}

impl SweepReport {
    /// The report of these cases.
    pub fn new(comparison: &Comparison, cases: Vec<CaseReport>, seconds: f64) -> Self {
        let table = rows(comparison, &cases);
        Self { schema: SweepSchema::V1, title: comparison.title.clone(), cases, table, seconds }
    }

    /// The bytes of `sweep.json`.
    pub fn to_json(&self) -> Vec<u8> {
        document(self)
    }

    /// The table in Markdown.
    pub fn to_markdown(&self) -> String {
        let mut text = format!("# {}\n\n", self.title);
        let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
        text += &line(&HEADER.map(String::from));
        text += "|---|---|---|---|---|---|---|\n";
        for row in &self.table {
            text += &line(&row.cells());
        }
        text
    }
}

/// The titles of the table.
pub const HEADER: [&str; 7] =
    ["variant", "measure", "here", "over the seeds", "FEM", "printed", "verdict"];

impl Row {
    /// The cells of a line of the table, as [`HEADER`] has them.
    pub fn cells(&self) -> [String; 7] {
        let range = match self.range {
            Some([least, most]) if self.seeds > 1 => format!("{} – {}", short(least), short(most)),
            _ => "–".into(),
        };
        let number = |value: Option<f64>| value.map_or("–".into(), short);
        [
            self.variant.clone(),
            self.column.clone(),
            number(self.median),
            range,
            number(self.fem),
            number(self.printed),
            self.verdict.map_or("–", Outcome::in_words).into(),
        ]
    }
}

/// Three digits; four where a number is no error.
fn short(value: f64) -> String {
    match value.abs() {
        _ if !value.is_finite() => "–".into(),
        0.1..1000.0 => {
            let digits = (3.0 - value.abs().log10().floor()).clamp(0.0, 4.0) as usize;
            format!("{value:.digits$}")
        }
        _ => format!("{value:.2e}"),
    }
}

fn rows(comparison: &Comparison, cases: &[CaseReport]) -> Vec<Row> {
    let mut rows = Vec::new();
    for variant in &comparison.variants {
        let own: Vec<&CaseReport> = cases.iter().filter(|c| c.variant == variant.name).collect();
        for column in &comparison.columns {
            let over_seeds = |whose: Whose| -> Vec<f64> {
                let mut values: Vec<f64> =
                    own.iter().filter_map(|case| measured(&case.run, column, whose)).collect();
                values.sort_by(f64::total_cmp);
                values
            };
            let values = over_seeds(column.of);
            let median = median(&values);
            let fem = (column.of != Whose::Fem).then(|| self::median(&over_seeds(Whose::Fem)));
            let printed = variant.printed.get(&column.name).copied();
            let verdict = median.zip(printed).and_then(|(here, printed)| {
                Some(Outcome::of(column.error(here)?, column.error(printed)?))
            });
            rows.push(Row {
                variant: variant.name.clone(),
                column: column.name.clone(),
                seeds: values.len(),
                median,
                range: values.first().zip(values.last()).map(|(&least, &most)| [least, most]),
                fem: fem.flatten(),
                printed,
                verdict,
            });
        }
    }
    rows
}

fn median(sorted: &[f64]) -> Option<f64> {
    let middle = sorted.len() / 2;
    match sorted.len() % 2 {
        _ if sorted.is_empty() => None,
        0 => Some((sorted[middle - 1] + sorted[middle]) / 2.0),
        _ => Some(sorted[middle]),
    }
}

impl Column {
    /// How wrong a value is; `None` where that is not known.
    fn error(&self, value: f64) -> Option<f64> {
        match (self.what, self.exact) {
            (_, Some(exact)) => Some((value - exact).abs()),
            (Quantity::Lambda, None) => None,
            (_, None) => Some(value),
        }
    }
}

/// The mean over the meshes and eigenpairs that a column asks for; `None` where one of them has no such value.
fn measured(report: &RunReport, column: &Column, whose: Whose) -> Option<f64> {
    let meshes = report.meshes.iter().filter(|mesh| mesh.path.contains(&column.mesh));
    let (mut sum, mut count) = (0.0, 0);
    for mesh in meshes {
        if mesh.status == Status::Failed {
            return None;
        }
        let (first, last) = column.k.ends();
        let wanted = mesh.eigenpairs.iter().filter(|report| column.k.has(report.pair.k));
        let values: Vec<f64> =
            wanted.map(|report| value(&report.pair, column.what, whose)).collect::<Option<_>>()?;
        if values.len() != last - first + 1 {
            return None;
        }
        sum += values.iter().sum::<f64>();
        count += values.len();
    }
    (count > 0).then(|| sum / count as f64)
}

/// A measure of one pair; `None` where it was not taken.
fn value(pair: &Eigenpair, what: Quantity, whose: Whose) -> Option<f64> {
    let formula = pair.closed_form.as_ref();
    let off = formula.and_then(|formula: &AgainstFormula| match whose {
        Whose::Own => Some(formula.own),
        Whose::Fem => formula.fem,
        Whose::Mpgd => formula.mpgd,
    });
    let lambda = match whose {
        Whose::Own => pair.lambda,
        Whose::Fem => pair.lambda_fem,
        Whose::Mpgd => pair.lambda_mpgd,
    };
    match what {
        Quantity::Mse => off.map(|FromFormula { mse, .. }| mse),
        Quantity::MseEuclidean => off.map(|off| off.mse_euclidean),
        Quantity::Rmse => off.map(|off| off.mse.sqrt()),
        Quantity::RmseEuclidean => off.map(|off| off.mse_euclidean.sqrt()),
        Quantity::Lambda => Some(lambda),
        Quantity::LambdaError => {
            let exact = formula.map_or(pair.lambda_fem, |formula| formula.lambda);
            Some((lambda / exact - 1.0).abs())
        }
        Quantity::Angle => match (off, whose) {
            (Some(off), _) => Some(off.angle),
            (None, Whose::Own) if formula.is_none() => Some(pair.angle_fem),
            _ => None,
        },
    }
    .filter(|value| value.is_finite())
}

#[cfg(test)]
mod tests;
