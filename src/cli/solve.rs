//! `chladni solve MESH -k K`: the spectrum of one mesh by a solver, with its certificate.

use std::num::NonZeroUsize;
use std::time::Instant;

use clap::ValueEnum;
use serde::Serialize;

use super::exit::Exit;
use super::paint::painted;
use super::single::{OneMesh, Written};
use super::{Format, Refusal, logging, print, print_json};
use crate::operators::{Boundary, Laplacian, MassKind, OperatorOptions, Robust};
use crate::pipeline::{Method, Pipeline};
use crate::publish::report::{MeshReport, Status};
use crate::publish::result::{
    Completeness, Eigenpair, MeshSummary, RepairCounts, Spectrum, TriangleQuality, Verdict,
};
use crate::publish::table::mesh_table;
use crate::spectrum::SpectrumError;
use crate::stages::context::Context;
use crate::stages::intake::Job;
use crate::stages::verify::Verified;
use crate::stages::{Failure, assemble, candidates, ingest, publish, verify};

#[derive(Debug, clap::Args)]
#[command(after_help = super::exit::help("\
  chladni solve scans/a.obj -k 50 --out spectra
  chladni solve scene.glb --object wheel --out spectra --formats vtu,csv --descriptors hks
  chladni solve disc.ply -k 20 --boundary dirichlet --laplacian fem --format json"))]
pub struct Arguments {
    #[command(flatten)]
    mesh: OneMesh,
    /// How many eigenpairs
    #[arg(short, value_name = "K", default_value = "10", value_parser = super::at_least_one)]
    k: NonZeroUsize,
    /// Which solver
    #[arg(long, value_enum, default_value = "fem")]
    method: Solver,
    /// Which Laplacian
    #[arg(long, value_enum, default_value = "cotangent")]
    laplacian: LaplacianName,
    /// Which mass matrix; the Laplacian's own unless given
    #[arg(long, value_enum)]
    mass: Option<MassName>,
    /// What holds on the boundary of the surface
    #[arg(long, value_enum, default_value = "neumann")]
    boundary: BoundaryName,
    /// Assemble on the intrinsic Delaunay triangulation, for meshes with slivers; `tufted`: on that of the tufted cover,
    /// for meshes that are not manifold, too
    #[arg(
        long,
        value_enum,
        num_args = 0..=1,
        require_equals = true,
        default_value = "off",
        default_missing_value = "intrinsic",
        hide_default_value = true
    )]
    robust: RobustName,
    #[command(flatten)]
    written: Written,
    /// How the result is shown
    #[arg(long, value_enum, default_value = "human")]
    format: Format,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Solver {
    /// Shift-invert block Lanczos, complete by a count
    Fem,
    /// The paper's Algorithm 1, held against the other
    Mpgd,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum LaplacianName {
    /// Cotangent weights with the consistent mass, (12)
    Fem,
    /// Cotangent weights with the lumped mass, (7)
    Cotangent,
    /// Edges without lengths, (5)
    Graph,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum MassName {
    /// A third of the area of the triangles at a vertex
    Lumped,
    /// The area nearest to a vertex
    Voronoi,
    /// Linear elements
    Consistent,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum RobustName {
    /// The triangles of the mesh
    Off,
    /// The intrinsic Delaunay triangulation of the mesh
    Intrinsic,
    /// That of its tufted cover
    Tufted,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum BoundaryName {
    /// The normal derivative vanishes
    Neumann,
    /// The function vanishes
    Dirichlet,
}

/// The document of `solve --format json`.
#[derive(Debug, Serialize)]
struct Solution<'a> {
    schema: &'static str,
    path: &'a str,
    status: Verdict,
    reason: Option<&'a str>,
    mesh: &'a MeshSummary,
    eigenvalues: Vec<f64>,
    certificate: Checks<'a>,
    quality: Option<TriangleQuality>,
    repairs: &'a RepairCounts,
    out: Option<&'a str>,
    seconds: f64,
}

#[derive(Debug, Serialize)]
struct Checks<'a> {
    orthonormality: f64,
    completeness: Option<&'a Completeness>,
    eigenpairs: &'a [Eigenpair],
}

pub fn execute(arguments: &Arguments) -> Result<Exit, Refusal> {
    let started = Instant::now();
    let job = arguments.mesh.job();
    arguments.written.check(&job)?;
    let context = context(arguments)?;
    let verified = match solve(&context, job) {
        Ok(verified) => verified,
        Err(failure) => {
            if asks_too_much(&failure) {
                return Err(Refusal::usage(failure));
            }
            logging::error(&failure);
            return Ok(if failure.is_internal() { Exit::Internal } else { Exit::MeshFailed });
        }
    };
    let spectrum = publish::spectrum(&context, &verified);
    let path = arguments.mesh.title();
    let mut report = if arguments.written.is_asked_for() {
        publish::publish(&context, 0, verified).map_err(Refusal::usage)?
    } else {
        publish::unwritten(&spectrum, verified)
    };
    report.path.clone_from(&path);
    report.seconds = started.elapsed().as_secs_f64();
    match arguments.format {
        Format::Json => print_json(&document(&path, &spectrum, &report))?,
        Format::Human => print(&painted(&mesh_table(&report)))?,
    }
    Ok(match report.status {
        Status::Verified => Exit::Success,
        Status::Unverified => Exit::Unverified,
        Status::Failed => Exit::MeshFailed,
    })
}

/// A run of one mesh without a cache.
fn context(arguments: &Arguments) -> Result<Context, Refusal> {
    let mut pipeline = Pipeline::default();
    pipeline.train.k = arguments.k.get().into();
    pipeline.train.method = match arguments.method {
        Solver::Fem => Method::Fem,
        Solver::Mpgd => Method::Mpgd,
    };
    pipeline.operators = OperatorOptions {
        laplacian: match arguments.laplacian {
            LaplacianName::Fem => Laplacian::Fem,
            LaplacianName::Cotangent => Laplacian::Cotangent,
            LaplacianName::Graph => Laplacian::Graph,
        },
        mass: arguments.mass.map(|mass| match mass {
            MassName::Lumped => MassKind::Lumped,
            MassName::Voronoi => MassKind::Voronoi,
            MassName::Consistent => MassKind::Consistent,
        }),
        robust: match arguments.robust {
            RobustName::Off => Robust::Off,
            RobustName::Intrinsic => Robust::Intrinsic,
            RobustName::Tufted => Robust::Tufted,
        },
        boundary: match arguments.boundary {
            BoundaryName::Neumann => Boundary::Neumann,
            BoundaryName::Dirichlet => Boundary::Dirichlet,
        },
    };
    pipeline.publish = arguments.written.options();
    pipeline.check().map_err(Refusal::usage)?;
    Ok(Context::alone(pipeline, None, arguments.written.folder()))
}

fn solve(context: &Context, job: Job) -> Result<Verified, Failure> {
    let loaded = ingest::ingest(context, job)?;
    let assembled = assemble::assemble(context, 0, loaded)?;
    let candidates = candidates::solve(context, 0, assembled)?;
    verify::verify(context, 0, candidates)
}

/// Whether other arguments would have helped: the mesh is not to blame.
fn asks_too_much(failure: &Failure) -> bool {
    use SpectrumError::{NoBoundary, NoInterior, TooMany};
    let asks = matches!(
        failure,
        Failure::TooSmall { .. }
            | Failure::Spectrum(NoBoundary | NoInterior { .. } | TooMany { .. })
    );
    asks || failure.is_no_object()
}

fn document<'a>(path: &'a str, spectrum: &'a Spectrum, report: &'a MeshReport) -> Solution<'a> {
    Solution {
        schema: "chladni-solve-1",
        path,
        status: spectrum.status,
        reason: report.reason.as_deref(),
        mesh: &spectrum.mesh,
        eigenvalues: spectrum.eigenpairs.iter().map(|pair| pair.lambda).collect(),
        certificate: Checks {
            orthonormality: spectrum.orthonormality,
            completeness: spectrum.completeness.as_ref(),
            eigenpairs: &spectrum.eigenpairs,
        },
        quality: spectrum.quality,
        repairs: &spectrum.repairs,
        out: report.out.as_deref(),
        seconds: report.seconds,
    }
}
