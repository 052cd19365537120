//! Recipe files: options of `[train]` that a pipeline file names in place of `"ritz"` or `"paper"`, and that `train.tune` leaves.
//!
//! Such a file is a pipeline file with `[train]` alone. Its options lie under what the pipeline file sets itself and over the
//! defaults.

use std::path::Path;

use toml::{Table, Value};

use super::{PipelineError, file};
use crate::ggnn::recipe::{Ritz, Trunks};
use crate::ggnn::tune::{Choice, Effort, Space, Trial, Tuning};
use crate::operators::Boundary;

/// The ending of recipe files.
const EXTENSION: &str = "toml";

/// Whether a recipe is named by its file: it ends as one, or has folders.
pub(super) fn is_recipe_file(recipe: &str) -> bool {
    recipe.contains(['/', '\\']) || recipe.ends_with(&format!(".{EXTENSION}"))
}

/// The options that a recipe file gave to a pipeline.
#[derive(Debug)]
pub(super) struct Laid {
    path: String,
    keys: Vec<String>,
}

impl Laid {
    /// The error with the file to blame, where the value that is refused comes from it.
    pub fn blamed(&self, error: PipelineError) -> PipelineError {
        match &error {
            PipelineError::Value { key, .. } if self.keys.iter().any(|k| k == key) => {
                PipelineError::InRecipe { path: self.path.clone(), source: Box::new(error) }
            }
            _ => error,
        }
    }
}

/// Lays the options of the recipe file that `table` names, relative to `folder`, under its own; `None` when it names none.
///
/// # Errors
/// When the file cannot be read, or is no recipe file.
pub(super) fn lay_under(table: &mut Table, folder: &Path) -> Result<Option<Laid>, PipelineError> {
    let Some(own) = table.get_mut("train").and_then(Value::as_table_mut) else { return Ok(None) };
    let named = own.get("recipe").and_then(Value::as_str).filter(|recipe| is_recipe_file(recipe));
    let Some(path) = named.map(|recipe| folder.join(recipe).display().to_string()) else {
        return Ok(None);
    };
    // What the file calls its own recipe, or the default, takes the place of its name.
    own.remove("recipe");
    let mut keys = Vec::new();
    for (key, value) in read(&path)? {
        if !own.contains_key(&key) {
            keys.push(format!("train.{key}"));
            own.insert(key, value);
        }
    }
    Ok(Some(Laid { path, keys }))
}

/// The options of a recipe file.
fn read(path: &str) -> Result<Table, PipelineError> {
    let text = std::fs::read_to_string(path)
        .map_err(|e| PipelineError::NoRecipe { path: path.into(), reason: e.to_string() })?;
    let mut table = file::options(path, &text)?;
    if let Some(section) = table.keys().find(|section| *section != "train") {
        let section = section.clone();
        return Err(PipelineError::NotOfRecipe { path: path.into(), section });
    }
    let Some(Value::Table(train)) = table.remove("train") else { return Ok(Table::new()) };
    let other = train.get("recipe").and_then(Value::as_str).filter(|recipe| is_recipe_file(recipe));
    if let Some(recipe) = other {
        let (path, recipe) = (path.into(), recipe.into());
        return Err(PipelineError::RecipeInRecipe { path, recipe });
    }
    Ok(train)
}

/// What a search has found, with where it was found.
#[derive(Debug)]
pub struct FoundRecipe<'a> {
    /// The name of the mesh.
    pub mesh: &'a str,
    /// The hash of its content.
    pub hash: String,
    /// The functions that it was judged by, φ2…φ4.
    pub functions: String,
    /// The variants that it was judged on.
    pub held_out: usize,
    /// The recipe that the search started from.
    pub recipe: &'a Ritz,
    /// What was searched.
    pub space: Space,
    /// What was found.
    pub tuning: &'a Tuning,
}

impl FoundRecipe<'_> {
    /// The text of a recipe file: what was chosen, under a table of all trials. The numbers read back as the same bits, and
    /// the same search has the same text.
    pub fn to_toml(&self) -> String {
        let Self { mesh, hash, functions, held_out, space, tuning, .. } = self;
        let members = space.members + held_out;
        let mut text = format!(
            "# A recipe for `train.recipe`: what `train.tune = {}` found for {mesh:?}, {hash:.12}.\n\
             # What a pipeline file sets itself wins over what stands here.\n\
             #\n\
             # Loss: the mean of log R over {functions} on {held_out} of {members} variants, which the trials were not trained on; 0.01 less is one\n\
             # per cent less in every λ. The first trial is the recipe that the search started from, * the one that was chosen.\n\
             #\n",
            tuning.trials.len(),
        );
        for line in aligned(&self.table()) {
            text += &format!("# {line}\n");
        }
        text += "\n[train]\n";
        for (key, value) in tuning.choice().map(|choice| options(choice, space)).unwrap_or_default()
        {
            text += &format!("{key} = {value}\n");
        }
        text
    }

    /// The trials, a row each, under a row of names.
    fn table(&self) -> Vec<Vec<String>> {
        let Self { recipe, space, tuning, .. } = self;
        let loss = |loss: f64| {
            if loss.is_finite() { format!("{loss:.5}") } else { "failed".to_string() }
        };
        let row = |(i, trial): (usize, &Trial)| {
            let mark = if i == tuning.best { "*" } else { " " };
            let numbers = options(&trial.choice, space).into_iter().map(|(_, value)| value);
            let whole = trial.whole.map_or("-".to_string(), loss);
            [mark.to_string()].into_iter().chain(numbers).chain([loss(trial.quarter), whole])
        };
        let steps = [Effort::Quarter, Effort::Whole]
            .map(|effort| format!("after {} steps", effort.of(recipe).steps));
        let names = tuning.choice().map(|choice| options(choice, space)).unwrap_or_default();
        let names = names.into_iter().map(|(name, _)| name.to_string());
        let names = [" ".to_string()].into_iter().chain(names).chain(steps).collect();
        let rows = tuning.trials.iter().enumerate().map(|trial| row(trial).collect());
        [names].into_iter().chain(rows).collect()
    }
}

/// The options that a search chooses, with their values as TOML.
fn options(choice: &Choice, space: &Space) -> Vec<(&'static str, String)> {
    let Choice { learning_rate, encoder_range, hidden_range, ridge, batch, spare, .. } = choice;
    let mut options = vec![
        ("learning_rate", format!("{learning_rate:?}")),
        ("encoder_range", format!("{encoder_range:?}")),
        ("hidden_range", format!("{hidden_range:?}")),
        ("ridge", format!("{ridge:?}")),
        ("batch", batch.to_string()),
    ];
    if space.trunks == Trunks::Shared {
        options.push(("spare", spare.to_string()));
    }
    if space.boundary == Boundary::Dirichlet {
        options.push(("boundary_penalty", format!("{:?}", choice.boundary_penalty)));
    }
    options
}

/// Rows as lines, their columns one under the other.
fn aligned(rows: &[Vec<String>]) -> Vec<String> {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |j: usize| rows.iter().filter_map(|row| row.get(j)).map(String::len).max();
    let widths: Vec<usize> = (0..columns).map(|j| width(j).unwrap_or(0)).collect();
    let line = |row: &Vec<String>| {
        let cells = row.iter().zip(&widths).map(|(cell, &width)| format!("{cell:>width$}"));
        cells.collect::<Vec<_>>().join("  ")
    };
    rows.iter().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::super::file::tests::parse;
    use super::*;
    use crate::ggnn::recipe::Recipe;
    use crate::pipeline::{Pipeline, RecipeName};

    /// A folder with `recipe.toml`, and a pipeline that names it.
    fn with_recipe(recipe: &str, pipeline: &str) -> Result<Pipeline, PipelineError> {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("recipe.toml"), recipe).unwrap();
        let path = dir.path().join("pipeline.toml");
        std::fs::write(&path, format!("[train]\nrecipe = \"recipe.toml\"\n{pipeline}")).unwrap();
        Pipeline::load(&path, &[])
    }

    #[test]
    fn a_recipe_lies_under_the_file_and_over_the_defaults() {
        let train = with_recipe("[train]\nsteps = 7\nridge = 1e-9", "steps = 9").unwrap().train;
        assert_eq!((train.steps, train.ridge, train.recipe), (9, 1e-9, RecipeName::Ritz));
        let shared = with_recipe("[train]\ntrunk = \"shared\"", "steps = 9").unwrap().train;
        assert_eq!((shared.steps, shared.spare), (9, Ritz::shared().spare));
        let paper = with_recipe("[train]\nrecipe = \"paper\"\nepochs = 9", "").unwrap().train;
        assert_eq!((paper.recipe, paper.epochs, paper.batch), (RecipeName::Paper, 9, 10));
        assert_eq!(with_recipe("", "").unwrap(), Pipeline::default());
    }

    #[test]
    fn a_bad_recipe_is_refused_with_its_file_its_place_and_a_remedy() {
        let refused = |recipe: &str| {
            let message = with_recipe(recipe, "").unwrap_err().to_string();
            assert!(message.contains("recipe.toml: "), "{message}");
            message
        };
        let message = refused("[train]\nlearning_rat = 1e-3");
        assert!(message.ends_with("did you mean `train.learning_rate`?"), "{message}");
        assert!(refused("[train]\nridge = \"small\"").contains("line 2"));
        let message = refused("[train]\nridge = -1.0");
        assert!(message.ends_with("train.ridge = -1: must not be negative"), "{message}");
        let message = refused("[train]\nspare = 3");
        assert!(message.contains("set that, or leave it out"), "{message}");
        let message = refused("[family]\nmembers = 3");
        assert!(message.contains("move it to the pipeline file"), "{message}");
        let message = refused("[train]\nrecipe = \"other.toml\"");
        assert!(message.contains("put the options of both into one"), "{message}");
        let missing = parse("[train]\nrecipe = \"nowhere/r.toml\"", &[]).unwrap_err().to_string();
        assert!(missing.starts_with("nowhere/r.toml: "), "{missing}");
        // Its own values are blamed on the pipeline file alone.
        let own = with_recipe("[train]\nridge = 1e-9", "steps = 0").unwrap_err().to_string();
        assert_eq!(own, "train.steps = 0: must be at least 1");
    }

    #[test]
    fn what_a_search_found_reads_back_as_the_same_bits() {
        let own = Choice::of(&Ritz::default(), 1000.0);
        let other =
            Choice { learning_rate: 0.1 + 0.2, ridge: 1.0 / 3e11, spare: 7, batch: 3, ..own };
        let trials = vec![
            Trial { choice: own, quarter: 3.5, whole: Some(3.25) },
            Trial { choice: other, quarter: 3.0, whole: Some(3.0) },
            Trial { choice: own, quarter: f64::INFINITY, whole: None },
        ];
        for (trunks, boundary) in
            [(Trunks::PerEigenfunction, Boundary::Neumann), (Trunks::Shared, Boundary::Dirichlet)]
        {
            let found = FoundRecipe {
                mesh: "a\n[train].obj",
                hash: "0123456789abcdef".into(),
                functions: "φ2…φ4".into(),
                held_out: 2,
                recipe: &Ritz::default(),
                space: Space { trunks, boundary, members: 6 },
                tuning: &Tuning { trials: trials.clone(), best: 1 },
            };
            let text = found.to_toml();
            let trunk = format!("trunk = \"{}\"", trunks.name());
            let train = with_recipe(&text, &trunk).unwrap().train;
            let spare = if trunks == Trunks::Shared { 7 } else { 0 };
            let Recipe::Ritz(recipe) = train.recipe(3) else { panic!("{train:?}") };
            assert_eq!(Choice::of(&recipe, train.boundary_penalty), Choice { spare, ..other });
            assert!(text.contains("*  0.30000000000000004") && text.contains("failed  "), "{text}");
            assert_eq!(text.contains("boundary_penalty"), boundary == Boundary::Dirichlet);
        }
    }
}
