//! `chladni model list|export|import`: the models of the cache, and models as files.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use comfy_table::CellAlignment::{Left, Right};
use comfy_table::presets::NOTHING;
use comfy_table::{LineStyle, Table};
use serde::Serialize;

use super::exit::Exit;
use super::{CacheLocation, Format, Refusal, cache, print, print_json};
use crate::ggnn::Model;
use crate::ggnn::model::TrainedMesh;
use crate::operators::Boundary;
use crate::pipeline::is_model_file;
use crate::publish::write_if_changed;
use crate::stages::models::{self, Listed, ModelError};
use crate::stages::predict::GivenModel;
use crate::store::Store;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Say which models the cache holds
    List(List),
    /// Write a model of the cache to a file
    Export(Export),
    /// Bring a model from a file into the cache
    Import(Import),
}

#[derive(Debug, clap::Args)]
#[command(after_help = super::exit::help("  chladni model list"))]
pub struct List {
    #[command(flatten)]
    cache: CacheLocation,
    /// How the result is shown
    #[arg(long, value_enum, default_value = "human")]
    format: Format,
}

#[derive(Debug, clap::Args)]
#[command(after_help = super::exit::help("  chladni model export cow cow.safetensors"))]
pub struct Export {
    /// Its name, or enough of the beginning
    name: String,
    /// The file to write, for example cow.safetensors
    file: PathBuf,
    #[command(flatten)]
    cache: CacheLocation,
}

#[derive(Debug, clap::Args)]
#[command(after_help = super::exit::help("\
  chladni model import cow.safetensors
  chladni model import cow.safetensors --name spot"))]
pub struct Import {
    /// A file that `chladni model export` wrote
    file: PathBuf,
    /// Its name in the cache; that of the file unless given
    #[arg(long)]
    name: Option<String>,
    #[command(flatten)]
    cache: CacheLocation,
}

/// The document of `model list --format json`.
#[derive(Debug, Serialize)]
struct Models<'a> {
    schema: &'static str,
    models: Vec<Entry<'a>>,
}

#[derive(Debug, Serialize)]
struct Entry<'a> {
    name: &'a str,
    k: usize,
    known: usize,
    boundary: Boundary,
    mesh: &'a TrainedMesh,
    parameters: &'a serde_json::Value,
    chladni: &'a str,
    /// Whether the cache has all its blocks.
    whole: bool,
}

pub fn execute(command: &Command) -> Result<Exit, Refusal> {
    match command {
        Command::List(arguments) => list(arguments),
        Command::Export(arguments) => export(arguments),
        Command::Import(arguments) => import(arguments),
    }
}

fn list(arguments: &List) -> Result<Exit, Refusal> {
    let listed = models::list(&existing(&arguments.cache)?).map_err(refusal)?;
    match arguments.format {
        Format::Json => print_json(&document(&listed))?,
        Format::Human if listed.is_empty() => {
            print("no models: `chladni run` leaves one for every mesh that it trains")?;
        }
        Format::Human => print(&text(&listed))?,
    }
    Ok(Exit::Success)
}

fn export(arguments: &Export) -> Result<Exit, Refusal> {
    let (name, model) =
        models::load(&existing(&arguments.cache)?, &arguments.name).map_err(refusal)?;
    let bytes = model.to_bytes();
    write_if_changed(&arguments.file, &bytes)
        .map_err(|error| Refusal::usage(without_out(&error.to_string())))?;
    print(&format!(
        "{}: the model {name}, {} eigenpairs, {:.1} MB",
        arguments.file.display(),
        model.k(),
        bytes.len() as f64 / 1e6
    ))?;
    Ok(Exit::Success)
}

/// This command has no --out.
fn without_out(message: &str) -> String {
    message.replace(" (choose one with --out DIR)", "").replace(" with --out DIR", "")
}

fn import(arguments: &Import) -> Result<Exit, Refusal> {
    let model = Model::load(&arguments.file).map_err(Refusal::usage)?;
    let name = arguments.name.clone().unwrap_or_else(|| {
        let stem = arguments.file.file_stem().unwrap_or(arguments.file.as_os_str());
        stem.to_string_lossy().into_owned()
    });
    let store = Store::open(&arguments.cache.dir).map_err(cache::refusal)?;
    models::import(&store, &name, &model).map_err(refusal)?;
    print(&format!(
        "{name}: {} eigenpairs, trained for {}",
        model.k(),
        model.description.mesh.name
    ))?;
    Ok(Exit::Success)
}

/// The model that `reference` means: a file, or a name in the cache. A name that is also a file's is taken as the file.
pub fn given(reference: &str, cache: &CacheLocation) -> Result<Arc<GivenModel>, Refusal> {
    let path = Path::new(reference);
    if is_model_file(reference) || path.is_file() {
        let model = Model::load(path).map_err(Refusal::usage)?;
        return Ok(GivenModel::new(reference.into(), model));
    }
    given_by_name(reference, &existing(cache)?)
}

/// The model of this name, or of the only name that begins so.
pub fn given_by_name(name: &str, store: &Store) -> Result<Arc<GivenModel>, Refusal> {
    let (name, model) = models::load(store, name).map_err(refusal)?;
    Ok(GivenModel::new(name, model))
}

/// The cache, which has to be there: a look must not make one.
fn existing(cache: &CacheLocation) -> Result<Store, Refusal> {
    if !Store::exists(&cache.dir) {
        return Err(Refusal::usage(format!(
            "{}: there is no cache, and so no model; give the folder of a cache with --cache or CHLADNI_CACHE",
            cache.dir.display()
        )));
    }
    cache::open(&cache.dir)
}

/// All but a broken store is the user's to mend.
fn refusal(error: ModelError) -> Refusal {
    match error {
        ModelError::Store(error) => cache::refusal(error),
        error => Refusal::usage(error),
    }
}

fn document(listed: &[Listed]) -> Models<'_> {
    let models = listed.iter().map(|Listed { name, description, k, whole }| Entry {
        name,
        k: *k,
        known: description.known,
        boundary: description.operators.boundary,
        mesh: &description.mesh,
        parameters: &description.parameters,
        chladni: &description.chladni,
        whole: *whole,
    });
    Models { schema: "chladni-models-1", models: models.collect() }
}

const COLUMNS: [(&str, comfy_table::CellAlignment); 6] = [
    ("name", Left),
    ("K", Right),
    ("mesh", Left),
    ("vertices", Right),
    ("boundary", Left),
    ("state", Left),
];

fn text(listed: &[Listed]) -> String {
    let mut table = Table::new();
    table.load_style(NOTHING.header_separator(LineStyle::none().fill('─').junction('─')));
    table.set_header(COLUMNS.map(|(title, _)| title));
    for Listed { name, description, k, whole } in listed {
        let state = if *whole { "whole" } else { "blocks are missing" };
        table.add_row([
            name.clone(),
            k.to_string(),
            format!("{} {:.12}", description.mesh.name, description.mesh.hash.to_string()),
            description.mesh.vertices.to_string(),
            description.operators.boundary.name().to_string(),
            state.to_string(),
        ]);
    }
    for (shown, (_, alignment)) in table.column_iter_mut().zip(COLUMNS) {
        shown.set_cell_alignment(alignment);
        shown.set_padding((0, 2));
    }
    table.trim_fmt()
}
