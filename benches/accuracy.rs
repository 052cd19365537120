//! How well a model predicts on samplings that it has never seen: the table of `docs/training.md`.
//!
//! `cargo bench --bench accuracy [-- CASE… KEY=VALUE…]`. For every shape a family is made from one mesh and a model is
//! trained on it; the test mesh is another sampling, at least four times as fine. Beside the model stand, from the same
//! run, its untrained trunk with solved heads, the training mesh's own FEM eigenvectors carried over by closest point, and
//! FEM on the subdivided test mesh: what a prediction would be worth that knew the surface's own eigenfunctions.
//! All are held against FEM on the test mesh: the relative error of λ and the principal angle to the eigenspace, median
//! and maximum over k = 2 … K (1 … K under Dirichlet conditions).

use std::collections::HashMap;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;

use chladni::ggnn::Block;
use chladni::ggnn::features::{FeatureOptions, Features};
use chladni::ggnn::heads::solve_heads;
use chladni::ggnn::network::Layer;
use chladni::ggnn::predict::{NetworkInput, append_next, predict_all};
use chladni::ggnn::recipe::Ritz;
use chladni::ggnn::sample::{Member, Sample};
use chladni::ggnn::train::{Silent, train_blocks};
use chladni::mesh::closest::ClosestPoint;
use chladni::mesh::sample::icosphere;
use chladni::mesh::subdivide::subdivide;
use chladni::mesh::topology::component_labels;
use chladni::mesh::{TriMesh, load};
use chladni::operators::{Boundary, MassKind, OperatorOptions, Operators};
use chladni::remesh::perturb::perturb;
use chladni::remesh::{Family, FamilyRecipe, Operation, refined};
use chladni::spectrum::certificate::{References, certify};
use chladni::spectrum::eigenpairs::normalise;
use chladni::spectrum::nullspace::nullspace;
use chladni::spectrum::pencil::column_mut;
use chladni::spectrum::refine::lowest_from;
use chladni::spectrum::{Dense, Problem, factor::Analysis, fem};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use shapes::{SIDE, ball, square};

mod shapes;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// A shape with the meshes that a model of it is trained on, and one that it is tested on.
struct Case {
    name: &'static str,
    family: Vec<TriMesh>,
    test: TriMesh,
    boundary: Boundary,
    /// Where all of them lie.
    shape: TriMesh,
}

/// What may be changed from the command line.
struct Options {
    recipe: Ritz,
    k: usize,
    members: usize,
    vertices: usize,
    seed: u64,
    shared: bool,
    penalty: f64,
    /// How often members are subdivided, on the surface, before training …
    subdivided: usize,
    /// … and once more before the last solve of the heads.
    finer: usize,
    more: HashMap<String, String>,
}

/// What `docs/training.md` arrives at for a shape.
struct Usual {
    members: f64,
    batch: f64,
    steps: f64,
    rate: f64,
    encoder: f64,
    width: f64,
    subdivided: f64,
    finer: f64,
}

impl Usual {
    fn of(case: &str) -> Self {
        let [members, batch, steps, rate, encoder, width, subdivided, finer] = match case {
            "sphere" => [100.0, 10.0, 100.0, 1e-3, 3.0, 128.0, 0.0, 0.0],
            "spot" => [10.0, 1.0, 1000.0, 6e-3, 6.0, 192.0, 1.0, 3.0],
            "bunny2" => [10.0, 1.0, 600.0, 6e-3, 6.0, 128.0, 0.0, 2.0],
            _ => [200.0, 4.0, 300.0, 3e-3, 5.0, 128.0, 1.0, 1.0],
        };
        Self { members, batch, steps, rate, encoder, width, subdivided, finer }
    }
}

impl Options {
    /// What `docs/training.md` arrives at, unless the command line says otherwise.
    fn of(case: &str, more: &HashMap<String, String>) -> Self {
        let number = |key: &str, default: f64| -> f64 {
            more.get(key).and_then(|v| v.parse().ok()).unwrap_or(default)
        };
        let usual = Usual::of(case);
        let mut recipe = Ritz::default();
        recipe.shape.layer = match more.get("layer").map(String::as_str) {
            Some("sggc") => Layer::Sggc,
            _ => Layer::Pointwise,
        };
        recipe.shape.width = number("width", usual.width) as usize;
        recipe.shape.layers = number("layers", 4.0) as usize;
        recipe.ranges.encoder = number("encoder", usual.encoder);
        recipe.ranges.hidden = number("hidden", 0.005);
        recipe.steps = number("steps", usual.steps) as usize;
        recipe.batch = number("batch", usual.batch) as usize;
        recipe.learning_rate = number("lr", usual.rate);
        recipe.ridge = number("ridge", 1e-10);
        recipe.spare = number("spare", 4.0) as usize;
        Self {
            recipe,
            k: number("k", 16.0) as usize,
            members: number("members", usual.members) as usize,
            vertices: number("vertices", 500.0) as usize,
            seed: number("seed", 0.0) as u64,
            shared: number("shared", 1.0) != 0.0,
            penalty: number("penalty", 1000.0),
            finer: number("finer", usual.finer) as usize,
            subdivided: number("subdivided", usual.subdivided) as usize,
            more: more.clone(),
        }
    }

    fn get(&self, key: &str, default: f64) -> f64 {
        self.more.get(key).and_then(|v| v.parse().ok()).unwrap_or(default)
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let (settings, names): (Vec<_>, Vec<_>) = arguments.iter().partition(|a| a.contains('='));
    let more: HashMap<String, String> = settings
        .iter()
        .filter_map(|s| s.split_once('='))
        .map(|(k, v)| (k.to_string(), v.to_string()))
        .collect();
    println!(
        "| shape | K | model | train s | λ error %, median / max | angle, median / max | predict s |"
    );
    println!("|---|---|---|---|---|---|---|");
    for name in ["sphere", "spot", "bunny2", "square"] {
        if names.is_empty() || names.iter().any(|n| *n == name) {
            let options = Options::of(name, &more);
            let case = case(name, &options)?;
            let ks: &[usize] =
                if name == "spot" && !more.contains_key("k") { &[4, 8, 16] } else { &[options.k] };
            for &k in ks {
                run(&case, &Options { k, ..Options::of(name, &more) })?;
            }
        }
    }
    Ok(())
}

fn case(name: &str, options: &Options) -> Result<Case, Box<dyn Error>> {
    let recipe = FamilyRecipe {
        members: options.members,
        vertices: options.vertices.into(),
        seed: options.seed,
        ..FamilyRecipe::default()
    };
    Ok(match name {
        "sphere" => Case {
            name: "unit sphere",
            family: (0..options.members as u64).map(|i| ball(2, options.seed, i)).collect(),
            test: icosphere(4),
            boundary: Boundary::Neumann,
            shape: icosphere(2),
        },
        "spot" => {
            let mesh = load(&data("spot_11533.obj"))?.mesh;
            let family = Family::of(&mesh, &recipe)?.members;
            Case {
                name: "spot",
                family,
                shape: mesh.clone(),
                test: mesh,
                boundary: Boundary::Neumann,
            }
        }
        "bunny2" => {
            let mesh = load(&data("bunny2.obj"))?.mesh;
            let operations = match options.get("operations", 1.0) as u32 {
                0 => vec![Operation::Perturb, Operation::Flip],
                1 => vec![Operation::Subdivide, Operation::Perturb],
                _ => vec![Operation::Subdivide, Operation::Perturb, Operation::Flip],
            };
            let recipe = FamilyRecipe { operations, ..recipe };
            let family = Family::of(&mesh, &recipe)?.members;
            let fine = subdivide(&subdivide(&mesh));
            let mut rng = ChaCha8Rng::seed_from_u64(77);
            let test = perturb(&fine, &ClosestPoint::on(&mesh), 0.3, &mut rng);
            Case { name: "bunny2", family, test, boundary: Boundary::Neumann, shape: mesh }
        }
        _ => Case {
            name: "square",
            family: (0..options.members as u64)
                .map(|i| square(144, options.seed, i, evenly))
                .collect(),
            test: square(932, options.get("test", 4711.0) as u64, 0, evenly),
            boundary: Boundary::Dirichlet,
            shape: square(144, 1, 0, evenly),
        },
    })
}

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data").join(name)
}

/// The vertices of a side at equal distances.
fn evenly(i: usize, per_side: usize, _: &mut ChaCha8Rng) -> f64 {
    SIDE * i as f64 / per_side as f64
}

/// A mesh as training and prediction see it.
struct Seen {
    member: Member,
    known: Dense,
}

fn seen(
    mesh: &TriMesh,
    features: &Features,
    boundary: Boundary,
    penalty: f64,
    robust: bool,
) -> Result<Seen, Box<dyn Error>> {
    let operators = Operators::assemble(
        mesh,
        OperatorOptions { robust: robust.into(), ..MassKind::Lumped.into() },
    )?;
    let input = NetworkInput::new(&features.read(mesh), &operators.adjacency);
    let member = Member::new(input, operators, boundary, penalty);
    let known = match boundary {
        Boundary::Neumann => nullspace(&component_labels(mesh), &member.mass),
        Boundary::Dirichlet => Dense::zeros(mesh.n(), 0),
    };
    Ok(Seen { member, known })
}

fn run(case: &Case, options: &Options) -> Result<(), Box<dyn Error>> {
    let surface = ClosestPoint::on(&case.shape);
    let finer = |mesh: &TriMesh, times: usize| refined(mesh, &surface, times);
    let coarse: Vec<TriMesh> =
        case.family.par_iter().map(|mesh| finer(mesh, options.subdivided)).collect();
    let features = Features::of(&case.shape, FeatureOptions::default());
    // Members alone: what is judged are functions on the test mesh as it is.
    let robust = options.get("robust", 0.0) != 0.0;
    let family: Vec<Seen> = coarse
        .iter()
        .map(|mesh| seen(mesh, &features, case.boundary, options.penalty, robust))
        .collect::<Result<_, _>>()?;
    let count = options.k - family[0].known.ncols();
    let finer: Vec<Seen> = coarse
        .par_iter()
        .filter(|_| options.finer > 0)
        .map(|mesh| {
            let mesh = finer(mesh, options.finer);
            seen(&mesh, &features, case.boundary, options.penalty, robust)
                .map_err(|error| error.to_string())
        })
        .collect::<Result<_, _>>()?;
    let train = |recipe: &Ritz| -> Result<Vec<Block>, Box<dyn Error>> {
        let sample = |(seen, earlier): (&Seen, &Dense)| Sample::new(&seen.member, earlier);
        let samples = |of: &[Seen], earlier: &[Dense]| of.iter().zip(earlier).map(sample).collect();
        let known = |of: &[Seen]| of.iter().map(|s| s.known.clone()).collect::<Vec<_>>();
        let settle = |blocks: Vec<Block>, earlier: &[Dense]| {
            if finer.is_empty() {
                return Ok(blocks);
            }
            let samples: Vec<Sample> = samples(&finer, earlier);
            solve_heads(&blocks, &samples, recipe.ridge).ok_or("heads")
        };
        let mut earlier = [known(&family), known(&finer)];
        if options.shared {
            let blocks =
                train_blocks(samples(&family, &earlier[0]), recipe, count, options.seed, &Silent)?;
            return Ok(settle(blocks, &earlier[1])?);
        }
        let mut blocks = Vec::new();
        for k in 0..count {
            let seed = options.seed ^ (k as u64 + 1).rotate_left(32);
            let block = train_blocks(samples(&family, &earlier[0]), recipe, 1, seed, &Silent)?;
            let block = settle(block, &earlier[1])?.remove(0);
            for (family, earlier) in [&family, &finer].into_iter().zip(&mut earlier) {
                family.par_iter().zip(earlier).for_each(|(s, phi)| {
                    append_next(&block, &s.member.input, &s.member.mass, phi);
                });
            }
            blocks.push(block);
        }
        Ok(blocks)
    };
    let judge = Judge::new(case, options.k, options.get("detail", 0.0) != 0.0)?;
    let target = seen(&case.test, &features, case.boundary, options.penalty, false)?;
    let untrained = Ritz { steps: 0, ..options.recipe };
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let noise = Dense::from_fn(case.test.n(), options.k, |_, _| rng.random_range(-1.0..1.0));
    let mut refinements = vec![("random functions", noise)];
    for (name, recipe) in [("trained", &options.recipe), ("untrained", &untrained)] {
        let started = Instant::now();
        let blocks = train(recipe)?;
        let seconds = started.elapsed().as_secs_f64();
        let started = Instant::now();
        let blocks: Vec<&Block> = blocks.iter().collect();
        let phi = predict_all(&target.known, &blocks, &target.member.input, &target.member.mass);
        let predicted = started.elapsed().as_secs_f64();
        if name == "trained" {
            refinements.push(("the predictions", phi.clone()));
        }
        judge.row(case, name, seconds, phi, predicted)?;
    }
    if case.name == "square" {
        let mut modes: Vec<(usize, usize)> =
            (1..9).flat_map(|i| (1..9).map(move |j| (i, j))).collect();
        modes.sort_by_key(|&(i, j)| (i * i + j * j, i));
        let exact = Dense::from_fn(case.test.n(), options.k, |v, m| {
            let [x, y, _] = case.test.vertices()[v];
            (modes[m].0 as f64 * x).sin() * (modes[m].1 as f64 * y).sin()
        });
        judge.row(case, "sin sin", 0.0, exact, 0.0)?;
    }
    let started = Instant::now();
    let floor = fem_on_subdivided(&case.test, case.boundary, options.k)?;
    judge.row(
        case,
        "FEM on the test mesh subdivided",
        0.0,
        floor,
        started.elapsed().as_secs_f64(),
    )?;
    let started = Instant::now();
    let carried = carry(&coarse[0], &case.test, case.boundary, options.k)?;
    judge.row(
        case,
        "FEM of a member, carried over",
        0.0,
        carried,
        started.elapsed().as_secs_f64(),
    )?;
    println!("FEM on the test mesh itself, to 1e-10 and counted: {:.3} s", judge.seconds);
    for (start, functions) in &refinements {
        let (seconds, blocks) = judge.refined(case, functions)?;
        println!("refined to 1e-8 from {start}: {seconds:.3} s, {blocks} blocks of eight solves");
    }
    Ok(())
}

/// FEM on the test mesh with every triangle cut in four, at the vertices of the test mesh.
fn fem_on_subdivided(
    mesh: &TriMesh,
    boundary: Boundary,
    k: usize,
) -> Result<Dense, Box<dyn Error>> {
    // The old vertices are the first.
    Ok(fem_on(&subdivide(mesh), boundary, k)?.submatrix(0, 0, mesh.n(), k).to_owned())
}

/// The lowest FEM eigenvectors of a mesh.
fn fem_on(mesh: &TriMesh, boundary: Boundary, k: usize) -> Result<Dense, Box<dyn Error>> {
    let operators = Operators::assemble(mesh, MassKind::Lumped)?;
    let problem = Problem::new(&operators, boundary, &component_labels(mesh))?;
    let found = fem::lowest(&problem, &Analysis::new(problem.pencil())?, k)?;
    Ok(problem.extend(found.pairs.vectors))
}

/// FEM eigenvectors of one mesh as functions on another, by closest point.
fn carry(
    from: &TriMesh,
    to: &TriMesh,
    boundary: Boundary,
    k: usize,
) -> Result<Dense, Box<dyn Error>> {
    let vectors = fem_on(from, boundary, k)?;
    let closest = ClosestPoint::on(from);
    let points: Vec<_> = to.vertices().par_iter().map(|&p| closest.to(p)).collect();
    Ok(Dense::from_fn(to.n(), k, |i, j| {
        points[i].interpolate(from, chladni::spectrum::pencil::column(&vectors, j))
    }))
}

/// FEM on the test mesh.
struct Judge {
    operators: Operators,
    labels: Vec<u32>,
    references: References,
    seconds: f64,
    known: usize,
    /// Every pair too, and not only median and maximum.
    detail: bool,
}

impl Judge {
    fn new(case: &Case, k: usize, detail: bool) -> Result<Self, Box<dyn Error>> {
        let operators = Operators::assemble(&case.test, MassKind::Lumped)?;
        let labels = component_labels(&case.test);
        let problem = Problem::new(&operators, case.boundary, &labels)?;
        let mut seconds = f64::INFINITY;
        let mut solve = || {
            let started = Instant::now();
            let found = fem::lowest(&problem, &Analysis::new(problem.pencil())?, k);
            seconds = seconds.min(started.elapsed().as_secs_f64());
            found
        };
        let mut fem = solve()?;
        for _ in 1..5 {
            fem = solve()?;
        }
        let known = problem.nullspace().ncols();
        Ok(Self {
            operators,
            labels,
            references: References { fem, mpgd: None },
            seconds,
            known,
            detail,
        })
    }

    /// The least seconds of five refinements of these functions, factorisation included, and the blocks that each takes.
    fn refined(&self, case: &Case, functions: &Dense) -> Result<(f64, usize), Box<dyn Error>> {
        let problem = Problem::new(&self.operators, case.boundary, &self.labels)?;
        let functions = problem.restrict(functions);
        let start = functions.get(.., self.known..).to_owned();
        let (mut least, mut blocks) = (f64::INFINITY, 0);
        for _ in 0..5 {
            let started = Instant::now();
            blocks = lowest_from(&problem, &Analysis::new(problem.pencil())?, &start)?.blocks;
            least = least.min(started.elapsed().as_secs_f64());
        }
        Ok((least, blocks))
    }

    fn row(
        &self,
        case: &Case,
        model: &str,
        train: f64,
        phi: Dense,
        predict: f64,
    ) -> Result<(), Box<dyn Error>> {
        let problem = Problem::new(&self.operators, case.boundary, &self.labels)?;
        let mut phi = problem.restrict(&phi);
        for j in 0..phi.ncols() {
            normalise(column_mut(&mut phi, j), problem.pencil().mass);
        }
        let certificate =
            certify(&problem, &Analysis::new(problem.pencil())?, &phi, &self.references)?;
        let pairs = &certificate.pairs[self.known..];
        let errors = pairs.iter().map(|p| 100.0 * (p.lambda / p.lambda_fem - 1.0).abs());
        let angles = pairs.iter().map(|p| p.angle_fem);
        let (e, a) = (spread(errors.collect()), spread(angles.collect()));
        println!(
            "| {} | {} | {model} | {train:.1} | {:.3} / {:.3} | {:.4} / {:.4} | {predict:.3} |",
            case.name,
            certificate.pairs.len(),
            e[0],
            e[1],
            a[0],
            a[1],
        );
        if self.detail {
            for p in pairs {
                println!(
                    "    {:.4} {:.4} {:+.3} % {:.4} cluster {}",
                    p.lambda,
                    p.lambda_fem,
                    100.0 * (p.lambda / p.lambda_fem - 1.0),
                    p.angle_fem,
                    p.cluster
                );
            }
        }
        Ok(())
    }
}

/// Median and maximum.
fn spread(mut values: Vec<f64>) -> [f64; 2] {
    values.sort_by(f64::total_cmp);
    [values[values.len() / 2], values[values.len() - 1]]
}
