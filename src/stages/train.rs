//! Training: the stage that stands K times in the chain, once for every eigenfunction. Where each has a trunk of its own, a
//! call trains one block; where all share a trunk, the first call trains all of them and the others find theirs there.

use std::ops::RangeInclusive;
use std::sync::Arc;
use std::time::Instant;

use rayon::prelude::*;
use tokio_util::sync::CancellationToken;
use tracing_indicatif::span_ext::IndicatifSpanExt;

use super::Failure;
use super::artifacts::TrunkArtifact;
use super::assemble::Assembled;
use super::context::{Context, Work, canonical};
use super::family::{Seen, TrainingSet};
use crate::flow::events::How;
use crate::ggnn::Block;
use crate::ggnn::features::Input;
use crate::ggnn::heads::solve_heads;
use crate::ggnn::paper::{self, train_block};
use crate::ggnn::predict::append_next;
use crate::ggnn::recipe::{Recipe, Ritz, Trunks};
use crate::ggnn::sample::{Member, Sample};
use crate::ggnn::train::{Observer, TrainError, train_blocks};
use crate::operators::Boundary;
use crate::pipeline::Pipeline;
use crate::spectrum::Dense;
use crate::store::{CacheKey, Digest};

/// A mesh whose first blocks are trained.
#[derive(Debug, Clone)]
pub struct InTraining {
    /// The mesh.
    pub assembled: Assembled,
    /// What training may see.
    pub training: Arc<TrainingSet>,
    /// The blocks so far, in the order of their eigenfunctions.
    pub blocks: Vec<TrainedBlock>,
    /// The eigenfunctions so far on every member: as many as training has needed; none before the first training.
    earlier: Vec<Dense>,
}

/// A block with where it came from.
#[derive(Debug, Clone)]
pub struct TrainedBlock {
    /// Which eigenfunction it predicts, counted from 1.
    pub k: usize,
    /// The block.
    pub block: Arc<Block>,
    /// Where the store has its trunk, with it and all other heads.
    pub key: CacheKey,
    /// Of the trunk with its heads.
    pub digest: Digest,
    /// Trained in this run or reused.
    pub how: How,
    /// Seconds spent on it in this run; the heads of a trunk share its time evenly.
    pub seconds: f64,
}

impl InTraining {
    /// A mesh none of whose blocks is trained yet.
    pub fn new(assembled: Assembled, training: TrainingSet) -> Self {
        let training = Arc::new(training);
        Self { assembled, training, blocks: Vec::new(), earlier: Vec::new() }
    }

    /// How many eigenfunctions need no block: those of λ = 0.
    pub fn known(&self) -> usize {
        self.training.known
    }

    /// The last eigenfunction that there is a block for, or that needs none.
    fn reached(&self) -> usize {
        self.known() + self.blocks.len()
    }
}

/// Trains or recalls the block for φ_k, and with it those on the same trunk. Eigenfunctions of λ = 0 have none.
///
/// # Errors
/// When training fails or is interrupted.
pub fn train(
    context: &Context,
    item: usize,
    k: usize,
    mut state: InTraining,
) -> Result<InTraining, Failure> {
    if k <= state.reached() {
        return Ok(state);
    }
    let started = Instant::now();
    let options = &context.pipeline.train;
    let recipe = options.recipe(context.pipeline.features.inputs());
    let wanted = match options.trunk {
        Trunks::PerEigenfunction => k..=k,
        Trunks::Shared => k..=options.k,
    };
    let work = work(context, &state, &recipe, &wanted).seeded(options.seed, "f32");
    let recalled = context.recall(item, work, || {
        let blocks = trained(context, &mut state, &recipe, &wanted)?;
        Ok(TrunkArtifact::of(&blocks))
    })?;
    let (spent, functions) = (started.elapsed(), named(&wanted));
    let mesh = &state.assembled.loaded.job.name;
    let seconds = spent.as_secs_f64();
    tracing::debug!(mesh, functions, how = ?recalled.how, seconds, "trained");
    let (key, digest, how) = (recalled.key, recalled.digest, recalled.how);
    let blocks = recalled.artifact.into_blocks();
    let seconds = seconds / blocks.len() as f64;
    state.blocks.extend(wanted.zip(blocks).map(|(k, block)| {
        let block = Arc::new(block);
        TrainedBlock { k, block, key, digest, how, seconds }
    }));
    state.assembled.loaded.spent(format!("train {functions}"), how, spent);
    Ok(state)
}

/// What the blocks for φ of `wanted` depend on: a trunk of its own on the blocks before it, a shared one on K.
fn work(
    context: &Context,
    state: &InTraining,
    recipe: &Recipe,
    wanted: &RangeInclusive<usize>,
) -> Work<TrunkArtifact> {
    let Pipeline { features, operators, train, .. } = &context.pipeline;
    let (training, trunk) = (&state.training, train.trunk);
    let penalty = match operators.boundary {
        Boundary::Neumann => None,
        Boundary::Dirichlet => Some(train.boundary_penalty),
    };
    let mut work = Work::of_stage()
        .param("trunk", trunk.name())
        .param("recipe", canonical(recipe))
        .param("penalty", canonical(&penalty))
        .param("head subdivisions", train.head_subdivisions.to_string())
        .param("features", canonical(&features.effective()))
        .input("family", &training.family_digest);
    if features.input != Input::EdgeLengths || train.head_subdivisions > 0 {
        // Its frame, its landmarks, or the surface that finer samplings lie on.
        work = work.input("mesh", &state.assembled.loaded.digest());
    }
    let members = training.operators_digests.iter();
    let work = members.fold(work, |work, operators| work.input("operators", operators));
    match trunk {
        Trunks::PerEigenfunction => {
            let earlier = state.blocks.iter();
            earlier.fold(work.part(*wanted.start()), |work, earlier| {
                work.input(format!("block {}", earlier.k), &earlier.digest)
            })
        }
        Trunks::Shared => work.param("k", wanted.end().to_string()),
    }
}

/// Trains the blocks for φ of `wanted` on one trunk, against all that is known before them.
fn trained(
    context: &Context,
    state: &mut InTraining,
    recipe: &Recipe,
    wanted: &RangeInclusive<usize>,
) -> Result<Vec<Block>, Failure> {
    let mesh = &state.assembled.loaded.job.name;
    let progress = Progress::new(mesh, wanted, recipe.reports(), &context.cancel);
    let Seen { members, nullspaces } = state.training.seen();
    if state.earlier.is_empty() {
        state.earlier.clone_from(nullspaces);
    }
    catch_up(members, &state.blocks, state.training.known, &mut state.earlier);
    let members = members.iter().zip(&state.earlier);
    let seed = trunk_seed(context.pipeline.train.seed, *wanted.start());
    let blocks = match recipe {
        Recipe::Ritz(recipe) => {
            let (heads, width) = (wanted.clone().count(), recipe.shape.width);
            if heads > width {
                return Err(Failure::NarrowTrunk { heads, width });
            }
            let samples = members.map(|(member, earlier)| Sample::new(member, earlier)).collect();
            let finer = state.training.finer()?;
            train_blocks(samples, recipe, heads, seed, &progress).and_then(|blocks| match finer {
                None => Ok(blocks),
                Some(finer) => heads_on(finer, &blocks, recipe),
            })
        }
        Recipe::Paper(recipe) => {
            // Under the Neumann condition, the only one so far, no vertex is held.
            let sample = |(member, earlier)| paper::Sample::new(member, vec![], earlier);
            let samples: Vec<_> = members.map(sample).collect();
            train_block(&samples, recipe, seed, &progress).map(|block| vec![block])
        }
    };
    blocks.map_err(|source| match source {
        TrainError::Cancelled => Failure::Interrupted,
        source => Failure::Train { functions: named(wanted), source },
    })
}

/// The blocks of a shared trunk with heads for other samplings.
fn heads_on(finer: &Seen, blocks: &[Block], recipe: &Ritz) -> Result<Vec<Block>, TrainError> {
    let members = finer.members.iter().zip(&finer.nullspaces);
    let samples: Vec<_> =
        members.map(|(member, nullspace)| Sample::new(member, nullspace)).collect();
    solve_heads(blocks, &samples, recipe.ridge).ok_or(TrainError::Degenerate { step: recipe.steps })
}

/// φ2, or φ2…φ16.
fn named(functions: &RangeInclusive<usize>) -> String {
    let (first, last) = (functions.start(), functions.end());
    if first == last { format!("φ{first}") } else { format!("φ{first}…φ{last}") }
}

/// Every trunk has its own stream of the pipeline's seed, by the first eigenfunction that it is for.
fn trunk_seed(seed: u64, k: usize) -> u64 {
    seed ^ (k as u64).rotate_left(32)
}

/// Predicts on every member what the blocks since the last training add.
fn catch_up(members: &[Member], blocks: &[TrainedBlock], known: usize, earlier: &mut [Dense]) {
    members.par_iter().zip(earlier).for_each(|(member, phi)| {
        for trained in &blocks[phi.ncols() - known..] {
            append_next(&trained.block, &member.input, &member.mass, phi);
        }
    });
}

/// Shows a training on its progress bar and tells it when to stop.
struct Progress<'c> {
    bar: tracing::Span,
    cancel: &'c CancellationToken,
}

impl<'c> Progress<'c> {
    fn new(
        mesh: &str,
        wanted: &RangeInclusive<usize>,
        steps: usize,
        cancel: &'c CancellationToken,
    ) -> Self {
        let functions = named(wanted);
        let bar = tracing::info_span!(
            "train",
            mesh,
            functions,
            indicatif.pb_show = tracing::field::Empty
        );
        bar.pb_set_length(steps as u64);
        let together = if wanted.start() < wanted.end() { " on one trunk" } else { "" };
        bar.pb_set_message(&format!("{mesh}: training {functions}{together}"));
        bar.pb_start();
        Self { bar, cancel }
    }
}

impl Observer for Progress<'_> {
    fn step(&self, step: usize, _steps: usize, _quotient: f64) {
        self.bar.pb_set_position(step as u64);
    }

    fn cancelled(&self) -> bool {
        self.cancel.is_cancelled()
    }
}
