//! Where recipe `paper` goes, epoch by epoch: the tables of `docs/training.md`, "Recipe paper".
//!
//! `cargo bench --bench paper_recipe [-- square|sphere… KEY=VALUE…]`. With `landscape=1`, what the loss's
//! terms are worth at functions that are known: the constant, and analytic eigenfunctions at the vertices. Then trainings: the Rayleigh quotient over the
//! epochs, the terms at the end, and what is predicted on a finer mesh, against FEM there. λ is in input units (on the
//! square 2, 5, 5, 8, on the sphere 0, 2, 2, 2, 6), the terms are those of unit area.

use std::cell::RefCell;
use std::collections::HashMap;
use std::error::Error;
use std::time::Instant;

use chladni::ggnn::features::{Normalise, coordinates};
use chladni::ggnn::network::Interval;
use chladni::ggnn::paper::loss::Terms;
use chladni::ggnn::paper::{Paper, ResidualRows, Sample, train_block};
use chladni::ggnn::predict::{NetworkInput, predict_next};
use chladni::ggnn::sample::Member;
use chladni::ggnn::train::Observer;
use chladni::mesh::TriMesh;
use chladni::mesh::sample::icosphere;
use chladni::mesh::topology::component_labels;
use chladni::operators::{Boundary, MassKind, Operators};
use chladni::spectrum::eigenpairs::normalise;
use chladni::spectrum::pencil::{apply, column, dot, quadratic};
use chladni::spectrum::{Dense, Eigenpairs, Problem, factor::Analysis, fem};
use dfdx::prelude::{Cpu, TensorFromVec};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use shapes::{SIDE, ball, square};

mod shapes;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// The epochs whose quotients are printed.
const EPOCHS: [usize; 12] = [1, 3, 5, 10, 20, 30, 50, 75, 100, 150, 200, 250];

/// A mesh with its operators in units of its own area.
struct Seen {
    member: Member,
    area: f64,
    /// The constant on a closed surface, nothing otherwise.
    known: Dense,
}

type Settings = HashMap<String, String>;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let settings: Settings = arguments
        .iter()
        .filter_map(|a| a.split_once('='))
        .map(|(key, value)| (key.to_string(), value.to_string()))
        .collect();
    for name in ["square", "sphere"] {
        if arguments.iter().all(|a| a.contains('=')) || arguments.iter().any(|a| a == name) {
            run(name, &settings)?;
        }
    }
    Ok(())
}

fn number(settings: &Settings, key: &str, default: f64) -> f64 {
    settings.get(key).and_then(|value| value.parse().ok()).unwrap_or(default)
}

fn list(settings: &Settings, key: &str, default: &[usize]) -> Vec<usize> {
    let parse = |value: &String| value.split(':').filter_map(|v| v.parse().ok()).collect();
    settings.get(key).map_or(default.to_vec(), parse)
}

/// The recipe with the command line's values.
fn recipe(settings: &Settings) -> Paper {
    let mut recipe = Paper::default();
    let set = |place: &mut f64, key: &str| *place = number(settings, key, *place);
    set(&mut recipe.weights.boundary, "boundary");
    set(&mut recipe.weights.residual, "residual");
    set(&mut recipe.weights.orthogonality, "orthogonality");
    set(&mut recipe.warmup.start, "start");
    set(&mut recipe.learning_rate, "rate");
    set(&mut recipe.decay, "decay");
    set(&mut recipe.ranges.encoder, "encoder");
    set(&mut recipe.ranges.hidden, "hidden");
    let set = |place: &mut usize, key: &str| *place = number(settings, key, *place as f64) as usize;
    set(&mut recipe.warmup.epochs, "warmup");
    set(&mut recipe.epochs, "epochs");
    set(&mut recipe.batch, "batch");
    recipe.milestones = list(settings, "milestones", &recipe.milestones);
    if settings.get("weights").is_some_and(|v| v == "symmetric") {
        recipe.ranges.interval = Interval::Symmetric;
    }
    if settings.get("rows").is_some_and(|v| v == "all") {
        recipe.rows = ResidualRows::All;
    }
    recipe
}

fn run(name: &str, settings: &Settings) -> Result<(), Box<dyn Error>> {
    let recipe = recipe(settings);
    let members = number(settings, "members", 200.0) as u64;
    let (boundary, test) = match name {
        "square" => (Boundary::Dirichlet, square(932, 0, 4711, randomly)),
        _ => (Boundary::Neumann, icosphere(3)),
    };
    let mesh = |member| match name {
        "square" => square(144, 0, member, randomly),
        _ => ball(2, 0, member),
    };
    let family: Vec<Seen> =
        (0..members).map(|m| seen(&mesh(m), boundary)).collect::<Result<_, _>>()?;
    let reference = reference(&test, boundary)?;
    let test = seen(&test, boundary)?;
    println!("# {name}, {members} members: {settings:?}");
    if settings.contains_key("landscape") {
        landscape(&family, recipe.rows);
    }
    let blocks = number(settings, "blocks", 1.0) as usize;
    if recipe.epochs > 0 {
        for seed in list(settings, "seeds", &[0]) {
            train(&family, (&test, &reference), &recipe, blocks, seed as u64)?;
        }
    }
    Ok(())
}

/// The mean terms at the constant and at analytic eigenfunctions.
fn landscape(family: &[Seen], rows: ResidualRows) {
    println!(
        "| function | λ | boundary | residual, mean | median | largest |\n|---|---|---|---|---|---|"
    );
    let row = |label: &str, function: &dyn Fn(&Seen) -> Vec<f64>| {
        let terms: Vec<Terms> = family.iter().map(|s| terms_at(s, function(s), rows)).collect();
        let count = terms.len() as f64;
        let mean = terms.iter().fold(Terms::default(), |a, &b| a.plus(b)).times(1.0 / count);
        let mut residuals: Vec<f64> = terms.iter().map(|t| t.residual).collect();
        residuals.sort_by(f64::total_cmp);
        println!(
            "| {label} | {:.3} | {:.3} | {:.4} | {:.4} | {:.4} |",
            mean.quotient / family[0].area,
            mean.boundary,
            mean.residual,
            residuals[residuals.len() / 2],
            residuals[residuals.len() - 1],
        );
    };
    row("constant", &|s| vec![1.0; s.member.input.n()]);
    let on_square = family[0].known.ncols() == 0;
    for (i, j) in [(1, 1), (1, 2), (2, 2), (3, 3)] {
        let wave = |s: &Seen| {
            let points = s.member.input.features.chunks_exact(3);
            let value = |p: &[f32]| match on_square {
                true => (f64::from(p[0]) * i as f64).sin() * (f64::from(p[1]) * j as f64).sin(),
                false if i == j => f64::from(p[i - 1]),
                false => f64::from(p[0] * p[1]),
            };
            points.map(value).collect()
        };
        row(&format!("analytic {i}, {j}"), &wave);
    }
}

fn terms_at(seen: &Seen, function: Vec<f64>, rows: ResidualRows) -> Terms {
    let n = function.len();
    let sample = Sample::new(&seen.member, &Dense::zeros(n, 0));
    let z = Cpu::default().tensor_from_vec(function, (n,));
    sample.loss(z, Paper::default().weights, rows).1
}

fn train(
    family: &[Seen],
    (test, reference): (&Seen, &Eigenpairs),
    recipe: &Paper,
    blocks: usize,
    seed: u64,
) -> Result<(), Box<dyn Error>> {
    let mut earlier: Vec<Dense> = family.iter().map(|s| s.known.clone()).collect();
    let mut predicted = test.known.clone();
    for k in 0..blocks {
        let samples: Vec<Sample> = family
            .iter()
            .zip(&earlier)
            .map(|(s, earlier)| Sample::new(&s.member, earlier))
            .collect();
        let log = Log::default();
        let started = Instant::now();
        let seed = seed ^ (k as u64).rotate_left(32);
        let block = match train_block(&samples, recipe, seed, &log) {
            Ok(block) => block,
            Err(error) => {
                println!("seed {seed}: {error}");
                return Ok(());
            }
        };
        let seconds = started.elapsed().as_secs_f64();
        let log = log.0.into_inner();
        let area = family[0].area;
        let history: Vec<String> = EPOCHS
            .iter()
            .filter_map(|&e| {
                log.get(e - 1).map(|t| {
                    let Terms { boundary, residual, quotient, .. } = t;
                    format!("{e}: {:.3} ({boundary:.1e}, {residual:.1e})", quotient / area)
                })
            })
            .collect();
        let last = log.last().copied().unwrap_or_default();
        println!(
            "seed {seed} φ{}: {seconds:.0} s; λ {}; at the end bc {:.2e}, residual {:.2e}, ortho {:.2e}",
            k + 1 + test.known.ncols(),
            history.join(", "),
            last.boundary,
            last.residual,
            last.orthogonality,
        );
        let next = predict_next(&block, &test.member.input, &test.member.mass, &predicted);
        println!("    on {} vertices: {}", test.member.input.n(), judged(test, reference, &next));
        predicted = joined(&predicted, &next);
        family.par_iter().zip(&mut earlier).for_each(|(s, phi)| {
            let next = predict_next(&block, &s.member.input, &s.member.mass, phi);
            *phi = joined(phi, &next);
        });
    }
    Ok(())
}

/// λ of a prediction, 0 where it is held, and its share in FEM's eigenspaces.
fn judged(test: &Seen, reference: &Eigenpairs, prediction: &[f64]) -> String {
    let mut u = prediction.to_vec();
    test.member.input.fixed.iter().for_each(|&i| u[i as usize] = 0.0);
    normalise(&mut u, &test.member.mass);
    let lambda = quadratic(&test.member.stiffness, &u) / test.area;
    let mut bu = vec![0.0; u.len()];
    apply(&test.member.mass, &u, &mut bu);
    let mass = &test.member.mass;
    let mut shares: Vec<(f64, f64)> = Vec::new();
    for (k, &value) in reference.values.iter().enumerate() {
        let mut phi = column(&reference.vectors, k).to_vec();
        normalise(&mut phi, mass);
        let share = dot(&phi, &bu).powi(2);
        match shares.last_mut() {
            Some((first, sum)) if value - *first < 0.03 * value => *sum += share,
            _ => shares.push((value, share)),
        }
    }
    let (value, share) =
        shares.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or_default();
    format!(
        "λ {lambda:.4}, nearest FEM λ {value:.4} at an angle of {:.4}",
        (1.0 - share).max(0.0).sqrt().asin()
    )
}

fn joined(phi: &Dense, next: &[f64]) -> Dense {
    let c = phi.ncols();
    Dense::from_fn(phi.nrows(), c + 1, |i, j| if j < c { phi[(i, j)] } else { next[i] })
}

/// Keeps the terms of every epoch.
#[derive(Default)]
struct Log(RefCell<Vec<Terms>>);

impl Observer for Log {
    fn step(&self, _: usize, _: usize, _: f64) {}

    fn terms(&self, _: usize, terms: &Terms) {
        self.0.borrow_mut().push(*terms);
    }

    fn cancelled(&self) -> bool {
        false
    }
}

/// FEM's eigenpairs, 0 where they are held.
fn reference(mesh: &TriMesh, boundary: Boundary) -> Result<Eigenpairs, Box<dyn Error>> {
    let operators = Operators::assemble(mesh, MassKind::Lumped)?;
    let labels = component_labels(mesh);
    let problem = Problem::new(&operators, boundary, &labels)?;
    let mut pairs = fem::lowest(&problem, &Analysis::new(problem.pencil())?, 8)?.pairs;
    pairs.vectors = problem.extend(pairs.vectors);
    Ok(pairs)
}

fn seen(mesh: &TriMesh, boundary: Boundary) -> Result<Seen, Box<dyn Error>> {
    let operators = Operators::assemble(mesh, MassKind::Lumped)?;
    let area = operators.total_mass();
    let input = NetworkInput::new(&coordinates(mesh, Normalise::None), &operators.adjacency);
    let member = Member::whole(input, operators, boundary);
    let known = match boundary {
        Boundary::Neumann => Dense::from_fn(mesh.n(), 1, |_, _| 1.0),
        Boundary::Dirichlet => Dense::zeros(mesh.n(), 0),
    };
    Ok(Seen { member, area, known })
}

/// The corner, and the other vertices of a side at random.
fn randomly(i: usize, _: usize, rng: &mut ChaCha8Rng) -> f64 {
    if i == 0 { 0.0 } else { rng.random_range(0.0..SIDE) }
}
