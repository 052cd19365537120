//! Holding eigenfunctions against the reference solver, M-PGD and Sylvester's law.

use std::time::Instant;

use super::artifacts::CertificateArtifact;
use super::assemble::Assembled;
use super::candidates::{Candidates, Origin};
use super::context::Context;
use super::reference;
use super::refine::Refinement;
use super::verdict::{Judgement, Standard, judge};
use super::work::Work;
use super::{Failure, stand_in};
use crate::spectrum::certificate::{PairCertificate, References, certify};
use crate::spectrum::closed_form::Deviation;
use crate::spectrum::factor::Analysis;
use crate::spectrum::fem::Reference;
use crate::spectrum::pencil::column;
use crate::spectrum::{Certificate, Dense, Eigenpairs, Problem};
use crate::store::Digest;

/// A mesh with its certified eigenpairs.
#[derive(Debug, Clone)]
pub struct Verified {
    /// The mesh.
    pub assembled: Assembled,
    /// Where the eigenfunctions come from.
    pub origin: Origin,
    /// φ₁ … φ_K on the mesh, n×K, unit B-norm in input units.
    pub vectors: Dense,
    /// Which candidate stands at each place: inside a cluster they are sorted by λ.
    pub order: Vec<usize>,
    /// What was measured.
    pub certificate: Certificate,
    /// What follows from it.
    pub judgement: Judgement,
    /// What a solver made of learned functions. Then λ and the angles of the certificate are those of the functions
    /// before; all else, and the judgement, is of the refined pairs.
    pub refinement: Option<Refinement>,
    /// How far the functions, and those that they are held against, are from a formula, where one is known.
    pub deviations: Option<Deviations>,
    /// Nothing was measured: this is a plan, and a run would.
    pub stands_in: bool,
}

/// How far functions are from those of a formula, by k; of the references at least as many as of one's own.
#[derive(Debug, Clone)]
pub struct Deviations {
    /// Of what is published.
    pub own: Vec<Deviation>,
    /// Of the reference solver's.
    pub fem: Vec<Deviation>,
    /// Of M-PGD's, as far as it got.
    pub mpgd: Vec<Deviation>,
}

/// Certifies the K eigenpairs of a mesh.
///
/// # Errors
/// When a factorisation breaks down or the run is interrupted.
pub fn verify(context: &Context, item: usize, candidates: Candidates) -> Result<Verified, Failure> {
    let started = Instant::now();
    let Candidates { mut assembled, vectors, digest, origin, refinement } = candidates;
    let (references, digests) = references(context, item, &assembled, &origin)?;
    let boundary = context.pipeline.operators.boundary;
    let problem = assembled.problem(boundary)?;
    let (vectors, order, standard) = match origin {
        Origin::Fem { .. } => {
            let order = (0..vectors.ncols()).collect();
            (vectors, order, Standard::Residuals)
        }
        Origin::Mpgd { .. } | Origin::Learned { .. } | Origin::Predicted { .. } => {
            let (vectors, order) = in_order(&problem, &vectors, &references);
            (vectors, order, Standard::References)
        }
    };
    let measure = |vectors: &Dense, digest: &Digest| {
        let work = Work::<CertificateArtifact>::of_stage()
            .param("boundary", boundary.name())
            .input("candidates", digest)
            .input("operators", &assembled.operators_digest);
        let work = digests.iter().fold(work, |work, (role, digest)| work.input(*role, digest));
        let stand_in = || stand_in::certificate(vectors.ncols());
        context.recall_costly(item, work.seeded(0, "f64"), stand_in, || {
            let analysis = Analysis::new(problem.pencil())?;
            Ok((&certify(&problem, &analysis, &problem.restrict(vectors), &references)?).into())
        })
    };
    let recalled = measure(&vectors, &digest)?;
    let (how, mut stands_in) = (recalled.how, recalled.stands_in);
    let mut certificate = Certificate::from(recalled.artifact);
    let tolerances = &context.pipeline.verify;
    let judgement = match &refinement {
        None => judge(&certificate, tolerances, standard),
        Some(refined) => {
            let measured = measure(&refined.pairs.vectors, &refined.digest)?;
            stands_in |= measured.stands_in;
            let measured = Certificate::from(measured.artifact);
            let judgement = judge(&measured, tolerances, refined.standard());
            certificate = beside(&certificate, measured);
            judgement
        }
    };
    let deviations = match stands_in {
        true => None,
        false => deviations(context, &assembled, &problem, &vectors, &references)?,
    };
    drop(problem);
    assembled.loaded.spent("verify", how, started.elapsed());
    let verified = Verified {
        assembled,
        origin,
        vectors,
        order,
        certificate,
        judgement,
        refinement,
        deviations,
        stands_in,
    };
    Ok(verified)
}

/// What the formula that the pipeline names says of the functions and their references.
fn deviations(
    context: &Context,
    assembled: &Assembled,
    problem: &Problem<'_>,
    vectors: &Dense,
    references: &References,
) -> Result<Option<Deviations>, Failure> {
    let Some(surface) = context.pipeline.verify.closed_form.surface() else { return Ok(None) };
    let (mesh, boundary) = (&assembled.loaded.ingested.mesh, context.pipeline.operators.boundary);
    let exact = surface.eigenpairs(mesh, boundary, vectors.ncols())?;
    let of = |vectors: &Dense| exact.deviations(vectors, &assembled.operators.mass);
    let reference = |pairs: &Eigenpairs| of(&problem.extend(pairs.vectors.clone()));
    Ok(Some(Deviations {
        own: of(vectors),
        fem: reference(&references.fem.pairs),
        mpgd: references.mpgd.as_ref().map(|mpgd| reference(&mpgd.pairs)).unwrap_or_default(),
    }))
}

/// The certificate of refined pairs with the λ and the angles of the learned ones.
fn beside(learned: &Certificate, refined: Certificate) -> Certificate {
    let pairs = refined.pairs.into_iter().zip(&learned.pairs).map(|(refined, learned)| {
        let PairCertificate { lambda, angle_fem, angle_mpgd, .. } = *learned;
        PairCertificate { lambda, angle_fem, angle_mpgd, ..refined }
    });
    Certificate { pairs: pairs.collect(), ..refined }
}

/// The inputs of a certificate, by role.
type Roles = Vec<(&'static str, Digest)>;

/// What the candidates are held against. The reference solver needs no second opinion: residuals and Sylvester's law
/// prove its pairs.
fn references(
    context: &Context,
    item: usize,
    assembled: &Assembled,
    origin: &Origin,
) -> Result<(References, Roles), Failure> {
    if let Origin::Fem { reference, .. } = origin {
        return Ok((References { fem: (**reference).clone(), mpgd: None }, Vec::new()));
    }
    let fem = reference::fem(context, item, assembled)?;
    let mut digests = vec![("reference", fem.digest)];
    let fem = Reference::from(fem.artifact);
    if let Origin::Mpgd { opinion, .. } = origin {
        return Ok((References { fem, mpgd: Some((**opinion).clone()) }, digests));
    }
    let mpgd = reference::mpgd(context, item, assembled, fem.pairs.len())?;
    digests.push(("second opinion", mpgd.digest));
    Ok((References { fem, mpgd: Some(mpgd.artifact.into()) }, digests))
}

/// Sorts the candidates by Rayleigh quotient inside each cluster of the reference, whose basis is arbitrary, and nowhere
/// else: a pair in the wrong cluster is an error to be seen. Returns them with where each came from.
fn in_order(
    problem: &Problem<'_>,
    candidates: &Dense,
    references: &References,
) -> (Dense, Vec<usize>) {
    let pencil = problem.pencil();
    let free = problem.restrict(candidates);
    let quotients: Vec<f64> =
        (0..free.ncols()).map(|j| pencil.rayleigh_quotient(column(&free, j))).collect();
    let mut order: Vec<usize> = (0..quotients.len()).collect();
    for run in references.clusters(pencil.area()) {
        let end = run.end.min(order.len());
        // The indicators of components stay by lowest vertex index.
        if run.start < end && run.start >= problem.nullspace().ncols() {
            order[run.start..end].sort_by(|&a, &b| quotients[a].total_cmp(&quotients[b]));
        }
    }
    let sorted = Dense::from_fn(candidates.nrows(), order.len(), |i, j| candidates[(i, order[j])]);
    (sorted, order)
}
