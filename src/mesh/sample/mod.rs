//! Surfaces that have a formula, sampled as often and as finely as one likes: the multi-instance case of the paper.
//!
//! - [`icosphere`]: the sphere by splitting, for tests
//! - [`square`]: [0, π]², random vertices
//! - [`sphere`]: the unit sphere
//! - [`revolution`]: the torus and the vase
//!
//! Every sampling has the number of vertices that is asked for, and a random stream of its own: sampling 17 is the same
//! however many others there are.

mod icosphere;
pub mod revolution;
pub mod sphere;
pub mod square;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Topology, TriMesh};
pub use icosphere::icosphere;

/// A surface with a formula.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Shape {
    /// [0, π]² in the plane z = 0, a tenth of the vertices on the boundary.
    Square,
    /// Of radius 1 around the origin.
    Sphere,
    /// Of radii 1 and 0.4.
    Torus,
    /// A surface of revolution, open at its foot and at its mouth.
    Vase,
}

/// What samplings are for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Set {
    /// None of them is among those that a family is trained on.
    #[default]
    Test,
    /// They are the very samplings that a family of this seed and this number of vertices is trained on.
    Training,
}

impl Set {
    /// The number of sampling `member` of this set, for [`Shape::sample`].
    pub fn number(self, member: u64) -> u64 {
        match self {
            Self::Test => member,
            Self::Training => member | 1 << 63,
        }
    }
}

/// Why there is no such sampling.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SampleError {
    /// Too few vertices.
    #[error("a {} takes {} vertices or more, and not {vertices}", .shape.name(), .shape.fewest())]
    TooFew { shape: Shape, vertices: usize },
    /// No draw had the topology of the surface.
    #[error("none of {DRAWS} samplings of a {} with {vertices} vertices has its topology; ask for more vertices", .shape.name())]
    Topology { shape: Shape, vertices: usize },
}

/// Draws before a sampling is given up.
const DRAWS: usize = 16;

impl Shape {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Square, Self::Sphere, Self::Torus, Self::Vase];

    /// As pipelines and the command line call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Square => "square",
            Self::Sphere => "sphere",
            Self::Torus => "torus",
            Self::Vase => "vase",
        }
    }

    /// With fewer vertices it would be something else.
    pub fn fewest(self) -> usize {
        match self {
            Self::Square => 5,
            Self::Sphere => 12,
            Self::Torus => 60,
            Self::Vase => 60,
        }
    }

    /// Whether a surface has its components, boundary loops and Euler characteristic.
    pub fn is_like(self, topology: &Topology) -> bool {
        let own = match self {
            Self::Square => (1, 1, 1),
            Self::Sphere => (1, 0, 2),
            Self::Torus => (1, 0, 0),
            Self::Vase => (1, 2, 0),
        };
        own == (topology.components, topology.boundary_loops, topology.euler_characteristic)
    }

    /// Sampling number `member` of those of `seed`, with so many vertices.
    ///
    /// # Errors
    /// [`SampleError`].
    pub fn sample(self, vertices: usize, seed: u64, member: u64) -> Result<TriMesh, SampleError> {
        if vertices < self.fewest() {
            return Err(SampleError::TooFew { shape: self, vertices });
        }
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(member);
        (0..DRAWS)
            .filter_map(|_| self.draw(vertices, &mut rng))
            .find(|mesh| mesh.n() == vertices && self.is_like(&Topology::of(mesh)))
            .ok_or(SampleError::Topology { shape: self, vertices })
    }

    fn draw(self, vertices: usize, rng: &mut ChaCha8Rng) -> Option<TriMesh> {
        match self {
            Self::Square => square::sample(vertices, rng),
            Self::Sphere => sphere::sample(vertices, rng),
            Self::Torus => revolution::sample(&revolution::TORUS, vertices, rng),
            Self::Vase => revolution::sample(&revolution::VASE, vertices, rng),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    #[test]
    fn samplings_have_the_vertices_that_are_asked_for_and_the_area_of_the_surface() {
        // Inscribed, they have a little less.
        let cases = [
            (Shape::Square, PI * PI, 0.0, vec![5, 144, 932]),
            (Shape::Sphere, 4.0 * PI, 6.0, vec![12, 162, 252, 752, 1502]),
            (Shape::Torus, 4.0 * PI * PI * 0.4, 14.0, vec![60, 100, 997]),
            (Shape::Vase, revolution::VASE.area(), 20.0, vec![60, 500, 520, 2280]),
        ];
        for (shape, area, curved, sizes) in cases {
            for n in sizes {
                for member in 0..5 {
                    let mesh = shape.sample(n, 3, member).unwrap();
                    assert_eq!(mesh.n(), n);
                    let missing = 1.0 - mesh.area().0 / area;
                    let bound = curved / n as f64 + 1e-12;
                    assert!((-1e-9..bound).contains(&missing), "{shape:?} {n}: {missing}");
                }
            }
        }
    }

    #[test]
    fn faces_of_closed_ones_face_outwards() {
        for (shape, volume) in
            [(Shape::Sphere, 4.0 / 3.0 * PI), (Shape::Torus, 2.0 * PI * PI * 0.16)]
        {
            let mesh = shape.sample(900, 1, 0).unwrap();
            let p = |i: u32| mesh.vertices()[i as usize];
            let signed = |&[a, b, c]: &[u32; 3]| {
                let ([x, y, z], [u, v, w], [r, s, t]) = (p(a), p(b), p(c));
                (x * (v * t - w * s) + y * (w * r - u * t) + z * (u * s - v * r)) / 6.0
            };
            let found: f64 = mesh.faces().iter().map(signed).sum();
            assert!((found / volume - 1.0).abs() < 0.05, "{shape:?}: {found}");
        }
    }

    #[test]
    fn a_sampling_is_that_of_its_seed_and_number_alone() {
        for shape in Shape::ALL {
            let first = shape.sample(200, 7, 3).unwrap();
            assert_eq!(shape.sample(200, 7, 3).unwrap(), first);
            assert_ne!(shape.sample(200, 7, 4).unwrap(), first);
            assert_ne!(shape.sample(200, 8, 3).unwrap(), first);
            let error = shape.sample(shape.fewest() - 1, 7, 3).unwrap_err();
            assert!(matches!(error, SampleError::TooFew { .. }), "{error}");
        }
    }
}
