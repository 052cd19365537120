//! Our side of `eigsh.py`: the eigensolver on one mesh as a process of its own, so that its peak memory can be told.
//!
//! `solver matrices MESH FOLDER` writes L and B for the other side; `solver solve MESH K` prints one JSON object. MESH is a
//! file, or `sphere:LEVELS`. Time is that of the solver with its count by inertia; reading and assembly are not in it, on
//! either side.

use std::fs::File;
use std::io::BufWriter;
use std::path::Path;
use std::time::Instant;

use chladni::mesh::topology::component_labels;
use chladni::mesh::{TriMesh, load, sample::icosphere};
use chladni::operators::{Boundary, MassKind, Operators};
use chladni::spectrum::{Problem, factor::Analysis, fem};
use npyz::WriterBuilder;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

type Outcome = Result<(), Box<dyn std::error::Error>>;

fn main() -> Outcome {
    // `cargo bench` adds --bench.
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments[..] {
        ["matrices", mesh, folder] => matrices(&self::mesh(mesh)?, folder.as_ref()),
        ["solve", mesh, k] => solve(&self::mesh(mesh)?, k.parse()?),
        // Run by `cargo bench` without arguments: nothing to compare with.
        _ => {
            println!("usage: solver matrices MESH FOLDER | solver solve MESH K; see eigsh.py");
            Ok(())
        }
    }
}

fn mesh(name: &str) -> Result<TriMesh, Box<dyn std::error::Error>> {
    match name.strip_prefix("sphere:") {
        Some(levels) => Ok(icosphere(levels.parse()?)),
        None => Ok(load(name.as_ref())?.mesh),
    }
}

fn matrices(mesh: &TriMesh, folder: &Path) -> Outcome {
    let operators = Operators::assemble(mesh, MassKind::Lumped)?;
    for (name, matrix) in [("L", &operators.stiffness), ("B", &operators.mass)] {
        let index = |values: &[usize]| values.iter().map(|&i| i as i32).collect::<Vec<_>>();
        let pointers = matrix.proper_indptr().into_owned();
        array(folder, name, "indptr", &index(&pointers))?;
        array(folder, name, "indices", &index(matrix.indices()))?;
        array(folder, name, "data", matrix.data())?;
    }
    Ok(())
}

fn array<T: npyz::AutoSerialize + Copy>(
    folder: &Path,
    matrix: &str,
    part: &str,
    values: &[T],
) -> Outcome {
    let file = BufWriter::new(File::create(folder.join(format!("{matrix}_{part}.npy")))?);
    let mut writer = npyz::WriteOptions::new()
        .default_dtype()
        .shape(&[values.len() as u64])
        .writer(file)
        .begin_nd()?;
    writer.extend(values.iter().copied())?;
    Ok(writer.finish()?)
}

fn solve(mesh: &TriMesh, k: usize) -> Outcome {
    let operators = Operators::assemble(mesh, MassKind::Lumped)?;
    let problem = Problem::new(&operators, Boundary::Neumann, &component_labels(mesh))?;
    let started = Instant::now();
    let analysis = Analysis::new(problem.pencil())?;
    let found = fem::lowest(&problem, &analysis, k)?;
    let seconds = started.elapsed().as_secs_f64();
    println!(
        "{}",
        serde_json::json!({
            "n": mesh.n(),
            "seconds": seconds,
            "eigenvalues": &found.pairs.values[..k],
            "complete": found.count == Some(found.pairs.len()),
            "peak_kib": peak_kib(),
        })
    );
    Ok(())
}

/// The most memory that this process has held, where the system tells.
fn peak_kib() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse().ok()
}
