//! The table of an experiment: what was run now, and for the variants that were not what earlier runs have found.
//!
//! Some rows take an hour. Those of all runs so far lie in `docs/paper/results`, a file an experiment.

use std::path::Path;

use chladni::publish::sweep::{HEADER, Row};

use super::Outcome;
use super::results::Experiment;

/// The table in Markdown, with the rows of `experiment` where it was run.
pub fn table(experiment: Outcome<Experiment>, docs: &Path, name: &str) -> Outcome<String> {
    let file = docs.join("paper/results").join(format!("{name}.json"));
    let before: Vec<Row> = match std::fs::read(&file) {
        Ok(bytes) => serde_json::from_slice(&bytes)?,
        Err(_) => Vec::new(),
    };
    let rows = match experiment {
        Ok(experiment) => merged(experiment.report.table, before),
        Err(error) if before.is_empty() => return Err(error),
        Err(_) => before,
    };
    std::fs::create_dir_all(docs.join("paper/results"))?;
    std::fs::write(&file, serde_json::to_string_pretty(&rows)? + "\n")?;
    Ok(markdown(&rows))
}

/// In the order of the experiment's file, each row from the run that has it.
fn merged(now: Vec<Row>, before: Vec<Row>) -> Vec<Row> {
    let found = |row: Row| {
        if row.seeds > 0 {
            return row;
        }
        let same = |old: &&Row| (&old.variant, &old.column) == (&row.variant, &row.column);
        before.iter().find(same).cloned().unwrap_or(row)
    };
    now.into_iter().map(found).collect()
}

/// Without columns that are empty, and each variant named once.
fn markdown(rows: &[Row]) -> String {
    let rows: Vec<_> = rows.iter().map(Row::cells).collect();
    let shown: Vec<usize> =
        (0..HEADER.len()).filter(|&i| rows.iter().any(|row| row[i] != "–")).collect();
    let line = |cells: &[String]| {
        let cells: Vec<&str> = shown.iter().map(|&i| cells[i].as_str()).collect();
        format!("| {} |\n", cells.join(" | "))
    };
    let mut text = line(&HEADER.map(String::from)) + &format!("|{}\n", "---|".repeat(shown.len()));
    let mut last = String::new();
    for mut row in rows {
        let variant = row[0].clone();
        if variant == last {
            row[0] = String::new();
        }
        last = variant;
        text += &line(&row);
    }
    text
}
