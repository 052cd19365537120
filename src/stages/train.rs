//! Training: the stage that stands K times in the chain, once for every eigenfunction. Where each has a trunk of its own, a
//! call trains one block; where all share a trunk, the first call trains all of them and the others find theirs there.

use std::ops::RangeInclusive;
use std::sync::Arc;
use std::time::Instant;

use tracing_indicatif::span_ext::IndicatifSpanExt;

use super::artifacts::TrunkArtifact;
use super::assemble::Assembled;
use super::checkpoints::{self, Checkpoints};
use super::context::{Context, Stop};
use super::family::{Prepared, Seen, TrainingSet};
use super::lineage::{self, Parent};
use super::work::{PARENTS_FRAME, Work, canonical};
use super::{Failure, models, stand_in};
use crate::flow::events::How;
use crate::ggnn::Block;
use crate::ggnn::checkpoint::Checkpoint;
use crate::ggnn::features::Input;
use crate::ggnn::heads::solve_heads;
use crate::ggnn::paper::{self, train_block};
use crate::ggnn::recipe::{Recipe, Ritz, Trunks};
use crate::ggnn::sample::{Sample, append_predictions};
use crate::ggnn::train::{Observer, TrainError, train_blocks, train_blocks_from, trunk_seed};
use crate::operators::Boundary;
use crate::pipeline::{RecipeName, Train};
use crate::spectrum::Dense;
use crate::store::{Artifact, CacheKey, Digest};

/// The options that a mesh is trained by.
#[derive(Debug, Clone)]
pub struct Chosen {
    /// Those of the pipeline, with what a search has chosen in their place.
    pub train: Train,
    /// What the search has found, as a recipe file; `None` where there was none.
    pub recipe_file: Option<String>,
}

/// A mesh whose first blocks are trained.
#[derive(Debug, Clone)]
pub struct InTraining {
    /// The mesh.
    pub assembled: Assembled,
    /// What training may see.
    pub training: Arc<TrainingSet>,
    /// The blocks so far, in the order of their eigenfunctions.
    pub blocks: Vec<TrainedBlock>,
    /// The options that it is trained by.
    pub chosen: Arc<Chosen>,
    /// The model that training goes on from, where it does not begin from nothing.
    parent: Option<Arc<Parent>>,
    /// The eigenfunctions so far on every member: as many as training has needed; none before the first training.
    earlier: Vec<Dense>,
    /// The same on the finer members that heads are solved on.
    earlier_on_finer: Vec<Dense>,
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
    pub fn new(prepared: Prepared, chosen: Chosen) -> Self {
        let Prepared { assembled, training } = prepared;
        let (training, chosen) = (Arc::new(training), Arc::new(chosen));
        Self {
            assembled,
            training,
            blocks: Vec::new(),
            chosen,
            parent: None,
            earlier: Vec::new(),
            earlier_on_finer: Vec::new(),
        }
    }

    /// The same, going on from the blocks of `parent`.
    pub fn from(self, parent: Arc<Parent>) -> Self {
        Self { parent: Some(parent), ..self }
    }

    /// The parent's block for φ_k, whose trunk a training of this recipe can go on from.
    fn parent_of(&self, k: usize, recipe: &Recipe) -> Option<&TrainedBlock> {
        let Recipe::Ritz(Ritz { shape, .. }) = recipe else { return None };
        let blocks = &self.parent.as_ref()?.blocks;
        blocks.iter().find(|parent| parent.k == k && parent.block.shape == *shape)
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
    let chosen = state.chosen.clone();
    let options = &chosen.train;
    let recipe = options.recipe(context.pipeline.features.inputs());
    let recipe = match recipe {
        Recipe::Ritz(ritz) if state.parent_of(k, &recipe).is_some() => {
            Recipe::Ritz(ritz.continued(options.fine_tune))
        }
        recipe => recipe,
    };
    let wanted = match options.trunk {
        Trunks::PerEigenfunction => k..=k,
        Trunks::Shared => k..=state.assembled.loaded.k,
    };
    let work = work(context, &state, &recipe, &wanted).seeded(options.seed, "f32");
    let key = *work.key();
    let shape = recipe.shape();
    let heads = wanted.clone().count();
    let stand_in = || stand_in::trunk(shape, heads);
    let recalled = context.recall_costly(item, work, stand_in, || {
        let blocks = trained(context, item, &mut state, &recipe, &wanted, &key)?;
        Ok(TrunkArtifact::of(&blocks))
    });
    let recalled = recalled.inspect_err(|failure| {
        if matches!(failure, Failure::Superseded) {
            leave_to_the_next_version(context, &state);
        }
    })?;
    if let Some(store) = context.writable() {
        checkpoints::remove(&key, store);
    }
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

/// The blocks so far are what the next version of the mesh begins with.
fn leave_to_the_next_version(context: &Context, state: &InTraining) {
    if let Some(model) = models::remember(context, state) {
        let parent = state.parent.as_deref();
        lineage::record(context, &state.assembled.loaded, &model, parent);
    }
}

/// What the blocks for φ of `wanted` depend on: a trunk of its own on the blocks before it, a shared one on K.
fn work(
    context: &Context,
    state: &InTraining,
    recipe: &Recipe,
    wanted: &RangeInclusive<usize>,
) -> Work<TrunkArtifact> {
    let train = &state.chosen.train;
    let work = Work::of_stage()
        .param("trunk", train.trunk.name())
        .param("recipe", canonical(recipe))
        .param("penalty", canonical(&penalty(context, train)))
        .param("head subdivisions", train.head_subdivisions.to_string());
    let mut work = of_family(work, context, &state.training, train);
    if state.parent.is_some() {
        work = work.input(PARENTS_FRAME, &Digest::of(&canonical(state.training.features())));
    }
    if let Some(parent) = state.parent_of(*wanted.start(), recipe) {
        work = work.input("parent", &parent.digest);
    }
    match train.trunk {
        Trunks::PerEigenfunction => {
            let earlier = state.blocks.iter();
            earlier.fold(work.part(*wanted.start()), |work, earlier| {
                work.input(format!("block {}", earlier.k), &earlier.digest)
            })
        }
        Trunks::Shared => work.param("k", wanted.end().to_string()),
    }
}

/// What holds the network to 0 on the boundary, where anything beside a recipe's own loss does.
pub fn penalty(context: &Context, train: &Train) -> Option<f64> {
    match (context.pipeline.operators.boundary, train.recipe) {
        (Boundary::Dirichlet, RecipeName::Ritz) => Some(train.boundary_penalty),
        (Boundary::Neumann, _) | (_, RecipeName::Paper) => None,
    }
}

/// `work` that depends on a family as training by the options `train` sees it.
pub fn of_family<A: Artifact>(
    work: Work<A>,
    context: &Context,
    training: &TrainingSet,
    train: &Train,
) -> Work<A> {
    let features = &context.pipeline.features;
    let mut work = work
        .param("features", canonical(&features.effective()))
        .input("family", &training.family_digest);
    if features.input != Input::EdgeLengths || train.head_subdivisions > 0 {
        // Its frame, its landmarks, or the surface that finer samplings lie on.
        work = work.input("mesh", &training.surface.digest);
    }
    let members = training.operators_digests.iter();
    members.fold(work, |work, operators| work.input("operators", operators))
}

/// Trains the blocks for φ of `wanted` on one trunk, against all that is known before them.
fn trained(
    context: &Context,
    item: usize,
    state: &mut InTraining,
    recipe: &Recipe,
    wanted: &RangeInclusive<usize>,
    result: &CacheKey,
) -> Result<Vec<Block>, Failure> {
    let mesh = &state.assembled.loaded.job.name;
    let together = if wanted.start() < wanted.end() { " on one trunk" } else { "" };
    let work = format!("{mesh}: training {}{together}", named(wanted));
    let checkpoints = context.store.as_ref();
    let checkpoints =
        checkpoints.map(|store| Checkpoints::of(result, store, context.checkpoint_every));
    let progress = Progress::new(mesh, &work, recipe.reports(), context.stop(item));
    let progress = Progress { checkpoints, ..progress };
    let training = state.training.clone();
    let seen = training.seen();
    catch_up(seen, &state.blocks, &mut state.earlier);
    let members = &seen.members;
    let seed = trunk_seed(state.chosen.train.seed, *wanted.start());
    let start = state.parent_of(*wanted.start(), recipe).map(|parent| parent.block.trunk());
    let blocks = match recipe {
        Recipe::Ritz(recipe) => {
            let heads = wanted.clone().count();
            fits(recipe, heads)?;
            let samples = Sample::all(members, &state.earlier);
            let held_out = recipe.held_out_of(samples.len());
            let finer = training.finer()?;
            let trained = match start {
                None => train_blocks(samples, recipe, heads, seed, &progress),
                Some(trunk) => train_blocks_from(trunk, samples, recipe, heads, seed, &progress),
            };
            trained.and_then(|blocks| match finer {
                None => Ok(blocks),
                Some(finer) => {
                    catch_up(finer, &state.blocks, &mut state.earlier_on_finer);
                    heads_on(finer, &state.earlier_on_finer, held_out, &blocks, recipe)
                }
            })
        }
        Recipe::Paper(recipe) => {
            let sample = |(member, earlier)| paper::Sample::new(member, earlier);
            let samples: Vec<_> = members.iter().zip(&state.earlier).map(sample).collect();
            train_block(&samples, recipe, seed, &progress).map(|block| vec![block])
        }
    };
    blocks.map_err(|source| match source {
        TrainError::Cancelled => progress.stopped(),
        source => Failure::Train { functions: named(wanted), source },
    })
}

/// Whether a trunk can carry so many heads.
///
/// # Errors
/// When it has fewer features.
pub fn fits(recipe: &Ritz, heads: usize) -> Result<(), Failure> {
    let width = recipe.shape.width;
    if heads > width { Err(Failure::NarrowTrunk { heads, width }) } else { Ok(()) }
}

/// Brings the eigenfunctions that are known on every member up to those of `blocks`.
fn catch_up(seen: &Seen, blocks: &[TrainedBlock], known: &mut Vec<Dense>) {
    if known.is_empty() {
        known.clone_from(&seen.nullspaces);
    }
    // What the blocks since the last time add.
    let zeros = seen.nullspaces.first().map_or(0, |zeros| zeros.ncols());
    let predicted = known.first().map_or(0, |phi| phi.ncols() - zeros);
    let new: Vec<&Block> = blocks[predicted..].iter().map(|new| &*new.block).collect();
    append_predictions(&seen.members, &new, known);
}

/// The blocks of a trunk with heads for finer samplings, against what is known there before them; not of the last members,
/// which are `held_out`.
fn heads_on(
    finer: &Seen,
    earlier: &[Dense],
    held_out: usize,
    blocks: &[Block],
    recipe: &Ritz,
) -> Result<Vec<Block>, TrainError> {
    let seen = finer.members.len() - held_out;
    let samples = Sample::all(&finer.members[..seen], earlier);
    solve_heads(blocks, &samples, recipe.ridge).ok_or(TrainError::Degenerate { step: recipe.steps })
}

/// φ2, or φ2…φ16.
pub fn named(functions: &RangeInclusive<usize>) -> String {
    let (first, last) = (functions.start(), functions.end());
    if first == last { format!("φ{first}") } else { format!("φ{first}…φ{last}") }
}

/// Shows trainings on a progress bar and tells them when to stop.
pub struct Progress<'c> {
    bar: tracing::Span,
    work: String,
    stop: Stop<'c>,
    /// Where it can go on from; a search has none.
    checkpoints: Option<Checkpoints<'c>>,
}

impl<'c> Progress<'c> {
    /// A bar for `work` on a mesh, of so many steps in all.
    pub fn new(mesh: &str, work: &str, steps: usize, stop: Stop<'c>) -> Self {
        let bar = tracing::info_span!("train", mesh, indicatif.pb_show = tracing::field::Empty);
        bar.pb_set_length(steps as u64);
        bar.pb_set_message(work);
        bar.pb_start();
        Self { bar, work: work.into(), stop, checkpoints: None }
    }

    /// Why a training was told to stop.
    pub fn stopped(&self) -> Failure {
        self.stop.check().err().unwrap_or(Failure::Interrupted)
    }
}

impl Observer for Progress<'_> {
    fn step(&self, _step: usize, _steps: usize, _quotient: f64) {
        self.bar.pb_inc(1);
    }

    fn cancelled(&self) -> bool {
        self.stop.check().is_err()
    }

    fn kept(&self) -> Option<Checkpoint> {
        let kept = self.checkpoints.as_ref()?.kept()?;
        tracing::info!("{} goes on after step {}", self.work, kept.step);
        self.bar.pb_inc(kept.step as u64);
        Some(kept)
    }

    fn wants_checkpoint(&self) -> bool {
        self.checkpoints.as_ref().is_some_and(Checkpoints::is_due)
    }

    fn keep(&self, checkpoint: Checkpoint) {
        if let Some(checkpoints) = &self.checkpoints {
            checkpoints.keep(checkpoint);
        }
    }
}
