//! A model: the chain of blocks that was trained for one mesh, with all that prediction on another sampling of the same
//! shape needs to know.
//!
//! - [`file`](mod@file): a model as a safetensors file
//! - [`fit`]: whether a mesh can be predicted with it, and whether it looks like the trained shape

pub mod file;
pub mod fit;

use serde::{Deserialize, Serialize};

use super::block::Block;
use super::features::Features;
use super::likeness::Moments;
use crate::mesh::{MeshHash, Topology, TriMesh};
use crate::operators::OperatorOptions;

pub use file::{ModelFault, ModelFileError};
pub use fit::{Unfit, Unlike};

/// The blocks of one training, in the order of their eigenfunctions.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// What they were trained on, and how.
    pub description: Description,
    /// The blocks of φ_{c+1}, φ_{c+2}, … after the c eigenfunctions of λ = 0.
    pub blocks: Vec<Block>,
}

impl Model {
    /// K: how many eigenpairs it predicts, those of λ = 0 included.
    pub fn k(&self) -> usize {
        self.description.known + self.blocks.len()
    }

    /// The blocks, those on one trunk together.
    pub fn trunks(&self) -> impl Iterator<Item = &[Block]> {
        self.blocks.chunk_by(Block::shares_trunk)
    }
}

/// All but the weights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Description {
    /// The version of this crate that trained it.
    pub chladni: String,
    /// The mesh it was trained for.
    pub mesh: TrainedMesh,
    /// c: how many eigenfunctions need no block, those of λ = 0.
    pub known: usize,
    /// What the network reads of a mesh.
    pub features: Features,
    /// The pencil (L, B) of training: the mass that predictions are deflated and scaled by, and the boundary condition.
    pub operators: OperatorOptions,
    /// How predictions are kept away from earlier ones.
    pub deflation: DeflationRule,
    /// The parameters of the pipeline that trained it.
    pub parameters: serde_json::Value,
}

/// How a prediction is deflated against the earlier ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DeflationRule {
    /// By the inner product of the mesh that is predicted on: no coefficients are kept from training.
    InnerProduct,
}

/// The mesh that a model was trained for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrainedMesh {
    /// The name of its file, without folders.
    pub name: String,
    /// Its content hash.
    pub hash: MeshHash,
    /// V.
    pub vertices: usize,
    /// F.
    pub faces: usize,
    /// Pieces that share no vertex.
    pub components: usize,
    /// Closed curves of edges with one triangle.
    pub boundary_loops: usize,
    /// χ = V − E + F.
    pub euler: i64,
    /// In squared input units.
    pub area: f64,
    /// Where its surface lies, as the network reads it; none where it reads nothing that depends on that.
    pub moments: Option<Moments>,
}

impl TrainedMesh {
    /// Describes a mesh whose file has this name, and of which `features` are read.
    pub fn of(name: &str, mesh: &TriMesh, topology: &Topology, features: &Features) -> Self {
        Self {
            name: name.rsplit('/').next().unwrap_or(name).to_string(),
            hash: mesh.hash(),
            vertices: topology.vertices,
            faces: topology.faces,
            components: topology.components,
            boundary_loops: topology.boundary_loops,
            euler: topology.euler_characteristic,
            area: mesh.area().0,
            moments: features.placed().map(|normalise| Moments::of(mesh, normalise)),
        }
    }
}

#[cfg(test)]
pub(crate) mod samples;
