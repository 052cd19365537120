//! The pencil (L, B) as sums over triangles: energies and inner products of functions without any matrix.
//!
//! uᵀLv = Σ_τ Σ_i ½ cot αᵢ (u_j − u_k)(v_j − v_k), where the edge (j, k) is opposite to the angle αᵢ of τ (6), and uᵀBv is a sum
//! over vertices for the diagonal masses, and over triangles for the consistent one (11):
//! |τ|/12 (Σ uᵢvᵢ + Σ uᵢ Σ vᵢ). All functions of a set are taken in one pass. The terms are dealt to a fixed number of
//! pieces, and the pieces' sums are added in their order: the bits do not depend on the number of threads.

use std::ops::Range;

use faer::linalg::matmul::matmul;
use faer::{Accum, MatRef, Par};
use rayon::prelude::*;

use super::Dense;
use super::pencil::{InnerProduct, column};
use crate::mesh::TriMesh;
use crate::operators::assembly::{sheets, triangles};
use crate::operators::mass::{lumped_areas, voronoi_areas};
use crate::operators::{MassKind, OperatorError, OperatorOptions, Triangle};

/// Sums are dealt to so many pieces.
const PIECES: usize = 64;

/// Terms that are worked on at a time.
const CHUNK: usize = 512;

/// (L, B) of a mesh with n vertices, L positive semi-definite and without a unit, B in squared input units.
#[derive(Debug, Clone, PartialEq)]
pub struct TrianglePencil {
    n: usize,
    triangles: Vec<Triangle>,
    mass: Mass,
    mass_kind: MassKind,
}

#[derive(Debug, Clone, PartialEq)]
enum Mass {
    /// b_i at every vertex.
    Diagonal(Vec<f64>),
    /// (11).
    Consistent,
}

/// weight · (Σ cᵢuᵢ)(Σ cᵢvᵢ) over up to three vertices i.
#[derive(Clone, Copy)]
struct Term {
    weight: f64,
    of: [(u32, f64); 3],
}

impl TrianglePencil {
    /// The pencil of `mesh`.
    ///
    /// # Errors
    /// [`OperatorError::NoTriangles`] for the graph Laplacian; [`OperatorError`] for a mass that does not go with
    /// the Laplacian, and for triangles without angles.
    pub fn of_mesh(
        mesh: &TriMesh,
        options: impl Into<OperatorOptions>,
    ) -> Result<Self, OperatorError> {
        let options = options.into();
        let mass_kind = options.mass_kind()?;
        let mut triangles = triangles(mesh, options.robust)?;
        let n = mesh.n();
        let mass = match mass_kind {
            MassKind::Lumped => Mass::Diagonal(lumped_areas(n, &triangles)),
            MassKind::Voronoi => Mass::Diagonal(voronoi_areas(n, &triangles)),
            MassKind::Consistent => Mass::Consistent,
            MassKind::Degree => return Err(OperatorError::NoTriangles),
        };
        let sheets = sheets(options.robust);
        let mass = match mass {
            Mass::Diagonal(areas) => {
                Mass::Diagonal(areas.into_iter().map(|area| area / sheets).collect())
            }
            Mass::Consistent => Mass::Consistent,
        };
        // From here on they are only summed over.
        for triangle in triangles.iter_mut().filter(|_| sheets > 1.0) {
            triangle.area /= sheets;
            triangle.cotangents.iter_mut().for_each(|cotangent| *cotangent /= sheets);
        }
        Ok(Self { n, triangles, mass, mass_kind })
    }

    /// The number of vertices.
    pub fn n(&self) -> usize {
        self.n
    }

    /// Which mass B is.
    pub fn mass_kind(&self) -> MassKind {
        self.mass_kind
    }

    /// The row sums of B: the area of every vertex. Length n.
    pub fn vertex_areas(&self) -> Vec<f64> {
        match &self.mass {
            Mass::Diagonal(areas) => areas.clone(),
            Mass::Consistent => lumped_areas(self.n, &self.triangles),
        }
    }

    /// The Rayleigh quotient (13) of every column of `phi`, n×k, in 1/(input unit)².
    pub fn rayleigh_quotients(&self, phi: &Dense) -> Vec<f64> {
        let rows = by_rows(phi);
        let energies = in_pieces(self.triangles.len(), rows.k, |range, sums| {
            self.triangles[range].iter().for_each(|triangle| add_energies(triangle, &rows, sums));
        });
        let masses = match &self.mass {
            Mass::Diagonal(areas) => in_pieces(areas.len(), rows.k, |range, sums| {
                for (&area, row) in areas[range.clone()].iter().zip(rows.of(range)) {
                    sums.iter_mut().zip(row).for_each(|(sum, u)| *sum += area * (u * u));
                }
            }),
            Mass::Consistent => in_pieces(self.triangles.len(), rows.k, |range, sums| {
                self.triangles[range].iter().for_each(|triangle| add_masses(triangle, &rows, sums));
            }),
        };
        energies.iter().zip(masses).map(|(energy, mass)| energy / mass).collect()
    }

    /// (ΦᵀLΦ, ΦᵀBΦ) for Φ = `phi`, n×k; each k×k and exactly symmetric.
    pub fn projected(&self, phi: &Dense) -> (Dense, Dense) {
        let k = phi.ncols();
        let rows = by_rows(phi);
        let grams = |terms: &[Term], sums: &mut Vec<f64>| {
            sums.resize(k * k, 0.0);
            let mut combined = vec![0.0; k * terms.len()];
            let mut weighted = combined.clone();
            for (i, term) in terms.iter().enumerate() {
                let [row, heavy] = [&mut combined, &mut weighted].map(|x| &mut x[k * i..][..k]);
                combine(term, &rows, row);
                heavy.iter_mut().zip(row).for_each(|(heavy, c)| *heavy = term.weight * *c);
            }
            let [x, y] = [&combined, &weighted]
                .map(|rows| MatRef::from_row_major_slice(rows, terms.len(), k));
            let into = faer::MatMut::from_column_major_slice_mut(sums, k, k);
            matmul(into, Accum::Add, x.transpose(), y, 1.0, Par::Seq);
        };
        let square =
            |sums: Vec<f64>| Dense::from_fn(k, k, |i, j| 0.5 * (sums[j * k + i] + sums[i * k + j]));
        if k == 0 {
            return (Dense::zeros(0, 0), Dense::zeros(0, 0));
        }
        (square(sum(self.stiffness_terms(), grams)), square(sum(self.mass_terms(), grams)))
    }

    /// L: three terms a triangle.
    fn stiffness_terms(&self) -> (usize, impl Fn(usize) -> Term + Sync + '_) {
        let term = |at: usize| {
            let Triangle { vertices, cotangents, .. } = self.triangles[at / 3];
            let [i, j, k] = [0, 1, 2].map(|turn| (at + turn) % 3);
            Term {
                weight: 0.5 * cotangents[i],
                of: [(vertices[j], 1.0), (vertices[k], -1.0), (vertices[k], 0.0)],
            }
        };
        (3 * self.triangles.len(), term)
    }

    /// B: a term a vertex, or four a triangle.
    fn mass_terms(&self) -> (usize, impl Fn(usize) -> Term + Sync + '_) {
        let count = match &self.mass {
            Mass::Diagonal(areas) => areas.len(),
            Mass::Consistent => 4 * self.triangles.len(),
        };
        let alone = |vertex: u32| [(vertex, 1.0), (vertex, 0.0), (vertex, 0.0)];
        let term = move |at: usize| match &self.mass {
            Mass::Diagonal(areas) => Term { weight: areas[at], of: alone(at as u32) },
            Mass::Consistent => {
                let Triangle { vertices, area, .. } = self.triangles[at / 4];
                let of = match vertices.get(at % 4) {
                    Some(&vertex) => alone(vertex),
                    None => vertices.map(|vertex| (vertex, 1.0)),
                };
                Term { weight: area / 12.0, of }
            }
        };
        (count, term)
    }
}

impl InnerProduct for TrianglePencil {
    fn apply(&self, x: &[f64], y: &mut [f64]) {
        match &self.mass {
            Mass::Diagonal(areas) => {
                y.iter_mut().zip(areas.iter().zip(x)).for_each(|(y, (b, x))| *y = b * x);
            }
            Mass::Consistent => {
                y.fill(0.0);
                for &Triangle { vertices, area, .. } in &self.triangles {
                    let values = vertices.map(|i| x[i as usize]);
                    let sum: f64 = values.iter().sum();
                    for (i, value) in vertices.into_iter().zip(values) {
                        y[i as usize] += area / 12.0 * (value + sum);
                    }
                }
            }
        }
    }

    fn square(&self, x: &[f64]) -> f64 {
        match &self.mass {
            Mass::Diagonal(areas) => areas.iter().zip(x).map(|(b, x)| x * (b * x)).sum(),
            Mass::Consistent => {
                let mut y = vec![0.0; x.len()];
                self.apply(x, &mut y);
                x.iter().zip(y).map(|(x, y)| x * y).sum()
            }
        }
    }
}

/// The values of all functions at a vertex, one vertex after the other.
struct Rows {
    k: usize,
    values: Vec<f64>,
}

impl Rows {
    /// The rows of some vertices.
    fn of(&self, vertices: Range<usize>) -> impl Iterator<Item = &[f64]> {
        self.values[vertices.start * self.k..vertices.end * self.k].chunks_exact(self.k.max(1))
    }

    /// The rows of the corners of a triangle.
    fn at(&self, triangle: &Triangle) -> [&[f64]; 3] {
        triangle.vertices.map(|vertex| &self.values[vertex as usize * self.k..][..self.k])
    }
}

fn by_rows(phi: &Dense) -> Rows {
    let k = phi.ncols();
    let mut values = vec![0.0; phi.nrows() * k];
    values.par_chunks_mut(CHUNK * k.max(1)).enumerate().for_each(|(chunk, rows)| {
        for j in 0..k {
            let column = &column(phi, j)[chunk * CHUNK..];
            let places = rows.iter_mut().skip(j).step_by(k);
            places.zip(column).for_each(|(to, &from)| *to = from);
        }
    });
    Rows { k, values }
}

/// Adds uᵀLu of one triangle for every function u.
#[inline(always)]
fn add_energies(triangle: &Triangle, rows: &Rows, sums: &mut [f64]) {
    let [p, q, r] = triangle.cotangents.map(|cotangent| 0.5 * cotangent);
    let [a, b, c] = rows.at(triangle);
    for (sum, (a, (b, c))) in sums.iter_mut().zip(a.iter().zip(b.iter().zip(c))) {
        let (x, y, z) = (b - c, c - a, a - b);
        *sum += p * (x * x) + q * (y * y) + r * (z * z);
    }
}

/// Adds uᵀBu of one triangle for every function u, with the consistent mass.
#[inline(always)]
fn add_masses(triangle: &Triangle, rows: &Rows, sums: &mut [f64]) {
    let weight = triangle.area / 12.0;
    let [a, b, c] = rows.at(triangle);
    for (sum, (a, (b, c))) in sums.iter_mut().zip(a.iter().zip(b.iter().zip(c))) {
        let all = a + b + c;
        *sum += weight * (a * a + b * b + c * c + all * all);
    }
}

/// Adds up what `add` makes of `count` terms, for k functions.
fn in_pieces(count: usize, k: usize, add: impl Fn(Range<usize>, &mut [f64]) + Sync) -> Vec<f64> {
    let piece = |number: usize| {
        let mut sums = vec![0.0; k];
        add(number * count / PIECES..(number + 1) * count / PIECES, &mut sums);
        sums
    };
    let pieces: Vec<Vec<f64>> = (0..PIECES).into_par_iter().map(piece).collect();
    pieces.into_iter().fold(vec![0.0; k], |mut all, sums| {
        all.iter_mut().zip(sums).for_each(|(all, sum)| *all += sum);
        all
    })
}

/// Σ cᵢuᵢ for every function u.
fn combine(term: &Term, rows: &Rows, out: &mut [f64]) {
    let [a, b, c] = term.of.map(|(vertex, _)| &rows.values[vertex as usize * rows.k..][..rows.k]);
    let [p, q, r] = term.of.map(|(_, coefficient)| coefficient);
    for (out, (a, (b, c))) in out.iter_mut().zip(a.iter().zip(b.iter().zip(c))) {
        *out = p * a + q * b + r * c;
    }
}

/// Adds up what `add` makes of all terms, chunk by chunk.
fn sum(
    (count, term): (usize, impl Fn(usize) -> Term + Sync),
    add: impl Fn(&[Term], &mut Vec<f64>) + Sync,
) -> Vec<f64> {
    let piece = |number: usize| {
        let [start, end] = [number, number + 1].map(|number| number * count / PIECES);
        let mut sums = Vec::new();
        for first in (start..end).step_by(CHUNK) {
            let terms: Vec<Term> = (first..end.min(first + CHUNK)).map(&term).collect();
            add(&terms, &mut sums);
        }
        sums
    };
    let pieces: Vec<Vec<f64>> = (0..PIECES).into_par_iter().map(piece).collect();
    let mut pieces = pieces.into_iter().filter(|sums| !sums.is_empty());
    let first = pieces.next().unwrap_or_default();
    pieces.fold(first, |mut all, sums| {
        all.iter_mut().zip(sums).for_each(|(all, sum)| *all += sum);
        all
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::sample::icosphere;
    use crate::operators::{Laplacian, Operators, Robust};
    use crate::spectrum::Pencil;
    use crate::spectrum::pencil::product;

    const MASSES: [MassKind; 3] = [MassKind::Lumped, MassKind::Voronoi, MassKind::Consistent];

    fn meshes() -> Vec<TriMesh> {
        let load = |name: &str| {
            crate::mesh::load(format!("tests/data/meshes/{name}").as_ref()).unwrap().mesh
        };
        let names = ["spot_829.obj", "gc_moebius.obj", "lapy_torus.off", "bunny1.obj"];
        names.into_iter().map(load).chain([icosphere(3)]).collect()
    }

    fn waves(mesh: &TriMesh, k: usize) -> Dense {
        let wave = |i: usize, j: usize| {
            let [x, y, z] = mesh.vertices()[i];
            (x * (j + 1) as f64 + y + 0.3 * z * j as f64).sin() + 0.1
        };
        Dense::from_fn(mesh.n(), k, wave)
    }

    fn close(found: &Dense, expected: &Dense) {
        let worst = (found - expected).norm_max();
        assert!(worst <= 1e-12 * expected.norm_max(), "{worst} of {}", expected.norm_max());
    }

    #[test]
    fn sums_over_triangles_are_those_of_the_assembled_matrices() {
        for (mesh, kind) in meshes().iter().flat_map(|mesh| MASSES.map(|kind| (mesh, kind))) {
            for robust in Robust::ALL {
                let options = OperatorOptions { robust, ..kind.into() };
                let operators = Operators::assemble(mesh, options).unwrap();
                let pencil = TrianglePencil::of_mesh(mesh, options).unwrap();
                let phi = waves(mesh, 5);
                let assembled = Pencil::from(&operators);
                let (stiffness, mass) = assembled.projected(&phi);
                let (found_stiffness, found_mass) = pencil.projected(&phi);
                close(&found_stiffness, &stiffness);
                close(&found_mass, &mass);
                close(&pencil.product(&phi), &product(&operators.mass, &phi));
                for (j, quotient) in pencil.rayleigh_quotients(&phi).into_iter().enumerate() {
                    let column = crate::spectrum::pencil::column(&phi, j);
                    let expected = assembled.rayleigh_quotient(column);
                    assert!((quotient / expected - 1.0).abs() < 1e-12, "{quotient} {expected}");
                    assert!((pencil.square(column) / mass[(j, j)] - 1.0).abs() < 1e-12);
                }
                let areas = crate::operators::mass::row_sums(&operators.mass);
                for (found, expected) in pencil.vertex_areas().into_iter().zip(areas) {
                    assert!((found / expected - 1.0).abs() < 1e-12);
                }
            }
        }
    }

    #[test]
    fn the_diagonal_products_have_the_bits_of_the_matrix() {
        // So that a prediction is the same bytes with the matrix and without.
        let mesh = icosphere(2);
        let operators = Operators::assemble(&mesh, MassKind::Lumped).unwrap();
        let pencil = TrianglePencil::of_mesh(&mesh, MassKind::Lumped).unwrap();
        let phi = waves(&mesh, 3);
        assert_eq!(pencil.product(&phi), operators.mass.product(&phi));
        let x = crate::spectrum::pencil::column(&phi, 1);
        assert_eq!(pencil.square(x), operators.mass.square(x));
    }

    #[test]
    fn the_bits_do_not_depend_on_the_number_of_threads() {
        let mesh = icosphere(4);
        let phi = waves(&mesh, 6);
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let pencil = TrianglePencil::of_mesh(&mesh, MassKind::Consistent).unwrap();
                (pencil.rayleigh_quotients(&phi), pencil.projected(&phi))
            })
        };
        assert_eq!(on(1), on(3));
    }

    #[test]
    fn the_graph_has_no_triangles() {
        let options = OperatorOptions { laplacian: Laplacian::Graph, ..Default::default() };
        let refused = TrianglePencil::of_mesh(&icosphere(0), options);
        assert_eq!(refused, Err(OperatorError::NoTriangles));
    }
}
