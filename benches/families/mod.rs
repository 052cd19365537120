//! The families whose training is timed: variants of the cow with so many vertices.

use std::error::Error;
use std::path::Path;

use chladni::ggnn::features::{Normalise, coordinates};
use chladni::ggnn::predict::NetworkInput;
use chladni::ggnn::sample::{Member, Sample};
use chladni::mesh::{TriMesh, load};
use chladni::operators::{Boundary, MassKind, Operators};
use chladni::remesh::{Family, FamilyRecipe};
use chladni::spectrum::Dense;

/// So many variants of spot with about so many vertices, as training sees them.
pub fn spot(members: usize, vertices: usize) -> Result<Vec<Member>, Box<dyn Error>> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/meshes/spot_829.obj");
    // A family of one is the mesh itself.
    let drawn = members.max(2);
    let recipe =
        FamilyRecipe { members: drawn, vertices: vertices.into(), ..FamilyRecipe::default() };
    let member = |mesh: &TriMesh| {
        let operators = Operators::assemble(mesh, MassKind::Lumped)?;
        let input = NetworkInput::new(&coordinates(mesh, Normalise::Area), &operators.adjacency);
        Ok(Member::new(input, operators, Boundary::Neumann, 0.0))
    };
    let family = Family::of(&load(&path)?.mesh, &recipe)?;
    family.members.iter().take(members).map(member).collect()
}

/// A member with its constant known.
pub fn sample(member: &Member) -> Sample {
    Sample::new(member, &Dense::from_fn(member.input.n(), 1, |_, _| 1.0))
}
