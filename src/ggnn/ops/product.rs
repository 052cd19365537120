//! How fast can a product be when its matrices are as narrow as a layer? A kernel for those alone, in either precision.
//!
//! C = A B or C += A B. B is packed once, in panels a few registers wide, for as many products as there are; a block of C stays
//! in registers while k runs. Every entry of C is one sum over k in its order: its bits do not depend on how the rows of A are
//! dealt out.

use std::ops::Range;

use faer::Accum;
use pulp::{Arch, Simd, WithSimd};

use super::lane::Lane;

/// A matrix whose rows or columns lie in one piece each.
#[derive(Debug, Clone, Copy)]
pub enum Layout<'a, E> {
    /// Row-major: entries, and how far it is from one row to the next.
    Rows(&'a [E], usize),
    /// Column-major: entries, and how far it is from one column to the next.
    Columns(&'a [E], usize),
}

/// A matrix B, k×n, in panels.
#[derive(Debug, Clone, Default)]
pub struct Panels<E> {
    k: usize,
    n: usize,
    /// Columns in a panel.
    width: usize,
    /// Panel after panel, each row by row, with zeros beyond the last column.
    entries: Vec<E>,
    /// Where the first panel starts.
    start: usize,
}

/// Which entries of a product are wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Wanted {
    All,
    /// Those on the diagonal and below it; what becomes of the others is not said.
    Lower,
}

/// Bytes in a line of the cache. Registers that straddle two lines take twice as long to load.
const LINE: usize = 64;

/// So many rows of B are worked on at a time: their part of a panel then stays near.
const DEPTH: usize = 128;

impl<E: Lane> Panels<E> {
    /// Packs b, k×n.
    pub fn of(b: Layout<'_, E>, k: usize, n: usize) -> Self {
        let mut panels = Self::default();
        panels.pack(b, k, n);
        panels
    }

    /// Packs b, k×n, in the place of what was packed before.
    pub fn pack(&mut self, b: Layout<'_, E>, k: usize, n: usize) {
        self.resize(k, n);
        let (width, size) = (self.width, self.size());
        let panels = &mut self.entries[self.start..][..size];
        for (at, panel) in panels.chunks_exact_mut((width * k).max(1)).enumerate() {
            pack(b, at * width..n.min((at + 1) * width), panel, width);
        }
    }

    /// Room for k×n entries, which [`Self::set_row`] packs one row after the other.
    pub fn resize(&mut self, k: usize, n: usize) {
        self.width = Arch::new().dispatch(Width(E::default()));
        // What lies beyond the last column of a packing of other sizes need not be zero.
        if (self.k, self.n) != (k, n) {
            (self.k, self.n) = (k, n);
            self.entries.clear();
            self.entries.resize(self.size() + LINE / size_of::<E>(), E::default());
        }
        let start = self.entries.as_ptr().align_offset(LINE);
        self.start = start.min(LINE / size_of::<E>());
    }

    /// Row `row` of B, n entries.
    pub fn set_row(&mut self, row: usize, entries: &[E]) {
        let (width, size) = (self.width, self.size());
        let panels = self.entries[self.start..][..size].chunks_exact_mut(width * self.k);
        for (panel, entries) in panels.zip(entries.chunks(width)) {
            panel[row * width..][..entries.len()].copy_from_slice(entries);
        }
    }

    fn size(&self) -> usize {
        self.n.div_ceil(self.width) * self.width * self.k
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
    pub fn multiply(&self, c: &mut [E], stride: usize, a: Layout<'_, E>, m: usize, accum: Accum) {
        let wanted = Wanted::All;
        Arch::new().dispatch(Product { panels: self, c, stride, a, m, accum, wanted });
    }

    /// The lower triangle of C += A B, for row-major C, n×n, and A, n×k. What becomes of the entries above it is not said.
    pub fn add_lower_product(&self, c: &mut [E], a: Layout<'_, E>) {
        let (n, accum, wanted) = (self.n, Accum::Add, Wanted::Lower);
        Arch::new().dispatch(Product { panels: self, c, stride: n, a, m: n, accum, wanted });
    }
}

/// The given columns of b as a panel.
fn pack<E: Lane>(b: Layout<'_, E>, columns: Range<usize>, panel: &mut [E], width: usize) {
    match b {
        Layout::Rows(entries, stride) => {
            for (place, row) in panel.chunks_exact_mut(width).zip(entries.chunks(stride)) {
                place[..columns.len()].copy_from_slice(&row[columns.clone()]);
            }
        }
        Layout::Columns(entries, stride) => {
            // A line of every column at a time: the rows that they go to are still near when the next column comes.
            let rows = LINE / size_of::<E>();
            for (first, panel) in panel.chunks_mut(rows * width).enumerate() {
                for (place, column) in columns.clone().enumerate() {
                    let places = panel.iter_mut().skip(place).step_by(width);
                    let column = &entries[column * stride + first * rows..];
                    places.zip(column).for_each(|(to, &from)| *to = from);
                }
            }
        }
    }
}

/// The columns of a panel, for entries like this one.
struct Width<E>(E);

impl<E: Lane> WithSimd for Width<E> {
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> usize {
        E::lanes::<S>() * if S::REGISTER_COUNT >= 32 { 4 } else { 2 }
    }
}

struct Product<'a, 'b, E> {
    panels: &'b Panels<E>,
    c: &'a mut [E],
    stride: usize,
    a: Layout<'b, E>,
    m: usize,
    accum: Accum,
    wanted: Wanted,
}

/// A part of a panel: so many of its rows from `depth` on, over these columns of C.
struct Slab<'a, E> {
    entries: &'a [E],
    rows: usize,
    depth: usize,
    columns: Range<usize>,
}

/// Rows of C that stay in registers.
const BLOCK: usize = 6;

impl<E: Lane> WithSimd for Product<'_, '_, E> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        if S::REGISTER_COUNT >= 32 { self.all::<S, 4>(simd) } else { self.all::<S, 2>(simd) }
    }
}

impl<E: Lane> Product<'_, '_, E> {
    /// Panel by panel, [`DEPTH`] rows of B at a time, [`BLOCK`] rows of C at a time.
    #[inline(always)]
    fn all<S: Simd, const N: usize>(mut self, simd: S) {
        let &Panels { k, n, width, ref entries, start } = self.panels;
        for first in (0..n).step_by(width) {
            let panel = &entries[start + first * k..][..width * k];
            let begin = match self.wanted {
                Wanted::All => 0,
                Wanted::Lower => first,
            };
            let whole = self.m - (self.m - begin) % BLOCK;
            for depth in (0..k.max(1)).step_by(DEPTH) {
                let rows = DEPTH.min(k - depth);
                let slab = Slab {
                    entries: &panel[depth * width..][..rows * width],
                    rows,
                    depth,
                    columns: first..n.min(first + width),
                };
                for row in (begin..whole).step_by(BLOCK) {
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
        slab: &Slab<'_, E>,
        row: usize,
    ) {
        let mut sums = [[E::splat(simd, E::default()); N]; M];
        if slab.depth > 0 || matches!(self.accum, Accum::Add) {
            for (i, sums) in sums.iter_mut().enumerate() {
                *sums = load(simd, &self.c[(row + i) * self.stride..][slab.columns.clone()]);
            }
        }
        // By value: sums that are lent out would be kept in memory.
        let sums = match self.a {
            Layout::Rows(a, stride) => {
                let mut rows: [&[E]; M] = [&[]; M];
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
fn load<E: Lane, S: Simd, const N: usize>(simd: S, c: &[E]) -> [E::Register<S>; N] {
    let registers = E::registers::<S>(c);
    if let Ok(registers) = <&[E::Register<S>; N]>::try_from(registers) {
        return *registers;
    }
    let mut sums = [E::splat(simd, E::default()); N];
    for (sum, c) in sums.iter_mut().zip(c.chunks(E::lanes::<S>())) {
        *sum = E::load_part(simd, c);
    }
    sums
}

#[inline(always)]
fn store<E: Lane, S: Simd, const N: usize>(simd: S, sums: [E::Register<S>; N], c: &mut [E]) {
    let registers = E::registers_mut::<S>(c);
    if let Ok(registers) = <&mut [E::Register<S>; N]>::try_from(registers) {
        *registers = sums;
        return;
    }
    for (sum, c) in sums.into_iter().zip(c.chunks_mut(E::lanes::<S>())) {
        E::store_part(simd, c, sum);
    }
}

/// sums += A B for `M` rows of A, each as long as the slab has rows.
#[inline(always)]
fn add_rows<E: Lane, S: Simd, const M: usize, const N: usize>(
    simd: S,
    mut sums: [[E::Register<S>; N]; M],
    a: [&[E]; M],
    slab: &Slab<'_, E>,
) -> [[E::Register<S>; N]; M] {
    let entries = E::registers::<S>(slab.entries);
    for (l, b) in (0..slab.rows).zip(entries.as_chunks::<N>().0) {
        for i in 0..M {
            sums[i] = add_row(simd, sums[i], a[i][l], b);
        }
    }
    sums
}

/// The same where A is column-major and starts at its first row here.
#[inline(always)]
fn add_columns<E: Lane, S: Simd, const M: usize, const N: usize>(
    simd: S,
    mut sums: [[E::Register<S>; N]; M],
    a: &[E],
    stride: usize,
    slab: &Slab<'_, E>,
) -> [[E::Register<S>; N]; M] {
    let entries = E::registers::<S>(slab.entries);
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
fn add_row<E: Lane, S: Simd, const N: usize>(
    simd: S,
    mut sums: [E::Register<S>; N],
    a: E,
    b: &[E::Register<S>; N],
) -> [E::Register<S>; N] {
    let a = E::splat(simd, a);
    for j in 0..N {
        sums[j] = E::mul_add(simd, a, b[j], sums[j]);
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
