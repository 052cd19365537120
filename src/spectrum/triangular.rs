//! Solves with a supernodal factor A = R D Rᵀ for several right-hand sides at a time.
//!
//! R is unit lower triangular. A supernode is a run of columns with one pattern below its diagonal block: a dense
//! block of values, (columns + rows below) × columns. The right-hand sides are interleaved, and a supernode is taken
//! in tiles of a few columns whose values stay in registers while the rows below stream by. On the factors of
//! surfaces, whose supernodes are narrow, that is several times faster than a dense product for each supernode.

use faer::sparse::linalg::cholesky::supernodal::SymbolicSupernodalCholesky;

use pulp::{Simd, WithSimd};

use super::panel::{strip, strip_mut};

/// Right-hand sides that are solved for at a time: a row of them fits the registers that nearly every machine has.
pub const COLUMNS: usize = 4;

/// The values of the right-hand sides in one row.
pub type Row = [f64; COLUMNS];

/// X ← (R D Rᵀ)⁻¹ X, in elimination order.
pub fn solve(symbolic: &SymbolicSupernodalCholesky<usize>, values: &[f64], x: &mut [Row]) {
    let solve = Solve { symbolic, values, x };
    #[cfg(target_arch = "x86_64")]
    if let Some(simd) = pulp::x86::V3::try_new() {
        return Simd::vectorize(simd, solve);
    }
    solve.with_simd(pulp::Scalar);
}

struct Solve<'a> {
    symbolic: &'a SymbolicSupernodalCholesky<usize>,
    values: &'a [f64],
    x: &'a mut [Row],
}

/// One supernode.
#[derive(Clone, Copy)]
struct Supernode<'a> {
    /// Its first column.
    start: usize,
    /// Its number of columns.
    columns: usize,
    /// The rows below its diagonal block.
    below: &'a [usize],
    /// (columns + below) × columns, by columns; D on the diagonal, R under it.
    values: &'a [f64],
}

impl<'a> Supernode<'a> {
    fn of(s: usize, symbolic: &'a SymbolicSupernodalCholesky<usize>, values: &'a [f64]) -> Self {
        let (start, end) = (symbolic.supernode_begin()[s], symbolic.supernode_end()[s]);
        let at = symbolic.col_ptr_for_val();
        let below = symbolic.supernode(s).pattern();
        Self { start, columns: end - start, below, values: &values[at[s]..at[s + 1]] }
    }

    /// Columns `first..first + T`, each from row `from` on.
    #[inline(always)]
    fn tile<const T: usize>(&self, first: usize, from: usize) -> [&'a [f64]; T] {
        let height = self.columns + self.below.len();
        let mut tile = [self.values; T];
        for t in 0..T {
            tile[t] = &self.values[(first + t) * height + from..(first + t + 1) * height];
        }
        tile
    }
}

impl WithSimd for Solve<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { symbolic, values, x } = self;
        for k in 0..COLUMNS / S::F64_LANES {
            for s in 0..symbolic.n_supernodes() {
                let node = Supernode::of(s, symbolic, values);
                let mut first = 0;
                while first + 8 <= node.columns {
                    forward::<S, 8>(simd, node, first, x, k);
                    first += 8;
                }
                if first + 4 <= node.columns {
                    forward::<S, 4>(simd, node, first, x, k);
                    first += 4;
                }
                if first + 2 <= node.columns {
                    forward::<S, 2>(simd, node, first, x, k);
                    first += 2;
                }
                if first < node.columns {
                    forward::<S, 1>(simd, node, first, x, k);
                }
            }
            for s in (0..symbolic.n_supernodes()).rev() {
                let node = Supernode::of(s, symbolic, values);
                let mut end = node.columns;
                if end % 2 == 1 {
                    end -= 1;
                    backward::<S, 1>(simd, node, end, x, k);
                }
                if end % 4 == 2 {
                    end -= 2;
                    backward::<S, 2>(simd, node, end, x, k);
                }
                if end % 8 == 4 {
                    end -= 4;
                    backward::<S, 4>(simd, node, end, x, k);
                }
                while end > 0 {
                    end -= 8;
                    backward::<S, 8>(simd, node, end, x, k);
                }
            }
        }
    }
}

/// R⁻¹ for the columns `first..first + T` of a supernode: solves their triangle, updates all rows below it.
#[inline(always)]
fn forward<S: Simd, const T: usize>(
    simd: S,
    node: Supernode<'_>,
    first: usize,
    x: &mut [Row],
    k: usize,
) {
    let at = node.start + first;
    let triangle: [&[f64]; T] = node.tile(first, first);
    let mut solved = [simd.splat_f64s(0.0); T];
    for t in 0..T {
        let mut sum = strip::<S, COLUMNS>(&x[at + t], k);
        for u in 0..t {
            sum = simd.mul_add_e_f64s(simd.splat_f64s(triangle[u][t]), solved[u], sum);
        }
        *strip_mut::<S, COLUMNS>(&mut x[at + t], k) = sum;
        solved[t] = simd.neg_f64s(sum);
    }
    let columns: [&[f64]; T] = node.tile(first, first + T);
    let inside = node.columns - first - T;
    for i in 0..inside {
        update::<S, T>(simd, strip_mut::<S, COLUMNS>(&mut x[at + T + i], k), &columns, i, &solved);
    }
    for (i, &row) in node.below.iter().enumerate() {
        let row = strip_mut::<S, COLUMNS>(&mut x[row], k);
        update::<S, T>(simd, row, &columns, inside + i, &solved);
    }
}

/// Adds the entries of row `i` of a tile times what was solved.
#[inline(always)]
fn update<S: Simd, const T: usize>(
    simd: S,
    row: &mut S::f64s,
    columns: &[&[f64]; T],
    i: usize,
    solved: &[S::f64s; T],
) {
    let mut sum = *row;
    for t in 0..T {
        sum = simd.mul_add_e_f64s(simd.splat_f64s(columns[t][i]), solved[t], sum);
    }
    *row = sum;
}

/// D⁻¹, then R⁻ᵀ, for the columns `first..first + T` of a supernode, whose rows below are done.
#[inline(always)]
fn backward<S: Simd, const T: usize>(
    simd: S,
    node: Supernode<'_>,
    first: usize,
    x: &mut [Row],
    k: usize,
) {
    let at = node.start + first;
    let columns: [&[f64]; T] = node.tile(first, first + T);
    let inside = node.columns - first - T;
    let mut sums = [simd.splat_f64s(0.0); T];
    for i in 0..inside {
        let row = strip::<S, COLUMNS>(&x[at + T + i], k);
        for t in 0..T {
            sums[t] = simd.mul_add_e_f64s(simd.splat_f64s(columns[t][i]), row, sums[t]);
        }
    }
    for (i, &row) in node.below.iter().enumerate() {
        let row = strip::<S, COLUMNS>(&x[row], k);
        for t in 0..T {
            sums[t] = simd.mul_add_e_f64s(simd.splat_f64s(columns[t][inside + i]), row, sums[t]);
        }
    }
    let triangle: [&[f64]; T] = node.tile(first, first);
    for t in (0..T).rev() {
        let row = strip_mut::<S, COLUMNS>(&mut x[at + t], k);
        let inverse = simd.splat_f64s(triangle[t][t].recip());
        let value = simd.sub_f64s(simd.mul_f64s(*row, inverse), sums[t]);
        *row = value;
        for u in 0..t {
            sums[u] = simd.mul_add_e_f64s(simd.splat_f64s(triangle[u][t]), value, sums[u]);
        }
    }
}
