//! Why a pipeline cannot be run: one line, which says where and what to do.

/// Why a pipeline cannot be run. Each message says where and what to do.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PipelineError {
    /// The file is not there or not readable.
    #[error("{path}: {reason}; give the path of a pipeline file, such as pipelines/spot.toml")]
    Unreadable { path: String, reason: String },
    /// The file is not TOML, or a value has the wrong type.
    #[error("{path}: {reason}")]
    Malformed { path: String, reason: String },
    /// A key that no option has.
    #[error("{path}: there is no option `{key}`{}", hint(.nearest.as_deref()))]
    UnknownKey { path: String, key: String, nearest: Option<String> },
    /// The recipe file is not there or not readable.
    #[error(
        "{path}: {reason}; train.recipe is \"ritz\", \"paper\", or a recipe file, relative to the pipeline file"
    )]
    NoRecipe { path: String, reason: String },
    /// A recipe file has other options than those of `[train]`.
    #[error(
        "{path}: [{section}] has no place in a recipe file, which has [train] alone; move it to the pipeline file"
    )]
    NotOfRecipe { path: String, section: String },
    /// A recipe file names another.
    #[error(
        "{path}: train.recipe = {recipe:?}: a recipe file cannot name another; put the options of both into one"
    )]
    RecipeInRecipe { path: String, recipe: String },
    /// A value that cannot work, from a recipe file.
    #[error("{path}: {source}")]
    InRecipe { path: String, source: Box<PipelineError> },
    /// `--set` without `=`.
    #[error("--set {argument}: write KEY=VALUE, for example --set train.k=10")]
    Assignment { argument: String },
    /// A rehearsal of what has none.
    #[error(
        "--quick: {path} has no [quick], which says what a rehearsal does with less; add one, such as\n[quick.train]\nsteps = 5"
    )]
    NoRehearsal { path: String },
    /// A file with variants where one pipeline is wanted.
    #[error(
        "{path}: [{section}] belongs to a sweep over variants of a pipeline, which `chladni run` and `chladni explain` alone go through"
    )]
    Sweep { path: String, section: String },
    /// A variant is asked for that the file does not have.
    #[error("--variant {variant:?}: {path} has {}", listed(.known))]
    NoVariant { path: String, variant: String, known: Vec<String> },
    /// A variant of a sweep cannot be run.
    #[error("variant {variant:?}: {source}")]
    InVariant { variant: String, source: Box<PipelineError> },
    /// A value that cannot work.
    #[error("{key} = {value}: {rule}")]
    Value { key: &'static str, value: String, rule: &'static str },
}

fn listed(names: &[String]) -> String {
    let names: Vec<String> = names.iter().map(|name| format!("{name:?}")).collect();
    if names.is_empty() { "no variants".into() } else { names.join(", ") }
}

fn hint(nearest: Option<&str>) -> String {
    nearest.map(|name| format!("; did you mean `{name}`?")).unwrap_or_default()
}
