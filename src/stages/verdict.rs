//! A certificate against a pipeline's tolerances: which pairs are verified, and why others are not.

use crate::pipeline::Verify;
use crate::spectrum::Certificate;
use crate::spectrum::certificate::PairCertificate;
use crate::spectrum::mpgd::StoppedBy;

/// What follows from a certificate.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Judgement {
    /// For every pair what it falls short of; empty for a verified pair.
    pub pairs: Vec<Vec<Shortfall>>,
    /// What the set as a whole falls short of.
    pub set: Vec<Shortfall>,
}

/// A tolerance that was not met.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Shortfall {
    /// |λ − λ_FEM| is too large.
    #[error("λ differs from the reference")]
    LambdaFem,
    /// |λ − λ_MPGD| is too large, where M-PGD has converged.
    #[error("λ differs from M-PGD")]
    LambdaMpgd,
    /// The angle to the reference cluster is too large.
    #[error("angle to the reference")]
    AngleFem,
    /// The angle to M-PGD's cluster is too large, where M-PGD has converged.
    #[error("angle to M-PGD")]
    AngleMpgd,
    /// ‖Lφ − λBφ‖ is too large.
    #[error("the residual is too large")]
    Residual,
    /// ΦᵀBΦ is too far from I.
    #[error("the eigenfunctions are not orthonormal")]
    Orthonormality,
    /// The count by inertia does not match, or could not be trusted.
    #[error("an eigenvalue is missing or repeated")]
    Completeness,
}

impl Judgement {
    /// Whether nothing falls short.
    pub fn is_verified(&self) -> bool {
        self.set.is_empty() && self.pairs.iter().all(Vec::is_empty)
    }

    /// What falls short, in words; empty when nothing does.
    pub fn reason(&self) -> String {
        let pairs = self.pairs.iter().enumerate().filter(|(_, short)| !short.is_empty());
        let mut reasons: Vec<String> =
            pairs.map(|(j, short)| format!("pair {}: {}", j + 1, join(short))).collect();
        if !self.set.is_empty() {
            reasons.push(join(&self.set));
        }
        reasons.join("; ")
    }
}

fn join(shortfalls: &[Shortfall]) -> String {
    shortfalls.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
}

/// What pairs are judged by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Standard {
    /// Learned pairs: by how far they are from both references.
    References,
    /// Solved pairs: by their residuals, which bound the error of λ.
    Residuals,
}

/// Judges every pair and the set. A measurement that is not a number falls short.
pub fn judge(certificate: &Certificate, tolerances: &Verify, standard: Standard) -> Judgement {
    // For λ = 0, relative means relative to the first eigenvalue that is not; where K ends before it, to the shift in
    // the gap below it.
    let sigma = certificate.completeness.sigma;
    let positive = |pair: &&PairCertificate| pair.lambda_fem > ZERO * sigma;
    let first = certificate.pairs.iter().find(positive).map_or(sigma, |pair| pair.lambda_fem);
    let converged =
        |pair: &PairCertificate| pair.mpgd.is_none_or(|run| run.stopped_by == StoppedBy::Tolerance);
    let pairs = certificate.pairs.iter().map(|pair| {
        // Its cluster is compared as a whole, so one unconverged member spoils the angle of all.
        let mut cluster = certificate.pairs.iter().filter(|other| other.cluster == pair.cluster);
        match standard {
            Standard::Residuals => judge_residual(pair, tolerances, first),
            Standard::References => {
                judge_pair(pair, tolerances, first, converged(pair), cluster.all(converged))
            }
        }
    });
    let mut set = Vec::new();
    if exceeds(certificate.orthonormality, tolerances.orthonormality_tolerance) {
        set.push(Shortfall::Orthonormality);
    }
    if !certificate.completeness.complete {
        set.push(Shortfall::Completeness);
    }
    Judgement { pairs: pairs.collect(), set }
}

/// An eigenvalue below this multiple of the largest is zero to working precision.
const ZERO: f64 = 1e-9;

fn judge_residual(pair: &PairCertificate, tolerances: &Verify, first: f64) -> Vec<Shortfall> {
    let residual = pair.residual / pair.lambda.max(first);
    let short = exceeds(residual, tolerances.residual_tolerance);
    short.then_some(Shortfall::Residual).into_iter().collect()
}

fn judge_pair(
    pair: &PairCertificate,
    tolerances: &Verify,
    first: f64,
    mpgd_converged: bool,
    cluster_converged: bool,
) -> Vec<Shortfall> {
    let relative = |reference: f64| {
        let scale = if reference.abs() > 1e-6 * first { reference.abs() } else { first };
        (pair.lambda - reference).abs() / scale
    };
    let checks = [
        (relative(pair.lambda_fem), tolerances.lambda_tolerance, true, Shortfall::LambdaFem),
        (
            relative(pair.lambda_mpgd),
            tolerances.lambda_tolerance,
            mpgd_converged,
            Shortfall::LambdaMpgd,
        ),
        (pair.angle_fem, tolerances.angle_tolerance, true, Shortfall::AngleFem),
        (pair.angle_mpgd, tolerances.angle_tolerance, cluster_converged, Shortfall::AngleMpgd),
    ];
    checks
        .into_iter()
        .filter(|&(value, tolerance, applies, _)| applies && exceeds(value, tolerance))
        .map(|(_, _, _, shortfall)| shortfall)
        .collect()
}

fn exceeds(value: f64, tolerance: f64) -> bool {
    value.is_nan() || value > tolerance
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectrum::certificate::Completeness;
    use crate::spectrum::mpgd::Run;

    fn certificate() -> Certificate {
        let run =
            Run { iterations: 9, change: 0.0, residual: 1e-9, stopped_by: StoppedBy::Tolerance };
        let pair = |lambda: f64, reference: f64, cluster: usize| PairCertificate {
            lambda,
            cluster,
            residual: 0.0,
            rho: 0.0,
            lambda_fem: reference,
            lambda_mpgd: reference,
            angle_fem: 0.01,
            angle_mpgd: 0.01,
            mpgd: (cluster > 0).then_some(run),
        };
        Certificate {
            orthonormality: 1e-14,
            pairs: vec![pair(1e-15, -1e-14, 0), pair(2.01, 2.0, 1)],
            completeness: Completeness {
                sigma: 3.0,
                count: Some(2),
                found: 2,
                complete: true,
                cut_cluster: false,
            },
        }
    }

    #[test]
    fn each_shortfall_is_named() {
        let tolerances = Verify::default();
        assert!(judge(&certificate(), &tolerances, Standard::References).is_verified());
        let with = |change: fn(&mut Certificate)| {
            let mut certificate = certificate();
            change(&mut certificate);
            judge(&certificate, &tolerances, Standard::References)
        };
        assert_eq!(
            with(|c| c.pairs[1].lambda = 2.03).pairs[1],
            [Shortfall::LambdaFem, Shortfall::LambdaMpgd]
        );
        assert_eq!(with(|c| c.pairs[1].angle_fem = 0.06).pairs[1], [Shortfall::AngleFem]);
        assert_eq!(with(|c| c.pairs[1].angle_mpgd = f64::NAN).pairs[1], [Shortfall::AngleMpgd]);
        assert_eq!(with(|c| c.orthonormality = 1e-3).set, [Shortfall::Orthonormality]);
        let incomplete = with(|c| c.completeness.complete = false);
        assert_eq!(incomplete.reason(), "an eigenvalue is missing or repeated");
    }

    #[test]
    fn solved_pairs_are_judged_by_their_residuals_alone() {
        let mut certificate = certificate();
        certificate.pairs[1].lambda_mpgd = f64::NAN;
        certificate.pairs[1].mpgd = None;
        let judged = |c: &Certificate| judge(c, &Verify::default(), Standard::Residuals);
        assert!(judged(&certificate).is_verified());
        certificate.pairs[0].residual = 1e-5;
        assert_eq!(judged(&certificate).pairs, [vec![Shortfall::Residual], vec![]]);
    }

    #[test]
    fn an_unconverged_second_opinion_does_not_count() {
        let mut certificate = certificate();
        certificate.pairs[1].lambda_mpgd = 9.0;
        certificate.pairs[1].mpgd =
            Some(Run { iterations: 9, change: 0.1, residual: 0.5, stopped_by: StoppedBy::Count });
        assert!(judge(&certificate, &Verify::default(), Standard::References).is_verified());
    }
}
