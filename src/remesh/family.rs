//! A family: seeded variants of one mesh that keep its topology.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::simplify::simplify;
use crate::mesh::trimesh::{dot, sub, triangle_area};
use crate::mesh::{Topology, TriMesh};

/// Which variants to make.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct FamilyRecipe {
    /// How many meshes; 1 is the mesh itself.
    pub members: usize,
    /// About how many vertices each; at most three quarters of the mesh's own. A mesh that has no more than this
    /// itself is its own family: coarser variants of it would be another shape.
    pub vertices: usize,
    /// How far vertices move, in mean edge lengths, while the collapses are chosen.
    pub jitter: f64,
    /// Seeds the perturbations.
    pub seed: u64,
}

impl Default for FamilyRecipe {
    /// The values that `docs/training.md` arrives at; on a mesh of fewer vertices the cap on their share rules.
    fn default() -> Self {
        Self { members: 8, vertices: 620, jitter: 0.3, seed: 0 }
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
        "none of {draws} simplifications to {vertices} vertices and more kept the topology of the mesh without \
         collapsed triangles; set family.members = 1 to train on the mesh alone"
    )]
    Topology { draws: usize, vertices: usize },
}

/// Draws before a member is given up.
const DRAWS: usize = 32;

/// Draws before they become gentler, and again after as many more.
const DRAWS_AS_ASKED: usize = 8;

/// A member has at most this share of the mesh's vertices.
const LARGEST_SHARE: f64 = 0.75;

/// A variant with a triangle thinner than this is drawn again, unless the mesh has such triangles itself: one
/// collapsed triangle's cotangents swamp the stiffness of all others.
const THINNEST: f64 = 1e-3;

impl Family {
    /// Makes the family of `mesh`.
    ///
    /// Every member has its own random stream, so that member i does not depend on how many others there are. Draws
    /// that fail are followed by gentler ones: less jitter, more vertices.
    ///
    /// # Errors
    /// [`FamilyError::Topology`] when no draw for some member keeps the topology.
    pub fn of(mesh: &TriMesh, recipe: &FamilyRecipe) -> Result<Self, FamilyError> {
        if recipe.members <= 1 || mesh.n() <= recipe.vertices {
            return Ok(Self { members: vec![mesh.clone()] });
        }
        let vertices = recipe.vertices.min((LARGEST_SHARE * mesh.n() as f64) as usize);
        let wanted = kind(mesh);
        let thin = THINNEST.min(0.1 * thinnest(mesh));
        let members = (0..recipe.members as u64)
            .map(|member| {
                let mut rng = ChaCha8Rng::seed_from_u64(recipe.seed);
                rng.set_stream(member);
                (0..DRAWS)
                    .filter_map(|draw| {
                        // 0 for the first draws, then 1, 2, …
                        let gentler = (draw / DRAWS_AS_ASKED) as i32;
                        let kept = 1.0 - 0.5_f64.powi(gentler);
                        let vertices = vertices + (kept * (mesh.n() - vertices) as f64) as usize;
                        let jitter = recipe.jitter * 0.25_f64.powi(gentler);
                        simplify(mesh, vertices, jitter, &mut rng).ok()
                    })
                    .find(|variant| kind(variant) == wanted && thinnest(variant) >= thin)
                    .ok_or(FamilyError::Topology { draws: DRAWS, vertices })
            })
            .collect::<Result<_, _>>()?;
        Ok(Self { members })
    }
}

/// The smallest ratio of area to squared longest edge over all triangles: √3/4 for equilateral ones, 0 for
/// collapsed ones.
fn thinnest(mesh: &TriMesh) -> f64 {
    let ratio = |face: &[u32; 3]| {
        let corners @ [a, b, c] = mesh.corners(*face);
        let longest = [sub(a, b), sub(b, c), sub(c, a)].map(|edge| dot(edge, edge));
        triangle_area(corners) / longest.into_iter().fold(f64::MIN_POSITIVE, f64::max)
    };
    mesh.faces().iter().map(ratio).fold(f64::INFINITY, f64::min)
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
        FamilyRecipe { members, vertices: 120, jitter: 0.3, seed: 5 }
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

    #[test]
    fn a_family_of_one_and_that_of_a_small_mesh_are_the_mesh() {
        let mesh = icosphere(1);
        assert_eq!(Family::of(&mesh, &recipe(1)).unwrap().members, std::slice::from_ref(&mesh));
        assert_eq!(Family::of(&mesh, &recipe(4)).unwrap().members, [mesh]);
    }
}
