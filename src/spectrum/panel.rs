//! Panels: eight functions on the mesh stored side by side, so that one row fills one wide register.
//!
//! The block solver lives on three products of tall thin matrices: the coefficients VᵀW, the update W − VC, and the
//! combination VC. With the functions of a block interleaved each of them streams through V once, at the speed of
//! memory; a general matrix product packs its operands first, and takes several times as long. Rows are cut into
//! chunks of a fixed size and partial sums are added in the order of the chunks: the bits of a result do not depend
//! on the number of threads.

#![allow(
    clippy::needless_range_loop,
    reason = "loops over registers, which an iterator would keep in memory"
)]

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::Dense;
use super::pencil::column_mut;
use crate::operators::Sparse;

/// Functions in a panel.
pub const WIDTH: usize = 8;

/// The values of a panel's functions at one vertex.
pub type Row = [f64; WIDTH];

/// The coefficients between two panels.
pub type Square = [Row; WIDTH];

/// Rows that one thread takes at a time: a panel's chunk fits the second-level cache.
const CHUNK: usize = 2048;

/// Rows of which a thread has a whole basis in its second-level cache.
const SMALL_CHUNK: usize = 256;

/// n×8, by rows.
#[derive(Debug, Clone)]
pub struct Panel {
    rows: Vec<Row>,
}

impl Panel {
    /// Zeros.
    pub fn zeros(n: usize) -> Self {
        Self { rows: vec![[0.0; WIDTH]; n] }
    }

    /// The rows.
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// The rows, to be written.
    pub fn rows_mut(&mut self) -> &mut [Row] {
        &mut self.rows
    }

    /// Columns `first..` of a dense matrix, as many as there are and fit.
    pub fn from_columns(x: &Dense, first: usize) -> Self {
        let columns = WIDTH.min(x.ncols() - first);
        let mut panel = Self::zeros(x.nrows());
        for j in 0..columns {
            let column = super::pencil::column(x, first + j);
            panel.rows.iter_mut().zip(column).for_each(|(row, &value)| row[j] = value);
        }
        panel
    }

    /// Writes the first columns to columns `first..` of a dense matrix, as many as fit.
    pub fn write_columns(&self, x: &mut Dense, first: usize) {
        for j in 0..WIDTH.min(x.ncols() - first) {
            let column = column_mut(x, first + j);
            column.iter_mut().zip(&self.rows).for_each(|(value, row)| *value = row[j]);
        }
    }
}

/// Y = A X.
pub fn apply(a: &Sparse, x: &Panel, y: &mut Panel) {
    let (indices, data, pointers) = (a.indices(), a.data(), a.indptr());
    y.rows.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, y)| {
        let first = chunk * CHUNK;
        let row = |i: usize| {
            let range = pointers.outer_inds_sz(first + i);
            indices[range.clone()].iter().copied().zip(data[range].iter().copied())
        };
        widest(Product { row, x: &x.rows, y });
    });
}

/// VᵀW for every panel of V.
pub fn coefficients(v: &[Panel], w: &Panel) -> Vec<Square> {
    let partial: Vec<Vec<Square>> = w
        .rows
        .par_chunks(CHUNK)
        .enumerate()
        .map(|(chunk, w)| {
            let first = chunk * CHUNK;
            v.iter().map(|v| widest(Gram { v: &v.rows[first..first + w.len()], w })).collect()
        })
        .collect();
    let mut sums = vec![[[0.0; WIDTH]; WIDTH]; v.len()];
    for part in partial {
        for (sum, part) in sums.iter_mut().zip(part) {
            for (sum, part) in sum.as_flattened_mut().iter_mut().zip(part.as_flattened()) {
                *sum += part;
            }
        }
    }
    sums
}

/// W ← W − VC.
pub fn subtract(w: &mut Panel, v: &[Panel], c: &[Square]) {
    w.rows.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, w)| {
        let first = chunk * CHUNK;
        for (v, c) in v.iter().zip(c) {
            let v = &v.rows[first..first + w.len()];
            widest(Update { w, v, c: &negative(c) });
        }
    });
}

/// W ← W C.
pub fn transform(w: &mut Panel, c: &Square) {
    w.rows.par_chunks_mut(CHUNK).for_each(|w| widest(Transform { w, c }));
}

/// V C for several C, each with as many rows of eight as V has columns. V is read once.
pub fn combine(v: &[Panel], c: &[Vec<Row>]) -> Vec<Panel> {
    let n = v.first().map_or(0, |panel| panel.rows.len());
    let mut sums: Vec<Panel> = c.iter().map(|_| Panel::zeros(n)).collect();
    let mut chunks: Vec<Vec<&mut [Row]>> = (0..n.div_ceil(SMALL_CHUNK)).map(|_| vec![]).collect();
    for sum in &mut sums {
        for (chunk, rows) in chunks.iter_mut().zip(sum.rows.chunks_mut(SMALL_CHUNK)) {
            chunk.push(rows);
        }
    }
    chunks.into_par_iter().enumerate().for_each(|(chunk, sums)| {
        let first = chunk * SMALL_CHUNK;
        for (w, c) in sums.into_iter().zip(c) {
            for (v, c) in v.iter().zip(c.as_chunks::<WIDTH>().0) {
                let v = &v.rows[first..first + w.len()];
                widest(Update { w, v, c });
            }
        }
    });
    sums
}

fn negative(c: &Square) -> Square {
    c.map(|row| row.map(|value| -value))
}

/// Runs a kernel on rows of [`WIDTH`] with the widest registers of this machine.
fn widest<K: WithSimd>(kernel: K) -> K::Output {
    Arch::new().dispatch(kernel)
}

/// Register number `strip` of a row of P values.
#[inline(always)]
pub(super) fn strip<S: Simd, const P: usize>(row: &[f64; P], strip: usize) -> S::f64s {
    S::as_simd_f64s(row).0[strip]
}

/// Register number `strip` of a row of P values, to be written.
#[inline(always)]
pub(super) fn strip_mut<S: Simd, const P: usize>(row: &mut [f64; P], strip: usize) -> &mut S::f64s {
    &mut S::as_mut_simd_f64s(row).0[strip]
}

struct Product<'a, F> {
    row: F,
    x: &'a [Row],
    y: &'a mut [Row],
}

impl<I: Iterator<Item = (usize, f64)>, F: Fn(usize) -> I> WithSimd for Product<'_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for k in 0..WIDTH / S::F64_LANES {
            for (i, y) in self.y.iter_mut().enumerate() {
                let mut sum = simd.splat_f64s(0.0);
                for (j, value) in (self.row)(i) {
                    let x = strip::<S, WIDTH>(&self.x[j], k);
                    sum = simd.mul_add_e_f64s(simd.splat_f64s(value), x, sum);
                }
                *strip_mut::<S, WIDTH>(y, k) = sum;
            }
        }
    }
}

struct Gram<'a> {
    v: &'a [Row],
    w: &'a [Row],
}

impl WithSimd for Gram<'_> {
    type Output = Square;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Square {
        let mut square = [[0.0; WIDTH]; WIDTH];
        for k in 0..WIDTH / S::F64_LANES {
            let mut sums = [simd.splat_f64s(0.0); WIDTH];
            for (v, w) in self.v.iter().zip(self.w) {
                let w = strip::<S, WIDTH>(w, k);
                for a in 0..WIDTH {
                    sums[a] = simd.mul_add_e_f64s(simd.splat_f64s(v[a]), w, sums[a]);
                }
            }
            for a in 0..WIDTH {
                *strip_mut::<S, WIDTH>(&mut square[a], k) = sums[a];
            }
        }
        square
    }
}

/// W ← W + VC.
struct Update<'a> {
    w: &'a mut [Row],
    v: &'a [Row],
    c: &'a Square,
}

impl WithSimd for Update<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for k in 0..WIDTH / S::F64_LANES {
            let mut c = [simd.splat_f64s(0.0); WIDTH];
            for a in 0..WIDTH {
                c[a] = strip::<S, WIDTH>(&self.c[a], k);
            }
            for (w, v) in self.w.iter_mut().zip(self.v) {
                let w = strip_mut::<S, WIDTH>(w, k);
                let mut sum = *w;
                for a in 0..WIDTH {
                    sum = simd.mul_add_e_f64s(simd.splat_f64s(v[a]), c[a], sum);
                }
                *w = sum;
            }
        }
    }
}

struct Transform<'a> {
    w: &'a mut [Row],
    c: &'a Square,
}

impl WithSimd for Transform<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        for w in self.w {
            let row = *w;
            for k in 0..WIDTH / S::F64_LANES {
                let mut sum = simd.splat_f64s(0.0);
                for a in 0..WIDTH {
                    let c = strip::<S, WIDTH>(&self.c[a], k);
                    sum = simd.mul_add_e_f64s(simd.splat_f64s(row[a]), c, sum);
                }
                *strip_mut::<S, WIDTH>(w, k) = sum;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spectrum::pencil;

    fn wave(n: usize, seed: f64) -> Dense {
        Dense::from_fn(n, WIDTH, |i, j| ((i * (j + 2)) as f64 * 0.37 + seed).sin())
    }

    #[test]
    fn panels_compute_what_dense_matrices_do() {
        let n = CHUNK + 77;
        let dense = [wave(n, 0.0), wave(n, 1.0), wave(n, 2.0)];
        let v: Vec<Panel> = dense[..2].iter().map(|x| Panel::from_columns(x, 0)).collect();
        let mut w = Panel::from_columns(&dense[2], 0);
        let c = coefficients(&v, &w);
        for (x, c) in dense[..2].iter().zip(&c) {
            let expected = pencil::inner(x, &dense[2]);
            let worst = (0..WIDTH)
                .flat_map(|i| (0..WIDTH).map(move |j| (i, j)))
                .map(|(i, j)| (c[i][j] - expected[(i, j)]).abs())
                .fold(0.0, f64::max);
            assert!(worst < 1e-9, "{worst}");
        }
        // W − VC + VC = W.
        let flat: Vec<Row> = c.iter().flatten().copied().collect();
        let sum = combine(&v, &[flat]).remove(0);
        subtract(&mut w, &v, &c);
        let mut back = Dense::zeros(n, WIDTH);
        w.write_columns(&mut back, 0);
        let mut part = Dense::zeros(n, WIDTH);
        sum.write_columns(&mut part, 0);
        let scale = part.norm_max();
        assert!((back + part - &dense[2]).norm_max() < 1e-13 * scale);
    }

    #[test]
    fn the_bits_do_not_depend_on_the_number_of_threads() {
        let n = 3 * CHUNK + 5;
        let (v, w) =
            (vec![Panel::from_columns(&wave(n, 0.3), 0)], Panel::from_columns(&wave(n, 0.9), 0));
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| coefficients(&v, &w))
        };
        assert_eq!(on(1), on(3));
    }
}
