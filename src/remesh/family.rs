//! A family: seeded variants of one mesh that keep its topology, or samplings of a surface with a formula.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::flip::flip;
use super::perturb::perturb;
use super::resolution::Resolution;
use super::simplify::simplify;
use super::thickness::thinnest;
use crate::mesh::closest::ClosestPoint;
use crate::mesh::sample::{SampleError, Set, Shape};
use crate::mesh::subdivide::subdivide;
use crate::mesh::trimesh::InvalidMesh;
use crate::mesh::{Topology, TriMesh};

/// Every mesh is trained on variants of itself, so that a block learns the shape and not one sampling of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct FamilyRecipe {
    /// What the variants are of: the mesh, or a surface with a formula of which the mesh is one more sampling. One training then
    /// serves all meshes of the run; of the options here only members, vertices and seed count.
    pub of: Of,
    /// How many variants; 1 trains on the mesh alone.
    pub members: usize,
    /// What is done to the mesh for each of them, in this order. ["subdivide", "simplify", "perturb", "flip"], for example, samples the
    /// surface anew. Boundaries stay where "perturb" and "flip" find them.
    pub operations: Vec<Operation>,
    /// About how many vertices "simplify" leaves: a number, or a range [fewest, most] that every variant draws its own from; at most
    /// three quarters of those that there are. A mesh that has no more than this itself, or than 620, is not simplified: coarser
    /// variants of it would be another shape. If nothing else is done to it, it is trained on alone.
    pub vertices: Resolution,
    /// "simplify": how far vertices move at random, in mean edge lengths, while it is decided which of them a variant keeps.
    pub jitter: f64,
    /// "perturb": how far a vertex moves at most, in mean lengths of its edges.
    pub perturbation: f64,
    /// "flip": the share of edges that are tried.
    pub flips: f64,
    /// Seeds all of these. Variant i depends on it and on i, but not on how many there are.
    pub seed: u64,
}

/// `family.of`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Of {
    /// The mesh itself.
    #[default]
    Mesh,
    /// [0, π]² in the plane z = 0, a tenth of the vertices on the boundary.
    Square,
    /// Of radius 1 around the origin.
    Sphere,
    /// Of radii 1 and 0.4.
    Torus,
    /// A surface of revolution, open at its foot and at its mouth.
    Vase,
}

impl Of {
    /// The surface with a formula, if it is one.
    pub fn shape(self) -> Option<Shape> {
        match self {
            Self::Mesh => None,
            Self::Square => Some(Shape::Square),
            Self::Sphere => Some(Shape::Sphere),
            Self::Torus => Some(Shape::Torus),
            Self::Vase => Some(Shape::Vase),
        }
    }
}

/// A change of the sampling that keeps the surface, or nearly so.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Operation {
    /// Vertices are taken away.
    Simplify,
    /// Vertices move at random along the surface.
    Perturb,
    /// The diagonals of nearly flat pairs of triangles are exchanged.
    Flip,
    /// Every triangle becomes four.
    Subdivide,
}

impl Default for FamilyRecipe {
    /// The values that `docs/training.md` arrives at; on a mesh of fewer vertices the cap on their share rules.
    fn default() -> Self {
        Self {
            of: Of::Mesh,
            members: 8,
            operations: vec![Operation::Simplify],
            vertices: 2000.into(),
            jitter: 0.3,
            perturbation: 0.3,
            flips: 0.2,
            seed: 0,
        }
    }
}

/// The meshes that one model is trained on.
#[derive(Debug, Clone, PartialEq)]
pub struct Family {
    /// At least one mesh.
    pub members: Vec<TriMesh>,
}

/// Why no family could be made.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FamilyError {
    /// No draw kept components, boundary loops and Euler characteristic with triangles of some thickness.
    #[error(
        "none of {draws} variants kept the topology of the mesh without collapsed triangles; raise family.vertices, \
         leave out one of family.operations, or set family.members = 1 to train on the mesh alone"
    )]
    Topology { draws: usize },
    /// A surface with a formula has no such sampling.
    #[error("{0} (family.vertices)")]
    Sample(#[from] SampleError),
    /// The mesh is no sampling of the surface that the family is of.
    #[error(
        "the mesh is no sampling of a {}: it has {} components, {} boundary loops and Euler characteristic {}; family.of = \"mesh\" \
         trains on variants of the mesh itself",
        .shape.name(), .found.0, .found.1, .found.2
    )]
    Other { shape: Shape, found: (usize, usize, i64) },
}

/// Draws before a member is given up.
const DRAWS: usize = 32;

/// Draws before they become gentler, and again after as many more.
const DRAWS_AS_ASKED: usize = 8;

/// A member has at most this share of the mesh's vertices.
const LARGEST_SHARE: f64 = 0.75;

/// A mesh of so few vertices is not simplified unless fewer are asked for.
const SMALL: usize = 620;

/// A variant with a triangle thinner than this is drawn again, unless the mesh has such triangles itself: one
/// collapsed triangle's cotangents swamp the stiffness of all others.
const THINNEST: f64 = 1e-3;

impl Family {
    /// Makes the family of `mesh`.
    ///
    /// Every member has its own random stream, so that member i does not depend on how many others there are. Draws
    /// that fail are followed by gentler ones: smaller moves, fewer flips, more vertices.
    ///
    /// # Errors
    /// [`FamilyError::Topology`] when no draw for some member keeps the topology.
    pub fn of(mesh: &TriMesh, recipe: &FamilyRecipe) -> Result<Self, FamilyError> {
        if let Some(shape) = recipe.of.shape() {
            return Self::sampled(shape, recipe);
        }
        if recipe.members <= 1 || recipe.leaves_alone(mesh) {
            return Ok(Self { members: vec![mesh.clone()] });
        }
        let wanted = kind(mesh);
        let thin = THINNEST.min(0.1 * thinnest(mesh));
        let surface = ClosestPoint::on(mesh);
        let members = (0..recipe.members as u64)
            .map(|member| {
                let mut rng = ChaCha8Rng::seed_from_u64(recipe.seed);
                rng.set_stream(member);
                let vertices = recipe.vertices.draw(&mut rng);
                (0..DRAWS)
                    .filter_map(|draw| {
                        // 0 for the first draws, then 1, 2, …
                        let gentler = (draw / DRAWS_AS_ASKED) as i32;
                        recipe.variant(mesh, &surface, vertices, gentler, &mut rng).ok()
                    })
                    .find(|variant| kind(variant) == wanted && thinnest(variant) >= thin)
                    .ok_or(FamilyError::Topology { draws: DRAWS })
            })
            .collect::<Result<_, _>>()?;
        Ok(Self { members })
    }

    /// Samplings of a surface with a formula.
    fn sampled(shape: Shape, recipe: &FamilyRecipe) -> Result<Self, FamilyError> {
        let member = |member: u64| {
            let mut rng = ChaCha8Rng::seed_from_u64(recipe.seed);
            rng.set_stream(member);
            shape.sample(recipe.vertices.draw(&mut rng), recipe.seed, Set::Training.number(member))
        };
        let members = (0..recipe.members as u64).map(member).collect::<Result<_, _>>()?;
        Ok(Self { members })
    }
}

impl FamilyRecipe {
    /// Whether a family by this recipe can be one of a mesh with this topology.
    ///
    /// # Errors
    /// [`FamilyError::Other`] where the family is of a surface with a formula, and the mesh is another one.
    pub fn suits(&self, topology: &Topology) -> Result<(), FamilyError> {
        let Topology { components, boundary_loops, euler_characteristic, .. } = *topology;
        match self.of.shape() {
            Some(shape) if !shape.is_like(topology) => {
                let found = (components, boundary_loops, euler_characteristic);
                Err(FamilyError::Other { shape, found })
            }
            _ => Ok(()),
        }
    }

    /// Whether nothing would be done to `mesh`.
    fn leaves_alone(&self, mesh: &TriMesh) -> bool {
        let simplified = self.simplifies(mesh);
        !self.operations.iter().any(|&operation| operation != Operation::Simplify || simplified)
    }

    /// Whether `simplify` does anything to `mesh`.
    fn simplifies(&self, mesh: &TriMesh) -> bool {
        mesh.n() > self.vertices.fewest.min(SMALL)
    }

    /// One draw of a variant, `gentler` times gentler than asked for.
    fn variant(
        &self,
        mesh: &TriMesh,
        surface: &ClosestPoint<'_>,
        vertices: usize,
        gentler: i32,
        rng: &mut ChaCha8Rng,
    ) -> Result<TriMesh, InvalidMesh> {
        let strength = 0.25_f64.powi(gentler);
        self.operations.iter().try_fold(mesh.clone(), |mesh, operation| match operation {
            Operation::Simplify if !self.simplifies(&mesh) => Ok(mesh),
            Operation::Simplify => {
                let vertices = vertices.min((LARGEST_SHARE * mesh.n() as f64) as usize);
                let kept = 1.0 - 0.5_f64.powi(gentler);
                let vertices = vertices + (kept * (mesh.n() - vertices) as f64) as usize;
                simplify(&mesh, vertices, strength * self.jitter, rng)
            }
            Operation::Perturb => Ok(perturb(&mesh, surface, strength * self.perturbation, rng)),
            Operation::Flip => Ok(flip(&mesh, strength * self.flips, rng)),
            Operation::Subdivide => Ok(subdivide(&mesh)),
        })
    }
}

/// What a variant must share with its mesh: components, boundary loops, Euler characteristic.
fn kind(mesh: &TriMesh) -> (usize, usize, i64) {
    let topology = Topology::of(mesh);
    (topology.components, topology.boundary_loops, topology.euler_characteristic)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::sample::icosphere;

    fn recipe(members: usize) -> FamilyRecipe {
        FamilyRecipe { members, vertices: 120.into(), seed: 5, ..FamilyRecipe::default() }
    }

    #[test]
    fn samplings_of_a_formula_do_not_depend_on_the_mesh() {
        let of = |mesh: &TriMesh, members| {
            let recipe = FamilyRecipe { of: Of::Sphere, ..recipe(members) };
            Family::of(mesh, &recipe)
        };
        let family = of(&icosphere(2), 3).unwrap();
        assert_eq!(of(&icosphere(1), 3).unwrap(), family);
        assert_eq!(of(&icosphere(1), 2).unwrap().members, family.members[..2]);
        assert!(family.members.iter().all(|member| member.n() == 120));
        let square = Shape::Square.sample(100, 0, 0).unwrap();
        let recipe = FamilyRecipe { of: Of::Sphere, ..recipe(3) };
        let error = recipe.suits(&Topology::of(&square)).unwrap_err();
        assert_eq!(error, FamilyError::Other { shape: Shape::Sphere, found: (1, 1, 1) });
        assert_eq!(recipe.suits(&Topology::of(&icosphere(0))), Ok(()));
    }

    #[test]
    fn members_differ_keep_the_topology_and_lie_on_the_mesh() {
        let mesh = icosphere(2);
        let family = Family::of(&mesh, &recipe(4)).unwrap();
        for (i, member) in family.members.iter().enumerate() {
            assert_eq!(kind(member), (1, 0, 2));
            assert!((110..=122).contains(&member.n()), "{}", member.n());
            assert!(member.vertices().iter().all(|p| mesh.vertices().contains(p)));
            assert!(family.members[..i].iter().all(|other| other != member));
        }
    }

    #[test]
    fn a_member_depends_on_its_number_and_the_seed_alone() {
        let mesh = icosphere(2);
        let few = Family::of(&mesh, &recipe(2)).unwrap();
        let many = Family::of(&mesh, &recipe(3)).unwrap();
        assert_eq!(few.members, many.members[..2]);
        let other = Family::of(&mesh, &FamilyRecipe { seed: 6, ..recipe(2) }).unwrap();
        assert_ne!(few, other);
    }

    #[test]
    fn no_member_of_spot_has_a_collapsed_triangle() {
        // Seed 16 drew one with a cotangent of 3e15 before such draws were refused.
        let spot = crate::mesh::load("tests/data/meshes/spot_829.obj".as_ref()).unwrap().mesh;
        let family = Family::of(&spot, &FamilyRecipe { seed: 16, ..Default::default() }).unwrap();
        assert!(family.members.iter().all(|member| thinnest(member) >= THINNEST));
    }

    const ALL: [Operation; 4] =
        [Operation::Subdivide, Operation::Simplify, Operation::Perturb, Operation::Flip];

    #[test]
    fn every_operation_keeps_the_topology_and_nearly_the_area() {
        let mesh = icosphere(2);
        for operations in ALL.map(|operation| vec![operation]).into_iter().chain([ALL.to_vec()]) {
            let recipe = FamilyRecipe { operations, ..recipe(3) };
            let family = Family::of(&mesh, &recipe).unwrap();
            assert_eq!(family, Family::of(&mesh, &recipe).unwrap(), "a seed repeats");
            let few = Family::of(&mesh, &FamilyRecipe { members: 2, ..recipe.clone() }).unwrap();
            assert_eq!(few.members, family.members[..2], "{recipe:?}");
            for member in &family.members {
                assert_eq!(kind(member), kind(&mesh));
                assert!(Topology::of(member).is_manifold() && Topology::of(member).is_oriented());
                assert_ne!(*member, mesh, "{recipe:?}");
                assert!(thinnest(member) > 0.01, "{recipe:?}: {}", thinnest(member));
                let ratio = member.area().0 / mesh.area().0;
                assert!((0.95..1.01).contains(&ratio), "{recipe:?}: {ratio}");
            }
        }
    }

    #[test]
    fn members_may_have_various_numbers_of_vertices() {
        let range = Resolution { fewest: 60, most: 140 };
        let recipe = FamilyRecipe { vertices: range, ..recipe(6) };
        let family = Family::of(&icosphere(2), &recipe).unwrap();
        let mut counts: Vec<usize> = family.members.iter().map(TriMesh::n).collect();
        assert!(counts.iter().all(|n| (55..=130).contains(n)), "{counts:?}");
        counts.sort_unstable();
        counts.dedup();
        assert!(counts.len() >= 4, "{counts:?}");
    }

    #[test]
    fn a_small_mesh_has_a_family_of_its_own_resolution_and_of_finer_ones() {
        let mesh = icosphere(1);
        for (operations, n) in [
            (vec![Operation::Perturb], 42..=42),
            (ALL.to_vec(), 110..=122),
            (vec![Operation::Subdivide], 162..=162),
        ] {
            let recipe = FamilyRecipe { operations, ..recipe(2) };
            for member in Family::of(&mesh, &recipe).unwrap().members {
                assert!(n.contains(&member.n()), "{recipe:?}: {}", member.n());
            }
        }
    }

    #[test]
    fn a_family_of_one_and_that_of_a_small_mesh_are_the_mesh() {
        let mesh = icosphere(1);
        assert_eq!(Family::of(&mesh, &recipe(1)).unwrap().members, std::slice::from_ref(&mesh));
        assert_eq!(Family::of(&mesh, &recipe(4)).unwrap().members, [mesh]);
    }
}
