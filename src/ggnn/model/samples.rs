//! A tiny untrained model of the unit sphere, for tests.

use super::*;
use crate::ggnn::block::{Check, TrainingRecord};
use crate::ggnn::features::FeatureOptions;
use crate::ggnn::network::{Trunk, TrunkShape};
use crate::ggnn::recipe::Ritz;
use crate::mesh::sample::icosphere;

/// [`sphere_model`], with one more head on the trunk of its second block.
pub fn shared_model() -> Model {
    let mut model = sphere_model();
    let second = &model.blocks[1];
    let head = second.head.iter().map(|w| 1.0 - w).collect();
    let record = TrainingRecord { untrained: 64.0, trained: 60.5, ..second.record.clone() };
    let third = Block { head, record, ..second.clone() };
    model.blocks.push(third);
    model
}

/// Two blocks of four features, for icosphere(1).
pub fn sphere_model() -> Model {
    sphere_model_reading(Features::of(&icosphere(1), FeatureOptions::default()))
}

/// [`sphere_model`], reading other features.
pub fn sphere_model_reading(features: Features) -> Model {
    let mesh = icosphere(1);
    let Ritz { shape, ranges, .. } = Ritz::default();
    let shape = TrunkShape { width: 4, layers: 1, inputs: features.inputs().unwrap(), ..shape };
    let block = |seed: u64| Block {
        shape,
        weights: Trunk::<f32>::init(shape, ranges, seed).weights().into(),
        head: (0..4).map(|i| (seed as f64 + 0.1) / (i as f64 + 3.0)).collect(),
        record: TrainingRecord {
            history: vec![30.0, 1.0 / 3.0],
            untrained: 31.0,
            trained: 29.5,
            held_out: vec![Check { step: 1, loss: 3.5 }, Check { step: 2, loss: 1.0 / 7.0 }],
        },
    };
    let topology = Topology::of(&mesh);
    Model {
        description: Description {
            chladni: "0.0.0".into(),
            mesh: TrainedMesh::of("meshes/sphere.obj", &mesh, &topology, &features),
            known: 1,
            features,
            operators: OperatorOptions::default(),
            deflation: DeflationRule::InnerProduct,
            parameters: serde_json::json!({ "train": { "seed": 3, "learning_rate": 6e-3 } }),
        },
        blocks: vec![block(1), block(2)],
    }
}
