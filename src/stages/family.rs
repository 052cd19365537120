//! What training may see of a mesh: its family with operators, and nothing of any reference.

use std::sync::{Arc, OnceLock};
use std::time::Instant;

use rayon::prelude::*;

use super::Failure;
use super::assemble::{Assembled, operators_of};
use super::context::Context;
use super::remesh::{Familied, Surface};
use crate::flow::events::How;
use crate::ggnn::features::{FeatureOptions, Features};
use crate::ggnn::predict::NetworkInput;
use crate::ggnn::sample::Member;
use crate::mesh::TriMesh;
use crate::mesh::closest::ClosestPoint;
use crate::mesh::topology::component_labels;
use crate::operators::{Boundary, OperatorOptions, Operators};
use crate::pipeline::RecipeName;
use crate::remesh::{Family, refined};
use crate::spectrum::Dense;
use crate::spectrum::nullspace::free_nullspace;
use crate::store::Digest;

/// All that training may see: the family, nothing of any reference. What only a training needs is made when the first asks
/// for it: most runs find their blocks in the store.
#[derive(Debug)]
pub struct TrainingSet {
    /// Of the family's meshes.
    pub family_digest: Digest,
    /// Of the operators of each member.
    pub operators_digests: Vec<Digest>,
    /// How many eigenfunctions of λ = 0 there are, on every member as on the mesh.
    pub known: usize,
    /// What the members are samplings of.
    pub surface: Arc<Surface>,
    options: FeatureOptions,
    boundary: Boundary,
    /// Whether Dirichlet conditions are built into the members, or asked for by the recipe's loss.
    recipe: RecipeName,
    /// What holds the network to 0 on a Dirichlet boundary.
    penalty: f64,
    family: Arc<Family>,
    operators: Vec<Operators>,
    features: OnceLock<Features>,
    seen: OnceLock<Seen>,
    finer: OnceLock<Seen>,
    head_subdivisions: usize,
    assembly: OperatorOptions,
}

/// A mesh with all that its training may see.
#[derive(Debug)]
pub struct Prepared {
    /// The mesh.
    pub assembled: Assembled,
    /// What training may see.
    pub training: TrainingSet,
}

/// A family as training sees it.
#[derive(Debug)]
pub struct Seen {
    /// The members, scaled to unit area.
    pub members: Vec<Member>,
    /// The eigenfunctions of λ = 0 on every member.
    pub nullspaces: Vec<Dense>,
}

impl TrainingSet {
    /// What the network reads of the members, and of every other mesh of the shape.
    pub fn features(&self) -> &Features {
        self.features.get_or_init(|| Features::of(self.surface.mesh(), self.options))
    }

    /// The family as training sees it.
    pub fn seen(&self) -> &Seen {
        self.seen.get_or_init(|| self.seen_under(self.penalty))
    }

    /// The family as training would see it under another penalty.
    pub fn seen_under(&self, penalty: f64) -> Seen {
        let family = self.family.members.iter().zip(&self.operators);
        let member = |(mesh, own)| self.member(mesh, own, penalty);
        let (members, nullspaces) = family.map(member).unzip();
        Seen { members, nullspaces }
    }

    /// The same training under another penalty.
    pub fn under(self, penalty: f64) -> Self {
        if penalty == self.penalty {
            return self;
        }
        Self { penalty, seen: OnceLock::new(), finer: OnceLock::new(), ..self }
    }

    /// The same training by a network that reads `features`.
    pub fn reading(self, features: Features) -> Self {
        Self {
            features: OnceLock::from(features),
            seen: OnceLock::new(),
            finer: OnceLock::new(),
            ..self
        }
    }

    /// How many members there are.
    pub fn members(&self) -> usize {
        self.family.members.len()
    }

    /// The family on finer samplings, where the heads of trunks are solved for the last time; `None` where they keep
    /// those of training.
    ///
    /// # Errors
    /// When a sampling has no operators.
    pub fn finer(&self) -> Result<Option<&Seen>, Failure> {
        if self.head_subdivisions == 0 {
            return Ok(None);
        }
        if let Some(finer) = self.finer.get() {
            return Ok(Some(finer));
        }
        let surface = ClosestPoint::on(self.surface.mesh());
        let one = |variant: &TriMesh| {
            let mesh = refined(variant, &surface, self.head_subdivisions);
            let operators = Operators::assemble(&mesh, self.assembly)?;
            Ok(self.member(&mesh, &operators, self.penalty))
        };
        let members: Result<Vec<_>, Failure> = self.family.members.par_iter().map(one).collect();
        let (members, nullspaces) = members?.into_iter().unzip();
        Ok(Some(self.finer.get_or_init(|| Seen { members, nullspaces })))
    }

    fn member(&self, mesh: &TriMesh, operators: &Operators, penalty: f64) -> (Member, Dense) {
        let fixed = self.boundary.fixed(&operators.boundary).to_vec();
        let input = network_input(self.features(), mesh, operators);
        let (operators, boundary) = (operators.clone(), self.boundary);
        let member = match self.recipe {
            RecipeName::Ritz => Member::new(input, operators, boundary, penalty),
            RecipeName::Paper => Member::whole(input, operators, boundary),
        };
        let nullspace = free_nullspace(&component_labels(mesh), &fixed, &member.mass);
        (member, nullspace)
    }
}

/// Assembles or recalls the operators of a family.
///
/// # Errors
/// When a member has no operators or too few free vertices for K eigenpairs, or the run is interrupted.
pub fn prepare(context: &Context, item: usize, familied: Familied) -> Result<Prepared, Failure> {
    let started = Instant::now();
    let Familied { mut assembled, family, family_digest, surface, known } = familied;
    let (options, train) = (context.pipeline.operators, &context.pipeline.train);
    let (mut operators, mut operators_digests) = (Vec::new(), Vec::new());
    let mut how = How::Reused;
    for mesh in &family.members {
        let recalled = operators_of(context, item, mesh)?;
        if recalled.how == How::Computed {
            how = How::Computed;
        }
        let own = Operators::from(recalled.artifact);
        let (n, k) = (mesh.n() - options.boundary.fixed(&own.boundary).len(), assembled.loaded.k);
        if n < k {
            return Err(Failure::CoarseFamily { n, k });
        }
        operators.push(own);
        operators_digests.push(recalled.digest);
    }
    assembled.loaded.spent("assemble family", how, started.elapsed());
    let training = TrainingSet {
        family_digest,
        operators_digests,
        known,
        surface,
        options: context.pipeline.features,
        boundary: options.boundary,
        recipe: train.recipe,
        penalty: train.boundary_penalty,
        family,
        operators,
        features: OnceLock::new(),
        seen: OnceLock::new(),
        finer: OnceLock::new(),
        head_subdivisions: train.head_subdivisions,
        assembly: options,
    };
    Ok(Prepared { assembled, training })
}

/// What the network reads of a mesh.
pub fn network_input(features: &Features, mesh: &TriMesh, operators: &Operators) -> NetworkInput {
    NetworkInput::new(&features.read(mesh), &operators.adjacency)
}
