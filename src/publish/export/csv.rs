//! Tables as text: RFC 4180, a header line, commas, and quotes where a field needs them. What is not a number, or was not
//! measured, is empty.
//!
//! `spectrum.csv` has one line for every eigenpair, with what `spectrum.json` says of it.

use crate::publish::result::{Eigenpair, Spectrum};

/// Lines of fields.
#[derive(Debug, Default)]
pub struct Table(String);

impl Table {
    /// Adds a line.
    pub fn line(&mut self, fields: impl IntoIterator<Item = String>) {
        let fields: Vec<String> = fields.into_iter().map(quoted).collect();
        self.0 += &fields.join(",");
        self.0.push('\n');
    }

    /// The text.
    pub fn into_text(self) -> String {
        self.0
    }
}

/// The shortest decimals that are this double; nothing for not-a-number and infinity.
pub fn number(value: f64) -> String {
    if value.is_finite() { format!("{value:?}") } else { String::new() }
}

fn quoted(field: String) -> String {
    if field.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", field.replace('"', "\"\""))
    } else {
        field
    }
}

const COLUMNS: [&str; 13] = [
    "k",
    "lambda",
    "lambda_area",
    "lambda_refined",
    "source",
    "cluster",
    "residual",
    "rho",
    "lambda_mpgd",
    "lambda_fem",
    "angle_mpgd",
    "angle_fem",
    "verdict",
];

/// The text of `spectrum.csv`.
pub fn to_csv(spectrum: &Spectrum) -> String {
    let mut table = Table::default();
    table.line(COLUMNS.map(String::from));
    for pair in &spectrum.eigenpairs {
        table.line(fields(pair));
    }
    table.into_text()
}

/// In the order of [`COLUMNS`].
fn fields(pair: &Eigenpair) -> [String; 13] {
    [
        pair.k.to_string(),
        number(pair.lambda),
        number(pair.lambda_area),
        number(pair.lambda_refined.unwrap_or(f64::NAN)),
        pair.source.name().into(),
        pair.cluster.to_string(),
        number(pair.residual),
        number(pair.rho),
        number(pair.lambda_mpgd),
        number(pair.lambda_fem),
        number(pair.angle_mpgd),
        number(pair.angle_fem),
        pair.verdict.name().into(),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::publish::result::tests::spectrum;

    #[test]
    fn a_line_a_pair_and_what_was_not_measured_is_empty() {
        let mut spectrum = spectrum();
        spectrum.eigenpairs[0].lambda = 1.0 / 3.0;
        spectrum.eigenpairs[0].lambda_mpgd = f64::NAN;
        let text = to_csv(&spectrum);
        let lines: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
        assert_eq!(lines.len(), 1 + spectrum.eigenpairs.len());
        assert_eq!(lines[0], COLUMNS);
        assert_eq!((lines[1][0], lines[1][1], lines[1][8]), ("1", "0.3333333333333333", ""));
        assert!(lines.iter().all(|line| line.len() == COLUMNS.len()));
    }

    #[test]
    fn fields_with_commas_and_quotes_are_quoted() {
        let mut table = Table::default();
        table.line(["a, b", "the \"c\"", "d"].map(String::from));
        assert_eq!(table.into_text(), "\"a, b\",\"the \"\"c\"\"\",d\n");
    }
}
