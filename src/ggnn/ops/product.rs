//! How fast can a product in single precision be when its matrices are as narrow as a layer? A kernel for those alone.
//!
//! C = A B or C += A B. B is packed once, in panels a few registers wide, for as many products as there are; a block of C stays
//! in registers while k runs. Every entry of C is one sum over k in its order: its bits do not depend on how the rows of A are
//! dealt out.

use std::cell::Cell;
use std::ops::Range;

use faer::Accum;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// A matrix whose rows or columns lie in one piece each.
#[derive(Debug, Clone, Copy)]
pub enum Layout<'a> {
    /// Row-major: entries, and how far it is from one row to the next.
    Rows(&'a [f32], usize),
    /// Column-major: entries, and how far it is from one column to the next.
    Columns(&'a [f32], usize),
}

/// A matrix B, k×n, in panels.
#[derive(Debug, Clone, Default)]
pub struct Panels {
    k: usize,
    n: usize,
    /// Columns in a panel.
    width: usize,
    /// Panel after panel, each row by row, with zeros beyond the last column.
    entries: Vec<f32>,
    /// Where the first panel starts.
    start: usize,
}

/// Numbers in a line of the cache. Registers that straddle two lines take twice as long to load.
const LINE: usize = 16;

/// So many rows of B are worked on at a time: part of a panel then stays near.
const DEPTH: usize = 128;

impl Panels {
    /// Packs b, k×n.
    pub fn of(b: Layout<'_>, k: usize, n: usize) -> Self {
        let mut panels = Self::default();
        panels.pack(b, k, n);
        panels
    }

    /// Packs b, k×n, in the place of what was packed before.
    pub fn pack(&mut self, b: Layout<'_>, k: usize, n: usize) {
        let width = Arch::new().dispatch(Width);
        let size = n.div_ceil(width) * width * k;
        // What lies beyond the last column of a packing of other sizes need not be zero.
        if (self.k, self.n) != (k, n) {
            self.entries.clear();
            self.entries.resize(size + LINE, 0.0);
        }
        (self.k, self.n, self.width) = (k, n, width);
        self.start = self.entries.as_ptr().align_offset(LINE * size_of::<f32>()).min(LINE);
        let panels = &mut self.entries[self.start..][..size];
        for (at, panel) in panels.chunks_exact_mut((width * k).max(1)).enumerate() {
            pack(b, at * width..n.min((at + 1) * width), panel, width);
        }
    }

    /// k.
    pub fn rows(&self) -> usize {
        self.k
    }

    /// n.
    pub fn columns(&self) -> usize {
        self.n
    }

    /// C = A B or C += A B, for C, m×n with rows `stride` apart, and A, m×k.
    pub fn multiply(&self, c: &mut [f32], stride: usize, a: Layout<'_>, m: usize, accum: Accum) {
        if !DEALT.get() || m * self.n * self.k < WORTH_DEALING {
            Arch::new().dispatch(Product { panels: self, c, stride, a, m, accum });
            return;
        }
        c.par_chunks_mut(DEALT_ROWS * stride).enumerate().for_each(|(chunk, c)| {
            let first = chunk * DEALT_ROWS;
            let m = DEALT_ROWS.min(m.saturating_sub(first));
            let a = a.rows_after(first);
            Arch::new().dispatch(Product { panels: self, c, stride, a, m, accum });
        });
    }
}

impl Layout<'_> {
    /// The rows from `first` on.
    fn rows_after(self, first: usize) -> Self {
        match self {
            Self::Rows(a, stride) => {
                Self::Rows(a.get(first * stride..).unwrap_or_default(), stride)
            }
            Self::Columns(a, stride) => Self::Columns(a.get(first..).unwrap_or_default(), stride),
        }
    }
}

thread_local! {
    static DEALT: Cell<bool> = const { Cell::new(false) };
}

/// From now on the larger products of this thread are dealt to all threads: for one that has no others beside it. No bit
/// depends on it.
pub fn deal_products() {
    DEALT.set(true);
}

/// Rows of C that go to a thread at a time.
const DEALT_ROWS: usize = 48;

/// Multiplications in a product, below which it is not worth while to wake another thread.
const WORTH_DEALING: usize = 2_000_000;

/// The given columns of b as a panel.
fn pack(b: Layout<'_>, columns: Range<usize>, panel: &mut [f32], width: usize) {
    match b {
        Layout::Rows(entries, stride) => {
            for (place, row) in panel.chunks_exact_mut(width).zip(entries.chunks(stride)) {
                place[..columns.len()].copy_from_slice(&row[columns.clone()]);
            }
        }
        Layout::Columns(entries, stride) => {
            for (place, column) in columns.enumerate() {
                let places = panel.iter_mut().skip(place).step_by(width);
                places.zip(&entries[column * stride..]).for_each(|(to, &from)| *to = from);
            }
        }
    }
}

/// The columns of a panel.
struct Width;

impl WithSimd for Width {
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> usize {
        S::F32_LANES * if S::REGISTER_COUNT >= 32 { 4 } else { 2 }
    }
}

struct Product<'a, 'b> {
    panels: &'b Panels,
    c: &'a mut [f32],
    stride: usize,
    a: Layout<'b>,
    m: usize,
    accum: Accum,
}

/// A part of a panel: so many of its rows from `depth` on, over these columns of C.
struct Slab<'a> {
    entries: &'a [f32],
    rows: usize,
    depth: usize,
    columns: Range<usize>,
}

/// Rows of C that stay in registers.
const BLOCK: usize = 6;

impl WithSimd for Product<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        if S::REGISTER_COUNT >= 32 { self.all::<S, 4>(simd) } else { self.all::<S, 2>(simd) }
    }
}

impl Product<'_, '_> {
    /// Panel by panel, [`DEPTH`] rows of B at a time, [`BLOCK`] rows of C at a time.
    #[inline(always)]
    fn all<S: Simd, const N: usize>(mut self, simd: S) {
        let &Panels { k, n, width, ref entries, start } = self.panels;
        for first in (0..n).step_by(width) {
            let panel = &entries[start + first * k..][..width * k];
            for depth in (0..k.max(1)).step_by(DEPTH) {
                let rows = DEPTH.min(k - depth);
                let slab = Slab {
                    entries: &panel[depth * width..][..rows * width],
                    rows,
                    depth,
                    columns: first..n.min(first + width),
                };
                let whole = self.m - self.m % BLOCK;
                for row in (0..whole).step_by(BLOCK) {
                    self.block::<S, BLOCK, N>(simd, &slab, row);
                }
                for row in whole..self.m {
                    self.block::<S, 1, N>(simd, &slab, row);
                }
            }
        }
    }

    /// `M` rows of C.
    #[inline(always)]
    fn block<S: Simd, const M: usize, const N: usize>(
        &mut self,
        simd: S,
        slab: &Slab<'_>,
        row: usize,
    ) {
        let mut sums = [[simd.splat_f32s(0.0); N]; M];
        if slab.depth > 0 || matches!(self.accum, Accum::Add) {
            for (i, sums) in sums.iter_mut().enumerate() {
                *sums = load(simd, &self.c[(row + i) * self.stride..][slab.columns.clone()]);
            }
        }
        // By value: sums that are lent out would be kept in memory.
        let sums = match self.a {
            Layout::Rows(a, stride) => {
                let mut rows: [&[f32]; M] = [&[]; M];
                for (i, row_of_a) in rows.iter_mut().enumerate() {
                    *row_of_a = &a[(row + i) * stride + slab.depth..][..slab.rows];
                }
                add_rows(simd, sums, rows, slab)
            }
            Layout::Columns(a, stride) => {
                let a = a.get(slab.depth * stride + row..).unwrap_or_default();
                add_columns(simd, sums, a, stride, slab)
            }
        };
        for (i, sums) in sums.into_iter().enumerate() {
            store(simd, sums, &mut self.c[(row + i) * self.stride..][slab.columns.clone()]);
        }
    }
}

/// Part of a row of C, as wide as a panel or less.
#[inline(always)]
fn load<S: Simd, const N: usize>(simd: S, c: &[f32]) -> [S::f32s; N] {
    let (registers, _) = S::as_simd_f32s(c);
    if let Ok(registers) = <&[S::f32s; N]>::try_from(registers) {
        return *registers;
    }
    let mut sums = [simd.splat_f32s(0.0); N];
    for (sum, c) in sums.iter_mut().zip(c.chunks(S::F32_LANES)) {
        *sum = simd.partial_load_f32s(c);
    }
    sums
}

#[inline(always)]
fn store<S: Simd, const N: usize>(simd: S, sums: [S::f32s; N], c: &mut [f32]) {
    let (registers, _) = S::as_mut_simd_f32s(c);
    if let Ok(registers) = <&mut [S::f32s; N]>::try_from(registers) {
        *registers = sums;
        return;
    }
    for (sum, c) in sums.into_iter().zip(c.chunks_mut(S::F32_LANES)) {
        simd.partial_store_f32s(c, sum);
    }
}

/// sums += A B for `M` rows of A, each as long as the slab has rows.
#[inline(always)]
fn add_rows<S: Simd, const M: usize, const N: usize>(
    simd: S,
    mut sums: [[S::f32s; N]; M],
    a: [&[f32]; M],
    slab: &Slab<'_>,
) -> [[S::f32s; N]; M] {
    let (entries, _) = S::as_simd_f32s(slab.entries);
    for (l, b) in (0..slab.rows).zip(entries.as_chunks::<N>().0) {
        for i in 0..M {
            sums[i] = add_row(simd, sums[i], a[i][l], b);
        }
    }
    sums
}

/// The same where A is column-major and starts at its first row here.
#[inline(always)]
fn add_columns<S: Simd, const M: usize, const N: usize>(
    simd: S,
    mut sums: [[S::f32s; N]; M],
    a: &[f32],
    stride: usize,
    slab: &Slab<'_>,
) -> [[S::f32s; N]; M] {
    let (entries, _) = S::as_simd_f32s(slab.entries);
    for (a, b) in a.chunks(stride).zip(entries.as_chunks::<N>().0) {
        let a = &a[..M];
        for i in 0..M {
            sums[i] = add_row(simd, sums[i], a[i], b);
        }
    }
    sums
}

/// sums + a b.
#[inline(always)]
fn add_row<S: Simd, const N: usize>(
    simd: S,
    mut sums: [S::f32s; N],
    a: f32,
    b: &[S::f32s; N],
) -> [S::f32s; N] {
    let a = simd.splat_f32s(a);
    for j in 0..N {
        sums[j] = simd.mul_add_e_f32s(a, b[j], sums[j]);
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::super::finite_differences::values;
    use super::super::real::{gemm, view};
    use super::*;

    fn rounded(len: usize, seed: u64) -> Vec<f32> {
        values(len, seed).iter().map(|&v| v as f32).collect()
    }

    fn transposed(x: &[f32], columns: usize) -> Vec<f32> {
        (0..columns).flat_map(|j| x.iter().skip(j).step_by(columns).copied()).collect()
    }

    #[test]
    fn products_are_those_of_double_precision() {
        for (m, k, n) in [(1, 1, 1), (7, 3, 5), (6, 64, 64), (13, 300, 70), (20, 257, 129)] {
            let (a, b, c) = (rounded(m * k, 1), rounded(k * n, 2), rounded(m * n, 3));
            let wide = |x: &[f32]| x.iter().map(|&v| f64::from(v)).collect::<Vec<f64>>();
            let (a_turned, b_turned) = (transposed(&a, k), transposed(&b, n));
            for accum in [Accum::Replace, Accum::Add] {
                let mut expected = wide(&c);
                gemm(&mut expected, view(&wide(&a), m, k), view(&wide(&b), k, n), accum);
                for a in [Layout::Rows(&a, k), Layout::Columns(&a_turned, m)] {
                    for b in [Layout::Rows(&b, n), Layout::Columns(&b_turned, k)] {
                        let mut found = c.clone();
                        Panels::of(b, k, n).multiply(&mut found, n, a, m, accum);
                        let close = |(f, e): (&f32, &f64)| (f64::from(*f) - e).abs() < 2e-5;
                        assert!(found.iter().zip(&expected).all(close), "{m} {k} {n} {accum:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_row_has_the_same_bits_alone_and_among_others() {
        let (m, k, n) = (17, 300, 40);
        let (a, b) = (rounded(m * k, 1), rounded(k * n, 2));
        let panels = Panels::of(Layout::Rows(&b, n), k, n);
        let mut all = vec![0.0; m * n];
        panels.multiply(&mut all, n, Layout::Rows(&a, k), m, Accum::Replace);
        for (row, expected) in a.chunks_exact(k).zip(all.chunks_exact(n)) {
            let mut found = vec![0.0; n];
            panels.multiply(&mut found, n, Layout::Rows(row, k), 1, Accum::Replace);
            assert_eq!(found, expected);
        }
    }

    #[test]
    fn products_that_are_dealt_have_the_same_bits() {
        let (m, k, n) = (211, 130, 90);
        let (a, b, c) = (rounded(m * k, 1), rounded(k * n, 2), rounded(m * n, 3));
        let turned = transposed(&a, k);
        let panels = Panels::of(Layout::Rows(&b, n), k, n);
        for a in [Layout::Rows(&a, k), Layout::Columns(&turned, m)] {
            let mut alone = c.clone();
            panels.multiply(&mut alone, n, a, m, Accum::Add);
            let mut dealt = c.clone();
            DEALT.set(true);
            panels.multiply(&mut dealt, n, a, m, Accum::Add);
            DEALT.set(false);
            assert_eq!(alone, dealt);
        }
    }

    #[test]
    fn packing_again_leaves_nothing_of_what_was_packed_before() {
        let ones = [1.0; 64];
        let mut panels = Panels::of(Layout::Rows(&ones, 8), 8, 8);
        panels.pack(Layout::Rows(&ones, 3), 2, 3);
        let mut c = [0.0; 3];
        panels.multiply(&mut c, 3, Layout::Rows(&ones, 2), 1, Accum::Replace);
        assert_eq!(c, [2.0; 3]);
        // No column of A at all: the sum over nothing.
        Panels::of(Layout::Rows(&[], 1), 0, 3).multiply(
            &mut c,
            3,
            Layout::Rows(&[], 0),
            1,
            Accum::Replace,
        );
        assert_eq!(c, [0.0; 3]);
    }
}
