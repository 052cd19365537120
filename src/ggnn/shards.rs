//! Data-parallel tapes: the members of a batch are dealt to a fixed number of shards, each on its own thread.
//!
//! A tape cannot leave its thread, and a step has two halves with a decision between them (the head is solved on
//! the Gram matrices of the whole batch), so every shard keeps its tapes and waits. Member i of a batch goes to
//! shard i modulo their number, so that they share evenly. Sums run over the members of a shard in order, then over
//! the shards in order: the bits depend on the number of shards alone. A lone shard deals its products to all threads.

use std::sync::Arc;

use crossbeam::channel::{Receiver, Sender, bounded};
use dfdx::prelude::*;

use super::head::{Grams, Head};
use super::network::{Prepared, Trunk};
use super::ops::product::deal_products;
use super::ops::rayleigh::{Term, rayleigh};
use super::ops::real::add;
use super::ops::{Matrix, lent};
use super::sample::Sample;

/// The shards of one training, as its coordinator sees them.
pub struct Shards {
    shards: Vec<Shard>,
}

struct Shard {
    orders: Sender<Order>,
    grams: Receiver<Grams>,
    gradients: Receiver<Vec<Vec<f32>>>,
}

enum Order {
    /// Forward passes over these samples.
    Forward { trunk: Trunk<f32>, members: Vec<usize> },
    /// Backward passes over the same samples.
    Backward { terms: Arc<Vec<Term>> },
}

impl Shards {
    /// Starts `count` shards (at most one a sample), runs `work` with them, and ends them.
    pub fn run<T>(samples: &[Sample], count: usize, work: impl FnOnce(&mut Self) -> T) -> T {
        let count = count.clamp(1, samples.len().max(1));
        std::thread::scope(|scope| {
            let shards = (0..count)
                .map(|_| {
                    let (orders, inbox) = bounded(1);
                    let (grams_out, grams) = bounded(1);
                    let (gradients_out, gradients) = bounded(1);
                    scope.spawn(move || {
                        if count == 1 {
                            deal_products();
                        }
                        serve(samples, &inbox, &grams_out, &gradients_out);
                    });
                    Shard { orders, grams, gradients }
                })
                .collect();
            // Dropping the shards' inboxes ends their threads, also when `work` unwinds.
            work(&mut Self { shards })
        })
    }

    /// Forward passes over `batch`: the summed Gram matrices.
    pub fn grams(&mut self, trunk: &Trunk<f32>, batch: &[usize]) -> Grams {
        for (first, shard) in self.shards.iter().enumerate() {
            let members = batch.iter().skip(first).step_by(self.shards.len()).copied().collect();
            shard.send(Order::Forward { trunk: trunk.clone(), members });
        }
        let mut sum = Grams::zeros(trunk.shape().width);
        for shard in &self.shards {
            sum.add(&receive(&shard.grams));
        }
        sum
    }

    /// Backward passes over the batch of the last [`Self::grams`]: the summed gradient of every parameter.
    ///
    /// Of one head it is the gradient of its quotient, of several that of the sum of their logarithms: all eigenvalues
    /// count alike, however large.
    pub fn gradients(&mut self, heads: &[Head]) -> Vec<Vec<f32>> {
        // A head is scaled to Σ uᵀBu = 1.
        let weight = |head: &Head| if heads.len() == 1 { 1.0 } else { head.quotient.recip() };
        let term = |head: &Head| Term {
            head: head.weights.clone(),
            quotient: head.quotient,
            weight: weight(head),
        };
        let terms: Arc<Vec<Term>> = Arc::new(heads.iter().map(term).collect());
        for shard in &self.shards {
            shard.send(Order::Backward { terms: terms.clone() });
        }
        let mut parts = self.shards.iter().map(|shard| receive(&shard.gradients));
        let first = parts.next().unwrap_or_default();
        parts.fold(first, add_all)
    }
}

impl Shard {
    fn send(&self, order: Order) {
        assert!(self.orders.send(order).is_ok(), "a training shard has panicked");
    }
}

fn receive<T>(from: &Receiver<T>) -> T {
    from.recv().unwrap_or_else(|_| panic!("a training shard has panicked"))
}

type Taped = Matrix<f32, OwnedTape<f32, Cpu>>;

/// The life of one shard: orders in, matrices out, until the coordinator hangs up.
fn serve(
    samples: &[Sample],
    orders: &Receiver<Order>,
    grams_out: &Sender<Grams>,
    gradients_out: &Sender<Vec<Vec<f32>>>,
) {
    let device = Cpu::default();
    let mut trunk = None;
    let mut taped: Vec<(&Sample, Taped)> = Vec::new();
    while let Ok(order) = orders.recv() {
        let delivered = match order {
            Order::Forward { trunk: newest, members } => {
                taped.clear();
                let layers = newest.prepared();
                let mut sum = Grams::zeros(newest.shape().width);
                for sample in members.into_iter().map(|member| &samples[member]) {
                    taped.push((sample, forward(sample, &newest, &layers, &device, &mut sum)));
                }
                trunk = Some(newest);
                grams_out.send(sum).is_ok()
            }
            Order::Backward { terms } => {
                let Some(trunk) = &trunk else { continue };
                // Empty when the batch left nothing to this shard.
                let sum = taped
                    .drain(..)
                    .map(|(sample, features)| {
                        let loss = rayleigh(features, &terms, &sample.pencil);
                        let mut gradients = loss.backward();
                        trunk.parameters().iter().map(|p| take(&mut gradients, p)).collect()
                    })
                    .reduce(add_all);
                gradients_out.send(sum.unwrap_or_default()).is_ok()
            }
        };
        if !delivered {
            break;
        }
    }
}

/// The features of one member on a tape of their own; adds their Gram matrices to `sum`.
fn forward(
    sample: &Sample,
    trunk: &Trunk<f32>,
    layers: &[Prepared<f32>],
    device: &Cpu,
    sum: &mut Grams,
) -> Taped {
    let x = sample.input.tensor(device).put_tape(OwnedTape::default());
    let features = trunk.forward_with(layers, x, &sample.input.graph);
    let (stiffness, mass) = (&sample.stiffness, &sample.mass);
    sum.include(&lent(&features), stiffness, mass, &sample.pencil.deflation);
    features
}

/// The gradient of one parameter.
pub(super) fn take(gradients: &mut Gradients<f32, Cpu>, parameter: &Matrix<f32>) -> Vec<f32> {
    match gradients.get_or_alloc_mut(parameter) {
        Ok(gradient) => std::mem::take(&mut **gradient),
        Err(error) => panic!("no memory for a gradient: {error:?}"),
    }
}

/// The sum of two sets of gradients.
pub(super) fn add_all(mut sum: Vec<Vec<f32>>, other: Vec<Vec<f32>>) -> Vec<Vec<f32>> {
    for (sum, other) in sum.iter_mut().zip(&other) {
        add(other, sum);
    }
    sum
}
