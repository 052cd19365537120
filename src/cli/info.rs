//! `chladni info MESH`: what ingest sees.

use std::fmt::Write;
use std::path::PathBuf;

use serde::Serialize;

use super::exit::Exit;
use super::{Format, Refusal, print, print_json};
use crate::mesh::{self, Ingested, Repairs};
use crate::operators::{MassKind, Operators};
use crate::publish::result::TriangleQuality;
use crate::publish::table::six_digits;

#[derive(Debug, clap::Args)]
pub struct Arguments {
    /// An OBJ, OFF, PLY, STL, VTK, VTP, glTF or GLB file
    mesh: PathBuf,
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
    non_manifold_edges: usize,
    non_manifold_vertices: usize,
    misoriented_edges: usize,
    quality: Option<TriangleQuality>,
    repairs: &'a Repairs,
}

pub fn execute(arguments: &Arguments) -> Result<Exit, Refusal> {
    let ingested = match mesh::load(&arguments.mesh) {
        Ok(ingested) => ingested,
        Err(error) => {
            eprintln!("error: {error}");
            return Ok(Exit::MeshFailed);
        }
    };
    let info = describe(arguments.mesh.display().to_string(), &ingested);
    match arguments.format {
        Format::Json => print_json(&info)?,
        Format::Human => print(&text(&info))?,
    }
    Ok(Exit::Success)
}

fn describe(path: String, ingested: &Ingested) -> Info<'_> {
    let (mesh, topology) = (&ingested.mesh, &ingested.topology);
    let bound = |pick: fn(f64, f64) -> f64| {
        mesh.vertices().iter().copied().reduce(|a, b| std::array::from_fn(|c| pick(a[c], b[c])))
    };
    Info {
        schema: "chladni-info-1",
        path,
        format: ingested.format,
        hash: mesh.hash().to_string(),
        vertices: topology.vertices,
        edges: topology.edges,
        faces: topology.faces,
        components: topology.components,
        boundary_loops: topology.boundary_loops,
        boundary_vertices: topology.boundary_vertices.len(),
        euler: topology.euler_characteristic,
        area: mesh.area().0,
        bounds: [bound(f64::min), bound(f64::max)].map(Option::unwrap_or_default),
        non_manifold_edges: topology.non_manifold_edges,
        non_manifold_vertices: topology.non_manifold_vertices,
        misoriented_edges: topology.misoriented_edges,
        // A mesh without operators has none; `solve` says why.
        quality: Operators::assemble(mesh, MassKind::Lumped).ok().map(|o| o.quality.into()),
        repairs: &ingested.repairs,
    }
}

fn text(info: &Info<'_>) -> String {
    let mut text = String::new();
    let mut line = |name: &str, value: String| {
        let _ = writeln!(text, "{name:<12} {value}");
    };
    line("mesh", info.path.clone());
    line("hash", info.hash.clone());
    line(
        "counts",
        format!("{} vertices, {} edges, {} faces", info.vertices, info.edges, info.faces),
    );
    line(
        "topology",
        format!(
            "{}, {}, Euler characteristic {}",
            plural(info.components, "component"),
            match info.boundary_loops {
                0 => "closed".to_string(),
                loops => format!(
                    "{} with {}",
                    plural(loops, "boundary loop"),
                    plural(info.boundary_vertices, "vertex").replace("vertexs", "vertices")
                ),
            },
            info.euler
        ),
    );
    line("area", six_digits(info.area));
    let [low, high] = info.bounds;
    let side = |c: usize| format!("[{}, {}]", six_digits(low[c]), six_digits(high[c]));
    line("bounds", format!("{} × {} × {}", side(0), side(1), side(2)));
    line("triangles", info.quality.as_ref().map_or(NO_ANGLES.into(), triangles));
    for (count, what, meaning) in [
        (
            info.non_manifold_edges,
            "non-manifold edge",
            "more than two faces meet there; the Laplacian couples them all",
        ),
        (
            info.non_manifold_vertices,
            "non-manifold vertex",
            "pieces touch in one point; they count as one component",
        ),
        (
            info.misoriented_edges,
            "misoriented edge",
            "neighbouring faces wind in opposite ways; the spectrum does not depend on it",
        ),
    ] {
        if count > 0 {
            let what = plural(count, what).replace("vertexs", "vertices");
            line("defect", format!("{what}: {meaning}"));
        }
    }
    if info.repairs.is_empty() {
        line("repairs", "none needed".into());
    } else {
        for repair in info.repairs.to_string().lines() {
            line("repaired", repair.to_string());
        }
    }
    text
}

const NO_ANGLES: &str = "some are too thin for double precision: solve with --robust";

fn triangles(quality: &TriangleQuality) -> String {
    let angle = format!("smallest angle {:.2}°", quality.min_angle_degrees);
    match quality.negative_weights {
        0 => format!("{angle}, no negative cotangent weight"),
        count => format!(
            "{angle}, {}: `--robust` (operators.robust) mends those inside the surface",
            plural(count, "negative cotangent weight")
        ),
    }
}

fn plural(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}
