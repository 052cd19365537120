//! `chladni options`: what can stand in a pipeline file.

use super::exit::Exit;
use super::{Refusal, print, print_json};
use crate::pipeline::reference;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  chladni options                    every option with its default and what it means; this is a pipeline file
  chladni options train.layer        one of them
  chladni options sweep              what a file with variants has besides
  chladni options --schema > chladni.schema.json
                                     a JSON Schema: editors complete and check pipeline files by it; name it in their first line,
                                     #:schema chladni.schema.json")]
pub struct Arguments {
    /// A section, such as train, or an option, such as train.k
    #[arg(value_name = "OPTION", conflicts_with = "schema")]
    name: Option<String>,
    /// Print the JSON Schema of pipeline files instead
    #[arg(long)]
    schema: bool,
}

pub fn execute(arguments: &Arguments) -> Result<Exit, Refusal> {
    match &arguments.name {
        _ if arguments.schema => print_json(&reference::schema())?,
        None => print(&reference::defaults())?,
        Some(name) => print(&reference::about(name).map_err(Refusal::usage)?)?,
    }
    Ok(Exit::Success)
}
