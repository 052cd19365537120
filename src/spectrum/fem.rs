//! The reference: the lowest eigenpairs of Lφ = λBφ by shift-invert block Lanczos, complete by Sylvester's law.
//!
//! 1. The eigenfunctions of λ = 0 are known, and put aside.
//! 2. A Krylov space of (L + μB)⁻¹B is grown until the wanted pairs have converged, and more of them until the gap above
//!    the cluster of λ_K is among them.
//! 3. The eigenvalues below that gap are counted by the inertia there. If some were missed, which takes a multiplicity
//!    of more than a block, the search goes on orthogonally to what was found.
//!
//! The shift lies below the spectrum. One in its midst needs a Krylov space smaller by a sixth, but the unpivoted
//! factorisation of the indefinite L − σB costs two digits of every residual, and mending that costs more than a sixth.
//!
//! A few hundred vertices, or a good part of the whole spectrum, are solved as the dense pencil that the answer nearly
//! is.

use super::cluster::{cluster_end, zero_below};
use super::factor::Analysis;
use super::inertia::count_below;
use super::lanczos::{Krylov, Ritz};
use super::panel::{Panel, WIDTH};
use super::pencil::{column, columns_mut};
use super::rayleigh_ritz::ritz_pairs;
use super::{Dense, Eigenpairs, Pencil, Problem, SpectrumError};

/// A residual is small enough when it is below so many roundings of the largest eigenvalue, in the B⁻¹ norm …
pub(super) const ROUNDINGS: f64 = 50.0;

/// … or below this, relative to the eigenvalue.
const TOLERANCE: f64 = 1e-10;

/// The shift μ in units of 1/area: far from zero and below the first eigenvalues (Weyl: λ_k·area ≈ 4πk).
const SHIFT: f64 = 1.0;

/// Up to so many rows the pencil is solved densely.
const DENSE: usize = 400;

/// Up to so many it may be, when the Krylov space would be the whole space: three matrices of 130 MB.
const LARGEST_DENSE: usize = 4000;

/// The eigenvalue above the gap is only needed to see the gap: so exactly, relative to itself.
const GLANCE: f64 = 1e-3;

/// When k pairs are wanted of a Krylov space of dimension m, a block more divides their residuals by about (m/k) to this
/// power: measured on spheres, tori, squares and animals for k = 10 … 100, from residuals of 10⁵ times the goal on.
const RATE: f64 = 1.2;

/// For k pairs that no cluster prolongs a Krylov space of dimension 3k and this many is enough, or nearly so: measured as
/// before. A look costs as much as a step or two.
const FIRST_LOOK: usize = 92;

/// From a good start, this many.
const FIRST_LOOK_NEAR: usize = 52;

/// Searches for eigenvalues that an earlier one missed.
const ATTEMPTS: u64 = 16;

/// The eigenpairs below a gap of the spectrum, and what Sylvester's law says of their number.
#[derive(Debug, Clone)]
pub struct Reference {
    /// At least the K pairs that were asked for, to the end of the cluster of λ_K, in canonical form (see
    /// [`Eigenpairs::canonical`]).
    pub pairs: Eigenpairs,
    /// A shift in the gap above them.
    pub sigma: f64,
    /// The number of eigenvalues below σ; `None` when rounding could have changed it.
    pub count: Option<usize>,
}

/// Computes the lowest `k` eigenpairs, to the end of the cluster of λ_k.
///
/// The result depends on the problem and `k` alone, not on the number of threads.
///
/// # Errors
/// [`SpectrumError::TooMany`] when `k` exceeds n, [`SpectrumError::Breakdown`] when L + μB is not numerically positive
/// definite, [`SpectrumError::NotConverged`], [`SpectrumError::OutOfMemory`].
pub fn lowest(
    problem: &Problem<'_>,
    analysis: &Analysis<'_>,
    k: usize,
) -> Result<Reference, SpectrumError> {
    solved(problem, analysis, k, None)
}

/// The same from functions that are nearly eigenfunctions, n×m on the free vertices: those of λ = 0 and more of the lowest.
/// Which pairs are found, and how exactly, does not depend on them; how long it takes does.
///
/// # Errors
/// As [`lowest`].
pub fn lowest_near(
    problem: &Problem<'_>,
    analysis: &Analysis<'_>,
    k: usize,
    near: &Dense,
) -> Result<Reference, SpectrumError> {
    solved(problem, analysis, k, Some(near))
}

fn solved(
    problem: &Problem<'_>,
    analysis: &Analysis<'_>,
    k: usize,
    near: Option<&Dense>,
) -> Result<Reference, SpectrumError> {
    let pencil = problem.pencil();
    let (n, area) = (pencil.n(), pencil.area());
    if k > n {
        return Err(SpectrumError::TooMany { asked: k, n });
    }
    if n <= DENSE || (n <= 4 * k && n <= LARGEST_DENSE) {
        return from_all(problem, analysis, k);
    }
    let vectors = problem.nullspace().clone();
    let known = vectors.ncols();
    let start = near.filter(|near| near.ncols() > known);
    let start =
        start.map(|near| Panel::sums(&near.subcols(known, near.ncols() - known).to_owned()));
    let search = Search { start, ..Search::new(pencil, k) };
    let zeros = Eigenpairs { values: vec![0.0; vectors.ncols()], vectors };
    let (mut pairs, next) = match search.extend(analysis, zeros, Goal::First, 0) {
        // A long cluster above λ_k can fill the Krylov space of a small problem.
        Err(SpectrumError::NotConverged { .. }) if n <= LARGEST_DENSE => {
            return from_all(problem, analysis, k);
        }
        outcome => outcome?,
    };
    let sigma = between(pairs.values[pairs.len() - 1], next);
    let count = count_below(analysis, sigma)?;
    for attempt in 1..=ATTEMPTS {
        // The start panel had no part in some eigenvectors, or not in all copies.
        if count.is_none_or(|count| count <= pairs.len()) {
            break;
        }
        (pairs, _) = search.extend(analysis, pairs, Goal::Below(sigma), attempt)?;
    }
    Ok(Reference { pairs: pairs.canonical(zero_below(area)), sigma, count })
}

/// The lowest `k` of all eigenpairs.
fn from_all(
    problem: &Problem<'_>,
    analysis: &Analysis<'_>,
    k: usize,
) -> Result<Reference, SpectrumError> {
    let area = problem.pencil().area();
    let all = dense(problem);
    let end = cluster_end(&all.values, k, area);
    let sigma = above(&all.values, end, area);
    let count = count_below(analysis, sigma)?;
    Ok(Reference { pairs: all.truncated(end), sigma, count })
}

/// A shift between two eigenvalues. Nearer to the upper one: a value that is not quite converged lies above its
/// eigenvalue.
fn between(lower: f64, upper: f64) -> f64 {
    lower + 0.75 * (upper - lower)
}

/// A shift between eigenvalue number `end` and the next.
pub fn above(values: &[f64], end: usize, area: f64) -> f64 {
    match values.get(end) {
        Some(&next) => between(values[end - 1], next),
        // The whole spectrum is known: anything above it will do.
        None => 1.5 * values[end - 1].abs() + 1.0 / area,
    }
}

/// What a search has to find beside what was found before.
#[derive(Clone, Copy)]
enum Goal {
    /// All that is missing of the lowest k, and the rest of the cluster of λ_k.
    First,
    /// All below a shift.
    Below(f64),
}

struct Search<'a> {
    pencil: Pencil<'a>,
    k: usize,
    area: f64,
    /// A residual that is as small as rounding allows.
    floor: f64,
    /// Sums of functions that are nearly eigenfunctions, where there are any.
    start: Option<Panel>,
}

impl<'a> Search<'a> {
    fn new(pencil: Pencil<'a>, k: usize) -> Self {
        let floor = ROUNDINGS * f64::EPSILON * largest_eigenvalue(pencil);
        Self { pencil, k, area: pencil.area(), floor, start: None }
    }

    /// Finds the lowest pairs orthogonal to those found so far. Returns all in ascending order, and the eigenvalue that
    /// comes next.
    fn extend(
        &self,
        analysis: &Analysis<'_>,
        found: Eigenpairs,
        goal: Goal,
        attempt: u64,
    ) -> Result<(Eigenpairs, f64), SpectrumError> {
        let mu = SHIFT / self.area;
        let factor = analysis.positive(mu)?;
        let known: Vec<Panel> = (0..found.len())
            .step_by(WIDTH)
            .map(|first| Panel::from_columns(&found.vectors, first))
            .collect();
        let wanted = self.k.saturating_sub(found.len());
        let (mut krylov, mut look_at) = match (&self.start, goal) {
            (Some(start), Goal::First) => (
                Krylov::from_start(factor, self.pencil.mass, known, start.clone(), attempt),
                3 * wanted + FIRST_LOOK_NEAR,
            ),
            _ => (Krylov::new(factor, self.pencil.mass, known, attempt), 3 * wanted + FIRST_LOOK),
        };
        loop {
            while krylov.dimension() < look_at {
                krylov.grow();
            }
            let ritz = krylov.ritz();
            let look = self.look(&ritz, mu, &found, goal);
            if look.excess <= 1.0 {
                let next = lambda(&ritz, mu, look.new);
                return Ok((self.merge(found, krylov, &ritz, mu, look.new), next));
            }
            let m = look.dimension;
            if m + 2 * WIDTH + found.len() > self.pencil.n() || m > 40 * look.new + 1000 {
                let excess = look.excess;
                return Err(SpectrumError::NotConverged { iterations: m / WIDTH, excess });
            }
            let blocks = (self.pencil.n() - found.len()) / WIDTH - 1;
            look_at = WIDTH * blocks.min(m / WIDTH + look.more_blocks());
        }
    }

    /// How far the search is.
    fn look(&self, ritz: &Ritz, mu: f64, found: &Eigenpairs, goal: Goal) -> Look {
        let dimension = ritz.values.len();
        let lambdas = (0..dimension).map(|j| lambda(ritz, mu, j));
        let new = match goal {
            Goal::First => {
                let values: Vec<f64> = found.values.iter().copied().chain(lambdas).collect();
                cluster_end(&values, self.k.min(values.len()), self.area)
                    - found.len().min(values.len())
            }
            Goal::Below(sigma) => lambdas.take_while(|&lambda| lambda < sigma).count(),
        };
        // x' = (L + μB)⁻¹Bx has the residual B(x − x'/θ).
        let residual = |j: usize| {
            let theta = ritz.values[dimension - 1 - j];
            ritz.residuals[dimension - 1 - j] / (theta * theta)
        };
        let excess = |j: usize| {
            let lambda = lambda(ritz, mu, j).abs();
            let goal = if j < new { TOLERANCE * lambda } else { GLANCE * lambda };
            residual(j) / (0.5 * goal.max(self.floor))
        };
        let worst = if new < dimension {
            (0..=new)
                .map(excess)
                .fold(0.0, |a, b| if b.is_nan() { f64::INFINITY } else { b.max(a) })
        } else {
            f64::INFINITY
        };
        Look { dimension, new, excess: worst }
    }

    /// What was found before and the `new` dominant Ritz pairs, in ascending order.
    fn merge(
        &self,
        found: Eigenpairs,
        krylov: Krylov<'_>,
        ritz: &Ritz,
        mu: f64,
        new: usize,
    ) -> Eigenpairs {
        let chosen: Vec<usize> = (0..ritz.values.len()).rev().take(new).collect();
        let panels = krylov.vectors(ritz, &chosen);
        let values: Vec<f64> =
            found.values.iter().copied().chain((0..new).map(|j| lambda(ritz, mu, j))).collect();
        let mut order: Vec<usize> = (0..values.len()).collect();
        order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
        let mut vectors = Dense::zeros(self.pencil.n(), order.len());
        // Where each of them goes.
        let mut places: Vec<_> = order.iter().zip(columns_mut(&mut vectors)).collect();
        places.sort_by_key(|&(&from, _)| from);
        let mut places = places.into_iter().map(|(_, place)| place);
        for (j, place) in places.by_ref().take(found.len()).enumerate() {
            place.copy_from_slice(column(&found.vectors, j));
        }
        for panel in panels {
            panel.write_to(places.by_ref().take(WIDTH).collect());
        }
        drop(places);
        Eigenpairs { values: order.iter().map(|&j| values[j]).collect(), vectors }
    }
}

/// A lower bound of λ_max: the Rayleigh quotient of one vertex.
pub(super) fn largest_eigenvalue(pencil: Pencil<'_>) -> f64 {
    let (l, b) = (pencil.stiffness.diag_iter(), pencil.mass.diag_iter());
    let quotient = |(l, b): (Option<&f64>, Option<&f64>)| Some(l? / b?);
    l.zip(b).filter_map(quotient).fold(0.0, f64::max)
}

/// The j-th lowest λ = 1/θ − μ, from the j-th largest θ.
fn lambda(ritz: &Ritz, mu: f64, j: usize) -> f64 {
    ritz.values[ritz.values.len() - 1 - j].recip() - mu
}

/// What a look at T showed.
struct Look {
    /// m.
    dimension: usize,
    /// The number of pairs that have to converge.
    new: usize,
    /// The largest of their residuals over what is asked of it.
    excess: f64,
}

impl Look {
    /// How many blocks to add before the next look, at [`RATE`]; as many as there are at most.
    fn more_blocks(&self) -> usize {
        let (blocks, wanted) = (self.dimension / WIDTH, self.new as f64);
        let mut left = self.excess.ln();
        for more in 1..blocks {
            left -= RATE * ((WIDTH * (blocks + more)) as f64 / wanted).ln();
            if left <= 0.0 {
                return more;
            }
        }
        blocks
    }
}

/// All eigenpairs of a small problem.
fn dense(problem: &Problem<'_>) -> Eigenpairs {
    let pencil = problem.pencil();
    // Scaled by the diagonal of B, so that large and small triangles are alike to it.
    let scale: Vec<f64> =
        pencil.mass.diag_iter().map(|b| b.copied().unwrap_or(f64::NAN).sqrt().recip()).collect();
    let scaled = |a: &crate::operators::Sparse| {
        let mut x = Dense::zeros(a.rows(), a.rows());
        for (&value, (i, j)) in a {
            x[(i, j)] = scale[i] * value * scale[j];
        }
        x
    };
    let ritz = ritz_pairs(&scaled(pencil.stiffness), &scaled(pencil.mass), 0.0);
    let mut vectors = ritz.coefficients;
    for j in 0..vectors.ncols() {
        let column = super::pencil::column_mut(&mut vectors, j);
        column.iter_mut().zip(&scale).for_each(|(value, s)| *value *= s);
    }
    let mut pairs = Eigenpairs { values: ritz.values, vectors };
    // The zeros are known better.
    let nullspace = problem.nullspace();
    pairs.values[..nullspace.ncols()].fill(0.0);
    pairs.vectors.subcols_mut(0, nullspace.ncols()).copy_from(nullspace);
    pairs.canonical(zero_below(pencil.area()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::TriMesh;
    use crate::mesh::sample::icosphere;
    use crate::mesh::topology::component_labels;
    use crate::operators::{Boundary, MassKind, Operators};
    use crate::spectrum::dual_norm::inverse_mass_norms;
    use crate::spectrum::pencil::{inner, product};

    fn reference(mesh: &TriMesh, kind: MassKind, k: usize) -> Reference {
        let operators = Operators::assemble(mesh, kind).unwrap();
        let labels = component_labels(mesh);
        let problem = Problem::new(&operators, Boundary::Neumann, &labels).unwrap();
        lowest(&problem, &Analysis::new(problem.pencil()).unwrap(), k).unwrap()
    }

    fn solve(levels: u32, kind: MassKind, k: usize) -> Eigenpairs {
        reference(&icosphere(levels), kind, k).pairs
    }

    /// Spheres of these radii, side by side.
    fn spheres(levels: u32, radii: &[f64]) -> TriMesh {
        let sphere = icosphere(levels);
        let (mut vertices, mut faces) = (Vec::new(), Vec::new());
        for (copy, radius) in radii.iter().enumerate() {
            let first = vertices.len() as u32;
            let place =
                |p: &[f64; 3]| [p[0] * radius + 9.0 * copy as f64, p[1] * radius, p[2] * radius];
            vertices.extend(sphere.vertices().iter().map(place));
            faces.extend(sphere.faces().iter().map(|face| face.map(|i| i + first)));
        }
        TriMesh::new(vertices, faces).unwrap()
    }

    #[test]
    fn vectors_are_orthonormal_and_solve_the_pencil() {
        let operators = Operators::assemble(&icosphere(3), MassKind::Consistent).unwrap();
        let pencil = Pencil::from(&operators);
        let pairs = solve(3, MassKind::Consistent, 25);
        let gram = inner(&pairs.vectors, &product(pencil.mass, &pairs.vectors));
        assert!((&gram - Dense::identity(25, 25)).norm_max() < 1e-12);
        let lx = product(pencil.stiffness, &pairs.vectors);
        let bx = product(pencil.mass, &pairs.vectors);
        for (j, &value) in pairs.values.iter().enumerate() {
            let worst = (0..pencil.n())
                .map(|i| (lx[(i, j)] - value * bx[(i, j)]).abs())
                .fold(0.0, f64::max);
            assert!(worst < 1e-10, "pair {j}: {worst}");
        }
    }

    #[test]
    fn residuals_are_as_small_as_is_asked() {
        for kind in [MassKind::Lumped, MassKind::Consistent] {
            let operators = Operators::assemble(&icosphere(5), kind).unwrap();
            let pencil = Pencil::from(&operators);
            // With clusters of multiplicity 3, 4 and 5, some of them close to one another.
            let pairs = solve(5, kind, 49);
            let (lx, bx) =
                (product(pencil.stiffness, &pairs.vectors), product(pencil.mass, &pairs.vectors));
            let floor = ROUNDINGS * f64::EPSILON * largest_eigenvalue(pencil);
            for first in (0..pairs.len()).step_by(WIDTH) {
                let mut r = Panel::from_columns(&lx, first);
                for (r, b) in r.rows_mut().iter_mut().zip(Panel::from_columns(&bx, first).rows()) {
                    let lambda = |j: usize| pairs.values.get(first + j).copied().unwrap_or(0.0);
                    (0..WIDTH).for_each(|j| r[j] -= lambda(j) * b[j]);
                }
                let norms = inverse_mass_norms(pencil, &r);
                for (j, lambda) in pairs.values[first..].iter().take(WIDTH).enumerate() {
                    assert!(
                        norms[j] < floor.max(TOLERANCE * lambda),
                        "{kind:?}, pair {}",
                        first + j
                    );
                }
            }
        }
    }

    #[test]
    fn every_eigenvalue_of_a_small_mesh() {
        // The icosahedron's vertices: 0, and multiplicities 3, 5, 3 from its symmetry.
        let pairs = solve(0, MassKind::Lumped, 12);
        let runs = super::super::cluster::clusters(&pairs.values, 1e-6, 1e-7);
        assert_eq!(runs.iter().map(ExactSizeIterator::len).collect::<Vec<_>>(), [1, 3, 5, 3]);
    }

    #[test]
    fn k_inside_a_cluster_brings_the_rest_of_it() {
        // Degrees 0 to 3 of the sphere are 16 pairs; K = 12 ends inside degree 3.
        let found = reference(&icosphere(4), MassKind::Lumped, 12);
        assert_eq!((found.pairs.len(), found.count), (16, Some(16)));
        assert!(found.pairs.values[15] < found.sigma && found.sigma < 20.0);
    }

    #[test]
    fn more_copies_of_an_eigenvalue_than_a_block_holds_are_all_found() {
        // Twelve equal spheres: 0 twelve times, then 2 thirty-six times.
        let found = reference(&spheres(2, &[1.0; 12]), MassKind::Lumped, 13);
        assert_eq!((found.pairs.len(), found.count), (48, Some(48)));
        assert_eq!(found.pairs.values[11], 0.0);
        for value in &found.pairs.values[12..] {
            assert!((value / found.pairs.values[12] - 1.0).abs() < 1e-10, "{value}");
        }
    }

    #[test]
    fn whatever_the_search_begins_with_it_finds_the_same() {
        let sphere = icosphere(3);
        let flat = sphere.vertices().iter().map(|&[x, y, z]| [x, 0.8 * y, 0.7 * z]).collect();
        let operators = Operators::assemble(
            &TriMesh::new(flat, sphere.faces().to_vec()).unwrap(),
            MassKind::Lumped,
        );
        let operators = operators.unwrap();
        let labels = component_labels(&sphere);
        let problem = Problem::new(&operators, Boundary::Neumann, &labels).unwrap();
        let analysis = Analysis::new(problem.pencil()).unwrap();
        let cold = lowest(&problem, &analysis, 20).unwrap();
        let n = problem.pencil().n();
        // Those of a sphere, all alike, nothing, and fewer than are wanted.
        let alike = Dense::from_fn(n, 20, |i, j| if j == 0 { 1.0 } else { i as f64 });
        let few = cold.pairs.vectors.subcols(0, 5).to_owned();
        let own = solve(3, MassKind::Lumped, 20).vectors;
        for start in [own, alike, Dense::zeros(n, 20), few, Dense::zeros(n, 0)] {
            let warm = lowest_near(&problem, &analysis, 20, &start).unwrap();
            assert_eq!((warm.pairs.len(), warm.count), (cold.pairs.len(), cold.count));
            for (warm, cold) in warm.pairs.values.iter().zip(&cold.pairs.values).skip(1) {
                assert!((warm / cold - 1.0).abs() < 1e-11, "{warm} {cold}");
            }
        }
    }

    #[test]
    fn the_zeros_of_components_are_indicators_by_lowest_vertex() {
        let pairs = reference(&spheres(2, &[1.0, 0.3, 2.0]), MassKind::Consistent, 3).pairs;
        assert_eq!(pairs.values, [0.0; 3]);
        for (copy, n) in [(0, 162), (1, 162), (2, 162)] {
            let column = pairs.vectors.col(copy);
            assert!(column[copy * n] > 0.0);
            assert_eq!(column.iter().filter(|&&value| value != 0.0).count(), n);
        }
    }

    #[test]
    fn the_bytes_do_not_depend_on_the_number_of_threads() {
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let pairs = pool.install(|| solve(4, MassKind::Consistent, 20));
            (pairs.values, pairs.vectors)
        };
        assert_eq!(on(1), on(3));
    }
}
