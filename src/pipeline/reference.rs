//! What every option means: its documentation in the code, as a commented file of all defaults and as a schema for editors.
//!
//! `docs/pipeline.md` holds both; `tests/docs.rs` writes it and holds it against the code.

use schemars::generate::SchemaSettings;
use schemars::transform::{RecursiveTransform, Transform};
use schemars::{JsonSchema, Schema};
use serde_json::Value;
use textwrap::{Options, WordSplitter};

use super::sweep::{Section, Variant};
use super::{Pipeline, PipelineError, file};

/// A pipeline file, with the variants of a sweep.
#[derive(JsonSchema)]
#[expect(dead_code, reason = "only its schema is wanted")]
struct PipelineFile {
    #[schemars(flatten)]
    pipeline: Pipeline,
    sweep: Section,
    /// A variant of the pipeline: options of its own, as train.width or train = { width = 64 }, and what is said of them.
    variant: Vec<Variant>,
    /// Laid over every variant by `--quick`, as far as its recipe reads it.
    quick: Pipeline,
}

/// A sweep as it may stand in a file, below the options that its variants share.
const SWEEP: &str = r#"[sweep]
title = "How wide a trunk should be"
seeds = [0, 1, 2]
columns = [
  { name = "error", what = "mse", k = 1, mesh = "square-324" },
  { name = "λ₁", what = "lambda", of = "own", k = 1, exact = 2.0 },
]

[[variant]]
name = "narrow"
train.width = 64
printed = { error = 5e-6 }

[[variant]]
name = "wide"
train.width = 1024
seeds = [0]

[quick]
train.steps = 5
"#;

/// How wide lines of comments are.
const WIDTH: usize = 110;

/// The JSON Schema (draft 7) of a pipeline file, by which editors complete and check one.
pub fn schema() -> Schema {
    let mut schema = root(SchemaSettings::draft07());
    schema.insert("title".into(), "A pipeline of chladni".into());
    RecursiveTransform(|schema: &mut Schema| {
        if schema.get("properties").is_some() {
            schema.insert("additionalProperties".into(), false.into());
        }
    })
    .transform(&mut schema);
    schema
}

/// Every option with its default and what it means: a pipeline file.
pub fn defaults() -> String {
    text(&parts(&default_options()))
}

/// A sweep, with what the keys of it mean that no pipeline has.
pub fn sweep() -> String {
    text(&parts(SWEEP))
}

/// What of [`defaults`] and [`sweep`] is about a section, such as `train`, or an option, such as `train.k`.
///
/// # Errors
/// [`PipelineError::UnknownKey`].
pub fn about(name: &str) -> Result<String, PipelineError> {
    let mut all = parts(&(default_options() + SWEEP));
    let known: Vec<String> = all.iter().map(|part| part.name.clone()).collect();
    let within = format!("{name}.");
    all.retain(|part| part.name == name || part.name.starts_with(&within));
    if all.is_empty() {
        return Err(file::unknown_key("chladni options", name, &known));
    }
    Ok(text(&all))
}

/// A section's head or an option, as it stands in a file, with its meaning above it.
struct Part {
    /// `train`, or `train.k`.
    name: String,
    text: String,
}

fn default_options() -> String {
    toml::to_string(&Pipeline::default()).unwrap_or_default()
}

/// The sections and options of a file in its order. What is there again is not explained again.
fn parts(toml: &str) -> Vec<Part> {
    let schema =
        root(SchemaSettings::draft2020_12().with(|s| s.inline_subschemas = true)).to_value();
    let mut parts: Vec<Part> = Vec::new();
    let mut section = String::new();
    for line in toml.lines().filter(|line| !line.is_empty()) {
        let name = match (line.strip_prefix('['), line.split_once(" = ")) {
            (Some(head), _) => {
                section = head.trim_matches(['[', ']']).into();
                section.clone()
            }
            (None, Some((key, _))) if !key.starts_with(' ') => format!("{section}.{key}"),
            // The value goes on.
            _ => {
                if let Some(part) = parts.last_mut() {
                    part.text += &format!("{line}\n");
                }
                continue;
            }
        };
        let line = with_exponent(line);
        let explained = parts.iter().any(|part| part.name == name);
        let meaning = if explained { String::new() } else { meaning(&schema, &name) };
        parts.push(Part { name, text: format!("{meaning}{line}\n") });
    }
    parts
}

/// The line with a small number as people write it: 1e-10.
fn with_exponent(line: &str) -> String {
    match line.split_once(" = ").map(|(key, value)| (key, value.parse::<f64>())) {
        Some((key, Ok(small))) if small > 0.0 && small < 1e-3 => format!("{key} = {small:e}"),
        _ => line.to_string(),
    }
}

/// The parts as a file.
fn text(parts: &[Part]) -> String {
    parts.iter().map(|part| part.text.as_str()).collect::<Vec<_>>().join("\n")
}

/// What a section or option means, as comments; nothing for options of a pipeline inside a variant.
fn meaning(schema: &Value, name: &str) -> String {
    let mut names = name.split('.');
    let meant = names.by_ref().take(2).fold(schema, |of, name| &element(of)["properties"][name]);
    if names.next().is_some() {
        return String::new();
    }
    let mut comment = String::new();
    describe(meant, "# ", "", &mut comment);
    if name.contains('.') {
        values(meant, 1, &mut comment);
    }
    comment
}

/// Of a list, what its elements are.
fn element(schema: &Value) -> &Value {
    schema.get("items").unwrap_or(schema)
}

/// Adds the description of `of`, if it has one, as lines that begin with `indent`; the first says `name` before it.
fn describe(of: &Value, indent: &str, name: &str, comment: &mut String) {
    let Some(description) = of["description"].as_str() else { return };
    let mut first = format!("{indent}{name}");
    for paragraph in description.split("\n\n") {
        let words: Vec<&str> = paragraph.split_whitespace().collect();
        let wrap =
            Options::new(WIDTH).word_splitter(WordSplitter::NoHyphenation).break_words(false);
        let wrap = wrap.initial_indent(&first).subsequent_indent(indent);
        for line in textwrap::wrap(&words.join(" "), wrap) {
            comment.push_str(line.trim_end());
            comment.push('\n');
        }
        first = indent.to_string();
    }
}

/// Adds what can stand for `of`: names and kinds of values, or the keys of a table, those that it must have first; each with its
/// meaning.
fn values(of: &Value, depth: usize, comment: &mut String) {
    let of = element(of);
    let indent = format!("# {}", "  ".repeat(depth));
    let choices = ["oneOf", "anyOf"].iter().filter_map(|key| of[key].as_array()).flatten();
    for choice in choices.filter(|choice| choice.get("description").is_some()) {
        let name = choice.get("const").map(|name| format!("{name}: ")).unwrap_or_default();
        describe(choice, &indent, &name, comment);
    }
    let keys = of["properties"].as_object().map(|keys| keys.keys()).into_iter().flatten();
    let required = of["required"].as_array().into_iter().flatten().filter_map(|key| key.as_str());
    let required: Vec<&str> = required.collect();
    let others = keys.map(String::as_str).filter(|key| !required.contains(key));
    for key in required.iter().copied().chain(others) {
        let property = &of["properties"][key];
        describe(property, &indent, &format!("{key}: "), comment);
        values(property, depth + 1, comment);
    }
}

fn root(settings: SchemaSettings) -> Schema {
    let mut schema = settings.into_generator().into_root_schema_for::<PipelineFile>();
    schema.remove("required");
    schema.remove("description");
    schema
}
