//! The table of an experiment: what was run now, and for the variants that were not what earlier runs have found.
//!
//! Some rows take an hour. Those of all runs so far lie in `docs/paper/results`, a file an experiment. A row is of the options that its
//! variant had then: with others it counts no more.

use std::collections::BTreeMap;
use std::path::Path;

use chladni::pipeline::sweep::{Asked, Sweep};
use chladni::publish::sweep::{HEADER, Row};
use serde::{Deserialize, Serialize};

use super::Outcome;
use super::results::Experiment;

/// A row with what it was computed by.
#[derive(Clone, Serialize, Deserialize)]
struct Kept {
    /// A digest of the options of its variant.
    options: String,
    row: Row,
}

/// The table in Markdown, with the rows of `experiment` where it was run.
pub fn table(experiment: Outcome<Experiment>, docs: &Path, name: &str) -> Outcome<String> {
    let file = docs.join("paper/results").join(format!("{name}.json"));
    let before: Vec<Kept> = match std::fs::read(&file) {
        Ok(bytes) => serde_json::from_slice(&bytes)?,
        Err(_) => Vec::new(),
    };
    let now: Vec<Row> = match experiment {
        Ok(experiment) => experiment.report.table,
        Err(error) if before.is_empty() => return Err(error),
        Err(_) => Vec::new(),
    };
    let Wanted { rows, options } = wanted(docs, name)?;
    let with_options = |row: Row| Some(Kept { options: options.get(&row.variant)?.clone(), row });
    let now: Vec<Kept> = now.into_iter().filter_map(with_options).collect();
    let kept = rows.into_iter().map(|empty| {
        let options = options.get(&empty.variant).cloned().unwrap_or_default();
        let of = |row: &Row| (row.variant.clone(), row.column.clone());
        let same = |kept: &&Kept| of(&kept.row) == of(&empty) && kept.options == options;
        // A run that has not come to all seeds says less; of equals the later counts.
        let found = before.iter().find(same).into_iter().chain(now.iter().find(same));
        let found = found.max_by_key(|kept| kept.row.seeds).cloned();
        found.unwrap_or(Kept { options, row: empty })
    });
    let kept: Vec<Kept> = kept.collect();
    std::fs::create_dir_all(docs.join("paper/results"))?;
    std::fs::write(&file, serde_json::to_string_pretty(&kept)? + "\n")?;
    Ok(markdown(&kept))
}

/// What an experiment is to have.
struct Wanted {
    /// A row for each variant and column, in the order of its file, with what is printed of it and nothing else.
    rows: Vec<Row>,
    /// Digests of the options of each variant, the seed and paths aside.
    options: BTreeMap<String, String>,
}

/// The file of an experiment.
pub fn sweep(docs: &Path, name: &str) -> Outcome<Sweep> {
    let file = docs.join("../pipelines/paper").join(format!("{name}.toml"));
    Ok(Sweep::load(&file, Asked::default())?)
}

fn wanted(docs: &Path, name: &str) -> Outcome<Wanted> {
    let Sweep { comparison, cases } = sweep(docs, name)?;
    let comparison = comparison.ok_or("it compares nothing")?;
    let mut options = BTreeMap::new();
    for mut case in cases {
        case.pipeline.train.seed = 0;
        case.pipeline.input.paths.clear();
        let digest = blake3::hash(&serde_json::to_vec(&case.pipeline)?);
        options.insert(case.variant, digest.to_hex()[..16].to_string());
    }
    let mut rows = Vec::new();
    for variant in comparison.variants {
        // One without seeds was run by somebody else.
        options.entry(variant.name.clone()).or_default();
        rows.extend(comparison.columns.iter().map(|column| Row {
            variant: variant.name.clone(),
            column: column.name.clone(),
            seeds: 0,
            median: None,
            range: None,
            fem: None,
            printed: variant.printed.get(&column.name).copied(),
            verdict: None,
        }));
    }
    Ok(Wanted { rows, options })
}

/// Without columns that are empty, and each variant named once.
fn markdown(kept: &[Kept]) -> String {
    let rows: Vec<_> = kept.iter().map(|kept| kept.row.cells()).collect();
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
