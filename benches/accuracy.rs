//! How well a model predicts on samplings that it has never seen: the table of `docs/training.md`.
//!
//! `cargo bench --bench accuracy [-- CASE… KEY=VALUE…]`. For every shape a family is made from one mesh and a model is
//! trained on it; the test mesh is another sampling, at least four times as fine. Beside the model stand, from the same
//! run, its untrained trunk with solved heads, and the training mesh's own FEM eigenvectors carried over by closest point.
//! All are held against FEM on the test mesh: the relative error of λ and the principal angle to the eigenspace, median
//! and maximum over k = 2 … K (1 … K under Dirichlet conditions).

use std::collections::HashMap;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::time::Instant;

use chladni::ggnn::Block;
use chladni::ggnn::features::{Normalise, coordinates};
use chladni::ggnn::predict::{NetworkInput, predict_all, predict_next};
use chladni::ggnn::recipe::Ritz;
use chladni::ggnn::sample::{Member, Sample};
use chladni::ggnn::train::{Observer, train_blocks};
use chladni::mesh::closest::ClosestPoint;
use chladni::mesh::sample::icosphere;
use chladni::mesh::subdivide::subdivide;
use chladni::mesh::topology::component_labels;
use chladni::mesh::{TriMesh, load};
use chladni::operators::{Boundary, MassKind, Operators};
use chladni::remesh::perturb::perturb;
use chladni::remesh::{Family, FamilyRecipe, Operation};
use chladni::spectrum::certificate::{References, certify};
use chladni::spectrum::eigenpairs::normalise;
use chladni::spectrum::nullspace::nullspace;
use chladni::spectrum::pencil::column_mut;
use chladni::spectrum::{Dense, Problem, factor::Analysis, fem};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use spade::{DelaunayTriangulation, Point2, Triangulation};

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

struct Silent;

impl Observer for Silent {
    fn step(&self, _: usize, _: usize, _: f64) {}

    fn cancelled(&self) -> bool {
        false
    }
}

/// A shape with the meshes that a model of it is trained on, and one that it is tested on.
struct Case {
    name: &'static str,
    family: Vec<TriMesh>,
    test: TriMesh,
    boundary: Boundary,
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
    more: HashMap<String, String>,
}

impl Options {
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
    let number = |key: &str, default: f64| -> f64 {
        more.get(key).and_then(|v| v.parse().ok()).unwrap_or(default)
    };
    let shared = number("shared", 1.0) != 0.0;
    let mut recipe = Ritz::default();
    recipe.shape.width = number("width", 128.0) as usize;
    recipe.shape.layers = number("layers", 4.0) as usize;
    recipe.ranges.encoder = number("encoder", 4.0);
    recipe.ranges.hidden = number("hidden", 0.005);
    recipe.steps = number("steps", if shared { 300.0 } else { 100.0 }) as usize;
    recipe.batch = number("batch", 2.0) as usize;
    recipe.learning_rate = number("lr", 6e-3);
    recipe.ridge = number("ridge", 1e-10);
    let options = Options {
        recipe,
        k: number("k", 16.0) as usize,
        members: number("members", 16.0) as usize,
        vertices: number("vertices", 500.0) as usize,
        seed: number("seed", 0.0) as u64,
        shared,
        penalty: number("penalty", 10.0),
        more: more.clone(),
    };
    println!(
        "| shape | K | model | train s | λ error %, median / max | angle, median / max | predict s |"
    );
    println!("|---|---|---|---|---|---|---|");
    for name in ["sphere", "spot", "bunny2", "square"] {
        if names.is_empty() || names.iter().any(|n| *n == name) {
            run(&case(name, &options)?, &options)?;
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
        },
        "spot" => {
            let mesh = load(&data("spot_11533.obj"))?.mesh;
            let family = Family::of(&mesh, &recipe)?.members;
            Case { name: "spot", family, test: mesh, boundary: Boundary::Neumann }
        }
        "bunny2" => {
            let mesh = load(&data("bunny2.obj"))?.mesh;
            let operations = match options.get("operations", 0.0) as u32 {
                0 => vec![Operation::Perturb, Operation::Flip],
                1 => vec![Operation::Subdivide, Operation::Perturb],
                _ => vec![Operation::Subdivide, Operation::Perturb, Operation::Flip],
            };
            let recipe = FamilyRecipe { operations, ..recipe };
            let family = Family::of(&mesh, &recipe)?.members;
            let fine = subdivide(&subdivide(&mesh));
            let mut rng = ChaCha8Rng::seed_from_u64(77);
            let test = perturb(&fine, &ClosestPoint::on(&mesh), 0.3, &mut rng);
            Case { name: "bunny2", family, test, boundary: Boundary::Neumann }
        }
        _ => Case {
            name: "square",
            family: (0..options.members as u64).map(|i| square(144, options.seed, i)).collect(),
            test: square(932, 4711, 0),
            boundary: Boundary::Dirichlet,
        },
    })
}

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data").join(name)
}

/// A geodesic sphere, turned at random, its vertices shifted along the surface.
fn ball(levels: u32, seed: u64, member: u64) -> TriMesh {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(member);
    let mesh = icosphere(levels);
    let edge = (4.0 * std::f64::consts::PI / mesh.n() as f64).sqrt();
    let mut axis = [0.0; 3].map(|_: f64| rng.random_range(-1.0..1.0));
    let length = axis.iter().map(|x| x * x).sum::<f64>().sqrt();
    axis.iter_mut().for_each(|x| *x /= length);
    let (sin, cos) = rng.random_range(0.0..std::f64::consts::TAU).sin_cos();
    let vertices = mesh.vertices().iter().map(|&[x, y, z]| {
        let [a, b, c] = axis;
        let along = (1.0 - cos) * (a * x + b * y + c * z);
        let turned = [
            cos * x + sin * (b * z - c * y) + along * a,
            cos * y + sin * (c * x - a * z) + along * b,
            cos * z + sin * (a * y - b * x) + along * c,
        ];
        let moved = turned.map(|v| v + 0.25 * edge * rng.random_range(-1.0..1.0));
        let length = moved.iter().map(|x| x * x).sum::<f64>().sqrt();
        moved.map(|v| v / length)
    });
    TriMesh::new(vertices.collect(), mesh.faces().to_vec()).expect("a sphere is a valid mesh")
}

/// The paper's square [0, π]²: a tenth of the vertices on the boundary, the others at random, Delaunay.
fn square(n: usize, seed: u64, member: u64) -> TriMesh {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(member);
    let side = std::f64::consts::PI;
    let on_boundary = n / 10 / 4 * 4;
    let mut triangulation = DelaunayTriangulation::<Point2<f64>>::new();
    let per_side = on_boundary / 4;
    for i in 0..per_side {
        let t = side * i as f64 / per_side as f64;
        for (x, y) in [(t, 0.0), (side, t), (side - t, side), (0.0, side - t)] {
            triangulation.insert(Point2::new(x, y)).expect("a finite point");
        }
    }
    while triangulation.num_vertices() < n {
        let point = Point2::new(rng.random_range(0.0..side), rng.random_range(0.0..side));
        triangulation.insert(point).expect("a finite point");
    }
    let vertices = triangulation.vertices().map(|v| [v.position().x, v.position().y, 0.0]);
    let faces = triangulation.inner_faces().map(|f| f.vertices().map(|v| v.index() as u32));
    TriMesh::new(vertices.collect(), faces.collect()).expect("a triangulation is a valid mesh")
}

/// A mesh as training and prediction see it.
struct Seen {
    member: Member,
    known: Dense,
}

fn seen(mesh: &TriMesh, boundary: Boundary, penalty: f64) -> Result<Seen, Box<dyn Error>> {
    let mut operators = Operators::assemble(mesh, MassKind::Lumped)?;
    let share: f64 = std::env::var("MASS").ok().and_then(|v| v.parse().ok()).unwrap_or(0.0);
    if share > 0.0 {
        let consistent = Operators::assemble(mesh, MassKind::Consistent)?;
        operators.mass = &operators.mass.map(|x| x * (1.0 - share)) + &consistent.mass.map(|x| x * share);
    }
    let input = NetworkInput::new(&coordinates(mesh, Normalise::Area), &operators.adjacency);
    let member = Member::new(input, operators, boundary, penalty);
    let known = match boundary {
        Boundary::Neumann => nullspace(&component_labels(mesh), &member.mass),
        Boundary::Dirichlet => Dense::zeros(mesh.n(), 0),
    };
    Ok(Seen { member, known })
}

fn run(case: &Case, options: &Options) -> Result<(), Box<dyn Error>> {
    let family: Vec<Seen> = case
        .family
        .iter()
        .map(|mesh| seen(mesh, case.boundary, options.penalty))
        .collect::<Result<_, _>>()?;
    let count = options.k - family[0].known.ncols();
    let train = |recipe: &Ritz| -> Result<Vec<Block>, Box<dyn Error>> {
        let sample = |seen: &Seen, earlier: &Dense| Sample::new(&seen.member, earlier);
        if options.shared {
            let samples = family.iter().map(|s| sample(s, &s.known)).collect();
            return Ok(train_blocks(samples, recipe, count, options.seed, &Silent)?);
        }
        let mut earlier: Vec<Dense> = family.iter().map(|s| s.known.clone()).collect();
        let mut blocks = Vec::new();
        for k in 0..count {
            let samples = family.iter().zip(&earlier).map(|(s, e)| sample(s, e)).collect();
            let seed = options.seed ^ (k as u64 + 1).rotate_left(32);
            let block = train_blocks(samples, recipe, 1, seed, &Silent)?.remove(0);
            family.par_iter().zip(&mut earlier).for_each(|(s, phi)| {
                let next = predict_next(&block, &s.member.input, &s.member.mass, phi);
                let c = phi.ncols();
                *phi = Dense::from_fn(phi.nrows(), c + 1, |i, j| {
                    if j < c { phi[(i, j)] } else { next[i] }
                });
            });
            blocks.push(block);
        }
        Ok(blocks)
    };
    let judge = Judge::new(case, options.k)?;
    let target = seen(&case.test, case.boundary, options.penalty)?;
    let untrained = Ritz { steps: 0, ..options.recipe };
    for (name, recipe) in [("trained", &options.recipe), ("untrained", &untrained)] {
        let started = Instant::now();
        let blocks = train(recipe)?;
        let seconds = started.elapsed().as_secs_f64();
        let started = Instant::now();
        let blocks: Vec<&Block> = blocks.iter().collect();
        let phi =
            predict_all(&target.known, &blocks, &target.member.input, &target.member.mass);
        let predicted = started.elapsed().as_secs_f64();
        judge.row(case, name, seconds, phi, predicted)?;
        if options.get("family", 0.0) != 0.0 && name == "trained" {
            let values: Vec<String> =
                blocks.iter().map(|b| format!("{:.3}", b.record.trained)).collect();
            println!("family quotients: {}", values.join(" "));
        }
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
    let carried = carry(&case.family[0], &case.test, case.boundary, options.k)?;
    judge.row(case, "FEM of a member, carried over", 0.0, carried, started.elapsed().as_secs_f64())?;
    println!("FEM on the test mesh itself: {:.3} s", judge.seconds);
    Ok(())
}

/// FEM eigenvectors of one mesh as functions on another, by closest point.
fn carry(
    from: &TriMesh,
    to: &TriMesh,
    boundary: Boundary,
    k: usize,
) -> Result<Dense, Box<dyn Error>> {
    let operators = Operators::assemble(from, MassKind::Lumped)?;
    let problem = Problem::new(&operators, boundary, &component_labels(from))?;
    let found = fem::lowest(&problem, &Analysis::new(problem.pencil())?, k)?;
    let vectors = problem.extend(found.pairs.vectors);
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
}

impl Judge {
    fn new(case: &Case, k: usize) -> Result<Self, Box<dyn Error>> {
        let operators = Operators::assemble(&case.test, MassKind::Lumped)?;
        let labels = component_labels(&case.test);
        let started = Instant::now();
        let problem = Problem::new(&operators, case.boundary, &labels)?;
        let fem = fem::lowest(&problem, &Analysis::new(problem.pencil())?, k)?;
        let seconds = started.elapsed().as_secs_f64();
        let known = problem.nullspace().ncols();
        Ok(Self { operators, labels, references: References { fem, mpgd: None }, seconds, known })
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
        if std::env::var_os("DETAIL").is_some() {
            for p in pairs {
                println!("    {:.4} {:.4} {:+.3} % {:.4} cluster {}", p.lambda, p.lambda_fem, 100.0 * (p.lambda / p.lambda_fem - 1.0), p.angle_fem, p.cluster);
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
