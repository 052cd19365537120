//! Recipe `ritz`: trains one block on a family, or several on one trunk.
//!
//! Each step: forward passes over a batch; the heads solved on that batch ([`super::head`]); the gradient of the
//! batch's Rayleigh quotients with respect to the trunk ([`super::ops::rayleigh`]); one Adam step. Since the head
//! is optimal for the batch, the quotient's gradient needs no term for the head (the envelope theorem); the ridge is
//! taken as a constant there.
//!
//! Nothing here has seen a vector of a reference solver: the inputs are meshes, their operators, and the
//! predictions of earlier blocks.

use std::sync::Arc;

use dfdx::prelude::*;
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use super::block::{Block, TrainingRecord};
use super::checkpoint::Checkpoint;
use super::head::{Grams, Head};
use super::held_out::Watch;
use super::network::Trunk;
use super::ops::Matrix;
use super::paper::loss::Terms;
use super::recipe::Ritz;
use super::sample::Sample;
use super::shards::Shards;

/// Why a block was not trained.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum TrainError {
    /// The caller asked to stop.
    #[error("training was interrupted")]
    Cancelled,
    /// The features span nothing beyond the earlier eigenfunctions, or are no longer numbers.
    #[error(
        "the network's features became useless at step {step}: \
         lower train.learning_rate, or raise train.width"
    )]
    Degenerate { step: usize },
}

/// Who watches a training: told about every step, asked whether to go on.
pub trait Observer {
    /// After step `step` of `steps`, with the batch's Rayleigh quotient.
    fn step(&self, step: usize, steps: usize, quotient: f64);
    /// After an epoch of recipe `paper`: the mean terms of its loss.
    fn terms(&self, _epoch: usize, _terms: &Terms) {}
    /// Whether to stop now.
    fn cancelled(&self) -> bool;
    /// What was kept of this very training before, if anything: it goes on from there.
    fn kept(&self) -> Option<Checkpoint> {
        None
    }
    /// Whether it is time for a checkpoint.
    fn wants_checkpoint(&self) -> bool {
        false
    }
    /// Takes a checkpoint to keep: when it wants one, and when training stops because it asked for that.
    fn keep(&self, _checkpoint: Checkpoint) {}
}

/// Nobody watches, and nothing stops the training.
#[derive(Debug, Clone, Copy)]
pub struct Silent;

impl Observer for Silent {
    fn step(&self, _: usize, _: usize, _: f64) {}

    fn cancelled(&self) -> bool {
        false
    }
}

/// Trains the blocks of the `count` eigenfunctions that follow those deflated in `samples`, all on one trunk.
///
/// The last samples are held out, where the recipe says so: training does not see them, ends when it becomes no better
/// there, and returns the best that it had.
///
/// The same inputs, recipe and seed give the same bits, whatever the number of threads.
///
/// # Errors
/// [`TrainError`].
pub fn train_blocks(
    samples: Vec<Sample>,
    recipe: &Ritz,
    count: usize,
    seed: u64,
    observer: &dyn Observer,
) -> Result<Vec<Block>, TrainError> {
    let trunk = Trunk::init(recipe.shape, recipe.ranges, seed);
    train_blocks_from(trunk, samples, recipe, count, seed, observer)
}

/// The same, on a trunk that is trained already: for another shape, or by another recipe. `seed` draws the batches.
///
/// # Errors
/// [`TrainError`].
pub fn train_blocks_from(
    mut trunk: Trunk<f32>,
    samples: Vec<Sample>,
    recipe: &Ritz,
    count: usize,
    seed: u64,
    observer: &dyn Observer,
) -> Result<Vec<Block>, TrainError> {
    let (seen, held_out) = samples.split_at(samples.len() - recipe.held_out_of(samples.len()));
    let everyone: Vec<usize> = (0..seen.len()).collect();
    let mut batches = Batches::new(seen.len(), recipe.batch, seed);
    let mut watch = Watch::new(held_out, recipe.steps);
    // More than a batch has members would have nothing to do in a step, and keep a lone member from all threads.
    Shards::run(seen, recipe.shards.min(recipe.batch), |shards| {
        let solve = |grams: Grams, heads: usize, step: usize| {
            grams.solve(recipe.ridge, heads).ok_or(TrainError::Degenerate { step })
        };
        let untrained = solve(shards.grams(&trunk, &everyone), count, 0)?;
        let mut adam = Moments::new(trunk.parameters());
        let mut history = Vec::with_capacity(recipe.steps);
        let mut first = 0;
        if let Some(kept) = observer.kept()
            && kept.restore(
                recipe.steps,
                kept.step,
                trunk.parameters_mut().iter_mut().collect(),
                &mut adam,
            )
        {
            first = kept.step;
            (0..first).for_each(|_| drop(batches.next()));
            history.extend(kept.history);
            watch.resume(kept.checks, kept.best);
        }
        for step in first..recipe.steps {
            if watch.is_over() {
                break;
            }
            let stops = observer.cancelled();
            if step > first && (stops || observer.wants_checkpoint()) {
                let state = Checkpoint::of(step, trunk.parameters(), &adam, &history);
                observer.keep(watch.with_findings(state));
            }
            if stops {
                return Err(TrainError::Cancelled);
            }
            let batch = batches.next();
            // Solved on the very batch that gives the gradient: heads from another batch are not optimal here.
            let grams = shards.grams(&trunk, &batch);
            let heads = match grams.solve(recipe.ridge, count + recipe.spare) {
                Some(heads) => heads,
                // A narrow trunk or a small mesh may have no room for spare ones.
                None => solve(grams, count, step)?,
            };
            let gradients = shards.gradients(&heads);
            adam.update(trunk.parameters_mut(), gradients, recipe.learning_rate_at(step));
            let quotient = geometric_mean(&heads);
            history.push(quotient);
            observer.step(step + 1, recipe.steps, quotient);
            if watch.is_due(step + 1) {
                let heads = solve(shards.grams(&trunk, &everyone), count, step + 1)?;
                watch.check(step + 1, blocks_of(&trunk, heads, &untrained));
            }
        }
        let (best, checks) = watch.into_best();
        let mut blocks = match best {
            Some(best) => best,
            None => {
                let heads = solve(shards.grams(&trunk, &everyone), count, recipe.steps)?;
                blocks_of(&trunk, heads, &untrained)
            }
        };
        for Block { record, .. } in &mut blocks {
            record.history.clone_from(&history);
            record.held_out.clone_from(&checks);
        }
        Ok(blocks)
    })
}

/// The blocks of a trunk as it is, with `heads` that were `untrained` before the first step.
fn blocks_of(trunk: &Trunk<f32>, heads: Vec<Head>, untrained: &[Head]) -> Vec<Block> {
    let weights = Arc::new(trunk.weights());
    let block = |(head, untrained): (Head, &Head)| Block {
        shape: trunk.shape(),
        weights: weights.clone(),
        record: TrainingRecord {
            history: Vec::new(),
            untrained: untrained.quotient,
            trained: head.quotient,
            held_out: Vec::new(),
        },
        head: head.weights,
    };
    heads.into_iter().zip(untrained).map(block).collect()
}

/// The seed of the trunk whose first eigenfunction is φ_k: every trunk has its own stream of the pipeline's seed.
pub fn trunk_seed(seed: u64, k: usize) -> u64 {
    seed ^ (k as u64).rotate_left(32)
}

fn geometric_mean(heads: &[Head]) -> f64 {
    let [head] = heads else {
        let logarithms: f64 = heads.iter().map(|head| head.quotient.ln()).sum();
        return (logarithms / heads.len() as f64).exp();
    };
    head.quotient
}

/// Draws batches: every member once in random order, then again.
struct Batches {
    order: Vec<usize>,
    next: usize,
    size: usize,
    rng: ChaCha8Rng,
}

impl Batches {
    fn new(members: usize, size: usize, seed: u64) -> Self {
        // Its own stream of the seed: the weights come from another.
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(1);
        Self { order: (0..members).collect(), next: members, size: size.clamp(1, members), rng }
    }

    fn next(&mut self) -> Vec<usize> {
        if self.next + self.size > self.order.len() {
            self.order.shuffle(&mut self.rng);
            self.next = 0;
        }
        let mut batch = self.order[self.next..self.next + self.size].to_vec();
        batch.sort_unstable();
        self.next += self.size;
        batch
    }
}

/// Adam's moments, beside dfdx's kernel.
pub(super) struct Moments {
    first: Vec<<Cpu as Storage<f32>>::Vec>,
    second: Vec<<Cpu as Storage<f32>>::Vec>,
    step: i32,
}

impl Moments {
    /// Zeros for every parameter.
    pub fn new<'p>(parameters: impl IntoIterator<Item = &'p Matrix<f32>>) -> Self {
        let mut zeros = Gradients::leaky();
        let first: Vec<<Cpu as Storage<f32>>::Vec> = parameters
            .into_iter()
            .map(|p| match zeros.get_or_alloc_mut(p) {
                Ok(zeros) => zeros.clone(),
                Err(error) => panic!("no memory for Adam's moments: {error:?}"),
            })
            .collect();
        Self { second: first.clone(), first, step: 0 }
    }

    /// First and second moments, and how often they were changed.
    pub fn state(&self) -> ([Vec<Vec<f32>>; 2], u32) {
        let values = |all: &[<Cpu as Storage<f32>>::Vec]| all.iter().map(|m| m.to_vec()).collect();
        ([values(&self.first), values(&self.second)], self.step.unsigned_abs())
    }

    /// Puts back what [`Self::state`] gave.
    pub fn set(&mut self, [first, second]: &[Vec<Vec<f32>>; 2], step: u32) {
        let all = self.first.iter_mut().chain(&mut self.second);
        for (moment, values) in all.zip(first.iter().chain(second)) {
            moment.copy_from_slice(values);
        }
        self.step = step as i32;
    }

    /// One step down the gradients.
    pub fn update<'p>(
        &mut self,
        parameters: impl IntoIterator<Item = &'p mut Matrix<f32>>,
        gradients: Vec<Vec<f32>>,
        lr: f64,
    ) {
        self.step += 1;
        let config = AdamConfig { lr, ..AdamConfig::default() };
        let moments = self.first.iter_mut().zip(&mut self.second);
        let mut scratch = Gradients::leaky();
        for ((parameter, gradient), (first, second)) in
            parameters.into_iter().zip(gradients).zip(moments)
        {
            let slot = match scratch.get_or_alloc_mut(parameter) {
                Ok(slot) => slot,
                Err(error) => panic!("no memory for a gradient: {error:?}"),
            };
            **slot = gradient;
            if let Err(error) = config.try_update(self.step, parameter, first, second, slot) {
                panic!("dfdx's Adam on the CPU cannot fail, but did: {error:?}");
            }
        }
    }
}
