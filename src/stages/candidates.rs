//! The eigenfunctions that are to be verified, from a model's prediction or from the reference solver itself.

use std::sync::Arc;
use std::time::Instant;

use super::Failure;
use super::artifacts::PredictionArtifact;
use super::assemble::Assembled;
use super::context::{Context, Recalled};
use super::family::{TrainingSet, network_input};
use super::lineage::Parent;
use super::predict::Predicted;
use super::refine::Refinement;
use super::train::{Chosen, InTraining, TrainedBlock};
use super::work::{PARENTS_FRAME, Work, canonical};
use super::{lineage, models, predict, reference, stand_in, warm};
use crate::flow::events::How;
use crate::ggnn::Block;
use crate::ggnn::features::Features;
use crate::ggnn::predict::predict_all;
use crate::operators::Operators;
use crate::pipeline::Method;
use crate::publish::result::{Ancestor, Inheritance};
use crate::spectrum::Dense;
use crate::spectrum::certificate::SecondOpinion;
use crate::spectrum::fem::Reference;
use crate::store::Digest;

/// A mesh with K functions that may be its eigenfunctions.
#[derive(Debug, Clone)]
pub struct Candidates {
    /// The mesh.
    pub assembled: Assembled,
    /// φ₁ … φ_K, n×K, unit B-norm in input units.
    pub vectors: Dense,
    /// Of what they were made from.
    pub digest: Digest,
    /// Where they come from.
    pub origin: Origin,
    /// What a solver made of learned ones.
    pub refinement: Option<Refinement>,
}

/// How functions came from the blocks of a mesh's previous version.
#[derive(Debug, Clone)]
pub struct Grown {
    /// The model that they came from.
    pub parent: Arc<Parent>,
    /// By what.
    pub how: Inheritance,
}

impl Grown {
    fn ancestor(&self) -> Ancestor {
        Ancestor { mesh: self.parent.mesh(), how: self.how }
    }
}

/// Where candidates come from.
#[derive(Debug, Clone)]
pub enum Origin {
    /// A model was trained for the mesh.
    Learned {
        /// How many of the first are known in advance: the eigenfunctions of λ = 0.
        known: usize,
        /// The blocks of the others.
        blocks: Vec<TrainedBlock>,
        /// The options that they were trained by.
        chosen: Arc<Chosen>,
        /// What they grew from; nothing where they were trained for the mesh from the start.
        grown: Option<Grown>,
    },
    /// A given model.
    Predicted {
        /// How many of the first are known in advance: the eigenfunctions of λ = 0.
        known: usize,
        /// Predicted in this run or reused.
        how: How,
    },
    /// The reference solver.
    Fem {
        /// Its pairs and its count.
        reference: Box<Reference>,
        /// Solved in this run or reused.
        how: How,
        /// What it began with; nothing where it began with nothing.
        grown: Option<Ancestor>,
    },
    /// M-PGD.
    Mpgd {
        /// Its pairs and how it went.
        opinion: Box<SecondOpinion>,
        /// Solved in this run or reused.
        how: How,
    },
}

impl Origin {
    /// The options that blocks were trained by, where any were.
    pub fn chosen(&self) -> Option<&Chosen> {
        match self {
            Self::Learned { chosen, .. } => Some(chosen),
            Self::Predicted { .. } | Self::Fem { .. } | Self::Mpgd { .. } => None,
        }
    }

    /// The previous version that they grew from, if they did.
    pub fn ancestor(&self) -> Option<Ancestor> {
        match self {
            Self::Learned { grown, .. } => grown.as_ref().map(Grown::ancestor),
            Self::Fem { grown, .. } => *grown,
            Self::Predicted { .. } | Self::Mpgd { .. } => None,
        }
    }
}

/// Predicts the eigenfunctions of the mesh with its blocks.
///
/// # Errors
/// When the run is interrupted.
pub fn predict(context: &Context, item: usize, trained: InTraining) -> Result<Candidates, Failure> {
    let model = models::remember(context, &trained);
    if let Some(model) = model {
        lineage::record(context, &trained.assembled.loaded, &model, None);
    }
    let known = trained.known();
    let InTraining { assembled, blocks, training, chosen, .. } = trained;
    let Made { assembled, vectors, digest } =
        forward(context, item, assembled, Read::Own(&training), &blocks)?;
    let origin = Origin::Learned { known, blocks, chosen, grown: None };
    Ok(Candidates { assembled, vectors, digest, origin, refinement: None })
}

/// A mesh with functions of its own.
#[derive(Debug)]
pub struct Made {
    /// The mesh.
    pub assembled: Assembled,
    /// φ₁ … φ_K, n×K, unit B-norm in input units.
    pub vectors: Dense,
    /// Of the functions.
    pub digest: Digest,
}

/// What blocks read of a mesh.
#[derive(Debug, Clone, Copy)]
pub enum Read<'a> {
    /// What follows from the mesh and the options; it may take a while to make, and most runs find the functions in the store.
    Own(&'a TrainingSet),
    /// What the blocks of a previous version read: in its frame, or from its landmarks.
    Parents(&'a Features),
}

impl Read<'_> {
    fn features(&self) -> &Features {
        match self {
            Self::Own(training) => training.features(),
            Self::Parents(features) => features,
        }
    }
}

/// The functions that `blocks` predict on the mesh.
///
/// # Errors
/// When the run is interrupted.
pub fn forward(
    context: &Context,
    item: usize,
    mut assembled: Assembled,
    read: Read<'_>,
    blocks: &[TrainedBlock],
) -> Result<Made, Failure> {
    let started = Instant::now();
    let boundary = context.pipeline.operators.boundary;
    let work = forward_work(context, &assembled, read, blocks);
    let (n, k) = (assembled.loaded.ingested.mesh.n(), assembled.loaded.k);
    let stand_in = || stand_in::functions(n, k);
    let recalled = context.recall_costly(item, work.seeded(0, "f32"), stand_in, || {
        let operators = &assembled.operators;
        let input = network_input(read.features(), &assembled.loaded.ingested.mesh, operators)
            .with_zeros_at(boundary.fixed(&operators.boundary));
        let blocks: Vec<&Block> = blocks.iter().map(|trained| &*trained.block).collect();
        let problem = assembled.problem(boundary)?;
        let zeros = problem.extend(problem.nullspace().clone());
        let zeros = zeros.subcols(0, zeros.ncols().min(k)).to_owned();
        Ok((&predict_all(&zeros, &blocks, &input, &operators.mass)).into())
    })?;
    assembled.loaded.spent("predict", recalled.how, started.elapsed());
    Ok(Made { assembled, vectors: recalled.artifact.into(), digest: recalled.digest })
}

/// What functions on the mesh depend on that `blocks` have made.
pub fn forward_work(
    context: &Context,
    assembled: &Assembled,
    read: Read<'_>,
    blocks: &[TrainedBlock],
) -> Work<PredictionArtifact> {
    let work = Work::<PredictionArtifact>::of_stage()
        .param("features", canonical(&context.pipeline.features.effective()))
        .param("boundary", context.pipeline.operators.boundary.name())
        .param("k", assembled.loaded.k.to_string())
        .input("mesh", &assembled.loaded.digest())
        .input("operators", &assembled.operators_digest);
    let work = match read {
        Read::Own(_) => work,
        Read::Parents(features) => work.input(PARENTS_FRAME, &Digest::of(&canonical(features))),
    };
    blocks.iter().fold(work, |work, block| work.input(format!("block {}", block.k), &block.digest))
}

/// Predicts the eigenfunctions of the mesh with the model of the run.
///
/// # Errors
/// As [`predict::predict`].
pub fn apply(context: &Context, item: usize, assembled: Assembled) -> Result<Candidates, Failure> {
    let Assembled { loaded, operators, operators_digest } = assembled;
    let predicted = predict::predict(context, item, loaded)?;
    for doubt in predicted.doubts(context.pipeline.train.refine) {
        tracing::warn!(mesh = predicted.loaded.job.name, "{doubt}");
    }
    Ok(predicted.with_operators(operators, operators_digest))
}

impl Predicted {
    /// As candidates to be verified.
    pub fn with_operators(self, operators: Arc<Operators>, operators_digest: Digest) -> Candidates {
        Candidates {
            assembled: Assembled { loaded: self.loaded, operators, operators_digest },
            vectors: self.vectors,
            digest: self.digest,
            origin: Origin::Predicted { known: self.known, how: self.how },
            refinement: self.refinement,
        }
    }
}

/// Solves for the eigenfunctions of the mesh.
///
/// # Errors
/// When the mesh cannot have the boundary condition, the solver fails, or the run is interrupted.
pub fn solve(
    context: &Context,
    item: usize,
    mut assembled: Assembled,
) -> Result<Candidates, Failure> {
    let k = assembled.loaded.k;
    let (vectors, digest, how, spent, origin) = match context.pipeline.train.method {
        Method::Mpgd => {
            let Recalled { artifact, digest, how, spent, .. } =
                reference::mpgd(context, item, &assembled, k)?;
            let opinion = Box::new(SecondOpinion::from(artifact));
            let vectors = opinion.pairs.vectors.clone();
            (vectors, digest, how, spent, Origin::Mpgd { opinion, how })
        }
        Method::Fem | Method::LepDpinn | Method::Predict => {
            let (recalled, grown) = warm::fem(context, item, &assembled)?;
            let Recalled { artifact, digest, how, spent, .. } = recalled;
            let reference = Box::new(Reference::from(artifact));
            let vectors = reference.pairs.vectors.subcols(0, k).to_owned();
            (vectors, digest, how, spent, Origin::Fem { reference, how, grown })
        }
    };
    assembled.loaded.spent("solve", how, spent);
    let vectors = assembled.problem(context.pipeline.operators.boundary)?.extend(vectors);
    Ok(Candidates { assembled, vectors, digest, origin, refinement: None })
}
