//! From a file to the canonical mesh.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::Failure;
use super::context::Context;
use super::intake::Job;
use crate::flow::events::How;
use crate::mesh::{self, Ingested, MeshHash};
use crate::publish::report::StageRecord;
use crate::store::Digest;

/// A mesh with the job that it came from.
#[derive(Debug, Clone)]
pub struct Loaded {
    /// Where it came from.
    pub job: Job,
    /// The mesh, its repairs and its topology.
    pub ingested: Arc<Ingested>,
    /// Its content hash.
    pub hash: MeshHash,
    /// K, how many eigenpairs it is to have.
    pub k: usize,
    /// The stages so far, in their order.
    pub stages: Vec<StageRecord>,
}

impl Loaded {
    /// The content hash as the input of a key.
    pub fn digest(&self) -> Digest {
        Digest::from_bytes(*self.hash.as_bytes())
    }

    /// Takes note of the time that a stage took.
    pub fn spent(&mut self, stage: impl Into<String>, how: How, time: Duration) {
        let (stage, seconds) = (stage.into(), time.as_secs_f64());
        self.stages.push(StageRecord { stage, cached: how == How::Reused, seconds });
    }
}

/// Reads and repairs the mesh of `job`.
///
/// # Errors
/// Why the file is no mesh; that the pipeline turns it away; or that it has too few vertices for K pairs.
pub fn ingest(context: &Context, job: Job) -> Result<Loaded, Failure> {
    let started = Instant::now();
    let ingested = match &job.object {
        None => mesh::load(&job.source)?,
        Some(object) => context.opened.open(&job.source)?.object(object)?,
    };
    context.pipeline.ingest.check(&ingested, &job.source)?;
    let n = ingested.mesh.n();
    let k = context.pipeline.train.k.of(n);
    if n < k {
        return Err(Failure::TooSmall { n, k });
    }
    if let Some(surface) = context.pipeline.verify.closed_form.surface() {
        surface.check(&ingested.mesh)?;
    }
    let areas = ingested.mesh.vertex_areas().into_iter();
    if let Some(area) = areas.chain([ingested.mesh.area().0]).find(|area| !area.is_normal()) {
        return Err(Failure::Area { area });
    }
    if !ingested.repairs.is_empty() {
        tracing::info!(mesh = job.name, "{}", ingested.repairs);
    }
    let hash = ingested.mesh.hash();
    let mut loaded = Loaded { job, ingested: Arc::new(ingested), hash, k, stages: Vec::new() };
    loaded.spent(StageRecord::INGEST, How::Computed, started.elapsed());
    Ok(loaded)
}
