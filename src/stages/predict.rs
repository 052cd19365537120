//! Prediction with a trained model: from coordinates and adjacency to eigenfunctions, with no L and no B assembled.
//!
//! What is built of the mesh: the neighbours of every vertex with the weights 1/degree, which is W of (5); angles and areas
//! of the triangles; the values of the functions. Deflation and normalisation take vertex areas, λ is one pass over the
//! triangles ([`TrianglePencil`]).

use std::sync::Arc;
use std::time::Instant;

use super::artifacts::PredictionArtifact;
use super::context::Context;
use super::ingest::Loaded;
use super::refine::Refinement;
use super::work::{Work, canonical};
use super::{Failure, stand_in};
use crate::flow::events::How;
use crate::ggnn::model::Unlike;
use crate::ggnn::predict::{NetworkInput, predict_all};
use crate::ggnn::{Block, Model};
use crate::mesh::TriMesh;
use crate::mesh::topology::component_labels;
use crate::pipeline::Refine;
use crate::spectrum::nullspace::free_nullspace;
use crate::spectrum::pencil::{InnerProduct, inner};
use crate::spectrum::{Dense, TrianglePencil};
use crate::store::Digest;

/// A model that a run predicts with.
#[derive(Debug, Clone)]
pub struct GivenModel {
    /// Its name in the store, or its file.
    pub name: String,
    /// The model.
    pub model: Model,
    /// Of its file.
    pub digest: Digest,
}

impl GivenModel {
    /// A model as it is given to a run.
    pub fn new(name: String, model: Model) -> Arc<Self> {
        let digest = Digest::of(&model.to_bytes());
        Arc::new(Self { name, model, digest })
    }
}

/// A mesh with K predicted eigenfunctions.
#[derive(Debug, Clone)]
pub struct Predicted {
    /// The mesh.
    pub loaded: Loaded,
    /// L and B as sums over its triangles, in input units.
    pub pencil: TrianglePencil,
    /// φ₁ … φ_K, n×K, unit B-norm in input units.
    pub vectors: Dense,
    /// Of the functions.
    pub digest: Digest,
    /// How many of the first are known in advance: the eigenfunctions of λ = 0.
    pub known: usize,
    /// What speaks against them.
    pub unlike: Vec<Unlike>,
    /// Predicted in this run or reused.
    pub how: How,
    /// What a solver made of them.
    pub refinement: Option<Refinement>,
}

/// A predicted eigenvalue this much below the one before it is none of the mesh.
const DESCENT: f64 = 0.9;

impl Predicted {
    /// What speaks against them, in words; of those that are refined the order of the predictions says nothing.
    pub fn doubts(&self, refine: Refine) -> Vec<String> {
        let mut doubts: Vec<String> = self.unlike.iter().map(ToString::to_string).collect();
        if refine == Refine::None && self.descend() {
            doubts.push(
                "the predicted eigenvalues do not ascend: this is hardly another sampling of the shape that the model has learned; \
                 train.refine = \"rayleigh-ritz\" (predict --refine) makes the best of its predictions"
                    .into(),
            );
        }
        doubts
    }

    fn descend(&self) -> bool {
        let lambdas = self.pencil.rayleigh_quotients(&self.vectors);
        let unknown = lambdas.get(self.known..).unwrap_or_default();
        unknown.windows(2).any(|pair| pair[1] < DESCENT * pair[0])
    }

    /// max |ΦᵀBΦ − I| of the predictions, or of what they were refined to.
    pub fn orthonormality(&self) -> f64 {
        let vectors = self.refinement.as_ref().map_or(&self.vectors, |r| &r.pairs.vectors);
        let gram = inner(vectors, &self.pencil.product(vectors));
        (&gram - &Dense::identity(gram.nrows(), gram.ncols())).norm_max()
    }
}

/// Predicts the first K eigenfunctions of a mesh with the model of the run.
///
/// # Errors
/// When the model does not fit the mesh, the mesh has triangles without angles, or the run is interrupted.
pub fn predict(context: &Context, item: usize, mut loaded: Loaded) -> Result<Predicted, Failure> {
    let started = Instant::now();
    let given = context.model.as_ref().ok_or(Failure::NoModel)?;
    let (k, operators) = (loaded.k, context.pipeline.operators);
    let ingested = loaded.ingested.clone();
    given.model.check_boundary(operators.boundary)?;
    let unlike = given.model.check(&ingested.mesh, &ingested.topology, k)?;
    let pencil = TrianglePencil::of_mesh(&ingested.mesh, operators)?;
    let work = Work::<PredictionArtifact>::of_stage()
        .param("operators", canonical(&operators))
        .param("k", k.to_string())
        .input("mesh", &loaded.digest())
        .input("model", &given.digest);
    let stand_in = || stand_in::functions(ingested.mesh.n(), k);
    let recalled = context.recall_costly(item, work.seeded(0, "f32"), stand_in, || {
        let fixed = operators.boundary.fixed(&ingested.topology.boundary_vertices);
        let vectors = forward(&given.model, &ingested.mesh, fixed, &pencil, k);
        let first = (0..vectors.ncols()).find(|&j| !vectors.col(j).iter().all(|v| v.is_finite()));
        match first {
            Some(j) => Err(Failure::NotPredicted { k: j + 1 }),
            None => Ok((&vectors).into()),
        }
    })?;
    loaded.spent("predict", recalled.how, started.elapsed());
    Ok(Predicted {
        loaded,
        pencil,
        vectors: recalled.artifact.into(),
        digest: recalled.digest,
        known: given.model.description.known.min(k),
        unlike,
        how: recalled.how,
        refinement: None,
    })
}

/// The first `k` eigenfunctions on a mesh that the model fits, n×k; 0 at the vertices `fixed`.
fn forward(
    model: &Model,
    mesh: &TriMesh,
    fixed: &[u32],
    pencil: &TrianglePencil,
    k: usize,
) -> Dense {
    let zeros = free_nullspace(&component_labels(mesh), fixed, pencil);
    let known = zeros.ncols().min(k);
    let features = model.description.features.read_anywhere(mesh);
    let blocks: Vec<&Block> = model.blocks.iter().take(k - known).collect();
    let input = NetworkInput::read_by(&blocks, &features, mesh).with_zeros_at(fixed);
    predict_all(&zeros.subcols(0, known).to_owned(), &blocks, &input, pencil)
}
