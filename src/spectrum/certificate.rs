//! What was checked of a set of eigenpairs; each measure is explained at its field.
//!
//! Nothing here decides; [`Certificate`] only measures. The verdict against a pipeline's tolerances is taken by
//! the caller.

use std::ops::Range;

use super::cluster::{CLUSTER_GAP, clusters, zero_below};
use super::factor::Analysis;
use super::inertia::count_below;
use super::pencil::{column, combine, dot, inner, product, projection};
use super::rayleigh_ritz::ritz_pairs;
use super::{Dense, Eigenpairs, Pencil, SpectrumError, mpgd};
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
    /// At least K pairs, and as many more as it takes to end the cluster of λ_K and begin the next.
    pub fem: Eigenpairs,
    /// At least K pairs, to the end of the cluster of λ_K.
    pub mpgd: Eigenpairs,
    /// How M-PGD went for each pair that was not given to it: the last ones of `mpgd`.
    pub mpgd_runs: Vec<mpgd::Run>,
}

impl References {
    /// The clusters of the reference spectrum; the last one may be cut off by where the computation ended.
    pub fn clusters(&self, area: f64) -> Vec<Range<usize>> {
        clusters(&self.fem.values, CLUSTER_GAP, zero_below(area))
    }

    /// How M-PGD went for pair `j`.
    fn mpgd_run(&self, j: usize) -> Option<mpgd::Run> {
        let given = self.mpgd.len() - self.mpgd_runs.len();
        self.mpgd_runs.get(j.checked_sub(given)?).copied()
    }
}

/// Where the cluster of pair K ends, in a reference spectrum that reaches past it.
pub fn cluster_end(values: &[f64], k: usize, area: f64) -> usize {
    let runs = clusters(values, CLUSTER_GAP, zero_below(area));
    runs.into_iter().find(|run| run.contains(&(k - 1))).map_or(k, |run| run.end)
}

/// Reference pairs up to the first gap above λ_K: `lowest` is asked for more until the gap is seen.
///
/// # Errors
/// Whatever [`super::fem::lowest`] meets.
pub fn reference_past_gap(
    pencil: Pencil<'_>,
    analysis: &Analysis<'_>,
    k: usize,
) -> Result<Eigenpairs, SpectrumError> {
    let n = pencil.n();
    if k > n {
        return Err(SpectrumError::TooMany { asked: k, n });
    }
    let mut count = (k + 2).min(n);
    loop {
        let pairs = super::fem::lowest(pencil, analysis, count)?;
        let end = cluster_end(&pairs.values, k, pencil.area());
        if end < count || count == n {
            return Ok(pairs.truncated((end + 1).min(count)));
        }
        count = (count + count / 4 + 4).min(n);
    }
}

/// Measures the K columns of `vectors`, which are B-normalised approximate eigenfunctions in order.
///
/// # Errors
/// When a factorisation breaks down.
pub fn certify(
    pencil: Pencil<'_>,
    analysis: &Analysis<'_>,
    vectors: &Dense,
    references: &References,
) -> Result<Certificate, SpectrumError> {
    let k = vectors.ncols();
    let (lx, bx) = (product(pencil.stiffness, vectors), product(pencil.mass, vectors));
    let gram = inner(vectors, &bx);
    let thetas: Vec<f64> =
        (0..k).map(|j| dot(column(vectors, j), column(&lx, j)) / gram[(j, j)]).collect();
    let runs = references.clusters(pencil.area());
    let lambda2 = references.fem.values.iter().copied().find(|&v| v > zero_below(pencil.area()));
    let angles = |reference: &Eigenpairs| cluster_angles(pencil.mass, vectors, reference, &runs);
    let (angles_fem, angles_mpgd) = (angles(&references.fem), angles(&references.mpgd));
    let mass_solver = MassSolver::new(pencil);
    let pairs = (0..k)
        .map(|j| {
            let residual =
                Dense::from_fn(pencil.n(), 1, |i, _| lx[(i, j)] - thetas[j] * bx[(i, j)]);
            let cluster = runs.iter().position(|run| run.contains(&j)).unwrap_or(runs.len());
            Ok(PairCertificate {
                lambda: thetas[j],
                cluster,
                residual: mass_solver.inverse_norm(&residual),
                rho: energy_residual(analysis, &residual, thetas[j], lambda2)?,
                lambda_fem: references.fem.values[j],
                lambda_mpgd: references.mpgd.values.get(j).copied().unwrap_or(f64::NAN),
                angle_fem: angles_fem.get(cluster).copied().unwrap_or(f64::NAN),
                angle_mpgd: angles_mpgd.get(cluster).copied().unwrap_or(f64::NAN),
                mpgd: references.mpgd_run(j),
            })
        })
        .collect::<Result<_, SpectrumError>>()?;
    let identity = Dense::identity(k, k);
    Ok(Certificate {
        orthonormality: (&gram - &identity).norm_max(),
        pairs,
        completeness: completeness(pencil, analysis, vectors, references, &runs)?,
    })
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

/// ρ = ‖r‖_{(L+μB)⁻¹}/√(θ+μ) with μ = θ, or μ = λ₂ when θ is zero to working precision.
fn energy_residual(
    analysis: &Analysis<'_>,
    residual: &Dense,
    theta: f64,
    lambda2: Option<f64>,
) -> Result<f64, SpectrumError> {
    let lambda2 = lambda2.unwrap_or(theta);
    let mu = if theta > 1e-6 * lambda2 { theta } else { lambda2 };
    let mut solution = residual.clone();
    analysis.cholesky(mu)?.solve_in_place(&mut solution);
    let square = dot(column(residual, 0), column(&solution, 0));
    Ok((square.max(0.0) / (theta + mu)).sqrt())
}

/// B⁻¹ norms: a division for a diagonal B, conjugate gradients otherwise.
struct MassSolver<'a> {
    mass: &'a Sparse,
    lumped: bool,
}

impl<'a> MassSolver<'a> {
    fn new(pencil: Pencil<'a>) -> Self {
        Self { mass: pencil.mass, lumped: pencil.mass.nnz() == pencil.n() }
    }

    fn inverse_norm(&self, r: &Dense) -> f64 {
        let r = column(r, 0);
        if self.lumped {
            return r.iter().zip(self.mass.data()).map(|(r, b)| r * r / b).sum::<f64>().sqrt();
        }
        // The consistent mass is spectrally equivalent to its diagonal (condition below 10 after scaling):
        // conjugate gradients reach rounding in a few dozen steps, whatever n.
        dot(r, &conjugate_gradients(self.mass, r)).max(0.0).sqrt()
    }
}

/// Solves M x = r for a mass matrix M by diagonally preconditioned conjugate gradients, to rounding.
fn conjugate_gradients(m: &Sparse, r: &[f64]) -> Vec<f64> {
    let diagonal: Vec<f64> = m.diag_iter().map(|d| d.copied().unwrap_or(1.0)).collect();
    let precondition =
        |r: &[f64]| -> Vec<f64> { r.iter().zip(&diagonal).map(|(r, d)| r / d).collect() };
    let mut x = vec![0.0; r.len()];
    let mut r = r.to_vec();
    let mut z = precondition(&r);
    let mut p = z.clone();
    let mut q = vec![0.0; r.len()];
    let mut rz = dot(&r, &z);
    let goal = rz * 1e-28;
    for _ in 0..200 {
        if rz <= goal || rz == 0.0 {
            break;
        }
        super::pencil::apply(m, &p, &mut q);
        let alpha = rz / dot(&p, &q);
        x.iter_mut().zip(&p).for_each(|(x, p)| *x += alpha * p);
        r.iter_mut().zip(&q).for_each(|(r, q)| *r -= alpha * q);
        z = precondition(&r);
        let next = dot(&r, &z);
        p.iter_mut().zip(&z).for_each(|(p, z)| *p = z + next / rz * *p);
        rz = next;
    }
    x
}

fn completeness(
    pencil: Pencil<'_>,
    analysis: &Analysis<'_>,
    vectors: &Dense,
    references: &References,
    runs: &[Range<usize>],
) -> Result<Completeness, SpectrumError> {
    let k = vectors.ncols();
    let values = &references.fem.values;
    let run = runs.iter().find(|run| run.contains(&(k - 1))).cloned().unwrap_or(k - 1..k);
    let (a, m) = pencil.projected(vectors);
    let ritz = ritz_pairs(&a, &m, 1e-12).values;
    let found_below = |sigma: f64| ritz.iter().filter(|&&theta| theta < sigma).count();
    let gap_above = |end: usize| match values.get(end) {
        Some(next) => 0.5 * (values[end - 1] + next),
        // The whole spectrum is known: anything above it will do.
        None => 1.5 * values[end - 1].abs() + 1.0 / pencil.area(),
    };
    let sigma = gap_above(run.end);
    let count = count_below(analysis, sigma)?;
    let found = found_below(sigma);
    let cut_cluster = run.end > k;
    let complete = if cut_cluster {
        let below =
            if run.start == 0 { Some(0) } else { count_below(analysis, gap_above(run.start))? };
        let found_under = if run.start == 0 { 0 } else { found_below(gap_above(run.start)) };
        found == k && count.is_some() && below == Some(found_under)
    } else {
        count == Some(found)
    };
    Ok(Completeness { sigma, count, found, complete, cut_cluster })
}
