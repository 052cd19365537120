//! What the work was: `run.json` for one mesh, and the document of `chladni run --format json` for all of them.
//!
//! Here are the times and what the cache gave, which `spectrum.json` leaves out.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::json::{document, null_is_nan};
use super::result::{Ancestor, Completeness, Eigenpair, RepairCounts, Spectrum, Verdict};
use crate::mesh::MeshHash;

/// The format of `run.json`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum RunRecordSchema {
    /// The one that [`RunRecord`] describes.
    #[default]
    #[serde(rename = "chladni-mesh-run-1")]
    V1,
}

/// The document `run.json`: how the results of one mesh came about.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunRecord {
    /// The format.
    pub schema: RunRecordSchema,
    /// The stages in their order.
    pub stages: Vec<StageRecord>,
    /// The pairs that took work of their own, by ascending k.
    pub pairs: Vec<PairRecord>,
    /// Blocks that were trained.
    pub trained: usize,
    /// Blocks that came from the store.
    pub reused: usize,
    /// From the first stage to the last.
    #[serde(deserialize_with = "null_is_nan")]
    pub seconds: f64,
    /// Every piece of work with what it depended on: what a later run is compared with.
    #[serde(default)]
    pub work: Vec<WorkRecord>,
}

impl RunRecord {
    /// The bytes of `run.json`.
    pub fn to_json(&self) -> Vec<u8> {
        document(self)
    }
}

/// One stage of the work on one mesh.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StageRecord {
    /// Its name.
    pub stage: String,
    /// Whether its result came from the store.
    pub cached: bool,
    /// How long it took.
    #[serde(deserialize_with = "null_is_nan")]
    pub seconds: f64,
}

impl StageRecord {
    /// The stage that reads and mends a file.
    pub const INGEST: &str = "ingest";
    /// The stage that writes results.
    pub const PUBLISH: &str = "publish";

    /// Whether it computes something: reading a file and writing results has to be done every time.
    pub fn computes(&self) -> bool {
        ![Self::INGEST, Self::PUBLISH].contains(&&*self.stage)
    }
}

/// A piece of work that has a place in the cache.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WorkRecord {
    /// Its stage, as keys name it.
    pub stage: String,
    /// Which of several (the eigenfunction, for training), counted from 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part: Option<usize>,
    /// Whether its result came from the store.
    pub cached: bool,
    /// What its key is made of: parameters as they are, contents by the beginning of a hash.
    pub fields: BTreeMap<String, serde_json::Value>,
}

/// The work for one eigenpair.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PairRecord {
    /// Its place, from 1.
    pub k: usize,
    /// Whether its block came from the store.
    pub cached: bool,
    /// How long it took.
    #[serde(deserialize_with = "null_is_nan")]
    pub seconds: f64,
}

/// The format of the document of `chladni run --format json`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum RunReportSchema {
    /// The one that [`RunReport`] describes.
    #[default]
    #[serde(rename = "chladni-run-1")]
    V1,
}

/// The document of `chladni run --format json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunReport {
    /// The format.
    pub schema: RunReportSchema,
    /// One entry a mesh.
    pub meshes: Vec<MeshReport>,
    /// The whole run.
    #[serde(deserialize_with = "null_is_nan")]
    pub seconds: f64,
}

impl RunReport {
    /// The report of a run over these meshes.
    pub fn new(meshes: Vec<MeshReport>, seconds: f64) -> Self {
        Self { schema: RunReportSchema::V1, meshes, seconds }
    }

    /// The document of `chladni run --format json`.
    pub fn to_json(&self) -> Vec<u8> {
        document(self)
    }
}

/// How one mesh ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// All its checks are within the tolerances.
    Verified,
    /// It has results, but some check is not.
    Unverified,
    /// It has no results.
    Failed,
}

impl From<Verdict> for Status {
    fn from(verdict: Verdict) -> Self {
        match verdict {
            Verdict::Verified => Self::Verified,
            Verdict::Unverified => Self::Unverified,
        }
    }
}

/// One mesh in a [`RunReport`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MeshReport {
    /// The file, relative to the input that it was found under.
    pub path: String,
    /// The content hash; null when the file did not become a mesh.
    pub hash: Option<MeshHash>,
    /// The number of vertices; null for a failed mesh.
    pub vertices: Option<usize>,
    /// Surface area in squared input units; null for a failed mesh.
    pub area: Option<f64>,
    /// How it ended.
    pub status: Status,
    /// Why it is not verified.
    pub reason: Option<String>,
    /// The folder of its results; null for a failed mesh.
    pub out: Option<String>,
    /// What was changed between the file and the mesh; null for a failed mesh.
    #[serde(default)]
    pub repairs: Option<RepairCounts>,
    /// One entry a pair; empty for a failed mesh.
    pub eigenpairs: Vec<PairReport>,
    /// Whether an eigenvalue was missed or repeated; null for a failed mesh.
    pub completeness: Option<Completeness>,
    /// The previous version that its pairs come from; only there when they do.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub grown_from: Option<Ancestor>,
    /// Blocks that were trained.
    pub trained: usize,
    /// Blocks that came from the store.
    pub reused: usize,
    /// The stages in their order; empty for a failed mesh.
    #[serde(default)]
    pub stages: Vec<StageRecord>,
    /// The work on this mesh.
    #[serde(deserialize_with = "null_is_nan")]
    pub seconds: f64,
}

/// One eigenpair in a [`MeshReport`]: what was found, and what the work was.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PairReport {
    /// As in `spectrum.json`; in the document its fields stand beside the two below.
    #[serde(flatten)]
    pub pair: Eigenpair,
    /// Whether its block came from the store.
    pub cached: bool,
    /// How long it took; null when it took no work of its own.
    #[serde(deserialize_with = "null_is_nan")]
    pub seconds: f64,
}

impl MeshReport {
    /// A mesh with results: what was found and what the work was. `out` is the folder of the results,
    /// `reason` what an unverified spectrum falls short of.
    pub fn finished(
        path: String,
        out: String,
        spectrum: &Spectrum,
        reason: Option<String>,
        run: &RunRecord,
    ) -> Self {
        let eigenpairs = spectrum.eigenpairs.iter().map(|pair| {
            let work = run.pairs.iter().find(|work| work.k == pair.k);
            PairReport {
                pair: pair.clone(),
                cached: work.is_some_and(|work| work.cached),
                seconds: work.map_or(f64::NAN, |work| work.seconds),
            }
        });
        Self {
            path,
            hash: Some(spectrum.mesh.hash),
            vertices: Some(spectrum.mesh.vertices),
            area: Some(spectrum.mesh.area),
            status: spectrum.status.into(),
            reason,
            out: Some(out),
            repairs: Some(spectrum.repairs.clone()),
            eigenpairs: eigenpairs.collect(),
            completeness: spectrum.completeness.clone(),
            grown_from: spectrum.provenance.grown_from,
            trained: run.trained,
            reused: run.reused,
            stages: run.stages.clone(),
            seconds: run.seconds,
        }
    }

    /// A mesh without results. `hash` is known when it failed after ingest.
    pub fn failed(path: String, hash: Option<MeshHash>, reason: String, seconds: f64) -> Self {
        Self {
            path,
            hash,
            vertices: None,
            area: None,
            status: Status::Failed,
            reason: Some(reason),
            out: None,
            repairs: None,
            eigenpairs: Vec::new(),
            completeness: None,
            grown_from: None,
            trained: 0,
            reused: 0,
            stages: Vec::new(),
            seconds,
        }
    }
}

#[cfg(test)]
pub(super) mod tests;
