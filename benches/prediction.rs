//! How long does a prediction take, from coordinates and triangles to orthonormal eigenfunctions with their eigenvalues? Stage by
//! stage, beside what its products alone would take at the machine's rate, and beside our own solver on the same mesh.
//!
//! `cargo bench --bench prediction [-- FILE…]`. K = 16, width 128, four layers; weights are drawn, not trained, and heads are
//! arbitrary: the time does not depend on them. Rounds go by turns, and minima are shown: other work on the machine only adds.

use std::hint::black_box;
use std::time::Instant;

use chladni::ggnn::Block;
use chladni::ggnn::features::{Normalise, coordinates};
use chladni::ggnn::network::{Layer, TrunkShape};
use chladni::ggnn::ops::product::{Layout, Panels};
use chladni::ggnn::predict::{NetworkInput, predict_all};
use chladni::mesh::topology::component_labels;
use chladni::mesh::{TriMesh, load, sample::icosphere, subdivide::subdivide};
use chladni::operators::{Boundary, MassKind, Operators};
use chladni::spectrum::nullspace::free_nullspace;
use chladni::spectrum::{Problem, TrianglePencil, factor::Analysis, fem};
use faer::Accum;

use untrained::blocks;

mod untrained;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

const K: usize = 16;
const ROUNDS: usize = 9;

fn main() {
    // `cargo bench` adds --bench.
    let files: Vec<String> = std::env::args().skip(1).filter(|a| !a.starts_with("--")).collect();
    let root = env!("CARGO_MANIFEST_DIR");
    let meshes = if files.is_empty() {
        let path = std::path::Path::new(root).join("tests/data/meshes/bunny2.obj");
        let bunny = load(&path).expect("bunny2 can be read").mesh;
        let bunny = (0..3).fold(bunny, |mesh, _| subdivide(&mesh));
        vec![("bunny2, three times subdivided".into(), bunny), ("sphere".into(), icosphere(6))]
    } else {
        let read = |file: String| {
            let mesh = load(file.as_ref()).expect("the file can be read").mesh;
            (file, mesh)
        };
        files.into_iter().map(read).collect()
    };
    println!("{} threads, K = {K}", rayon::current_num_threads());
    for (name, mesh) in &meshes {
        compare(name, mesh);
    }
}

/// Seconds of every stage of a prediction, and of all.
type Stages = [f64; 6];

const NAMES: [&str; 6] = ["features", "triangles", "λ = 0", "adjacency", "functions", "λ"];

fn compare(name: &str, mesh: &TriMesh) {
    println!("\n{name}: {} vertices", mesh.n());
    let trunks = [
        ("shared", Layer::Pointwise),
        ("shared", Layer::Sggc),
        ("one each", Layer::Pointwise),
        ("one each", Layer::Sggc),
    ];
    let blocks: Vec<Vec<Block>> =
        trunks.iter().map(|&(trunk, layer)| blocks(trunk == "shared", layer, K - 1)).collect();
    let (mut best, mut solve) = ([[f64::INFINITY; NAMES.len()]; 4], f64::INFINITY);
    let (mut total, mut rate) = ([f64::INFINITY; 4], 0.0_f64);
    for _ in 0..ROUNDS {
        solve = solve.min(fem_seconds(mesh));
        for (i, blocks) in blocks.iter().enumerate() {
            let stages = predict(mesh, blocks);
            total[i] = total[i].min(stages.iter().sum());
            best[i].iter_mut().zip(stages).for_each(|(best, s)| *best = best.min(s));
            rate = rate.max(gemm_rate());
        }
    }
    println!(
        "our solver with its count: {:.0} ms; products run at {:.0} GFLOP/s",
        1e3 * solve,
        rate / 1e9
    );
    println!(
        "| trunks | layer | {} | all, ms | products, ms | all / products | solver / all |",
        NAMES.join(" | ")
    );
    println!("|---|---|{}---|---|---|---|", "---|".repeat(NAMES.len()));
    for (i, &(trunk, layer)) in trunks.iter().enumerate() {
        let floor = flops(mesh.n(), &blocks[i]) / rate;
        let stages: Vec<String> = best[i].iter().map(|s| format!("{:.1}", 1e3 * s)).collect();
        println!(
            "| {trunk} | {layer:?} | {} | {:.1} | {:.1} | {:.2} | {:.1} |",
            stages.join(" | "),
            1e3 * total[i],
            1e3 * floor,
            total[i] / floor,
            solve / total[i]
        );
    }
}

fn predict(mesh: &TriMesh, blocks: &[Block]) -> Stages {
    let mut clock = Instant::now();
    let mut lap = || std::mem::replace(&mut clock, Instant::now()).elapsed().as_secs_f64();
    let features = coordinates(mesh, Normalise::Area);
    let features_took = lap();
    let pencil = TrianglePencil::of_mesh(mesh, MassKind::Lumped).expect("triangles have angles");
    let triangles_took = lap();
    let zeros = free_nullspace(&component_labels(mesh), &[], &pencil);
    let zeros_took = lap();
    let blocks: Vec<&Block> = blocks.iter().collect();
    let input = NetworkInput::read_by(&blocks, &features, mesh);
    let adjacency_took = lap();
    let phi = predict_all(&zeros, &blocks, &input, &pencil);
    let functions_took = lap();
    black_box(pencil.rayleigh_quotients(&phi));
    [features_took, triangles_took, zeros_took, adjacency_took, functions_took, lap()]
}

fn fem_seconds(mesh: &TriMesh) -> f64 {
    let started = Instant::now();
    let operators = Operators::assemble(mesh, MassKind::Lumped).expect("triangles have angles");
    let problem = Problem::new(&operators, Boundary::Neumann, &component_labels(mesh));
    let problem = problem.expect("the mesh has eigenpairs");
    let analysis = Analysis::new(problem.pencil()).expect("it can be factorised");
    black_box(fem::lowest(&problem, &analysis, K).expect("the solver converges"));
    started.elapsed().as_secs_f64()
}

/// The products of the layers alone.
fn flops(n: usize, blocks: &[Block]) -> f64 {
    let trunks = blocks.chunk_by(|a, b| a.shares_trunk(b)).count();
    let TrunkShape { width, layers, layer, .. } = blocks[0].shape;
    let matrices = if layer.has_neighbours() { 2 } else { 1 };
    (trunks * layers * matrices * 2 * n * width * width) as f64
}

/// Floating-point operations a second of all threads together, on the products of a chunk of rows that stays in the cache.
fn gemm_rate() -> f64 {
    const H: usize = 128;
    const M: usize = 96;
    const REPEATS: usize = 200;
    let matrix = vec![0.1_f32; H * H];
    let panels = Panels::of(Layout::Rows(&matrix, H), H, H);
    let started = Instant::now();
    rayon::broadcast(|_| {
        let (a, mut c) = (vec![0.1_f32; M * H], vec![0.0; M * H]);
        for _ in 0..REPEATS {
            panels.multiply(&mut c, H, Layout::Rows(&a, H), M, Accum::Replace);
        }
        black_box(c);
    });
    let all = rayon::current_num_threads() * REPEATS * 2 * M * H * H;
    all as f64 / started.elapsed().as_secs_f64()
}
