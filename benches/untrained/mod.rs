//! Blocks whose weights are drawn and whose heads are arbitrary: the time of a prediction does not depend on them.

use std::sync::Arc;

use chladni::ggnn::Block;
use chladni::ggnn::block::TrainingRecord;
use chladni::ggnn::network::{Layer, Trunk, TrunkShape};
use chladni::ggnn::recipe::Ritz;

/// So many blocks of the default size, on one trunk or on one each.
pub fn blocks(shared: bool, layer: Layer, count: usize) -> Vec<Block> {
    let shape = TrunkShape { layer, ..Ritz::default().shape };
    let weights = |seed| Arc::new(Trunk::init(shape, Ritz::default().ranges, seed).weights());
    let first = weights(0);
    let record = TrainingRecord::default();
    let block = |k: usize| Block {
        shape,
        weights: if shared { first.clone() } else { weights(k as u64) },
        head: (0..shape.width).map(|j| ((j * j * (k + 3) + 7 * k) as f64).sin()).collect(),
        record: record.clone(),
    };
    (1..=count).map(block).collect()
}
