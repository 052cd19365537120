//! Data-parallel tapes: the members of a batch are dealt to a fixed number of shards, each on its own thread.
//!
//! A tape cannot leave its thread, and a step has two halves with a decision between them (the head is solved on
//! the Gram matrices of the whole batch), so every shard keeps its tapes and waits. Sums run over the members of
//! a shard in order, then over the shards in order: the bits depend on the number of shards alone.

use std::sync::Arc;

use crossbeam::channel::{Receiver, Sender, bounded};
use dfdx::prelude::*;

use super::head::Grams;
use super::network::Trunk;
use super::ops::Matrix;
use super::ops::rayleigh::{Quotient, rayleigh};
use super::train::Sample;

/// The shards of one training, as its coordinator sees them.
pub struct Shards {
    shards: Vec<Shard>,
    width: usize,
}

struct Shard {
    orders: Sender<Order>,
    grams: Receiver<Grams>,
    gradients: Receiver<Vec<Vec<f32>>>,
}

enum Order {
    /// Forward passes over these samples (of all; the shard takes its own).
    Forward { trunk: Box<Trunk<f32>>, batch: Arc<Vec<usize>> },
    /// Backward passes over the same samples.
    Backward { head: Arc<Vec<f64>>, quotient: Quotient },
}

impl Shards {
    /// Starts `count` shards (at most one a sample), runs `work` with them, and ends them.
    pub fn run<T>(samples: Vec<Sample>, count: usize, work: impl FnOnce(&mut Self) -> T) -> T {
        let count = count.clamp(1, samples.len().max(1));
        let mut dealt: Vec<Vec<(usize, Sample)>> = (0..count).map(|_| Vec::new()).collect();
        for (index, sample) in samples.into_iter().enumerate() {
            dealt[index % count].push((index, sample));
        }
        std::thread::scope(|scope| {
            let shards = dealt
                .into_iter()
                .map(|samples| {
                    let (orders, inbox) = bounded(1);
                    let (grams_out, grams) = bounded(1);
                    let (gradients_out, gradients) = bounded(1);
                    scope.spawn(move || serve(&samples, &inbox, &grams_out, &gradients_out));
                    Shard { orders, grams, gradients }
                })
                .collect();
            // Dropping the shards' inboxes ends their threads, also when `work` unwinds.
            work(&mut Self { shards, width: 0 })
        })
    }

    /// Forward passes over `batch`: the summed Gram matrices.
    pub fn grams(&mut self, trunk: &Trunk<f32>, batch: &[usize]) -> Grams {
        self.width = trunk.shape().width;
        let batch = Arc::new(batch.to_vec());
        for shard in &self.shards {
            shard.send(Order::Forward { trunk: Box::new(trunk.clone()), batch: batch.clone() });
        }
        let mut sum = Grams::zeros(self.width);
        for shard in &self.shards {
            sum.add(&receive(&shard.grams));
        }
        sum
    }

    /// Backward passes over the batch of the last [`Self::grams`]: the summed gradient of every parameter.
    pub fn gradients(&mut self, head: &[f64], quotient: Quotient) -> Vec<Vec<f32>> {
        let head = Arc::new(head.to_vec());
        for shard in &self.shards {
            shard.send(Order::Backward { head: head.clone(), quotient });
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
    samples: &[(usize, Sample)],
    orders: &Receiver<Order>,
    grams_out: &Sender<Grams>,
    gradients_out: &Sender<Vec<Vec<f32>>>,
) {
    let device = Cpu::default();
    let mut trunk = None;
    let mut taped: Vec<(&Sample, Taped)> = Vec::new();
    while let Ok(order) = orders.recv() {
        let delivered = match order {
            Order::Forward { trunk: newest, batch } => {
                taped.clear();
                let mut sum = Grams::zeros(newest.shape().width);
                for (_, sample) in samples.iter().filter(|(index, _)| batch.contains(index)) {
                    let (features, grams) = forward(sample, &newest, &device);
                    sum.add(&grams);
                    taped.push((sample, features));
                }
                trunk = Some(newest);
                grams_out.send(sum).is_ok()
            }
            Order::Backward { head, quotient } => {
                let Some(trunk) = &trunk else { continue };
                let zeros: Vec<Vec<f32>> = trunk
                    .parameters()
                    .iter()
                    .map(|p| vec![0.0; p.shape().0 * p.shape().1])
                    .collect();
                let sum = taped.drain(..).fold(zeros, |sum, (sample, features)| {
                    let loss = rayleigh(features, &head, &sample.pencil, quotient);
                    let mut gradients = loss.backward();
                    let own = trunk.parameters().iter().map(|p| take(&mut gradients, p)).collect();
                    add_all(sum, own)
                });
                gradients_out.send(sum).is_ok()
            }
        };
        if !delivered {
            break;
        }
    }
}

fn forward(sample: &Sample, trunk: &Trunk<f32>, device: &Cpu) -> (Taped, Grams) {
    let x = sample.input.tensor(device).put_tape(OwnedTape::default());
    let features = trunk.forward(x, &sample.input.graph);
    let grams = Grams::of(
        &features.as_vec(),
        trunk.shape().width,
        &sample.stiffness,
        &sample.mass,
        &sample.pencil.deflation,
    );
    (features, grams)
}

fn take(gradients: &mut Gradients<f32, Cpu>, parameter: &Matrix<f32>) -> Vec<f32> {
    match gradients.get_or_alloc_mut(parameter) {
        Ok(gradient) => std::mem::take(&mut **gradient),
        Err(error) => panic!("no memory for a gradient: {error:?}"),
    }
}

fn add_all(mut sum: Vec<Vec<f32>>, other: Vec<Vec<f32>>) -> Vec<Vec<f32>> {
    for (sum, other) in sum.iter_mut().zip(&other) {
        sum.iter_mut().zip(other).for_each(|(a, b)| *a += b);
    }
    sum
}
