//! Data-parallel tapes: the members of a batch are dealt to a fixed number of shards, each on its own thread.
//!
//! A tape cannot leave its thread, and a step has two halves with a decision between them (the head is solved on
//! the Gram matrices of the whole batch), so every shard keeps its tapes and waits. Member i of a batch goes to
//! shard i modulo their number, so that they share evenly. Sums run over the members of a shard in order, then over
//! the shards in order: the bits depend on the number of shards alone. A lone shard deals the rows of its members to all threads.

use std::sync::Arc;

use crossbeam::channel::{Receiver, Sender, bounded};
use dfdx::prelude::*;

use super::head::{Grams, Head};
use super::network::Trunk;
use super::ops::Matrix;
use super::ops::dealt::deal_rows;
use super::ops::rayleigh::{MemberPencil, Term, rayleigh};
use super::ops::real::add;
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
                            deal_rows();
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

/// The life of one shard: orders in, matrices out, until the coordinator hangs up.
fn serve(
    samples: &[Sample],
    orders: &Receiver<Order>,
    grams_out: &Sender<Grams>,
    gradients_out: &Sender<Vec<Vec<f32>>>,
) {
    let mut passed = None;
    while let Ok(order) = orders.recv() {
        let delivered = match order {
            Order::Forward { trunk, members } => {
                let members = members.into_iter().map(|member| &samples[member]).collect();
                let (forward, sum) = Passed::forward(trunk, members);
                passed = Some(forward);
                grams_out.send(sum).is_ok()
            }
            Order::Backward { terms } => {
                let Some(passed) = passed.take() else { continue };
                gradients_out.send(passed.backward(&terms)).is_ok()
            }
        };
        if !delivered {
            break;
        }
    }
}

/// Forward passes that wait for their way back: all members on one tape, so that their gradients are added where they
/// are made.
struct Passed {
    trunk: Trunk<f32>,
    tape: OwnedTape<f32, Cpu>,
    features: Vec<(Matrix<f32>, Arc<MemberPencil>)>,
}

impl Passed {
    /// The features of some members, and the sums of their Gram matrices.
    fn forward(trunk: Trunk<f32>, members: Vec<&Sample>) -> (Self, Grams) {
        let layers = trunk.prepared();
        let mut sum = Grams::zeros(trunk.shape().width);
        let mut tape = OwnedTape::default();
        let mut all = Vec::with_capacity(members.len());
        for sample in members {
            let (features, rest) = sample.forward(&trunk, &layers, tape, &mut sum);
            all.push((features, sample.pencil.clone()));
            tape = rest;
        }
        (Self { trunk, tape, features: all }, sum)
    }

    /// The gradient of every parameter. Nothing is left that shares the trunk, or its optimiser would change a copy.
    fn backward(self, terms: &Arc<Vec<Term>>) -> Vec<Vec<f32>> {
        let mut gradients = rayleigh(self.features, terms, self.tape).backward();
        self.trunk.parameters().iter().map(|parameter| take(&mut gradients, parameter)).collect()
    }
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
