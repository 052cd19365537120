//! What was checked of a set of eigenpairs; each measure is explained at its field.
//!
//! Nothing here decides; [`Certificate`] only measures. The verdict against a pipeline's tolerances is taken by
//! the caller.

use std::ops::Range;

use super::cluster::{CLUSTER_GAP, clusters, zero_below};
use super::dual_norm::{energy_norms, inverse_mass_norms};
use super::factor::Analysis;
use super::fem::{self, Reference};
use super::inertia::count_below;
use super::panel::{Panel, Row, WIDTH};
use super::pencil::{column, combine, dot, inner, product, projection};
use super::rayleigh_ritz::ritz_pairs;
use super::{Dense, Eigenpairs, Pencil, Problem, SpectrumError, mpgd};
use crate::operators::Sparse;

/// The measurements for one eigenpair (θ, φ), φᵀBφ = 1, r = Lφ − θBφ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairCertificate {
    /// θ, the Rayleigh quotient of φ, in 1/(input unit)².
    pub lambda: f64,
    /// Which cluster of the reference spectrum the pair belongs to, counted from 0.
    pub cluster: usize,
    /// ‖r‖ in the B⁻¹ norm: some eigenvalue lies within this distance of θ.
    pub residual: f64,
    /// ρ: some eigenvalue λᵢ has |λᵢ − θ| ≤ ρ (λᵢ + θ) (for θ near 0: ≤ ρ (λᵢ + λ₂)).
    pub rho: f64,
    /// The reference solver's eigenvalue.
    pub lambda_fem: f64,
    /// M-PGD's eigenvalue.
    pub lambda_mpgd: f64,
    /// Largest principal angle to the reference cluster, radians.
    pub angle_fem: f64,
    /// Largest principal angle to M-PGD's vectors of the cluster, radians.
    pub angle_mpgd: f64,
    /// How M-PGD went; `None` for a pair that was given to it, and for one it did not get to.
    pub mpgd: Option<mpgd::Run>,
}

impl PairCertificate {
    /// A pair of which nothing but λ is known.
    pub fn unmeasured(lambda: f64, cluster: usize) -> Self {
        let [residual, rho, lambda_fem, lambda_mpgd, angle_fem, angle_mpgd] = [f64::NAN; 6];
        Self {
            lambda,
            cluster,
            residual,
            rho,
            lambda_fem,
            lambda_mpgd,
            angle_fem,
            angle_mpgd,
            mpgd: None,
        }
    }
}

/// Whether an eigenvalue was missed or repeated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Completeness {
    /// The shift, in the gap above the cluster that holds λ_K.
    pub sigma: f64,
    /// The exact number of eigenvalues below σ; `None` when rounding could have changed it.
    pub count: Option<usize>,
    /// The number of Ritz values of the set below σ.
    pub found: usize,
    /// Nothing is missing below σ; where K cuts a cluster: nothing below that cluster, and all K lie below σ.
    pub complete: bool,
    /// K ends inside a cluster, whose further members were not asked for.
    pub cut_cluster: bool,
}

/// All measurements of a set of K pairs.
#[derive(Debug, Clone, PartialEq)]
pub struct Certificate {
    /// max |ΦᵀBΦ − I|.
    pub orthonormality: f64,
    /// One entry a pair.
    pub pairs: Vec<PairCertificate>,
    /// The count by inertia.
    pub completeness: Completeness,
}

/// The two independent solutions that a set of K pairs is held against.
#[derive(Debug, Clone)]
pub struct References {
    /// The reference solver's pairs, to the end of the cluster of λ_K, and the count by inertia.
    pub fem: Reference,
    /// M-PGD's pairs; `None` where it was not asked.
    pub mpgd: Option<SecondOpinion>,
}

/// What M-PGD found.
#[derive(Debug, Clone)]
pub struct SecondOpinion {
    /// At least K pairs, to the end of the cluster of λ_K, unless it was stopped.
    pub pairs: Eigenpairs,
    /// How it went for each pair that was not given to it: the last ones of `pairs`.
    pub runs: Vec<mpgd::Run>,
}

impl References {
    /// The clusters of the reference spectrum.
    pub fn clusters(&self, area: f64) -> Vec<Range<usize>> {
        clusters(&self.fem.pairs.values, CLUSTER_GAP, zero_below(area))
    }
}

impl SecondOpinion {
    /// How it went for pair `j`.
    fn run(&self, j: usize) -> Option<mpgd::Run> {
        let given = self.pairs.len() - self.runs.len();
        self.runs.get(j.checked_sub(given)?).copied()
    }
}

/// Measures the K columns of `vectors`, which are B-normalised approximate eigenfunctions in order, on the free vertices
/// of the problem.
///
/// # Errors
/// When a factorisation breaks down.
pub fn certify(
    problem: &Problem<'_>,
    analysis: &Analysis<'_>,
    vectors: &Dense,
    references: &References,
) -> Result<Certificate, SpectrumError> {
    let pencil = problem.pencil();
    let k = vectors.ncols();
    let (lx, bx) = (product(pencil.stiffness, vectors), product(pencil.mass, vectors));
    let gram = inner(vectors, &bx);
    let thetas: Vec<f64> =
        (0..k).map(|j| dot(column(vectors, j), column(&lx, j)) / gram[(j, j)]).collect();
    let residuals = residual_norms(problem, analysis, &thetas, &lx, &bx)?;
    let runs = references.clusters(pencil.area());
    let angles = |reference: &Eigenpairs| cluster_angles(pencil.mass, vectors, reference, &runs);
    let (fem, mpgd) = (&references.fem.pairs, references.mpgd.as_ref());
    let angles_fem = angles(fem);
    let angles_mpgd = mpgd.map(|mpgd| angles(&mpgd.pairs)).unwrap_or_default();
    let pairs = (0..k).map(|j| {
        let cluster = runs.iter().position(|run| run.contains(&j)).unwrap_or(runs.len());
        PairCertificate {
            lambda: thetas[j],
            cluster,
            residual: residuals[j].residual,
            rho: residuals[j].rho,
            lambda_fem: fem.values[j],
            lambda_mpgd: mpgd.and_then(|m| m.pairs.values.get(j).copied()).unwrap_or(f64::NAN),
            angle_fem: angles_fem.get(cluster).copied().unwrap_or(f64::NAN),
            angle_mpgd: angles_mpgd.get(cluster).copied().unwrap_or(f64::NAN),
            mpgd: mpgd.and_then(|m| m.run(j)),
        }
    });
    let identity = Dense::identity(k, k);
    Ok(Certificate {
        orthonormality: (&gram - &identity).norm_max(),
        pairs: pairs.collect(),
        completeness: completeness(pencil, analysis, vectors, &references.fem, &runs)?,
    })
}

/// The two measures of r = Lφ − θBφ; see [`PairCertificate`].
struct Residual {
    residual: f64,
    rho: f64,
}

/// The residuals of all pairs, from Lφ and Bφ. One factorisation serves all ρ.
///
/// ρ = ‖r‖_{(L+μB)⁻¹}/√(θ+μ) with μ = θ, or μ = λ₂ when θ is zero to working precision.
fn residual_norms(
    problem: &Problem<'_>,
    analysis: &Analysis<'_>,
    thetas: &[f64],
    lx: &Dense,
    bx: &Dense,
) -> Result<Vec<Residual>, SpectrumError> {
    let pencil = problem.pencil();
    let zero = zero_below(pencil.area());
    let positive = || thetas.iter().copied().filter(|&theta| theta > zero);
    let lowest = positive().fold(f64::INFINITY, f64::min);
    // Without any positive θ the scale of the first eigenvalues has to do.
    let lowest = if lowest.is_finite() { lowest } else { 1.0 / pencil.area() };
    let highest = positive().fold(lowest, f64::max);
    let factor = analysis.positive((lowest * highest).sqrt())?;
    let mut norms = Vec::with_capacity(thetas.len());
    for first in (0..thetas.len()).step_by(WIDTH) {
        let theta = |j: usize| thetas.get(first + j).copied().unwrap_or(lowest);
        let mut r = Panel::from_columns(lx, first);
        for (r, b) in r.rows_mut().iter_mut().zip(Panel::from_columns(bx, first).rows()) {
            for j in 0..WIDTH {
                r[j] -= theta(j) * b[j];
            }
        }
        let mu: Row = std::array::from_fn(|j| if theta(j) > zero { theta(j) } else { lowest });
        let in_mass = inverse_mass_norms(pencil, &r);
        let in_energy = energy_norms(pencil, &factor, mu, &r);
        norms.extend((0..WIDTH.min(thetas.len() - first)).map(|j| Residual {
            residual: in_mass[j],
            rho: in_energy[j] / (theta(j) + mu[j]).sqrt(),
        }));
    }
    Ok(norms)
}

/// The largest principal angle, in the B-inner product, between the smaller and the larger of two subspaces.
///
/// sin of the angle is ‖(I − UUᵀB)v‖ maximised over the smaller space, which is exact for small angles where
/// the cosine is not.
pub fn principal_angle(mass: &Sparse, x: &Dense, y: &Dense) -> f64 {
    let (small, large) = if x.ncols() <= y.ncols() { (x, y) } else { (y, x) };
    let (small, large) = (orthonormal(mass, small), orthonormal(mass, large));
    if small.ncols() == 0 || large.ncols() == 0 {
        return f64::NAN;
    }
    let mut rest = small.clone();
    let coefficients = inner(&product(mass, &large), &small);
    rest -= combine(&large, &coefficients);
    let sine_squared = super::rayleigh_ritz::symmetric_eigen(&projection(mass, &rest)).0;
    sine_squared.last().copied().unwrap_or(0.0).clamp(0.0, 1.0).sqrt().asin()
}

fn orthonormal(mass: &Sparse, x: &Dense) -> Dense {
    let gram = projection(mass, x);
    let basis = ritz_pairs(&gram, &gram, 1e-12).coefficients;
    combine(x, &basis)
}

/// The angle of every cluster between our vectors and the reference's, compared as subspaces.
///
/// A cluster that K cuts is compared through the fewer vectors that we have of it.
fn cluster_angles(
    mass: &Sparse,
    vectors: &Dense,
    reference: &Eigenpairs,
    runs: &[Range<usize>],
) -> Vec<f64> {
    let part = |x: &Dense, run: &Range<usize>| {
        let end = run.end.min(x.ncols());
        let start = run.start.min(end);
        x.subcols(start, end - start).to_owned()
    };
    runs.iter()
        .map(|run| principal_angle(mass, &part(vectors, run), &part(&reference.vectors, run)))
        .collect()
}

fn completeness(
    pencil: Pencil<'_>,
    analysis: &Analysis<'_>,
    vectors: &Dense,
    fem: &Reference,
    runs: &[Range<usize>],
) -> Result<Completeness, SpectrumError> {
    let k = vectors.ncols();
    let run = runs.iter().find(|run| run.contains(&(k - 1))).cloned().unwrap_or(k - 1..k);
    let (a, m) = pencil.projected(vectors);
    let ritz = ritz_pairs(&a, &m, 1e-12).values;
    let found_below = |sigma: f64| ritz.iter().filter(|&&theta| theta < sigma).count();
    let Reference { sigma, count, .. } = *fem;
    let found = found_below(sigma);
    let cut_cluster = run.end > k;
    let complete = if cut_cluster {
        let (below, found_under) = if run.start == 0 {
            (Some(0), 0)
        } else {
            let sigma = fem::above(&fem.pairs.values, run.start, pencil.area());
            (count_below(analysis, sigma)?, found_below(sigma))
        };
        found == k && count.is_some() && below == Some(found_under)
    } else {
        count == Some(found)
    };
    Ok(Completeness { sigma, count, found, complete, cut_cluster })
}
