//! The epochs of recipe `paper`.
//!
//! Every epoch goes through the family once, in random order and in batches. The gradient of a batch is the mean over its
//! members, each on a tape of its own; they run in parallel and are added in the order of the batch, so that the bits
//! depend on the seed alone.

use std::sync::Arc;

use dfdx::prelude::*;
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::loss::{Sample, Terms};
use super::network::Network;
use super::{Paper, Weights};
use crate::ggnn::block::{Block, TrainingRecord};
use crate::ggnn::checkpoint::Checkpoint;
use crate::ggnn::network::Prepared;
use crate::ggnn::predict::predict_next;
use crate::ggnn::shards::{add_all, take};
use crate::ggnn::train::{Moments, Observer, TrainError};
use crate::spectrum::pencil::quadratic;

/// Trains the block of the eigenfunction that follows those in `samples`.
///
/// # Errors
/// [`TrainError`].
pub fn train_block(
    samples: &[Sample],
    recipe: &Paper,
    seed: u64,
    observer: &dyn Observer,
) -> Result<Block, TrainError> {
    let mut network = Network::<f32>::init(recipe, seed);
    let untrained =
        quotient(samples, &block(recipe, &network)).ok_or(TrainError::Degenerate { step: 0 })?;
    let mut adam = Moments::new(network.parameters());
    let mut order: Vec<usize> = (0..samples.len()).collect();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(1);
    let mut history = Vec::with_capacity(recipe.epochs);
    let batch = recipe.batch.max(1);
    let batches = samples.len().div_ceil(batch).max(1);
    let (mut first, mut sum) = (0, Terms::default());
    if let Some(kept) = observer.kept()
        && let Some(terms) = Terms::from_entries(&kept.under_way)
        && kept.restore(
            recipe.epochs * batches,
            kept.step / batches,
            network.parameters_mut().collect(),
            &mut adam,
        )
    {
        (first, sum) = (kept.step, terms);
        (0..first / batches).for_each(|_| order.shuffle(&mut rng));
        history.extend(kept.history);
    }
    for epoch in first / batches..recipe.epochs {
        let (rate, weights) = (recipe.learning_rate_in(epoch), recipe.weights_in(epoch));
        order.shuffle(&mut rng);
        let steps = epoch * batches..;
        for (step, batch) in steps.zip(order.chunks(batch)).skip_while(|&(step, _)| step < first) {
            let stops = observer.cancelled();
            if step > first && (stops || observer.wants_checkpoint()) {
                let state = Checkpoint::of(step, network.parameters(), &adam, &history);
                observer.keep(Checkpoint { under_way: sum.entries().into(), ..state });
            }
            if stops {
                return Err(TrainError::Cancelled);
            }
            let (terms, gradients) = batch_gradients(&network, samples, batch, weights, recipe);
            adam.update(network.parameters_mut(), gradients, rate);
            sum = sum.plus(terms);
        }
        let mean = std::mem::take(&mut sum).times(1.0 / samples.len().max(1) as f64);
        if !mean.weighted(weights).is_finite() {
            return Err(TrainError::Degenerate { step: epoch });
        }
        history.push(mean.quotient);
        observer.terms(epoch + 1, &mean);
        observer.step(epoch + 1, recipe.epochs, mean.quotient);
    }
    let mut block = block(recipe, &network);
    let trained =
        quotient(samples, &block).ok_or(TrainError::Degenerate { step: recipe.epochs })?;
    block.record = TrainingRecord { history, untrained, trained, held_out: vec![] };
    Ok(block)
}

/// The sums of the terms over a batch, and the gradient of the mean of (23) with respect to every parameter.
fn batch_gradients(
    network: &Network<f32>,
    samples: &[Sample],
    batch: &[usize],
    weights: Weights,
    recipe: &Paper,
) -> (Terms, Vec<Vec<f32>>) {
    let layers = network.trunk.prepared();
    let share = 1.0 / batch.len() as f64;
    let mean = Weights {
        boundary: share * weights.boundary,
        residual: share * weights.residual,
        orthogonality: share * weights.orthogonality,
    };
    let parts: Vec<_> = batch
        .par_iter()
        .map(|&member| gradients(network, &layers, &samples[member], mean, recipe))
        .collect();
    let sum = parts.into_iter().reduce(|(terms, gradients), (more_terms, more_gradients)| {
        (terms.plus(more_terms), add_all(gradients, more_gradients))
    });
    sum.unwrap_or_default()
}

/// The terms on one member, and the gradient of (23).
fn gradients(
    network: &Network<f32>,
    layers: &Prepared<f32>,
    sample: &Sample,
    weights: Weights,
    recipe: &Paper,
) -> (Terms, Vec<Vec<f32>>) {
    let x = sample.input.tensor(&Cpu::default()).put_tape(OwnedTape::default());
    let prediction = network.forward(layers, x, &sample.input.graph);
    let (loss, terms) = sample.loss(prediction, weights, recipe.rows);
    let mut gradients = loss.backward();
    (terms, network.parameters().map(|p| take(&mut gradients, p)).collect())
}

/// The network as a block without a record.
fn block(recipe: &Paper, network: &Network<f32>) -> Block {
    Block {
        shape: recipe.shape,
        weights: Arc::new(network.trunk.weights()),
        head: network.head(),
        record: TrainingRecord::default(),
    }
}

/// The mean Rayleigh quotient of what the block predicts on the samples, deflated; `None` where it is not a number.
fn quotient(samples: &[Sample], block: &Block) -> Option<f64> {
    let quotient = |sample: &Sample| {
        let u = predict_next(block, &sample.input, &*sample.mass, &sample.earlier);
        quadratic(&sample.stiffness, &u)
    };
    let quotients: Vec<f64> = samples.par_iter().map(quotient).collect();
    let mean = quotients.iter().sum::<f64>() / quotients.len() as f64;
    mean.is_finite().then_some(mean)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ggnn::network::TrunkShape;
    use crate::ggnn::predict::NetworkInput;
    use crate::ggnn::sample::Member;
    use crate::ggnn::train::Silent;
    use crate::mesh::sample::icosphere;
    use crate::operators::{MassKind, Operators};
    use crate::spectrum::Dense;

    /// Unit spheres of different samplings, of unit area to training.
    fn spheres() -> Vec<Sample> {
        let sample = |mesh: crate::mesh::TriMesh| {
            let operators = Operators::assemble(&mesh, MassKind::Lumped).unwrap();
            let positions: Vec<f64> = mesh.vertices().iter().flatten().copied().collect();
            let area = operators.total_mass();
            let member = Member {
                input: NetworkInput::new(&positions, &operators.adjacency),
                stiffness: operators.stiffness,
                mass: operators.mass.map(|b| b / area),
            };
            Sample::new(&member, &Dense::from_fn(mesh.n(), 1, |_, _| 1.0))
        };
        [icosphere(1), icosphere(2), icosphere(1)].map(sample).into()
    }

    fn recipe(epochs: usize) -> Paper {
        let shape = TrunkShape { width: 32, layers: 2, ..Paper::default().shape };
        Paper { shape, epochs, batch: 2, milestones: vec![], ..Paper::default() }
    }

    #[test]
    fn the_sphere_is_learned() {
        let block = train_block(&spheres(), &recipe(200), 5, &Silent).unwrap();
        let lambda = 2.0 * 4.0 * std::f64::consts::PI;
        assert!((block.record.trained / lambda - 1.0).abs() < 0.2, "{:?}", block.record);
        assert_eq!(block.head.len(), 33);
        assert_eq!(block.record.history.len(), 200);
    }

    #[test]
    fn the_bits_do_not_depend_on_the_number_of_threads() {
        let train = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| train_block(&spheres(), &recipe(3), 5, &Silent).unwrap())
        };
        assert_eq!(train(1), train(3));
        let other = train_block(&spheres(), &recipe(3), 6, &Silent).unwrap();
        assert_ne!(other.head, train(2).head);
    }
}
