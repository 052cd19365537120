//! Our side of `training.py`: training steps and a prediction, as a process of its own.
//!
//! `steps data MEMBERS VERTICES FILE` writes what both sides train on. `steps run LAYER MEMBERS VERTICES WIDTH ITERATIONS THREADS
//! STEPS` prints one JSON object: milliseconds a step (least and median), those of its products at the machine's rate on
//! as many threads, those of a prediction, and the resident memory after a tenth of the steps and after all.

use std::cell::RefCell;
use std::error::Error;
use std::hint::black_box;
use std::sync::Arc;
use std::time::Instant;

use chladni::ggnn::Block;
use chladni::ggnn::block::TrainingRecord;
use chladni::ggnn::features::{Normalise, coordinates};
use chladni::ggnn::forward::Forward;
use chladni::ggnn::network::{Layer, Trunk, TrunkShape};
use chladni::ggnn::ops::real::Real;
use chladni::ggnn::predict::NetworkInput;
use chladni::ggnn::recipe::Ritz;
use chladni::ggnn::sample::Member;
use chladni::ggnn::train::{Observer, train_blocks};
use chladni::mesh::sample::icosphere;
use chladni::operators::{MassKind, Operators, Sparse};

use faer::Accum;

use families::{sample, spot};

#[path = "../families/mod.rs"]
mod families;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

type Outcome = Result<(), Box<dyn Error>>;

/// The mesh of the prediction has 10,242 vertices.
const LEVELS: u32 = 5;

fn main() -> Outcome {
    // `cargo bench` adds --bench.
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    match arguments[..] {
        ["data", members, vertices, file] => data(members.parse()?, vertices.parse()?, file),
        ["run", layer, members, vertices, width, iterations, threads, steps] => {
            let layer = if layer == "pointwise" { Layer::Pointwise } else { Layer::Sggc };
            let (width, iterations) = (width.parse()?, iterations.parse()?);
            let shape = TrunkShape { width, iterations, layer, ..Ritz::default().shape };
            run(shape, members.parse()?, vertices.parse()?, threads.parse()?, steps.parse()?)
        }
        _ => {
            println!("usage: steps data … | steps run …; see training.py");
            Ok(())
        }
    }
}

/// When each step ended, and how much memory there was.
#[derive(Default)]
struct Stopwatch(RefCell<Vec<(Instant, u64)>>);

impl Observer for Stopwatch {
    fn step(&self, step: usize, steps: usize, _: f64) {
        let memory = if step == steps || step == steps / 10 { resident_kib() } else { 0 };
        self.0.borrow_mut().push((Instant::now(), memory));
    }

    fn cancelled(&self) -> bool {
        false
    }
}

fn run(
    shape: TrunkShape,
    members: usize,
    vertices: usize,
    threads: usize,
    steps: usize,
) -> Outcome {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build_global()?;
    let family = spot(members, vertices)?;
    let recipe = Ritz { shape, batch: members, shards: threads, steps, ..Ritz::default() };
    let watch = Stopwatch::default();
    train_blocks(family.iter().map(sample).collect(), &recipe, 1, 0, &watch)?;
    let ends = watch.0.into_inner();
    let mut took: Vec<f64> =
        ends.windows(2).map(|w| 1e3 * (w[1].0 - w[0].0).as_secs_f64()).collect();
    took.sort_by(f64::total_cmp);
    let memory: Vec<u64> = ends.iter().map(|end| end.1).filter(|&kib| kib > 0).collect();
    let n: usize = family.iter().map(|member| member.input.n()).sum();
    println!(
        "{}",
        serde_json::json!({
            "least": took[0],
            "median": took[took.len() / 2],
            "products": 1e3 * products_seconds(shape, n, n / members, threads),
            "prediction": 1e3 * prediction_seconds(shape),
            "resident_kib": memory,
        })
    );
    Ok(())
}

/// Seconds for the layers' products of a step over n vertices, forward and backward, each thread on meshes of `rows`.
fn products_seconds(shape: TrunkShape, n: usize, rows: usize, threads: usize) -> f64 {
    const REPEATS: usize = 20;
    let TrunkShape { width: h, layers, iterations, .. } = shape;
    let k = if shape.layer.has_neighbours() { 2 * h } else { h };
    let once = || {
        let (x, joined) = (vec![0.1_f32; rows * h], vec![0.1_f32; rows * k]);
        let (mut next, mut d_joined, mut d_matrix) = (x.clone(), joined.clone(), vec![0.0; h * k]);
        let packed =
            [f32::pack_transposed(&vec![0.1; h * k], h, k), f32::pack(&vec![0.1; h * k], h, k)];
        for _ in 0..REPEATS {
            f32::multiply(&mut next, &joined, rows, &packed[0]);
            f32::multiply(&mut d_joined, &x, rows, &packed[1]);
            f32::transposed_product(&mut d_matrix, &x, &joined, rows, Accum::Add);
        }
        black_box((next, d_joined, d_matrix));
    };
    let turn = |_| {
        let started = Instant::now();
        std::thread::scope(|scope| (0..threads).for_each(|_| drop(scope.spawn(once))));
        started.elapsed().as_secs_f64()
    };
    let best = (0..20).map(turn).fold(f64::INFINITY, f64::min);
    let passes = (layers * iterations * n) as f64 / rows as f64;
    passes * best / (REPEATS * threads) as f64
}

fn prediction_seconds(shape: TrunkShape) -> f64 {
    let mesh = icosphere(LEVELS);
    let weights = Arc::new(Trunk::init(shape, Ritz::default().ranges, 0).weights());
    let record = TrainingRecord::default();
    let block = |k: usize| Block {
        shape,
        weights: weights.clone(),
        head: (0..shape.width).map(|j| ((j * k) as f64).sin()).collect(),
        record: record.clone(),
    };
    let blocks: Vec<Block> = (0..16).map(block).collect();
    let blocks: Vec<&Block> = blocks.iter().collect();
    let input = NetworkInput::read_by(&blocks, &coordinates(&mesh, Normalise::Area), &mesh);
    let turn = |_| {
        let started = Instant::now();
        black_box(Forward::of(&blocks).map(|passes| passes.run(&input)));
        started.elapsed().as_secs_f64()
    };
    (0..20).map(turn).fold(f64::INFINITY, f64::min)
}

fn data(members: usize, vertices: usize, file: &str) -> Outcome {
    let entries = |m: &Sparse| -> Vec<(usize, usize, f64)> {
        m.iter().map(|(&value, (i, j))| (i, j, value)).collect()
    };
    let sphere = icosphere(LEVELS);
    let operators = Operators::assemble(&sphere, MassKind::Lumped)?;
    let of = |member: &Member| {
        serde_json::json!({
            "features": member.input.features,
            "neighbours": (0..member.input.n()).map(|i| member.input.graph.neighbours(i).to_vec()).collect::<Vec<_>>(),
            "stiffness": entries(&member.stiffness),
            "mass": entries(&member.mass),
        })
    };
    let members: Vec<serde_json::Value> = spot(members, vertices)?.iter().map(of).collect();
    let prediction = Member {
        input: NetworkInput::new(&coordinates(&sphere, Normalise::Area), &operators.adjacency),
        stiffness: operators.stiffness,
        mass: operators.mass,
    };
    let document = serde_json::json!({ "members": members, "prediction": of(&prediction) });
    Ok(std::fs::write(file, document.to_string())?)
}

/// The memory that this process holds, where the system tells.
fn resident_kib() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmRSS:"));
    line.and_then(|line| line.split_whitespace().nth(1)?.parse().ok()).unwrap_or(1)
}
