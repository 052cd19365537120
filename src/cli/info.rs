//! `chladni info MESH`: what ingest sees, what is wrong with it, and what becomes of that.
//!
//! - `findings`: everything that is not as it should be, with what ingest does about it and the option that changes that
//! - `text`: the page for people, at most 80 columns wide

mod findings;
mod text;

use serde::Serialize;

use self::findings::{Finding, findings};
use super::exit::Exit;
use super::single::OneMesh;
use super::{Format, Refusal, logging, print, print_json};
use crate::mesh::error::listed;
use crate::mesh::shape::Shape;
use crate::mesh::topology::{Piece, pieces};
use crate::mesh::{self, Ingested, Opened, Repairs};
use crate::operators::{MassKind, Operators};
use crate::publish::result::TriangleQuality;

#[derive(Debug, clap::Args)]
#[command(after_help = super::exit::help("\
  chladni info scans/a.obj
  chladni info scans/parts.glb --object wheel
  chladni info scans/a.obj --format json | jq '.findings[] | .what, .count, .option'"))]
pub struct Arguments {
    #[command(flatten)]
    mesh: OneMesh,
    /// How the result is shown
    #[arg(long, value_enum, default_value = "human")]
    format: Format,
}

/// The document of `info --format json`.
#[derive(Debug, Serialize)]
struct Info<'a> {
    schema: &'static str,
    path: String,
    format: mesh::Format,
    /// What it is made of, by name, where it is all of a file.
    objects: Vec<String>,
    hash: String,
    vertices: usize,
    edges: usize,
    faces: usize,
    components: usize,
    boundary_loops: usize,
    boundary_vertices: usize,
    euler: i64,
    area: f64,
    bounds: [[f64; 3]; 2],
    /// What the input unit may be, by the size of the bounding box.
    units: &'static str,
    non_manifold_edges: usize,
    non_manifold_vertices: usize,
    misoriented_edges: usize,
    quality: Option<TriangleQuality>,
    shape: Shape,
    pieces: Vec<Piece>,
    findings: Vec<Finding>,
    repairs: &'a Repairs,
}

pub fn execute(arguments: &Arguments) -> Result<Exit, Refusal> {
    let (ingested, objects) = match arguments.mesh.read() {
        Ok(read) => read,
        Err(error) if error.is_no_object() => return Err(Refusal::usage(error)),
        Err(error) => {
            let objects = Opened::read(&arguments.mesh.file).map(|opened| opened.objects());
            match objects.ok().filter(|objects| objects.len() > 1) {
                Some(objects) => logging::error(&format!(
                    "{error}\n--object NAME looks at one of {}",
                    listed(&objects)
                )),
                None => logging::error(&error),
            }
            return Ok(Exit::MeshFailed);
        }
    };
    let info = describe(arguments.mesh.title(), objects, &ingested);
    match arguments.format {
        Format::Json => print_json(&info)?,
        Format::Human => print(&text::page(&info))?,
    }
    Ok(Exit::Success)
}

fn describe(path: String, objects: Vec<String>, ingested: &Ingested) -> Info<'_> {
    let (mesh, topology) = (&ingested.mesh, &ingested.topology);
    let bound = |pick: fn(f64, f64) -> f64| {
        mesh.vertices().iter().copied().reduce(|a, b| std::array::from_fn(|c| pick(a[c], b[c])))
    };
    let bounds = [bound(f64::min), bound(f64::max)].map(Option::unwrap_or_default);
    let area = mesh.area().0;
    // A mesh without operators has none; `solve` says why.
    let quality = Operators::assemble(mesh, MassKind::Lumped).ok().map(|o| o.quality.into());
    let pieces = pieces(mesh);
    Info {
        schema: "chladni-info-1",
        path,
        format: ingested.format,
        objects,
        hash: mesh.hash().to_string(),
        vertices: topology.vertices,
        edges: topology.edges,
        faces: topology.faces,
        components: topology.components,
        boundary_loops: topology.boundary_loops,
        boundary_vertices: topology.boundary_vertices.len(),
        euler: topology.euler_characteristic,
        area,
        bounds,
        units: units(bounds, area),
        non_manifold_edges: topology.non_manifold_edges,
        non_manifold_vertices: topology.non_manifold_vertices,
        misoriented_edges: topology.misoriented_edges,
        findings: findings(ingested, &pieces, quality.as_ref()),
        quality,
        shape: Shape::of(mesh),
        pieces,
        repairs: &ingested.repairs,
    }
}

/// What the input unit may be. Things that people scan and model are between a few centimetres and a few metres long.
fn units([low, high]: [[f64; 3]; 2], area: f64) -> &'static str {
    let longest = (0..3).map(|c| high[c] - low[c]).fold(0.0, f64::max);
    let close_to = |value: f64, to: f64| (value / to - 1.0).abs() < 1e-3;
    if close_to(area, 1.0) {
        "none: scaled to unit area"
    } else if close_to(longest, 1.0) || close_to(longest, 2.0) {
        "none: scaled to a box whose longest side is 1 or 2"
    } else if (0.02..20.0).contains(&longest) {
        "metres, if this is something at hand"
    } else if (20.0..20_000.0).contains(&longest) {
        "millimetres, if this is something at hand"
    } else {
        "not known: neither metres nor millimetres make this something at hand"
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_guessed_by_the_size_of_what_is_at_hand() {
        let cube = |side: f64| units([[0.0; 3], [side; 3]], 6.0 * side * side);
        assert!(cube(1.0).contains("side is 1 or 2") && cube(1.7).starts_with("metres"));
        assert!(cube(180.0).starts_with("millimetres"));
        assert!(cube((1.0_f64 / 6.0).sqrt()).contains("unit area"));
        assert!(cube(1e6).starts_with("not known") && cube(1e-6).starts_with("not known"));
    }
}
