//! Predicting the eigenfunctions on the input mesh, and holding them against M-PGD and the reference solver.

use std::time::Instant;

use super::Failure;
use super::artifacts::{CertificateArtifact, PredictionArtifact, ReferenceArtifact};
use super::assemble::network_input;
use super::context::{Context, Recalled, Work, canonical};
use super::train::InTraining;
use super::verdict::{Judgement, judge};
use crate::ggnn::predict::predict_all;
use crate::mesh::topology::component_labels;
use crate::pipeline::MpgdDirection;
use crate::spectrum::certificate::{References, certify, cluster_end, reference_past_gap};
use crate::spectrum::factor::Analysis;
use crate::spectrum::mpgd::{self, Direction, StoppedBy};
use crate::spectrum::nullspace::nullspace;
use crate::spectrum::pencil::column;
use crate::spectrum::{Certificate, Dense, Eigenpairs, Pencil};
use crate::store::Digest;

/// A mesh with its certified eigenpairs.
#[derive(Debug, Clone)]
pub struct Verified {
    /// The mesh and its blocks.
    pub trained: InTraining,
    /// φ₁ … φ_K on the input mesh, n×K, unit B-norm in input units.
    pub vectors: Dense,
    /// Which predicted column stands at each place: inside a cluster they are sorted by λ.
    pub order: Vec<usize>,
    /// What was measured.
    pub certificate: Certificate,
    /// What follows from it.
    pub judgement: Judgement,
}

/// Predicts and certifies the K eigenpairs of a mesh.
///
/// # Errors
/// When a factorisation breaks down or the run is interrupted.
pub fn verify(
    context: &Context,
    item: usize,
    mut trained: InTraining,
) -> Result<Verified, Failure> {
    let started = Instant::now();
    let prediction = predict(context, item, &trained)?;
    trained.assembled.loaded.spent("predict", prediction.how, prediction.spent);
    let references = references(context, item, &trained)?;
    let predicted = Dense::from(prediction.artifact);
    let work = Work::<CertificateArtifact>::of_stage()
        .input("prediction", &prediction.digest)
        .input("operators", &trained.assembled.operators_digest)
        .input("reference", &references.digest)
        .seeded(0, "f64");
    let references = References::from(references.artifact);
    let pencil = Pencil::from(&*trained.assembled.operators);
    let order = order_within_clusters(pencil, &predicted, &references);
    let vectors = Dense::from_fn(predicted.nrows(), order.len(), |i, j| predicted[(i, order[j])]);
    let recalled = context.recall(item, work, || {
        let analysis = Analysis::new(pencil)?;
        Ok((&certify(pencil, &analysis, &vectors, &references)?).into())
    })?;
    let how = recalled.how;
    let certificate = Certificate::from(recalled.artifact);
    let judgement = judge(&certificate, &context.pipeline.verify);
    let spent = started.elapsed().saturating_sub(prediction.spent);
    trained.assembled.loaded.spent("verify", how, spent);
    Ok(Verified { trained, vectors, order, certificate, judgement })
}

fn predict(
    context: &Context,
    item: usize,
    trained: &InTraining,
) -> Result<Recalled<PredictionArtifact>, Failure> {
    let loaded = &trained.assembled.loaded;
    let features = context.pipeline.features.normalise;
    let k = context.pipeline.train.k;
    let work = trained.blocks.iter().fold(
        Work::<PredictionArtifact>::of_stage()
            .param("features", canonical(&features))
            .param("k", k.to_string())
            .input("mesh", &loaded.digest())
            .input("operators", &trained.assembled.operators_digest),
        |work, block| work.input(format!("block {}", block.k), &block.digest),
    );
    context.recall(item, work.seeded(0, "f32"), || {
        let operators = &trained.assembled.operators;
        let mesh = &loaded.ingested.mesh;
        let input = network_input(context, mesh, operators);
        let blocks = trained.blocks.iter().map(|trained| &*trained.block);
        let vectors = predict_all(&zero_modes(trained, k), blocks, &input, &operators.mass);
        Ok((&vectors).into())
    })
}

/// Sorts the predicted columns by Rayleigh quotient inside each cluster of the reference, whose basis is arbitrary,
/// and nowhere else: a pair in the wrong cluster is an error to be seen.
fn order_within_clusters(
    pencil: Pencil<'_>,
    predicted: &Dense,
    references: &References,
) -> Vec<usize> {
    let quotients: Vec<f64> =
        (0..predicted.ncols()).map(|j| pencil.rayleigh_quotient(column(predicted, j))).collect();
    let mut order: Vec<usize> = (0..quotients.len()).collect();
    for run in references.clusters(pencil.area()) {
        let end = run.end.min(order.len());
        // The indicators of components stay by lowest vertex index.
        if run.start < end && run.start > 0 {
            order[run.start..end].sort_by(|&a, &b| quotients[a].total_cmp(&quotients[b]));
        }
    }
    order
}

/// The eigenfunctions of λ = 0 on the input mesh, at most k of them.
fn zero_modes(trained: &InTraining, k: usize) -> Dense {
    let assembled = &trained.assembled;
    let labels = component_labels(&assembled.loaded.ingested.mesh);
    let all = nullspace(&labels, &assembled.operators.mass);
    let count = all.ncols().min(k);
    all.subcols(0, count).to_owned()
}

/// The two independent solutions of the same pencil. They depend on the operators alone: no block, and no
/// tolerance of the verdict, enters their key, and nothing of theirs enters training.
fn references(
    context: &Context,
    item: usize,
    trained: &InTraining,
) -> Result<Recalled<ReferenceArtifact>, Failure> {
    let k = context.pipeline.train.k;
    let verify = &context.pipeline.verify;
    let operators: &Digest = &trained.assembled.operators_digest;
    let work = Work::<ReferenceArtifact>::of_stage()
        .param("k", k.to_string())
        .param("mpgd stopping", canonical(&verify.stopping()))
        .param("mpgd direction", canonical(&verify.mpgd_direction))
        .input("mesh", &trained.assembled.loaded.digest())
        .input("operators", operators)
        .seeded(verify.mpgd_seed, "f64");
    context.recall(item, work, || {
        let pencil = Pencil::from(&*trained.assembled.operators);
        let analysis = Analysis::new(pencil)?;
        let fem = reference_past_gap(pencil, &analysis, k)?;
        // A cluster that K cuts is compared as a whole.
        let count = cluster_end(&fem.values, k, pencil.area());
        let vectors = zero_modes(trained, count);
        let known = Eigenpairs { values: vec![0.0; vectors.ncols()], vectors };
        let cancelled = || context.cancel.is_cancelled();
        let factor = analysis.cholesky(1.0 / pencil.area())?;
        let direction = match verify.mpgd_direction {
            MpgdDirection::Gradient => Direction::Gradient,
            MpgdDirection::Preconditioned => Direction::Preconditioned(&factor),
        };
        let (stopping, seed) = (verify.stopping(), verify.mpgd_seed);
        let (mpgd, mpgd_runs) =
            mpgd::lowest(pencil, &known, count, direction, stopping, seed, &cancelled);
        if mpgd_runs.iter().any(|run| run.stopped_by == StoppedBy::Cancelled) {
            return Err(Failure::Interrupted);
        }
        Ok((&References { fem, mpgd, mpgd_runs }).into())
    })
}
