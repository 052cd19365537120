//! Section VI-B's claim that a prediction is faster than finite elements on a mesh that was never seen: from coordinates and triangles
//! to eigenfunctions and eigenvalues, by forward passes, and by assembly and solver, for one pair and for K.

use std::hint::black_box;
use std::time::Instant;

use chladni::ggnn::Block;
use chladni::ggnn::features::{Normalise, coordinates};
use chladni::ggnn::network::Layer;
use chladni::ggnn::predict::{NetworkInput, predict_all};
use chladni::mesh::TriMesh;
use chladni::mesh::sample::Shape;
use chladni::mesh::topology::{Topology, component_labels};
use chladni::operators::{Boundary, MassKind, Operators};
use chladni::spectrum::factor::Analysis;
use chladni::spectrum::{Dense, Problem, TrianglePencil, fem};

use super::untrained::blocks;

const K: usize = 16;
const ROUNDS: usize = 7;
const SIZES: [usize; 5] = [324, 932, 3000, 10_000, 30_000];

/// The first line of the table.
pub const HEADER: &str = "| n | one pair: forward pass, ms | the paper's layer, ms | assembly and FEM, ms | 16 pairs: shared trunk, ms | a trunk each, ms | the paper's layer, ms | assembly and FEM, ms |";

/// Medians over some rounds, by turns.
pub fn table() -> String {
    let one = [Layer::Pointwise, Layer::Sggc].map(|layer| blocks(false, layer, 1));
    let all = [(true, Layer::Pointwise), (false, Layer::Pointwise), (false, Layer::Sggc)]
        .map(|(shared, layer)| blocks(shared, layer, K));
    let mut text = format!("{HEADER}\n|{}\n", "---|".repeat(8));
    for n in SIZES {
        let Ok(mesh) = Shape::Square.sample(n, 3, 0) else { continue };
        let mut times: [Vec<f64>; 7] = Default::default();
        for _ in 0..ROUNDS {
            let predictions = [&one[0], &one[1], &all[0], &all[1], &all[2]]
                .map(|b| timed(|| predicted(&mesh, b)));
            let [a, b, d, e, f] = predictions;
            let (c, g) = (timed(|| solved(&mesh, 1)), timed(|| solved(&mesh, K)));
            times.iter_mut().zip([a, b, c, d, e, f, g]).for_each(|(all, t)| all.push(t));
        }
        let cells = times.map(|mut times| {
            times.sort_by(f64::total_cmp);
            format!("{:.1}", 1e3 * times[ROUNDS / 2])
        });
        text += &format!("| {n} | {} |\n", cells.join(" | "));
    }
    text
}

fn timed<T>(work: impl FnOnce() -> T) -> f64 {
    let started = Instant::now();
    black_box(work());
    started.elapsed().as_secs_f64()
}

/// Eigenfunctions that are 0 on the boundary, orthonormal, with their eigenvalues; no matrix is assembled.
fn predicted(mesh: &TriMesh, blocks: &[Block]) -> Vec<f64> {
    let features = coordinates(mesh, Normalise::Area);
    let pencil = TrianglePencil::of_mesh(mesh, MassKind::Lumped).expect("triangles have angles");
    let blocks: Vec<&Block> = blocks.iter().collect();
    let rim = Topology::of(mesh).boundary_vertices;
    let input = NetworkInput::read_by(&blocks, &features, mesh).with_zeros_at(&rim);
    let phi = predict_all(&Dense::zeros(mesh.n(), 0), &blocks, &input, &pencil);
    pencil.rayleigh_quotients(&phi)
}

fn solved(mesh: &TriMesh, k: usize) -> Vec<f64> {
    let operators = Operators::assemble(mesh, MassKind::Lumped).expect("triangles have angles");
    let problem = Problem::new(&operators, Boundary::Dirichlet, &component_labels(mesh));
    let problem = problem.expect("the square has a boundary");
    let analysis = Analysis::new(problem.pencil()).expect("it can be factorised");
    fem::lowest(&problem, &analysis, k).expect("the solver converges").pairs.values
}
