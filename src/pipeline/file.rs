//! From a file to a [`Pipeline`]: the text, with assignments laid over it, a recipe file and the defaults of its recipe under
//! it; unknown keys are refused with the nearest known one.

use std::path::Path;

use toml::{Table, Value};

use super::sweep::SECTIONS;
use super::{Pipeline, PipelineError, recipe_file};
use crate::ggnn::features::Normalise;
use crate::ggnn::paper::Paper;
use crate::ggnn::recipe::{Ritz, Trunks};
use crate::mesh::Format;

/// `train.head_subdivisions` of a shared trunk, unless a file says otherwise.
const HEAD_SUBDIVISIONS: usize = 1;

impl Pipeline {
    /// Reads a pipeline file, with `assignments` (`train.k=10`) laid over it. Input paths become relative to
    /// the current directory.
    ///
    /// # Errors
    /// [`PipelineError`].
    pub fn load(path: &Path, assignments: &[String]) -> Result<Self, PipelineError> {
        let name = path.display().to_string();
        let folder = path.parent().unwrap_or(Path::new(""));
        finish(&name, options(&name, &text(path)?)?, assignments, folder)
    }

    /// Parses the text of a pipeline file; `name` is for messages. A recipe file that it names is taken to be relative to the
    /// current directory.
    ///
    /// # Errors
    /// [`PipelineError`].
    pub fn parse(name: &str, text: &str, assignments: &[String]) -> Result<Self, PipelineError> {
        finish(name, options(name, text)?, assignments, Path::new(""))
    }
}

/// The text of a pipeline file.
pub(super) fn text(path: &Path) -> Result<String, PipelineError> {
    let extension = path.extension().and_then(|extension| extension.to_str());
    let read = if path.is_dir() {
        Err("it is a folder: a pipeline has it under [input]".into())
    } else if path.exists() && extension.and_then(Format::of_extension).is_some() {
        Err("it is a mesh: `chladni solve` takes one, and a pipeline has it under [input]".into())
    } else {
        std::fs::read_to_string(path).map_err(|error| error.to_string())
    };
    read.map_err(|reason| PipelineError::Unreadable { path: path.display().to_string(), reason })
}

/// The pipeline of these options with `assignments` laid over them; a recipe file and the defaults of the recipe under them. Paths
/// that are relative to `folder` become relative to the current directory.
pub(super) fn finish(
    name: &str,
    mut table: Table,
    assignments: &[String],
    folder: &Path,
) -> Result<Pipeline, PipelineError> {
    for argument in assignments {
        assign(&mut table, argument)?;
        refuse_unknown("--set", &table, &known_keys())?;
        let place = || format!("--set {argument}");
        table.clone().try_into::<Pipeline>().map_err(|e| malformed(place(), &e))?;
    }
    let laid = recipe_file::lay_under(&mut table, folder)?;
    lay_recipe_under(&mut table);
    let mut pipeline: Pipeline = table.try_into().map_err(|e| malformed(name.to_string(), &e))?;
    match (pipeline.check(), laid) {
        (Ok(()), _) => {}
        (Err(error), None) => return Err(error),
        (Err(error), Some(laid)) => return Err(laid.blamed(error)),
    }
    pipeline.input.paths.iter_mut().for_each(|p| *p = folder.join(&*p));
    if is_model_file(&pipeline.train.model) {
        pipeline.train.model = folder.join(&pipeline.train.model).display().to_string();
    }
    Ok(pipeline)
}

/// The ending of model files.
pub const MODEL_EXTENSION: &str = "safetensors";

/// Whether a model is named by its file: it ends as one, or has folders. Anything else is a name in the cache.
pub fn is_model_file(model: &str) -> bool {
    model.contains(['/', '\\']) || model.ends_with(&format!(".{MODEL_EXTENSION}"))
}

/// The options that a text sets, all of them known; `name` is for messages.
pub(super) fn options(name: &str, text: &str) -> Result<Table, PipelineError> {
    let (table, besides) = options_and(name, text, &SECTIONS)?;
    match besides.keys().next() {
        None => Ok(table),
        Some(section) => Err(PipelineError::Sweep { path: name.into(), section: section.clone() }),
    }
}

/// The options that a text sets, all of them known, and its sections called `besides`; `name` is for messages.
pub(super) fn options_and(
    name: &str,
    text: &str,
    besides: &[&str],
) -> Result<(Table, Table), PipelineError> {
    // Parsed as a pipeline first: the errors then carry line and column.
    let parsed = toml::from_str::<Pipeline>(text).and_then(|_| text.parse());
    let mut table: Table = parsed.map_err(|e| malformed(name.to_string(), &e))?;
    let besides =
        besides.iter().filter_map(|&section| Some((section.into(), table.remove(section)?)));
    let besides = besides.collect();
    refuse_unknown(name, &table, &known_keys())?;
    Ok((table, besides))
}

/// Whether these are options of a pipeline, with values of their types; `place` is for messages.
pub(super) fn check_options(place: &str, table: &Table) -> Result<(), PipelineError> {
    refuse_unknown(place, table, &known_keys())?;
    let typed = table.clone().try_into::<Pipeline>();
    typed.map(drop).map_err(|e| malformed(place.to_string(), &e))
}

fn malformed(path: String, error: &toml::de::Error) -> PipelineError {
    PipelineError::Malformed { path, reason: plain(&error.to_string()) }
}

/// A message of the parser in words that are not Rust's.
fn plain(reason: &str) -> String {
    reason
        .trim_end()
        .replace("expected usize", "expected a whole number")
        .replace("expected u64", "expected a whole number")
        .replace("expected f64", "expected a number")
        .replace("expected a sequence", "expected a list")
}

/// Lays `section.key=value` over a table. The value is TOML, or else a plain string.
fn assign(table: &mut Table, argument: &str) -> Result<(), PipelineError> {
    let malformed = || PipelineError::Assignment { argument: argument.to_string() };
    let (key, text) = argument.split_once('=').ok_or_else(malformed)?;
    let value = format!("value = {text}")
        .parse::<Table>()
        .ok()
        .and_then(|mut parsed| parsed.remove("value"))
        .unwrap_or_else(|| Value::String(text.to_string()));
    let (section, name) = key.trim().split_once('.').ok_or_else(malformed)?;
    table
        .entry(section)
        .or_insert_with(|| Value::Table(Table::new()))
        .as_table_mut()
        .ok_or_else(malformed)?
        .insert(name.to_string(), value);
    Ok(())
}

/// Options whose default depends on the recipe or the kind of trunk: lays these under what a file says.
fn lay_recipe_under(table: &mut Table) {
    let train = |key| table.get("train").and_then(|train| train.get(key)).and_then(Value::as_str);
    let mut under = Vec::new();
    if train("recipe") == Some("paper") {
        let Paper { shape, ranges, batch, learning_rate, .. } = Paper::default();
        under.extend([
            ("train", "layer", Value::try_from(shape.layer)),
            ("train", "batch", Value::try_from(batch)),
            ("train", "learning_rate", Value::try_from(learning_rate)),
            ("train", "encoder_range", Value::try_from(ranges.encoder)),
            ("train", "initial_weights", Value::try_from(ranges.interval)),
            ("features", "normalise", Value::try_from(Normalise::None)),
        ]);
    } else if train("trunk") == Some(Trunks::Shared.name()) {
        let Ritz { steps, spare, .. } = Ritz::shared();
        under.extend([
            ("train", "steps", Value::try_from(steps)),
            ("train", "spare", Value::try_from(spare)),
            ("train", "head_subdivisions", Value::try_from(HEAD_SUBDIVISIONS)),
        ]);
    }
    for (section, key, value) in under {
        let options = table.entry(section).or_insert_with(|| Value::Table(Table::new()));
        if let (Some(options), Ok(value)) = (options.as_table_mut(), value) {
            options.entry(key).or_insert(value);
        }
    }
}

/// All options as `section.key`, from the defaults.
fn known_keys() -> Vec<String> {
    let defaults = Table::try_from(Pipeline::default()).unwrap_or_default();
    flatten(&defaults)
}

fn flatten(table: &Table) -> Vec<String> {
    table
        .iter()
        .flat_map(|(section, value)| match value {
            Value::Table(keys) => {
                keys.keys().map(|key| format!("{section}.{key}")).collect::<Vec<_>>()
            }
            _ => vec![section.clone()],
        })
        .collect()
}

fn refuse_unknown(name: &str, table: &Table, known: &[String]) -> Result<(), PipelineError> {
    let sections: Vec<&str> = known.iter().filter_map(|k| Some(k.split_once('.')?.0)).collect();
    let empty = table.iter().filter(|(section, value)| {
        value.as_table().is_some_and(Table::is_empty) && !sections.contains(&section.as_str())
    });
    let unknown = flatten(table)
        .into_iter()
        .chain(empty.map(|(section, _)| section.clone()))
        .find(|key| !known.contains(key) && !sections.contains(&key.as_str()));
    match unknown {
        None => Ok(()),
        Some(key) => Err(unknown_key(name, &key, known)),
    }
}

/// That there is no such option among those that are known; `name` says where it was asked for.
pub(super) fn unknown_key(name: &str, key: &str, known: &[String]) -> PipelineError {
    let nearest = nearest(key, known);
    PipelineError::UnknownKey { path: name.to_string(), key: key.to_string(), nearest }
}

/// Options that have become others.
const REPLACED: [(&str, &str); 1] = [("publish.ply", "publish.formats")];

/// The known key that looks most like `key`, unless none does.
fn nearest(key: &str, known: &[String]) -> Option<String> {
    if let Some((_, by)) = REPLACED.iter().find(|(replaced, _)| *replaced == key) {
        return Some((*by).into());
    }
    // A right key in the wrong section is the nearest of all.
    let last = key.rsplit('.').next().unwrap_or(key);
    if let Some(moved) = known.iter().find(|k| k.rsplit('.').next() == Some(last)) {
        return Some(moved.clone());
    }
    let best = known
        .iter()
        .max_by(|a, b| strsim::jaro_winkler(key, a).total_cmp(&strsim::jaro_winkler(key, b)))?;
    (strsim::jaro_winkler(key, best) > 0.75).then(|| best.clone())
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::ggnn::recipe::Recipe;
    use crate::operators::MassKind;

    pub fn parse(text: &str, set: &[&str]) -> Result<Pipeline, PipelineError> {
        let set: Vec<String> = set.iter().map(ToString::to_string).collect();
        Pipeline::parse("p.toml", text, &set)
    }

    #[test]
    fn every_key_has_a_default() {
        assert_eq!(parse("", &[]), Ok(Pipeline::default()));
    }

    #[test]
    fn assignments_win_over_the_file() {
        let pipeline =
            parse("[train]\nk = 4", &["train.k=10", "operators.mass=consistent"]).unwrap();
        assert_eq!(
            (pipeline.train.k, pipeline.operators.mass),
            (10.into(), Some(MassKind::Consistent))
        );
    }

    #[test]
    fn unknown_keys_name_the_nearest_known_one() {
        let message = |text, set: &[&str]| parse(text, set).unwrap_err().to_string();
        assert_eq!(
            message("[train]\nlearning_rat = 1e-3", &[]),
            "p.toml: there is no option `train.learning_rat`; did you mean `train.learning_rate`?"
        );
        assert_eq!(
            message("", &["train.lambda_tolerance=1"]),
            "--set: there is no option `train.lambda_tolerance`; did you mean `verify.lambda_tolerance`?"
        );
        assert_eq!(message("[zzz]", &[]), "p.toml: there is no option `zzz`");
        assert!(message("[zzz]\nq = 1", &[]).starts_with("p.toml: there is no option `zzz.q`"));
    }

    #[test]
    fn an_option_that_became_another_is_answered_with_that() {
        for (text, set) in [("[publish]\nply = false", &[][..]), ("", &["publish.ply=true"])] {
            let message = parse(text, set).unwrap_err().to_string();
            let expected = "there is no option `publish.ply`; did you mean `publish.formats`?";
            assert!(message.ends_with(expected), "{message}");
        }
    }

    #[test]
    fn the_papers_recipe_has_its_own_defaults_and_refuses_the_others_options() {
        let paper = parse("[train]\nrecipe = \"paper\"", &[]).unwrap();
        assert_eq!(paper.train.recipe(3), Recipe::Paper(Paper::default()));
        assert_eq!(paper.features.normalise, Normalise::None);
        let set = ["train.recipe=paper", "train.batch=3", "features.normalise=area"];
        let chosen = parse("", &set).unwrap();
        assert_eq!((chosen.train.batch, chosen.features.normalise), (3, Normalise::Area));
        let message = |set: &[&str]| parse("", set).unwrap_err().to_string();
        let refused = message(&["train.epochs=9"]);
        assert!(
            refused.starts_with("train.epochs = 9: is for train.recipe = \"paper\""),
            "{refused}"
        );
        let refused = message(&["train.recipe=paper", "train.steps=9"]);
        assert!(
            refused.starts_with("train.steps = 9: is for train.recipe = \"ritz\""),
            "{refused}"
        );
        assert!(message(&["train.recipe=papers"]).contains("paper"));
    }

    #[test]
    fn a_shared_trunk_has_its_own_defaults_and_its_options_are_for_it_alone() {
        let shared = parse("", &["train.trunk=shared"]).unwrap().train;
        let Ritz { steps, spare, .. } = Ritz::shared();
        let found = (shared.steps, shared.spare, shared.head_subdivisions);
        assert_eq!(found, (steps, spare, HEAD_SUBDIVISIONS));
        let chosen = parse("", &["train.trunk=shared", "train.spare=0", "train.steps=7"]).unwrap();
        assert_eq!((chosen.train.spare, chosen.train.steps), (0, 7));
        let message = |set: &[&str]| parse("", set).unwrap_err().to_string();
        let refused = message(&["train.spare=2"]);
        let rule = "train.spare = 2: is for train.trunk = \"shared\"";
        assert!(refused.starts_with(rule), "{refused}");
        let refused = message(&["train.trunk=shared", "train.head_subdivisions=4"]);
        assert!(refused.contains("more than can be meant"), "{refused}");
    }
}
