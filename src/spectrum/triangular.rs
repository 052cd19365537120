//! Solves with a supernodal factor A = R D Rᵀ for several right-hand sides at a time.
//!
//! R is unit lower triangular. A supernode is a run of columns with one pattern below its diagonal block. It is cut into
//! tiles of up to eight columns, whose part of a solution stays in registers while the rows below stream by; a tile's
//! values are stored by rows, one tile after the other, so that a solve reads them from one end to the other and back.
//! On the factors of surfaces, whose supernodes are narrow, that is several times faster than a dense product for each
//! supernode.

use faer::sparse::linalg::cholesky::supernodal::SymbolicSupernodalCholesky;
use pulp::{Simd, WithSimd};

use super::panel::{strip, strip_mut};

/// Right-hand sides that are solved for at a time: a row of them fits the registers that nearly every machine has.
pub const COLUMNS: usize = 4;

/// The values of the right-hand sides in one row.
pub type Row = [f64; COLUMNS];

/// R and D⁻¹, packed for solves.
pub struct Packed {
    tiles: Vec<Tile>,
    /// The rows below the diagonal blocks of all supernodes.
    below: Vec<u32>,
    /// For every tile its triangle, width × width by rows with D⁻¹ on the diagonal, and then its rows below that.
    values: Vec<f64>,
}

/// Up to eight columns of a supernode.
#[derive(Clone, Copy)]
struct Tile {
    /// The first column.
    column: u32,
    /// The number of columns: 1, 2, 4 or 8.
    width: u32,
    /// The rows of the diagonal block below the tile: they follow its columns.
    inside: u32,
    /// The rows below the diagonal block, as a range of `Packed::below`.
    below: [u32; 2],
    /// Where its values begin.
    values: usize,
}

impl Packed {
    /// Packs the values that faer leaves in supernodes, each (columns + rows below) × columns, by columns.
    pub fn new(symbolic: &SymbolicSupernodalCholesky<usize>, values: &[f64]) -> Self {
        let mut packed =
            Self { tiles: Vec::new(), below: Vec::new(), values: Vec::with_capacity(values.len()) };
        for s in 0..symbolic.n_supernodes() {
            let (start, end) = (symbolic.supernode_begin()[s], symbolic.supernode_end()[s]);
            let at = symbolic.col_ptr_for_val();
            let first_below = packed.below.len() as u32;
            packed.below.extend(symbolic.supernode(s).pattern().iter().map(|&row| row as u32));
            let below = [first_below, packed.below.len() as u32];
            packed.supernode(start, end - start, below, &values[at[s]..at[s + 1]]);
        }
        packed.values.shrink_to_fit();
        packed
    }

    fn supernode(&mut self, start: usize, columns: usize, below: [u32; 2], values: &[f64]) {
        let height = values.len() / columns;
        let mut first = 0;
        while first < columns {
            let left = columns - first;
            let width = [8, 4, 2, 1].into_iter().find(|&width| width <= left).unwrap_or(1);
            self.tiles.push(Tile {
                column: (start + first) as u32,
                width: width as u32,
                inside: (left - width) as u32,
                below,
                values: self.values.len(),
            });
            for row in first..height {
                for column in first..first + width {
                    let value = values[column * height + row];
                    self.values.push(if row == column { value.recip() } else { value });
                }
            }
            first += width;
        }
    }

    /// X ← (R D Rᵀ)⁻¹ X, in elimination order.
    pub fn solve(&self, x: &mut [Row]) {
        let solve = Solve { packed: self, x };
        #[cfg(target_arch = "x86_64")]
        if let Some(simd) = pulp::x86::V3::try_new() {
            return Simd::vectorize(simd, solve);
        }
        solve.with_simd(pulp::Scalar);
    }

    /// The values of a tile: its triangle, the rows inside the diagonal block, and those below it.
    #[inline(always)]
    fn parts<const T: usize>(&self, tile: &Tile) -> Parts<'_, T> {
        let [first, last] = tile.below.map(|at| at as usize);
        let below = &self.below[first..last];
        let rows = T + tile.inside as usize + below.len();
        let values = self.values[tile.values..tile.values + rows * T].as_chunks::<T>().0;
        let (triangle, values) = values.split_at(T);
        let (inside, outside) = values.split_at(tile.inside as usize);
        Parts { triangle, inside, outside, below }
    }
}

/// A tile of T columns.
struct Parts<'a, const T: usize> {
    triangle: &'a [[f64; T]],
    inside: &'a [[f64; T]],
    outside: &'a [[f64; T]],
    /// The rows that `outside` stands for.
    below: &'a [u32],
}

struct Solve<'a> {
    packed: &'a Packed,
    x: &'a mut [Row],
}

impl WithSimd for Solve<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { packed, x } = self;
        for k in 0..COLUMNS / S::F64_LANES {
            for tile in &packed.tiles {
                match tile.width {
                    8 => forward::<S, 8>(simd, packed, tile, x, k),
                    4 => forward::<S, 4>(simd, packed, tile, x, k),
                    2 => forward::<S, 2>(simd, packed, tile, x, k),
                    _ => forward::<S, 1>(simd, packed, tile, x, k),
                }
            }
            for tile in packed.tiles.iter().rev() {
                match tile.width {
                    8 => backward::<S, 8>(simd, packed, tile, x, k),
                    4 => backward::<S, 4>(simd, packed, tile, x, k),
                    2 => backward::<S, 2>(simd, packed, tile, x, k),
                    _ => backward::<S, 1>(simd, packed, tile, x, k),
                }
            }
        }
    }
}

/// R⁻¹ for the columns of a tile: solves their triangle, updates all rows below it.
#[inline(always)]
fn forward<S: Simd, const T: usize>(
    simd: S,
    packed: &Packed,
    tile: &Tile,
    x: &mut [Row],
    k: usize,
) {
    let parts = packed.parts::<T>(tile);
    let (own, after) = x[tile.column as usize..].split_at_mut(T);
    let mut solved = [simd.splat_f64s(0.0); T];
    for t in 0..T {
        let mut sum = strip::<S, COLUMNS>(&own[t], k);
        for u in 0..t {
            sum = simd.mul_add_e_f64s(simd.splat_f64s(parts.triangle[t][u]), solved[u], sum);
        }
        *strip_mut::<S, COLUMNS>(&mut own[t], k) = sum;
        solved[t] = simd.neg_f64s(sum);
    }
    for (row, values) in after.iter_mut().zip(parts.inside) {
        update::<S, T>(simd, strip_mut::<S, COLUMNS>(row, k), values, &solved);
    }
    for (&row, values) in parts.below.iter().zip(parts.outside) {
        update::<S, T>(simd, strip_mut::<S, COLUMNS>(&mut x[row as usize], k), values, &solved);
    }
}

/// Adds one row of a tile times what was solved.
#[inline(always)]
fn update<S: Simd, const T: usize>(
    simd: S,
    row: &mut S::f64s,
    values: &[f64; T],
    solved: &[S::f64s; T],
) {
    let mut sum = *row;
    for t in 0..T {
        sum = simd.mul_add_e_f64s(simd.splat_f64s(values[t]), solved[t], sum);
    }
    *row = sum;
}

/// D⁻¹, then R⁻ᵀ, for the columns of a tile, whose rows below are done.
#[inline(always)]
fn backward<S: Simd, const T: usize>(
    simd: S,
    packed: &Packed,
    tile: &Tile,
    x: &mut [Row],
    k: usize,
) {
    let parts = packed.parts::<T>(tile);
    let mut sums = [simd.splat_f64s(0.0); T];
    for (&row, values) in parts.below.iter().zip(parts.outside) {
        let row = strip::<S, COLUMNS>(&x[row as usize], k);
        for t in 0..T {
            sums[t] = simd.mul_add_e_f64s(simd.splat_f64s(values[t]), row, sums[t]);
        }
    }
    let (own, after) = x[tile.column as usize..].split_at_mut(T);
    for (row, values) in after.iter().zip(parts.inside) {
        let row = strip::<S, COLUMNS>(row, k);
        for t in 0..T {
            sums[t] = simd.mul_add_e_f64s(simd.splat_f64s(values[t]), row, sums[t]);
        }
    }
    for t in (0..T).rev() {
        let row = strip_mut::<S, COLUMNS>(&mut own[t], k);
        let inverse = simd.splat_f64s(parts.triangle[t][t]);
        let value = simd.sub_f64s(simd.mul_f64s(*row, inverse), sums[t]);
        *row = value;
        for u in 0..t {
            sums[u] = simd.mul_add_e_f64s(simd.splat_f64s(parts.triangle[t][u]), value, sums[u]);
        }
    }
}
