//! A tiny untrained model of the unit sphere, for tests.

use super::*;
use crate::ggnn::block::TrainingRecord;
use crate::ggnn::recipe::Ritz;
use crate::ggnn::network::{Trunk, TrunkShape};
use crate::mesh::sample::icosphere;

/// Two blocks of four features, for icosphere(1).
pub fn sphere_model() -> Model {
    let mesh = icosphere(1);
    let Ritz { shape, ranges, .. } = Ritz::default();
    let shape = TrunkShape { width: 4, layers: 1, ..shape };
    let block = |seed: u64| Block {
        shape,
        weights: Trunk::<f32>::init(shape, ranges, seed).weights().into(),
        head: (0..4).map(|i| (seed as f64 + 0.1) / (i as f64 + 3.0)).collect(),
        record: TrainingRecord { history: vec![30.0, 1.0 / 3.0], untrained: 31.0, trained: 29.5 },
    };
    let normalise = Normalise::Area;
    let topology = Topology::of(&mesh);
    Model {
        description: Description {
            chladni: "0.0.0".into(),
            mesh: TrainedMesh::of("meshes/sphere.obj", &mesh, &topology, normalise),
            known: 1,
            normalise,
            operators: OperatorOptions::default(),
            deflation: DeflationRule::InnerProduct,
            parameters: serde_json::json!({ "train": { "seed": 3, "learning_rate": 6e-3 } }),
        },
        blocks: vec![block(1), block(2)],
    }
}
