//! The reference: the lowest eigenpairs of Lφ = λBφ by shift-invert block Lanczos.
//!
//! Works with (L + μB)⁻¹B, which is self-adjoint in the B-inner product and has the eigenvalues 1/(λ + μ): the
//! wanted end of the spectrum becomes the dominant one. The Krylov basis is kept B-orthonormal against all of
//! itself; a block holds several vectors, so that multiple eigenvalues are found together.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::cluster::zero_below;
use super::factor::{Analysis, Cholesky};
use super::pencil::{combine, inner, product, project_out};
use super::rayleigh_ritz::{ritz_pairs, symmetric_eigen};
use super::{Dense, Eigenpairs, Pencil, SpectrumError};

/// Vectors in one Lanczos block.
const BLOCK: usize = 8;

/// The shift μ in units of 1/area: far from zero and below the first eigenvalues (Weyl: λ_k·area ≈ 4πk).
const SHIFT: f64 = 1.0;

/// A Krylov vector whose norm falls below this (relative) while it is orthogonalised brings nothing new.
const BREAKDOWN: f64 = 1e-10;

/// Ritz pairs of the inverted operator are accepted below this residual, relative to the largest 1/(λ + μ).
const TOLERANCE: f64 = 1e-13;

/// Computes the `count` lowest eigenpairs, in canonical form (see [`Eigenpairs::canonical`]).
///
/// The result depends on the pencil and `count` alone: the start block is seeded by a constant.
///
/// # Errors
/// [`SpectrumError::TooMany`] when `count` exceeds n, [`SpectrumError::Breakdown`] when L + μB is not
/// numerically positive definite, [`SpectrumError::NotConverged`] otherwise.
pub fn lowest(
    pencil: Pencil<'_>,
    analysis: &Analysis<'_>,
    count: usize,
) -> Result<Eigenpairs, SpectrumError> {
    let n = pencil.n();
    if count > n {
        return Err(SpectrumError::TooMany { asked: count, n });
    }
    let mu = SHIFT / pencil.area();
    let factor = analysis.cholesky(mu)?;
    let subspace = Krylov::grow(pencil, &factor, count, mu)?;
    refine(pencil, &factor, subspace, count)
}

/// One step of inverse iteration, which damps what high frequencies are left, then Rayleigh–Ritz.
fn refine(
    pencil: Pencil<'_>,
    factor: &Cholesky<'_>,
    vectors: Dense,
    count: usize,
) -> Result<Eigenpairs, SpectrumError> {
    let mut x = product(pencil.mass, &vectors);
    factor.solve_in_place(&mut x);
    let (a, m) = pencil.projected(&x);
    let ritz = ritz_pairs(&a, &m, 0.0);
    let coefficients = ritz.coefficients.subcols(0, count).to_owned();
    let pairs =
        Eigenpairs { values: ritz.values[..count].to_vec(), vectors: combine(&x, &coefficients) };
    Ok(pairs.canonical(zero_below(pencil.area())))
}

/// A B-orthonormal Krylov basis V of (L + μB)⁻¹B with its projection T = VᵀB(L + μB)⁻¹BV.
struct Krylov<'p, 'f> {
    pencil: Pencil<'p>,
    factor: &'f Cholesky<'f>,
    basis: Dense,
    b_basis: Dense,
    /// T, symmetric; columns are filled as blocks are applied.
    projected: Vec<Vec<f64>>,
    rng: ChaCha8Rng,
}

impl<'p, 'f> Krylov<'p, 'f> {
    /// Grows the basis until the `count` dominant Ritz pairs have converged; returns their vectors, and a few
    /// more that help the last ones.
    fn grow(
        pencil: Pencil<'p>,
        factor: &'f Cholesky<'f>,
        count: usize,
        mu: f64,
    ) -> Result<Dense, SpectrumError> {
        let n = pencil.n();
        let mut krylov = Self {
            pencil,
            factor,
            basis: Dense::zeros(n, 0),
            b_basis: Dense::zeros(n, 0),
            projected: Vec::new(),
            rng: ChaCha8Rng::seed_from_u64(0x6368_6c61_646e_6921),
        };
        let wanted = (count + 2).min(n);
        let limit = n.min(20 * count + 40 * BLOCK);
        let start = krylov.random_block(BLOCK.min(n));
        let mut block = krylov.append(start);
        loop {
            let applied = krylov.apply_last(block);
            let dimension = krylov.basis.ncols();
            let (values, coefficients) = krylov.ritz();
            let ritz_count = wanted.min(values.len());
            // The residual of a Ritz pair lives in the block that comes next.
            let (next, coupling) = krylov.orthogonalise(applied);
            let residual = largest_residual(&coupling, &coefficients, ritz_count);
            let scale = values.first().copied().unwrap_or(1.0);
            let complete = dimension == n;
            if dimension >= wanted && (complete || residual <= TOLERANCE * scale) {
                return Ok(combine(&krylov.basis, &coefficients.subcols(0, ritz_count).to_owned()));
            }
            if dimension >= limit {
                // In terms of λ: |δ(1/(λ+μ))| = δλ/(λ+μ)².
                let last = values[ritz_count - 1];
                return Err(SpectrumError::NotConverged {
                    iterations: dimension / BLOCK,
                    residual: residual / last * (1.0 / last - mu).abs(),
                    goal: TOLERANCE * scale / last * (1.0 / last - mu).abs(),
                });
            }
            block = krylov.append(next);
        }
    }

    fn random_block(&mut self, columns: usize) -> Dense {
        let n = self.pencil.n();
        Dense::from_fn(n, columns, |_, _| self.rng.random_range(-1.0..1.0))
    }

    /// Adds B-orthonormal columns to the basis, replacing what is linearly dependent by random directions.
    /// Returns how many columns were added.
    fn append(&mut self, block: Dense) -> usize {
        let n = self.pencil.n();
        let room = n - self.basis.ncols();
        let mut added = 0;
        let mut candidate = block;
        let goal = candidate.ncols().min(room);
        while added < goal {
            let fresh = self.independent(candidate, goal - added);
            let b_fresh = product(self.pencil.mass, &fresh);
            added += fresh.ncols();
            self.basis = beside(&self.basis, &fresh);
            self.b_basis = beside(&self.b_basis, &b_fresh);
            candidate = if added < goal { self.random_block(goal - added) } else { fresh };
        }
        added
    }

    /// A B-orthonormal basis, of at most `most` columns, of what `block` adds to the Krylov basis.
    fn independent(&self, mut block: Dense, most: usize) -> Dense {
        let norms = |x: &Dense| -> f64 {
            let gram = inner(x, &product(self.pencil.mass, x));
            (0..gram.ncols()).map(|i| gram[(i, i)]).fold(0.0, f64::max).sqrt()
        };
        let before = norms(&block).max(f64::MIN_POSITIVE);
        for pass in 0..3 {
            project_out(&mut block, &self.basis, &self.b_basis);
            let gram = inner(&block, &product(self.pencil.mass, &block));
            let (scales, directions) = symmetric_eigen(&gram);
            // First pass: against the size it came with. Later: everything left is of unit size.
            let floor = if pass == 0 { (BREAKDOWN * before).powi(2) } else { 1e-4 };
            let kept: Vec<usize> =
                (0..scales.len()).rev().filter(|&i| scales[i] > floor).take(most).collect();
            let whitening = Dense::from_fn(scales.len(), kept.len(), |i, j| {
                directions[(i, kept[j])] / scales[kept[j]].sqrt()
            });
            block = combine(&block, &whitening);
        }
        block
    }

    /// (L + μB)⁻¹B on the newest `columns` of the basis; records their columns of T.
    fn apply_last(&mut self, columns: usize) -> Dense {
        let first = self.b_basis.ncols() - columns;
        let mut x = self.b_basis.subcols(first, columns).to_owned();
        self.factor.solve_in_place(&mut x);
        let t = inner(&self.b_basis, &x);
        self.projected.extend((0..columns).map(|j| (0..t.nrows()).map(|i| t[(i, j)]).collect()));
        x
    }

    /// Ritz values of the inverted operator in descending order, with their coefficients.
    fn ritz(&self) -> (Vec<f64>, Dense) {
        let m = self.projected.len();
        let t = Dense::from_fn(m, m, |i, j| {
            // Column j knows the rows up to the end of its own block; symmetry gives the rest.
            let (short, long) = (i.min(j), i.max(j));
            self.projected[long][short]
        });
        let (values, vectors) = symmetric_eigen(&t);
        let reversed = Dense::from_fn(m, m, |i, j| vectors[(i, m - 1 - j)]);
        (values.into_iter().rev().collect(), reversed)
    }

    /// Splits an applied block into what the basis does not hold yet and its coupling to the newest block.
    fn orthogonalise(&self, mut block: Dense) -> (Dense, Dense) {
        project_out(&mut block, &self.basis, &self.b_basis);
        project_out(&mut block, &self.basis, &self.b_basis);
        let coupling = inner(&block, &product(self.pencil.mass, &block));
        (block, coupling)
    }
}

/// The largest B-norm of the residuals of the first `count` Ritz pairs: the part of the applied newest block
/// that leaves the basis, weighted by the last rows of the coefficients.
fn largest_residual(gram: &Dense, coefficients: &Dense, count: usize) -> f64 {
    let columns = gram.ncols();
    let first = coefficients.nrows() - columns;
    (0..count)
        .map(|j| {
            let tail = |i: usize| coefficients[(first + i, j)];
            let square: f64 = (0..columns)
                .flat_map(|a| (0..columns).map(move |b| (a, b)))
                .map(|(a, b)| tail(a) * gram[(a, b)] * tail(b))
                .sum();
            square.max(0.0).sqrt()
        })
        .fold(0.0, f64::max)
}

fn beside(left: &Dense, right: &Dense) -> Dense {
    let mut joined = Dense::zeros(left.nrows(), left.ncols() + right.ncols());
    joined.subcols_mut(0, left.ncols()).copy_from(left);
    joined.subcols_mut(left.ncols(), right.ncols()).copy_from(right);
    joined
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::sample::icosphere;
    use crate::operators::{MassKind, Operators};

    fn solve(levels: u32, kind: MassKind, count: usize) -> Eigenpairs {
        let operators = Operators::assemble(&icosphere(levels), kind).unwrap();
        let pencil = Pencil::from(&operators);
        lowest(pencil, &Analysis::new(pencil).unwrap(), count).unwrap()
    }

    #[test]
    fn the_sphere_converges_with_order_two_from_both_sides() {
        // Lumped mass underestimates and consistent mass overestimates l(l+1).
        for (kind, side) in [(MassKind::Lumped, -1.0), (MassKind::Consistent, 1.0)] {
            let error = |levels| {
                let pairs = solve(levels, kind, 9);
                assert!(pairs.values[0].abs() < 1e-11);
                side * (pairs.values[8] / 6.0 - 1.0)
            };
            let (coarse, fine) = (error(2), error(3));
            assert!(coarse > 0.0 && fine > 0.0, "{kind:?}: {coarse} {fine}");
            let order = (coarse / fine).log2();
            assert!((1.8..2.2).contains(&order), "{kind:?}: order {order}");
        }
    }

    #[test]
    fn vectors_are_orthonormal_and_solve_the_pencil() {
        let operators = Operators::assemble(&icosphere(3), MassKind::Consistent).unwrap();
        let pencil = Pencil::from(&operators);
        let pairs = lowest(pencil, &Analysis::new(pencil).unwrap(), 25).unwrap();
        let gram = inner(&pairs.vectors, &product(pencil.mass, &pairs.vectors));
        assert!((&gram - Dense::identity(25, 25)).norm_max() < 1e-12);
        let lx = product(pencil.stiffness, &pairs.vectors);
        let bx = product(pencil.mass, &pairs.vectors);
        for (j, &value) in pairs.values.iter().enumerate() {
            let worst = (0..pencil.n())
                .map(|i| (lx[(i, j)] - value * bx[(i, j)]).abs())
                .fold(0.0, f64::max);
            assert!(worst < 1e-10, "pair {j}: {worst}");
        }
    }

    #[test]
    fn every_eigenvalue_of_a_small_mesh() {
        // The icosahedron's vertices: 0, and multiplicities 3, 5, 3 from its symmetry.
        let pairs = solve(0, MassKind::Lumped, 12);
        let runs = super::super::cluster::clusters(&pairs.values, 1e-6, 1e-7);
        assert_eq!(runs.iter().map(ExactSizeIterator::len).collect::<Vec<_>>(), [1, 3, 5, 3]);
    }
}
