//! Panels: eight functions on the mesh stored side by side, so that one row fills one wide register.
//!
//! The block solver lives on three products of tall thin matrices: the coefficients VᵀDW with a diagonal D, the update
//! W − VC, and the rotation VC. With the functions of a block interleaved each of them streams through V once, at the
//! speed of memory; a general matrix product packs its operands first, and takes several times as long. Rows are cut
//! into chunks of a fixed size and partial sums are added in the order of the chunks: the bits of a result do not
//! depend on the number of threads.

#![allow(
    clippy::needless_range_loop,
    reason = "loops over registers, which an iterator would keep in memory"
)]

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::Dense;
use super::pencil::columns_mut;
use crate::operators::Sparse;

/// Functions in a panel.
pub const WIDTH: usize = 8;

/// The values of a panel's functions at one vertex.
pub type Row = [f64; WIDTH];

/// The coefficients between two panels.
pub type Square = [Row; WIDTH];

/// Rows that one thread takes at a time: a chunk of several panels fits the second-level cache.
pub(super) const CHUNK: usize = 512;

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

    /// Column j is the sum of the columns j, j + 8, j + 16, … of a dense matrix.
    pub fn sums(x: &Dense) -> Self {
        let mut panel = Self::zeros(x.nrows());
        for j in 0..x.ncols() {
            let column = super::pencil::column(x, j);
            panel.rows.iter_mut().zip(column).for_each(|(row, &value)| row[j % WIDTH] += value);
        }
        panel
    }

    /// Writes the first columns to columns `first..` of a dense matrix, as many as fit.
    pub fn write_columns(&self, x: &mut Dense, first: usize) {
        self.write_to(columns_mut(x).skip(first).take(WIDTH).collect());
    }

    /// Writes the first functions, n values each.
    pub fn write_to(&self, columns: Vec<&mut [f64]>) {
        let mut chunks: Vec<Vec<&mut [f64]>> =
            self.rows.chunks(CHUNK).map(|_| Vec::with_capacity(columns.len())).collect();
        for column in columns {
            chunks.iter_mut().zip(column.chunks_mut(CHUNK)).for_each(|(to, part)| to.push(part));
        }
        self.rows.par_chunks(CHUNK).zip(chunks).for_each(|(rows, columns)| {
            for (j, column) in columns.into_iter().enumerate() {
                column.iter_mut().zip(rows).for_each(|(value, row)| *value = row[j]);
            }
        });
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

/// Y = D X.
pub fn scale(weights: &[f64], x: &Panel, y: &mut Panel) {
    let chunks = y.rows.par_chunks_mut(CHUNK).zip(x.rows.par_chunks(CHUNK));
    chunks.zip(weights.par_chunks(CHUNK)).for_each(|((y, x), weights)| {
        for ((y, x), weight) in y.iter_mut().zip(x).zip(weights) {
            *y = x.map(|value| weight * value);
        }
    });
}

/// VᵀDW for every panel of V and several panels W; D is the identity where no weights are given.
pub fn coefficients<const N: usize>(
    v: &[&Panel],
    w: [&Panel; N],
    weights: Option<&[f64]>,
) -> Vec<[Square; N]> {
    let n = w.first().map_or(0, |w| w.rows.len());
    let sums = (0..n.div_ceil(CHUNK)).into_par_iter().map(|chunk| {
        let rows = chunk * CHUNK..n.min((chunk + 1) * CHUNK);
        let weights = weights.map(|weights| &weights[rows.clone()]);
        let with = |v: &[Row]| w.map(|w| gram(v, &w.rows[rows.clone()], weights));
        v.iter().map(|v| with(&v.rows[rows.clone()])).collect()
    });
    total(sums.collect())
}

/// The sums of what was found in chunks, added in their order.
pub(super) fn total<const N: usize>(parts: Vec<Vec<[Square; N]>>) -> Vec<[Square; N]> {
    let add = |mut sums: Vec<[Square; N]>, part: Vec<[Square; N]>| {
        let sum = sums.as_flattened_mut().as_flattened_mut().as_flattened_mut();
        let part = part.as_flattened().as_flattened().as_flattened();
        sum.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
        sums
    };
    parts.into_iter().reduce(add).unwrap_or_default()
}

/// W ← W − VC for several panels W; V is read once.
pub fn subtract_from(w: &mut [Panel], v: &[&Panel], c: &[[Square; 2]]) {
    let mut chunks = chunks_mut(w, CHUNK);
    chunks.par_iter_mut().enumerate().for_each(|(chunk, w)| {
        for (v, c) in v.iter().zip(c) {
            for (w, c) in w.iter_mut().zip(c) {
                subtract(w, &v.rows[chunk * CHUNK..chunk * CHUNK + w.len()], c);
            }
        }
    });
}

/// V C in the place of the first panels of V, for several C, each with as many rows of eight as V has columns.
pub fn rotate(v: &mut Vec<Panel>, c: &[Vec<Row>]) {
    let room = || vec![[0.0; WIDTH]; SMALL_CHUNK * c.len()];
    chunks_mut(v, SMALL_CHUNK).into_par_iter().for_each_init(room, |sums, mut v| {
        sums.fill([0.0; WIDTH]);
        for (sum, c) in sums.chunks_mut(SMALL_CHUNK).zip(c) {
            for (v, c) in v.iter().zip(c.as_chunks::<WIDTH>().0) {
                widest(Update { w: &mut sum[..v.len()], v, c });
            }
        }
        for (v, sum) in v.iter_mut().zip(sums.chunks(SMALL_CHUNK)) {
            v.copy_from_slice(&sum[..v.len()]);
        }
    });
    v.truncate(c.len());
}

/// For every chunk of so many rows, the chunks of all panels.
fn chunks_mut(panels: &mut [Panel], rows: usize) -> Vec<Vec<&mut [Row]>> {
    let n = panels.first().map_or(0, |panel| panel.rows.len());
    let mut chunks: Vec<Vec<&mut [Row]>> = (0..n.div_ceil(rows)).map(|_| Vec::new()).collect();
    for panel in panels {
        chunks.iter_mut().zip(panel.rows.chunks_mut(rows)).for_each(|(to, part)| to.push(part));
    }
    chunks
}

/// VᵀDW of a few rows.
pub(super) fn gram(v: &[Row], w: &[Row], weights: Option<&[f64]>) -> Square {
    widest(Gram { v, w, weights })
}

/// W ← W − VC for a few rows.
pub(super) fn subtract(w: &mut [Row], v: &[Row], c: &Square) {
    widest(Update { w, v, c: &negative(c) });
}

/// W ← W C for a few rows.
pub(super) fn transform(w: &mut [Row], c: &Square) {
    widest(Transform { w, c });
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
    weights: Option<&'a [f64]>,
}

impl WithSimd for Gram<'_> {
    type Output = Square;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Square {
        let rows = self.v.iter().zip(self.w);
        match self.weights {
            Some(weights) => weighted(simd, rows.zip(weights).map(|((v, w), &d)| (v, w, d))),
            None => weighted(simd, rows.map(|(v, w)| (v, w, 1.0))),
        }
    }
}

/// The sum of d vᵀw over rows (v, w, d).
#[inline(always)]
fn weighted<'a, S: Simd>(
    simd: S,
    rows: impl Iterator<Item = (&'a Row, &'a Row, f64)> + Clone,
) -> Square {
    let mut square = [[0.0; WIDTH]; WIDTH];
    for k in 0..WIDTH / S::F64_LANES {
        let mut sums = [simd.splat_f64s(0.0); WIDTH];
        for (v, w, d) in rows.clone() {
            let w = simd.mul_f64s(simd.splat_f64s(d), strip::<S, WIDTH>(w, k));
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
        let w = Panel::from_columns(&dense[2], 0);
        let weights: Vec<f64> = (0..n).map(|i| 1.0 + (i as f64 * 0.1).cos()).collect();
        let c = coefficients(&[&v[0], &v[1]], [&w, &v[1]], Some(&weights));
        for (x, c) in dense.iter().zip(&c) {
            for (y, c) in [&dense[2], &dense[1]].into_iter().zip(c) {
                let weighted = Dense::from_fn(n, WIDTH, |i, j| weights[i] * y[(i, j)]);
                let expected = pencil::inner(x, &weighted);
                let difference = Dense::from_fn(WIDTH, WIDTH, |i, j| c[i][j] - expected[(i, j)]);
                assert!(difference.norm_max() < 1e-9);
            }
        }
        // W − VC + VC = W.
        let flat: Vec<Row> = c.iter().flat_map(|c| c[0]).collect();
        let mut rest = [w.clone(), w];
        subtract_from(&mut rest, &[&v[0], &v[1]], &c);
        let mut sum = v;
        rotate(&mut sum, &[flat]);
        let columns = |panel: &Panel| {
            let mut x = Dense::zeros(n, WIDTH);
            panel.write_columns(&mut x, 0);
            x
        };
        let part = columns(&sum[0]);
        let difference = columns(&rest[0]) + &part - &dense[2];
        assert!(difference.norm_max() < 1e-13 * part.norm_max());
    }

    #[test]
    fn the_bits_do_not_depend_on_the_number_of_threads() {
        let n = 3 * CHUNK + 5;
        let [v, w] = [0.3, 0.9].map(|seed| Panel::from_columns(&wave(n, seed), 0));
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| coefficients(&[&v], [&w], None))
        };
        assert_eq!(on(1), on(3));
    }
}
