//! Which fixed steps α of Algorithm 1 are stable.
//!
//! Let N = tᵀBt and A = L − R(t)B, so that the gradient (19) is g = 2At/N. Let Z hold the eigenvectors that the
//! constraint leaves. For t = Zc, (21) becomes d = (2/N) Z M (Λ − R) c with M = ZᵀB²Z: the printed projection is not
//! orthogonal, but it is gradient descent in the metric M⁻¹ all the same. The quotient does not grow in a step
//! t − αd when (t − αd)ᵀA(t − αd) ≤ 0, which is −αN gᵀd + α² dᵀAd ≤ 0. There A ⪯ L, and dᵀLd ≤ λ_max(L) gᵀd since MΛ has
//! the positive eigenvalues of BZΛZᵀB ⪯ L. Hence the sufficient condition
//!
//! ```text
//! α λ_max(L) ≤ tᵀBt.
//! ```
//!
//! L has no unit and does not change with the scale of the mesh, and the iteration starts at tᵀBt = 1: the condition
//! is about the shapes of the triangles alone. By Proposition 1 a mesh s times as large gives t/s and d/s in every
//! step. A start vector of other length acts as another step: tᵀBt = N₀ with α is tᵀBt = 1 with α/N₀.
//!
//! A step that is too long lengthens t, since cᵀM⁻¹c never falls (for k = 0 it is ‖t‖²), and N divides all later ones:
//! the printed iteration slows down instead of running away, until numbers overflow.

use crate::spectrum::Pencil;

/// A fixed step that is stable from a start of unit B-norm: 1/max_i Σ_j |L_ij| ≤ 1/λ_max(L), by Gershgorin.
pub fn largest_step(pencil: Pencil<'_>) -> f64 {
    let rows = pencil.stiffness.outer_iterator();
    let sums = rows.map(|row| row.data().iter().map(|l| l.abs()).sum::<f64>());
    sums.fold(0.0, f64::max).recip()
}
