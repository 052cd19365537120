//! `chladni generate`: samplings of surfaces that have a formula, as mesh files.

use std::path::{Path, PathBuf};

use super::exit::Exit;
use super::{Refusal, print};
use crate::mesh::TriMesh;
use crate::mesh::sample::Shape;
use crate::publish::mesh_file;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  chladni generate square --vertices 144 --count 200 --out squares/train.ply
  chladni generate sphere --vertices 1502 --seed 7 --out sphere.obj")]
pub struct Arguments {
    /// square: [0, π]², a tenth of its vertices on the boundary, all at random; sphere: of radius 1; torus: of radii 1 and 0.4; vase: a surface of revolution, open at foot and mouth
    #[arg(value_parser = shape, value_name = "square|sphere|torus|vase")]
    shape: Shape,
    /// How many vertices
    #[arg(long, value_name = "N", default_value = "500")]
    vertices: usize,
    /// Another number makes other samplings
    #[arg(long, value_name = "N", default_value = "0")]
    seed: u64,
    /// How many samplings; the files of several have numbers
    #[arg(long, value_name = "N", default_value = "1", value_parser = clap::value_parser!(u64).range(1..))]
    count: u64,
    /// The file, as PLY or OBJ by its ending
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

fn shape(name: &str) -> Result<Shape, String> {
    Shape::ALL
        .into_iter()
        .find(|shape| shape.name() == name)
        .ok_or_else(|| format!("there are {}", Shape::ALL.map(Shape::name).join(", ")))
}

pub fn execute(arguments: &Arguments) -> Result<Exit, Refusal> {
    let Arguments { shape, vertices, seed, count, out } = arguments;
    for member in 0..*count {
        let mesh = shape.sample(*vertices, *seed, member).map_err(Refusal::usage)?;
        let file = mesh_file::numbered(out, member, *count);
        write(&file, &mesh)?;
        print(&format!(
            "{}: {}, {} vertices, {} faces",
            file.display(),
            shape.name(),
            mesh.n(),
            mesh.faces().len()
        ))?;
    }
    Ok(Exit::Success)
}

fn write(file: &Path, mesh: &TriMesh) -> Result<(), Refusal> {
    mesh_file::write(file, mesh)
        .map_err(|error| Refusal::usage(format!("{}: {error}", file.display())))
}
