//! Eigenpairs that have a formula, (32) and (33), and how far computed ones are from them.
//!
//! The paper selects by hand which eigenfunction of a multiple eigenvalue is compared with which, and with which sign. Here
//! every computed φ is compared with the function of the exact eigenspace that is closest to it: its B-orthogonal projection,
//! of unit norm. On the square (1,2) shares its eigenspace with (2,1), (1,3) with (3,1); on the sphere all of one degree do.

use std::f64::consts::{PI, SQRT_2, TAU};
use std::ops::Range;

use faer::Side;
use faer::linalg::solvers::Solve;
use serde::{Deserialize, Serialize};

use super::Dense;
use super::cluster::clusters;
use super::pencil::{InnerProduct, column, combine, dot, inner, projection};
use crate::mesh::TriMesh;
use crate::operators::{Boundary, Sparse};

/// A surface whose eigenpairs have a formula.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ClosedForm {
    /// [0, π]² in the plane z = 0: sin nx sin my under the Dirichlet condition, cos nx cos my under the Neumann condition,
    /// λ = n² + m².
    Square,
    /// The unit sphere around the origin: the real spherical harmonics, λ = l(l + 1).
    Sphere,
}

/// A mesh is not the surface.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "vertex {vertex} does not lie on the {} whose eigenfunctions it is to be held against; leave verify.closed_form out",
    .surface.in_words()
)]
pub struct NotOnSurface {
    surface: ClosedForm,
    vertex: usize,
}

/// How far a vertex may be from the surface.
const ON_SURFACE: f64 = 1e-5;

/// Exact eigenvalues closer than this (relative) are one.
const SAME: f64 = 1e-9;

/// Eigenpairs at the vertices of a mesh.
#[derive(Debug, Clone)]
pub struct Exact {
    /// Ascending; the last eigenspace is whole.
    pub values: Vec<f64>,
    /// The eigenfunctions at the vertices, one a column, of unit norm on the surface.
    pub vectors: Dense,
}

/// How far a computed φ is from the closest function ψ of the exact eigenspace.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Deviation {
    /// The exact eigenvalue.
    pub lambda: f64,
    /// The angle between φ and the eigenspace, radians.
    pub angle: f64,
    /// (31), the mean of (ψ − φ)² over the vertices, both of unit B-norm.
    pub mse: f64,
    /// (31), both of unit 2-norm.
    pub mse_euclidean: f64,
}

impl ClosedForm {
    fn in_words(self) -> &'static str {
        match self {
            Self::Square => "square [0, π]² in the plane z = 0",
            Self::Sphere => "unit sphere around the origin",
        }
    }

    /// At least `count` eigenpairs, with the last eigenspace whole.
    ///
    /// # Errors
    /// When a vertex is not on the surface.
    pub fn eigenpairs(
        self,
        mesh: &TriMesh,
        boundary: Boundary,
        count: usize,
    ) -> Result<Exact, NotOnSurface> {
        self.check(mesh)?;
        Ok(match self {
            Self::Square => square(mesh, boundary, count),
            Self::Sphere => sphere(mesh, count),
        })
    }

    /// Whether every vertex lies on the surface.
    ///
    /// # Errors
    /// When one does not.
    pub fn check(self, mesh: &TriMesh) -> Result<(), NotOnSurface> {
        let off = mesh.vertices().iter().position(|p| !self.has(p));
        off.map_or(Ok(()), |vertex| Err(NotOnSurface { surface: self, vertex }))
    }

    fn has(self, &[x, y, z]: &[f64; 3]) -> bool {
        match self {
            Self::Square => {
                let inside = |v: f64| (-ON_SURFACE..PI + ON_SURFACE).contains(&v);
                inside(x) && inside(y) && z.abs() < ON_SURFACE
            }
            Self::Sphere => (x * x + y * y + z * z - 1.0).abs() < ON_SURFACE,
        }
    }
}

/// (32), ordered by λ and then by n.
fn square(mesh: &TriMesh, boundary: Boundary, count: usize) -> Exact {
    let first = match boundary {
        Boundary::Neumann => 0,
        Boundary::Dirichlet => 1,
    };
    // Of n² + m² below (s + 1)² + first² none is missing when n and m go to s.
    let most = (first..)
        .find(|&most: &usize| {
            let complete = (most + 1).pow(2) + first * first;
            let pairs = (first..=most).flat_map(|n| (first..=most).map(move |m| n * n + m * m));
            pairs.filter(|&lambda| lambda < complete).count() >= count
        })
        .unwrap_or(first);
    let complete = (most + 1).pow(2) + first * first;
    let mut pairs: Vec<(usize, usize, usize)> = (first..=most)
        .flat_map(|n| (first..=most).map(move |m| (n * n + m * m, n, m)))
        .filter(|&(lambda, ..)| lambda < complete)
        .collect();
    pairs.sort_unstable();
    let end = pairs.iter().position(|pair| pair.0 > pairs[count.max(1) - 1].0);
    pairs.truncate(end.unwrap_or(pairs.len()));
    // ∫ sin² or cos² over the side is π/2, and π for the constant.
    let norm = |n: usize| if n == 0 { PI } else { PI / 2.0 };
    let wave = |n: usize, x: f64| match boundary {
        Boundary::Neumann => (n as f64 * x).cos(),
        Boundary::Dirichlet => (n as f64 * x).sin(),
    };
    let vectors = Dense::from_fn(mesh.n(), pairs.len(), |vertex, j| {
        let ([x, y, _], (_, n, m)) = (mesh.vertices()[vertex], pairs[j]);
        wave(n, x) * wave(m, y) / (norm(n) * norm(m)).sqrt()
    });
    Exact { values: pairs.iter().map(|&(lambda, ..)| lambda as f64).collect(), vectors }
}

/// (33) as real functions: for each degree l the orders −l … l.
fn sphere(mesh: &TriMesh, count: usize) -> Exact {
    let degrees = (0..).find(|l: &usize| (l + 1).pow(2) >= count).unwrap_or(0) + 1;
    let mut vectors = Dense::zeros(mesh.n(), degrees * degrees);
    for (vertex, point) in mesh.vertices().iter().enumerate() {
        let [x, y, z] = *point;
        let azimuth = y.atan2(x);
        let sine = x.hypot(y);
        for m in 0..degrees {
            // For l = m, m + 1, …: stable upwards.
            let [mut before, mut legendre] = [0.0, sectoral(m, sine)];
            for l in m..degrees {
                let (sin, cos) = (m as f64 * azimuth).sin_cos();
                if m == 0 {
                    vectors[(vertex, l * l + l)] = legendre;
                } else {
                    vectors[(vertex, l * l + l + m)] = SQRT_2 * legendre * cos;
                    vectors[(vertex, l * l + l - m)] = SQRT_2 * legendre * sin;
                }
                let scale = |l: usize| {
                    let (l, m) = (l as f64, m as f64);
                    ((4.0 * l * l - 1.0) / (l * l - m * m)).sqrt()
                };
                let next =
                    scale(l + 1) * (z * legendre - if l == m { 0.0 } else { before / scale(l) });
                (before, legendre) = (legendre, next);
            }
        }
    }
    let degree = |l: usize| std::iter::repeat_n((l * (l + 1)) as f64, 2 * l + 1);
    Exact { values: (0..degrees).flat_map(degree).collect(), vectors }
}

/// The normalised associated Legendre function of degree and order `m`, where the polar angle has this sine; without the sign
/// (−1)^m.
fn sectoral(m: usize, sine: f64) -> f64 {
    let start = (1.0 / (2.0 * TAU)).sqrt();
    (1..=m).fold(start, |value, k| value * sine * ((2 * k + 1) as f64 / (2 * k) as f64).sqrt())
}

impl Exact {
    /// The eigenspaces, as ranges of columns.
    fn eigenspaces(&self) -> Vec<Range<usize>> {
        clusters(&self.values, SAME, SAME)
    }

    /// How far each column of `vectors`, on the same mesh and in the order of λ, is from the exact eigenspace at its place. There
    /// may be fewer than there are exact ones.
    pub fn deviations(&self, vectors: &Dense, mass: &Sparse) -> Vec<Deviation> {
        let spaces = self.eigenspaces();
        (0..vectors.ncols().min(self.values.len()))
            .map(|j| {
                let place =
                    spaces.iter().find(|space| space.contains(&j)).cloned().unwrap_or(j..j + 1);
                self.deviation(place, column(vectors, j), mass)
            })
            .collect()
    }

    fn deviation(&self, space: Range<usize>, phi: &[f64], mass: &Sparse) -> Deviation {
        let lambda = self.values[space.start];
        let psi = projected(&self.vectors.get(.., space).to_owned(), phi, mass);
        let difference: Vec<f64> = phi.iter().zip(&psi).map(|(a, b)| a - b).collect();
        let angle = mass.square(&difference).sqrt().atan2(mass.square(&psi).sqrt());
        let mse = |norm: &dyn Fn(&[f64]) -> f64| {
            let (one, other) = (norm(&psi), norm(phi));
            let squares = psi.iter().zip(phi).map(|(a, b)| (a / one - b / other).powi(2));
            squares.sum::<f64>() / phi.len() as f64
        };
        Deviation {
            lambda,
            angle,
            mse: mse(&|x| mass.square(x).sqrt()),
            mse_euclidean: mse(&|x| dot(x, x).sqrt()),
        }
    }
}

/// E(EᵀBE)⁻¹EᵀBφ, the function of span E that is closest to φ; 0 where E is dependent at the vertices.
pub fn projected(e: &Dense, phi: &[f64], mass: &Sparse) -> Vec<f64> {
    let (gram, phi) = (projection(mass, e), Dense::from_fn(phi.len(), 1, |i, _| phi[i]));
    let Ok(gram) = gram.llt(Side::Lower) else { return vec![0.0; phi.nrows()] };
    let coefficients = gram.solve(inner(e, &mass.product(&phi)));
    column(&combine(e, &coefficients), 0).to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::sample::{Shape, icosphere};
    use crate::operators::{MassKind, Operators};
    use crate::spectrum::Pencil;

    /// Exact functions at the vertices are nearly eigenfunctions, and orthonormal, to the order of the mesh width squared.
    fn are_eigenpairs(mesh: &TriMesh, exact: &Exact, tolerance: f64) {
        let operators = Operators::assemble(mesh, MassKind::Consistent).unwrap();
        let pencil = Pencil::from(&operators);
        let gram = projection(pencil.mass, &exact.vectors);
        for j in 0..exact.values.len() {
            for i in 0..=j {
                let expected = if i == j { 1.0 } else { 0.0 };
                assert!((gram[(i, j)] - expected).abs() < tolerance, "{i} {j}: {}", gram[(i, j)]);
            }
            let quotient = pencil.rayleigh_quotient(column(&exact.vectors, j));
            let difference = (quotient - exact.values[j]).abs();
            assert!(difference < tolerance * exact.values[j] + 1e-9, "{j}: {quotient}");
        }
    }

    #[test]
    fn they_are_orthonormal_and_have_their_quotients() {
        let sphere = icosphere(4);
        let exact = ClosedForm::Sphere.eigenpairs(&sphere, Boundary::Neumann, 17).unwrap();
        assert_eq!(exact.values.len(), 25);
        are_eigenpairs(&sphere, &exact, 0.03);
        let square = Shape::Square.sample(6000, 0, 0).unwrap();
        for boundary in [Boundary::Neumann, Boundary::Dirichlet] {
            let exact = ClosedForm::Square.eigenpairs(&square, boundary, 12).unwrap();
            are_eigenpairs(&square, &exact, 0.06);
        }
    }

    #[test]
    fn spherical_harmonics_are_those_of_the_tables() {
        // Condon and Shortley's real forms, degrees 1 and 2.
        let mesh = icosphere(1);
        let exact = ClosedForm::Sphere.eigenpairs(&mesh, Boundary::Neumann, 9).unwrap();
        for (vertex, &[x, y, z]) in mesh.vertices().iter().enumerate() {
            let half = (1.0 / PI).sqrt() / 2.0;
            let (one, two) = ((3.0 / PI).sqrt() / 2.0, (15.0 / PI).sqrt() / 2.0);
            let polar = (5.0 / PI).sqrt() / 4.0 * (3.0 * z * z - 1.0);
            let table = [
                half,
                one * y,
                one * z,
                one * x,
                two * x * y,
                two * y * z,
                polar,
                two * x * z,
                two / 2.0 * (x * x - y * y),
            ];
            for (j, expected) in table.into_iter().enumerate() {
                let found = exact.vectors[(vertex, j)];
                assert!((found - expected).abs() < 1e-13, "{vertex} {j}: {found} {expected}");
            }
        }
    }

    #[test]
    fn the_order_on_the_square_is_that_of_the_paper_and_eigenspaces_are_whole() {
        let mesh = Shape::Square.sample(50, 0, 0).unwrap();
        let values =
            |boundary, count| ClosedForm::Square.eigenpairs(&mesh, boundary, count).unwrap().values;
        assert_eq!(values(Boundary::Dirichlet, 5), [2.0, 5.0, 5.0, 8.0, 10.0, 10.0]);
        assert_eq!(values(Boundary::Dirichlet, 1), [2.0]);
        assert_eq!(values(Boundary::Neumann, 3), [0.0, 1.0, 1.0]);
        let sixteen = values(Boundary::Dirichlet, 16);
        assert_eq!(sixteen[10..], [18.0, 20.0, 20.0, 25.0, 25.0, 26.0, 26.0]);
    }

    #[test]
    fn signs_and_turns_within_an_eigenspace_cost_nothing_and_errors_are_measured() {
        let mesh = Shape::Square.sample(400, 0, 0).unwrap();
        let operators = Operators::assemble(&mesh, MassKind::Lumped).unwrap();
        let exact = ClosedForm::Square.eigenpairs(&mesh, Boundary::Dirichlet, 3).unwrap();
        let (sin, cos) = 0.7_f64.sin_cos();
        let turned = Dense::from_fn(mesh.n(), 3, |i, j| {
            let [a, b, c] = [0, 1, 2].map(|j| exact.vectors[(i, j)]);
            [-3.0 * a, cos * b + sin * c, sin * b - cos * c][j]
        });
        for deviation in exact.deviations(&turned, &operators.mass) {
            assert!(deviation.angle < 1e-12 && deviation.mse < 1e-24, "{deviation:?}");
        }
        // A hundredth of the first in the place of the second.
        let off = Dense::from_fn(mesh.n(), 2, |i, j| {
            exact.vectors[(i, j)] + if j == 1 { 0.01 * exact.vectors[(i, 0)] } else { 0.0 }
        });
        let found = exact.deviations(&off, &operators.mass)[1];
        assert_eq!(found.lambda, 5.0);
        assert!((0.009..0.011).contains(&found.angle), "{found:?}");
        // Of functions with a mean square of 1/π² on the square, and of 1/n.
        assert!((1e-4 / PI / PI / found.mse - 1.0).abs() < 0.5, "{found:?}");
        assert!((1e-4 / 400.0 / found.mse_euclidean - 1.0).abs() < 0.5, "{found:?}");
        let elsewhere = ClosedForm::Sphere.eigenpairs(&mesh, Boundary::Dirichlet, 3);
        assert_eq!(elsewhere.unwrap_err().vertex, 0);
    }
}
