//! Training one eigenfunction's block: the stage that stands K − 1 times in the chain.

use std::sync::Arc;
use std::time::Instant;

use rayon::prelude::*;
use tokio_util::sync::CancellationToken;
use tracing_indicatif::span_ext::IndicatifSpanExt;

use super::Failure;
use super::artifacts::BlockArtifact;
use super::assemble::Assembled;
use super::context::{Context, Work, canonical};
use super::family::TrainingSet;
use crate::flow::events::How;
use crate::ggnn::Block;
use crate::ggnn::paper::{self, train_block};
use crate::ggnn::predict::predict_next;
use crate::ggnn::recipe::Recipe;
use crate::ggnn::sample::Sample;
use crate::ggnn::train::{Observer, TrainError, train_blocks};
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
    /// The eigenfunctions so far on every member: as many as training has needed.
    earlier: Vec<Dense>,
}

/// A block with where it came from.
#[derive(Debug, Clone)]
pub struct TrainedBlock {
    /// Which eigenfunction it predicts, counted from 1.
    pub k: usize,
    /// The block.
    pub block: Arc<Block>,
    /// Where the store has it.
    pub key: CacheKey,
    /// Of the block.
    pub digest: Digest,
    /// Trained in this run or reused.
    pub how: How,
    /// Seconds spent on it in this run.
    pub seconds: f64,
}

impl InTraining {
    /// A mesh none of whose blocks is trained yet.
    pub fn new(assembled: Assembled, training: TrainingSet) -> Self {
        let earlier = training.nullspaces.clone();
        Self { assembled, training: Arc::new(training), blocks: Vec::new(), earlier }
    }

    /// How many eigenfunctions need no block: those of λ = 0.
    pub fn known(&self) -> usize {
        self.training.nullspaces.first().map_or(0, Dense::ncols)
    }
}

/// Trains or recalls the block for φ_k. Eigenfunctions of λ = 0 have none.
///
/// # Errors
/// When training fails or is interrupted.
pub fn train(
    context: &Context,
    item: usize,
    k: usize,
    mut state: InTraining,
) -> Result<InTraining, Failure> {
    if k <= state.known() {
        return Ok(state);
    }
    let started = Instant::now();
    let training = state.training.clone();
    let options = &context.pipeline.train;
    let recipe = options.recipe(context.pipeline.features.inputs());
    let family = Work::<BlockArtifact>::of_stage()
        .part(k)
        .param("recipe", canonical(&recipe))
        .param("features", canonical(&training.features))
        .input("family", &training.family_digest);
    let members = training.operators_digests.iter();
    let work = members.fold(family, |work, operators| work.input("operators", operators));
    let work = state
        .blocks
        .iter()
        .fold(work, |work, earlier| work.input(format!("block {}", earlier.k), &earlier.digest));
    let name = state.assembled.loaded.job.name.clone();
    let recalled = context.recall(item, work.seeded(options.seed, "f32"), || {
        let progress = Progress::new(&name, k, recipe.reports(), &context.cancel);
        catch_up(&training, &state.blocks, &mut state.earlier);
        let seed = block_seed(options.seed, k);
        let block =
            next_block(&training, &state.earlier, &recipe, seed, &progress).map_err(|source| {
                match source {
                    TrainError::Cancelled => Failure::Interrupted,
                    source => Failure::Train { k, source },
                }
            })?;
        Ok(BlockArtifact::from(&block))
    })?;
    let spent = started.elapsed();
    tracing::debug!(mesh = name, k, how = ?recalled.how, seconds = spent.as_secs_f64(), "block");
    state.blocks.push(TrainedBlock {
        k,
        block: Arc::new(recalled.artifact.into()),
        key: recalled.key,
        digest: recalled.digest,
        how: recalled.how,
        seconds: spent.as_secs_f64(),
    });
    state.assembled.loaded.spent(format!("train φ{k}"), recalled.how, spent);
    Ok(state)
}

/// Trains the block that follows the functions `earlier` on every member.
fn next_block(
    training: &TrainingSet,
    earlier: &[Dense],
    recipe: &Recipe,
    seed: u64,
    progress: &Progress<'_>,
) -> Result<Block, TrainError> {
    let members = training.members.iter().zip(earlier);
    match recipe {
        Recipe::Ritz(recipe) => {
            let samples = members.map(|(member, earlier)| Sample::new(member, earlier)).collect();
            Ok(train_blocks(samples, recipe, 1, seed, progress)?.remove(0))
        }
        Recipe::Paper(recipe) => {
            // Under the Neumann condition, the only one so far, no vertex is held.
            let sample = |(member, earlier)| paper::Sample::new(member, vec![], earlier);
            let samples: Vec<_> = members.map(sample).collect();
            train_block(&samples, recipe, seed, progress)
        }
    }
}

/// Every block has its own stream of the pipeline's seed.
fn block_seed(seed: u64, k: usize) -> u64 {
    seed ^ (k as u64).rotate_left(32)
}

/// Predicts on every member what the blocks since the last training add.
fn catch_up(training: &TrainingSet, blocks: &[TrainedBlock], earlier: &mut [Dense]) {
    let known = training.nullspaces.first().map_or(0, Dense::ncols);
    training.members.par_iter().zip(earlier).for_each(|(member, phi)| {
        for trained in &blocks[phi.ncols() - known..] {
            let next = predict_next(&trained.block, &member.input, &member.mass, phi);
            let columns = phi.ncols();
            *phi = Dense::from_fn(phi.nrows(), columns + 1, |i, j| {
                if j < columns { phi[(i, j)] } else { next[i] }
            });
        }
    });
}

/// Shows a training on its progress bar and tells it when to stop.
struct Progress<'c> {
    bar: tracing::Span,
    cancel: &'c CancellationToken,
}

impl<'c> Progress<'c> {
    fn new(mesh: &str, k: usize, steps: usize, cancel: &'c CancellationToken) -> Self {
        let bar = tracing::info_span!("train", mesh, k, indicatif.pb_show = tracing::field::Empty);
        bar.pb_set_length(steps as u64);
        bar.pb_set_message(&format!("{mesh}: training φ{k}"));
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
