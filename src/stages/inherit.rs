//! What becomes of the blocks of a mesh's previous version: the certificate decides.
//!
//! In this order, each only where the certificate of the one before was not passed, or it could not be done:
//! 1. *as they are*: they predict on the new mesh, by forward passes alone;
//! 2. *heads*: their trunks stay, and the heads are solved on the new mesh, in one pass over its vertices;
//! 3. *fine-tuning*: training goes on from their weights, on a family of the new mesh, for a part of the steps;
//! 4. training from nothing, which is the way of every mesh without a previous version.
//!
//! No vector of a reference enters any of them: a certificate says whether what was made is good enough, and nothing else.

use std::sync::Arc;
use std::time::Instant;

use super::assemble::Assembled;
use super::candidates::{self, Candidates, Grown, Made, Origin, Read, forward_work};
use super::context::Context;
use super::family::{self, Prepared, network_input};
use super::lineage::{self, Parent};
use super::train::{self, Chosen, InTraining, TrainedBlock};
use super::verify::{self, Verified};
use super::work::canonical;
use super::{Failure, models, refine, remesh, stand_in};
use crate::ggnn::Block;
use crate::ggnn::features::Features;
use crate::ggnn::heads::functions_on;
use crate::ggnn::sample::Member;
use crate::operators::Operators;
use crate::pipeline::RecipeName;
use crate::publish::result::Inheritance;
use crate::spectrum::cluster::zero_below;
use crate::spectrum::refine::rayleigh_ritz;
use crate::spectrum::{Dense, Pencil};

/// A mesh on its way through the stages of training.
#[derive(Debug)]
pub enum Way<T> {
    /// It has its certificate, and goes through them untouched.
    Settled(Box<Verified>),
    /// It is trained.
    Open(T),
}

impl<T> Way<T> {
    /// What `work` makes of a mesh that is trained.
    ///
    /// # Errors
    /// Those of `work`.
    pub fn and_then<U>(
        self,
        work: impl FnOnce(T) -> Result<U, Failure>,
    ) -> Result<Way<U>, Failure> {
        match self {
            Self::Settled(verified) => Ok(Way::Settled(verified)),
            Self::Open(load) => work(load).map(Way::Open),
        }
    }
}

impl Way<Verified> {
    /// At its end both are the same.
    pub fn arrived(self) -> Verified {
        match self {
            Self::Settled(verified) => *verified,
            Self::Open(verified) => verified,
        }
    }
}

/// Tries what the previous version of a mesh has, if it has one.
///
/// # Errors
/// When the run is interrupted or the mesh has used up its time.
pub fn inherit(
    context: &Context,
    item: usize,
    mut assembled: Assembled,
) -> Result<Way<Assembled>, Failure> {
    let Some(parent) = lineage::parent(context, &assembled.loaded) else {
        return Ok(Way::Open(assembled));
    };
    if remesh::multiplicity(context, &assembled)? != parent.description.known {
        // Every k would mean another eigenfunction.
        return Ok(Way::Open(assembled));
    }
    let mesh = assembled.loaded.job.name.clone();
    for step in Step::ALL {
        match attempt(context, item, assembled.clone(), &parent, step) {
            Ok(None) => {}
            // A plan does not know what comes of it: the certificate decides.
            Ok(Some((_, verified))) if verified.stands_in => {
                return Ok(Way::Settled(Box::new(verified)));
            }
            Ok(Some((model, verified))) if verified.judgement.is_verified() => {
                tracing::info!("{mesh}: {} ({})", step.recorded().in_words(), parent.name);
                lineage::record(context, &verified.assembled.loaded, &model, Some(&parent));
                return Ok(Way::Settled(Box::new(verified)));
            }
            Ok(Some((_, verified))) => {
                let reason = verified.judgement.reason();
                tracing::debug!(mesh, ?step, reason, "not good enough");
                assembled = verified.assembled;
            }
            Err(stop) if stop.ends_the_work() => return Err(stop),
            Err(failure) => tracing::debug!(mesh, ?step, %failure, "could not be done"),
        }
    }
    Ok(Way::Open(assembled))
}

/// What is tried with the blocks, from the least work to the most.
#[derive(Debug, Clone, Copy)]
enum Step {
    AsTheyAre,
    Heads,
    FineTuned,
}

impl Step {
    const ALL: [Self; 3] = [Self::AsTheyAre, Self::Heads, Self::FineTuned];

    /// As results tell of it.
    fn recorded(self) -> Inheritance {
        match self {
            Self::AsTheyAre => Inheritance::AsTheyAre,
            Self::Heads => Inheritance::Heads,
            Self::FineTuned => Inheritance::FineTuned,
        }
    }
}

/// What one step makes of the parent's blocks, certified, and the model that it uses; `None` when the parent has too few
/// blocks for it, or the options leave it out.
fn attempt(
    context: &Context,
    item: usize,
    assembled: Assembled,
    parent: &Arc<Parent>,
    step: Step,
) -> Result<Option<(String, Verified)>, Failure> {
    let k = assembled.loaded.k;
    let features = parent.features(&assembled.loaded);
    let grown = Grown { parent: parent.clone(), how: step.recorded() };
    let (model, candidates) = match (step, parent.blocks_to(k)) {
        (Step::AsTheyAre | Step::Heads, None) => return Ok(None),
        (Step::AsTheyAre, Some(blocks)) => {
            let made =
                candidates::forward(context, item, assembled, Read::Parents(&features), blocks)?;
            (parent.name.clone(), learned(made, blocks, grown))
        }
        (Step::Heads, Some(blocks)) => {
            let made = with_heads_solved_here(context, item, assembled, &features, blocks, parent)?;
            (parent.name.clone(), learned(made, blocks, grown))
        }
        (Step::FineTuned, _) => {
            let Some(trained) = fine_tuned(context, item, assembled, parent)? else {
                return Ok(None);
            };
            let Some(model) = models::remember(context, &trained) else { return Ok(None) };
            let InTraining { assembled, blocks, .. } = trained;
            let made =
                with_heads_solved_here(context, item, assembled, &features, &blocks, parent)?;
            (model, learned(made, &blocks, grown))
        }
    };
    let refined = refine::refine(context, item, candidates)?;
    Ok(Some((model, verify::verify(context, item, refined)?)))
}

fn learned(made: Made, blocks: &[TrainedBlock], grown: Grown) -> Candidates {
    let Made { assembled, vectors, digest } = made;
    let parent = &grown.parent;
    let origin = Origin::Learned {
        known: parent.description.known,
        blocks: blocks.to_vec(),
        chosen: Arc::new(Chosen { train: parent.train.clone(), recipe_file: None }),
        grown: Some(grown),
    };
    Candidates { assembled, vectors, digest, origin, refinement: None }
}

/// The eigenfunctions by the trunks of `blocks`, with heads that are solved on the mesh itself.
///
/// # Errors
/// When the features do not span them, or the run is interrupted.
fn with_heads_solved_here(
    context: &Context,
    item: usize,
    mut assembled: Assembled,
    features: &Features,
    blocks: &[TrainedBlock],
    parent: &Parent,
) -> Result<Made, Failure> {
    let started = Instant::now();
    let (boundary, train) = (context.pipeline.operators.boundary, &parent.train);
    let work = forward_work(context, &assembled, Read::Parents(features), blocks)
        .param("heads", "solved here")
        .param("ridge", train.ridge.to_string())
        .param("penalty", canonical(&train::penalty(context, train)));
    let (n, k) = (assembled.loaded.ingested.mesh.n(), assembled.loaded.k);
    let stand_in = || stand_in::functions(n, k);
    let recalled = context.recall_costly(item, work.seeded(0, "f32"), stand_in, || {
        let Assembled { operators, loaded, .. } = &assembled;
        let input = network_input(features, &loaded.ingested.mesh, operators);
        let own = Operators::clone(operators);
        let member = Member::new(input, own, boundary, train.boundary_penalty);
        let problem = assembled.problem(boundary)?;
        let zeros = problem.extend(problem.nullspace().clone());
        let blocks: Vec<Block> =
            blocks.iter().map(|trained| Block::clone(&trained.block)).collect();
        let functions = functions_on(&member, &zeros, &blocks, train.ridge);
        let projected = |phi: &Dense| Pencil::from(&**operators).projected(phi);
        let zero = zero_below(operators.area.0);
        let pairs = functions
            .and_then(|functions| rayleigh_ritz(projected, &functions, zeros.ncols(), zero))
            .ok_or(Failure::Dependent)?;
        Ok((&pairs.vectors).into())
    })?;
    assembled.loaded.spent("heads", recalled.how, started.elapsed());
    Ok(Made { assembled, vectors: recalled.artifact.into(), digest: recalled.digest })
}

/// Goes on with the training of the parent's blocks on a family of the mesh; `None` where that is not wanted, or where the recipe
/// has no steps of which a part could be done.
///
/// # Errors
/// When training fails or is interrupted.
fn fine_tuned(
    context: &Context,
    item: usize,
    assembled: Assembled,
    parent: &Arc<Parent>,
) -> Result<Option<InTraining>, Failure> {
    let train = parent.train.clone();
    if train.fine_tune == 0.0 || train.recipe != RecipeName::Ritz {
        return Ok(None);
    }
    let features = parent.features(&assembled.loaded);
    let familied = remesh::remesh(context, item, assembled)?;
    let Prepared { assembled, training } = family::prepare(context, item, familied)?;
    let training = training.under(train.boundary_penalty).reading(features);
    let chosen = Chosen { train, recipe_file: None };
    let mut state = InTraining::new(Prepared { assembled, training }, chosen).from(parent.clone());
    for k in 1..=state.assembled.loaded.k {
        state = train::train(context, item, k, state)?;
    }
    Ok(Some(state))
}
