//! A pipeline file with variants: the same pipeline several times, each with some options of its own, compared in one table.
//!
//! [`super::reference::sweep`] shows one, with what its keys mean.
//!
//! What is laid over what, the later over the earlier: the file's own options, the variant's, those of `[quick]` where that is
//! asked for (as far as the variant's recipe reads them), the seed, `--set`. A file without variants is a sweep of one.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use super::check::unread;
use super::{Pipeline, PipelineError, file};

/// The sections of a file that are not a pipeline's own.
pub(super) const SECTIONS: [&str; 3] = [SWEEP, VARIANT, QUICK];
const SWEEP: &str = "sweep";
const VARIANT: &str = "variant";
const QUICK: &str = "quick";

/// Pipelines that are run one after the other.
#[derive(Debug, Clone, PartialEq)]
pub struct Sweep {
    /// What is compared, and how it is shown; `None` for a file without variants.
    pub comparison: Option<Comparison>,
    /// One or more, in the order of the file, each variant with its seeds.
    pub cases: Vec<Case>,
}

/// One pipeline of a sweep.
#[derive(Debug, Clone, PartialEq)]
pub struct Case {
    /// The variant that it belongs to; empty for a file without variants.
    pub variant: String,
    /// `train.seed`.
    pub seed: u64,
    /// The pipeline.
    pub pipeline: Pipeline,
}

/// `[sweep]`, with what the variants say of themselves.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// What the table is of.
    pub title: String,
    /// What is shown of every variant.
    pub columns: Vec<Column>,
    /// The variants, in the order of the file.
    pub variants: Vec<Described>,
}

/// A variant as the table shows it.
#[derive(Debug, Clone, PartialEq)]
pub struct Described {
    /// Its name.
    pub name: String,
    /// What somebody else found, by the name of the column.
    pub printed: BTreeMap<String, f64>,
}

/// What is measured of a variant, from the results of its meshes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Column {
    /// Its title.
    pub name: String,
    /// What is measured.
    pub what: Quantity,
    /// Of whose eigenpairs; "own" where it is not given.
    #[serde(default)]
    pub of: Whose,
    /// Of which of them.
    pub k: Places,
    /// Part of the names of the meshes that are averaged over; all of them where it is not given.
    #[serde(default)]
    pub mesh: String,
    /// The true value of an eigenvalue.
    #[serde(default)]
    pub exact: Option<f64>,
}

/// `what` of a [`Column`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Quantity {
    /// (31) against a formula, both functions of unit B-norm.
    Mse,
    /// (31) against a formula, both functions of unit 2-norm.
    MseEuclidean,
    /// The root of (31), unit B-norm; over several k the mean of the roots, as in Table 1.
    Rmse,
    /// The same, unit 2-norm.
    RmseEuclidean,
    /// The angle to the formula's eigenspace, or to FEM's where there is no formula; radians.
    Angle,
    /// λ.
    Lambda,
    /// How far λ is, relative, from the formula's, or from FEM's where there is no formula.
    LambdaError,
}

/// `of` of a [`Column`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Whose {
    /// The pipeline's own.
    #[default]
    Own,
    /// The reference solver's, on the same mesh.
    Fem,
    /// M-PGD's.
    Mpgd,
}

/// One k, or several.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Places {
    /// A number.
    One(usize),
    /// The mean over [first, last].
    Range([usize; 2]),
}

impl Places {
    /// Whether k is among them.
    pub fn has(self, k: usize) -> bool {
        let (first, last) = self.ends();
        (first..=last).contains(&k)
    }

    /// The first and the last.
    pub fn ends(self) -> (usize, usize) {
        match self {
            Self::One(k) => (k, k),
            Self::Range([first, last]) => (first, last),
        }
    }
}

/// What of a file is asked for, and what is laid over it.
#[derive(Debug, Clone, Copy, Default)]
pub struct Asked<'a> {
    /// `train.k=10`, over everything else.
    pub assignments: &'a [String],
    /// How much of the work.
    pub effort: Effort,
    /// These variants alone; all of them where there is none.
    pub variants: &'a [String],
}

/// Which effort a sweep is run with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Effort {
    /// As the file says.
    #[default]
    Full,
    /// With what is under `[quick]` laid over it: a rehearsal.
    Quick,
}

/// What is compared, and how it is shown.
#[derive(Debug, Clone, PartialEq, Default, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub(super) struct Section {
    /// What the table is of.
    title: String,
    /// train.seed of every variant; [0] where it is not given.
    seeds: Option<Vec<u64>>,
    /// What the table shows of every variant.
    columns: Vec<Column>,
}

/// What stands beside the options of a `[[variant]]`.
#[derive(JsonSchema)]
pub(super) struct Variant {
    /// Its name, with a letter or digit.
    name: String,
    /// In place of those of the sweep.
    seeds: Option<Vec<u64>>,
    /// What somebody else has found, by the name of the column.
    #[schemars(default)]
    printed: BTreeMap<String, f64>,
    #[schemars(with = "Pipeline", flatten)]
    options: Table,
}

impl Sweep {
    /// Reads a pipeline file, with or without variants. Paths become relative to the current directory.
    ///
    /// # Errors
    /// [`PipelineError`].
    pub fn load(path: &Path, asked: Asked<'_>) -> Result<Self, PipelineError> {
        let name = path.display().to_string();
        let text = file::text(path)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        Self::read(&name, &text, asked, folder)
    }

    fn read(
        name: &str,
        text: &str,
        asked: Asked<'_>,
        folder: &Path,
    ) -> Result<Self, PipelineError> {
        let Asked { assignments, effort, .. } = asked;
        let (mut own, mut besides) = file::options_and(name, text, &SECTIONS)?;
        let has_quick = besides.contains_key(QUICK);
        let quick = overlay(name, QUICK, besides.remove(QUICK))?;
        let variants: Vec<Variant> = match besides.remove(VARIANT) {
            None => Vec::new(),
            Some(Value::Array(variants)) => {
                variants.into_iter().map(|v| Variant::of(name, v)).collect::<Result<_, _>>()?
            }
            Some(_) => return Err(wrong(name, "write [[variant]], once for every variant")),
        };
        let variants = only(variants, asked.variants, name)?;
        let section = besides.remove(SWEEP).map_or(Ok(Section::default()), Value::try_into);
        let section: Section = section.map_err(|e| wrong(name, &format!("[sweep]: {e}")))?;
        let own_seeds = variants.iter().filter_map(|variant| variant.seeds.as_ref());
        let mut seeds = own_seeds.chain(&section.seeds);
        if effort == Effort::Quick && !has_quick && seeds.all(|seeds| seeds.len() < 2) {
            return Err(PipelineError::NoRehearsal { path: name.into() });
        }
        let finished = |mut table: Table, seed: Option<u64>| {
            if effort == Effort::Quick {
                let quick = read_by_its_recipe(quick.clone(), &table);
                lay_over(&mut table, &quick);
            }
            if let Some(seed) = seed {
                lay_over(&mut table, &seeded(seed));
            }
            file::finish(name, table, assignments, folder)
        };
        if variants.is_empty() {
            if section != Section::default() {
                return Err(wrong(name, "[sweep] compares variants, and there is no [[variant]]"));
            }
            let pipeline = finished(own, None)?;
            let case = Case { variant: String::new(), seed: pipeline.train.seed, pipeline };
            return Ok(Self { comparison: None, cases: vec![case] });
        }
        let comparison = Comparison::of(name, section.title, section.columns, &variants)?;
        // The seed of a case is its own.
        if let Some(train) = own.get_mut("train").and_then(Value::as_table_mut)
            && let Some(seed) = train.remove("seed")
        {
            return Err(wrong(name, &format!("train.seed = {seed}: write sweep.seeds = [{seed}]")));
        }
        let mut cases = Vec::new();
        for Variant { name: variant, seeds, options, .. } in variants {
            let mut table = own.clone();
            lay_over(&mut table, &options);
            let seeds = seeds.or_else(|| section.seeds.clone()).unwrap_or_else(|| vec![0]);
            let seeds = match effort {
                Effort::Full => &seeds[..],
                Effort::Quick => &seeds[..1.min(seeds.len())],
            };
            for &seed in seeds {
                let pipeline = finished(table.clone(), Some(seed)).map_err(|source| {
                    PipelineError::InVariant { variant: variant.clone(), source: Box::new(source) }
                })?;
                cases.push(Case { variant: variant.clone(), seed, pipeline });
            }
        }
        Ok(Self { comparison: Some(comparison), cases })
    }
}

impl Case {
    /// Where its results go, below the folder of the sweep.
    pub fn folder(&self) -> PathBuf {
        if self.variant.is_empty() {
            return PathBuf::new();
        }
        PathBuf::from(folder_name(&self.variant)).join(format!("seed-{}", self.seed))
    }
}

impl Comparison {
    fn of(
        name: &str,
        title: String,
        columns: Vec<Column>,
        variants: &[Variant],
    ) -> Result<Self, PipelineError> {
        let mut folders = BTreeMap::new();
        for Variant { name: variant, printed, .. } in variants {
            if let Some(other) = folders.insert(folder_name(variant), variant) {
                let reason = format!("the variants {other:?} and {variant:?} need other names");
                return Err(wrong(name, &reason));
            }
            let unknown = printed.keys().find(|key| columns.iter().all(|c| c.name != **key));
            if let Some(key) = unknown {
                let reason = format!("variant {variant:?}: sweep.columns has no {key:?}");
                return Err(wrong(name, &reason));
            }
        }
        for Column { name: column, k, .. } in &columns {
            let (first, last) = k.ends();
            if first == 0 || last < first {
                let reason = format!("column {column:?}: k counts from 1, the smaller first");
                return Err(wrong(name, &reason));
            }
        }
        let described = variants
            .iter()
            .map(|v| Described { name: v.name.clone(), printed: v.printed.clone() })
            .collect();
        Ok(Self { title, columns, variants: described })
    }
}

impl Variant {
    fn of(file: &str, value: Value) -> Result<Self, PipelineError> {
        let Value::Table(mut table) = value else {
            return Err(wrong(file, "a [[variant]] is a table"));
        };
        let name = match table.remove("name") {
            Some(Value::String(name)) if !folder_name(&name).is_empty() => name,
            _ => return Err(wrong(file, "every [[variant]] needs a name, with a letter or digit")),
        };
        let here = format!("{file}, variant {name:?}");
        let seeds = table.remove("seeds").map(Value::try_into).transpose();
        let seeds = seeds.map_err(|e| wrong(&here, &format!("seeds: {e}")))?;
        let printed = table.remove("printed").map_or(Ok(BTreeMap::new()), Value::try_into);
        let printed = printed.map_err(|e| wrong(&here, &format!("printed: {e}")))?;
        let options = overlay(&here, "", Some(Value::Table(table)))?;
        Ok(Self { name, seeds, printed, options })
    }
}

/// The variants that are asked for.
fn only(
    mut variants: Vec<Variant>,
    asked: &[String],
    file: &str,
) -> Result<Vec<Variant>, PipelineError> {
    if let Some(variant) = asked.iter().find(|name| variants.iter().all(|v| v.name != **name)) {
        let known = variants.into_iter().map(|v| v.name).collect();
        return Err(PipelineError::NoVariant {
            path: file.into(),
            variant: variant.clone(),
            known,
        });
    }
    variants.retain(|variant| asked.is_empty() || asked.contains(&variant.name));
    Ok(variants)
}

/// Options of a pipeline that are laid over others.
fn overlay(name: &str, section: &str, value: Option<Value>) -> Result<Table, PipelineError> {
    let place = if section.is_empty() { name.to_string() } else { format!("{name}, [{section}]") };
    match value {
        None => Ok(Table::new()),
        Some(Value::Table(table)) => {
            file::check_options(&place, &table)?;
            Ok(table)
        }
        Some(_) => Err(wrong(&place, "it is a table of options")),
    }
}

/// Lays the options of `over` over those of `table`.
fn lay_over(table: &mut Table, over: &Table) {
    for (section, options) in over {
        match (table.get_mut(section), options) {
            (Some(Value::Table(own)), Value::Table(options)) => {
                own.extend(options.iter().map(|(key, value)| (key.clone(), value.clone())));
            }
            _ => {
                table.insert(section.clone(), options.clone());
            }
        }
    }
}

/// What of `quick` the recipe of `table` reads.
fn read_by_its_recipe(mut quick: Table, table: &Table) -> Table {
    let recipe = table.get("train").and_then(|train| train.get("recipe")).cloned();
    let recipe = recipe.and_then(|name| name.try_into().ok()).unwrap_or_default();
    if let Some(Value::Table(train)) = quick.get_mut("train") {
        train.retain(|key, _| !unread(recipe).contains(&format!("train.{key}").as_str()));
    }
    quick
}

fn seeded(seed: u64) -> Table {
    let seed = Value::Integer(i64::try_from(seed).unwrap_or(i64::MAX));
    let train = Table::from_iter([("seed".to_string(), seed)]);
    Table::from_iter([("train".to_string(), Value::Table(train))])
}

/// The folder of a variant: letters and digits of its name, joined by single hyphens.
pub fn folder_name(name: &str) -> String {
    let words = name.split(|c: char| !(c.is_alphanumeric() || c == '.' || c == '_'));
    let words: Vec<&str> = words.filter(|word| !word.trim_matches('.').is_empty()).collect();
    words.join("-")
}

fn wrong(path: &str, reason: &str) -> PipelineError {
    PipelineError::Malformed { path: path.to_string(), reason: reason.trim_end().to_string() }
}

#[cfg(test)]
mod tests;
