//! From learned eigenfunctions to better ones: Rayleigh–Ritz on their span, or the solver started from them.
//!
//! A refined pair is a second result beside the learned one, whose λ and angles stay what they were.

use std::time::{Duration, Instant};

use super::artifacts::RefinementArtifact;
use super::assemble::Assembled;
use super::candidates::Candidates;
use super::context::{Context, Recalled};
use super::ingest::Loaded;
use super::verdict::Standard;
use super::work::{Work, canonical};
use super::{Failure, stand_in};
use crate::flow::events::How;
use crate::mesh::Ingested;
use crate::mesh::topology::component_labels;
use crate::pipeline::Refine;
use crate::spectrum::cluster::zero_below;
use crate::spectrum::factor::Analysis;
use crate::spectrum::nullspace::multiplicity;
use crate::spectrum::refine::lowest_from;
use crate::spectrum::{Dense, Eigenpairs, TrianglePencil, refine::rayleigh_ritz};
use crate::store::Digest;

/// Refined eigenpairs.
#[derive(Debug, Clone)]
pub struct Refinement {
    /// What was done.
    pub method: Refine,
    /// K pairs, vectors n×K on the mesh, unit B-norm in input units.
    pub pairs: Eigenpairs,
    /// Blocks of eight solves that it took; none for Rayleigh–Ritz.
    pub blocks: usize,
    /// Of the pairs.
    pub digest: Digest,
    /// Computed in this run or reused.
    pub how: How,
    /// Seconds spent on it in this run.
    pub seconds: f64,
}

impl Refinement {
    /// What the refined pairs are judged by: those of a solver by their residuals, combinations of learned functions by
    /// how far they are from the references.
    pub fn standard(&self) -> Standard {
        match self.method {
            Refine::None | Refine::RayleighRitz => Standard::References,
            Refine::Full => Standard::Residuals,
        }
    }

    fn new(method: Refine, recalled: Recalled<RefinementArtifact>, spent: Duration) -> Self {
        let Recalled { artifact, digest, how, .. } = recalled;
        let (pairs, blocks) = artifact.into();
        Self { method, pairs, blocks, digest, how, seconds: spent.as_secs_f64() }
    }
}

/// The stage of a run: refines the candidates as `train.refine` says.
///
/// # Errors
/// When a factorisation or the solver fails, or the run is interrupted.
pub fn refine(
    context: &Context,
    item: usize,
    mut candidates: Candidates,
) -> Result<Candidates, Failure> {
    let Candidates { assembled, vectors, digest, .. } = &mut candidates;
    candidates.refinement = match context.pipeline.train.refine {
        Refine::None => None,
        Refine::RayleighRitz => {
            let mesh = &assembled.loaded.ingested.mesh;
            let pencil = TrianglePencil::of_mesh(mesh, context.pipeline.operators)?;
            Some(by_rayleigh_ritz(context, item, &mut assembled.loaded, &pencil, vectors, *digest)?)
        }
        Refine::Full => Some(in_full(context, item, assembled, vectors, *digest)?),
    };
    Ok(candidates)
}

/// The Ritz pairs of (ΦᵀLΦ, ΦᵀBΦ), without a matrix. `digest` is that of Φ = `vectors`, n×K, whose first columns are the
/// eigenfunctions of λ = 0.
///
/// # Errors
/// When the functions are linearly dependent.
pub fn by_rayleigh_ritz(
    context: &Context,
    item: usize,
    loaded: &mut Loaded,
    pencil: &TrianglePencil,
    vectors: &Dense,
    digest: Digest,
) -> Result<Refinement, Failure> {
    let started = Instant::now();
    let work = work(context, Refine::RayleighRitz, loaded, digest);
    let Ingested { mesh, topology, .. } = &*loaded.ingested;
    let fixed = context.pipeline.operators.boundary.fixed(&topology.boundary_vertices);
    let known = multiplicity(&component_labels(mesh), fixed).min(vectors.ncols());
    let zero = zero_below(mesh.area().0);
    let stand_in = || stand_in::refinement(vectors.nrows(), vectors.ncols());
    let recalled = context.recall_costly(item, work.seeded(0, "f64"), stand_in, || {
        let projected = |phi: &Dense| pencil.projected(phi);
        let pairs = rayleigh_ritz(projected, vectors, known, zero).ok_or(Failure::Dependent)?;
        Ok((&pairs, 0).into())
    })?;
    loaded.spent("refine", recalled.how, started.elapsed());
    Ok(Refinement::new(Refine::RayleighRitz, recalled, started.elapsed()))
}

/// The solver's pairs, started from `vectors`, n×K, whose digest is `digest`.
///
/// # Errors
/// When the factorisation breaks down or the solver does not converge.
pub fn in_full(
    context: &Context,
    item: usize,
    assembled: &mut Assembled,
    vectors: &Dense,
    digest: Digest,
) -> Result<Refinement, Failure> {
    let started = Instant::now();
    let work = work(context, Refine::Full, &assembled.loaded, digest)
        .input("operators", &assembled.operators_digest);
    let stand_in = || stand_in::refinement(vectors.nrows(), vectors.ncols());
    let recalled = context.recall_costly(item, work.seeded(0, "f64"), stand_in, || {
        let problem = assembled.problem(context.pipeline.operators.boundary)?;
        let analysis = Analysis::new(problem.pencil())?;
        let free = problem.restrict(vectors);
        let (k, known) = (free.ncols(), problem.nullspace().ncols().min(free.ncols()));
        let start = free.subcols(known, k - known).to_owned();
        let refined = lowest_from(&problem, &analysis, &start)?;
        let Eigenpairs { values, vectors } = refined.pairs.truncated(k);
        let pairs = Eigenpairs { values, vectors: problem.extend(vectors) };
        Ok((&pairs, refined.blocks).into())
    })?;
    assembled.loaded.spent("refine", recalled.how, started.elapsed());
    Ok(Refinement::new(Refine::Full, recalled, started.elapsed()))
}

fn work(
    context: &Context,
    method: Refine,
    loaded: &Loaded,
    candidates: Digest,
) -> Work<RefinementArtifact> {
    Work::of_stage()
        .param("method", method.name())
        .param("operators", canonical(&context.pipeline.operators))
        .input("mesh", &loaded.digest())
        .input("candidates", &candidates)
}
