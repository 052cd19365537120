//! A dense symmetric matrix of which the first columns are eliminated.
//!
//! Columns are cut into strips of eight rows, one wide register each, and start at a whole strip. Some entries above the
//! diagonal share a strip with one below: they are computed in vain and never read.

#![allow(
    clippy::needless_range_loop,
    reason = "loops over registers, which an iterator would keep in memory"
)]

use pulp::{Arch, Simd, WithSimd};

use super::panel::{Row, WIDTH, strip, strip_mut};

/// Columns that are eliminated before the rest of the matrix is brought up to date.
const BLOCK: usize = 16;

/// The lower triangle of a symmetric matrix, by columns.
#[derive(Debug, Default)]
pub struct Front {
    values: Vec<Row>,
    /// The length of a column, in strips.
    stride: usize,
    /// The columns to be eliminated.
    columns: usize,
    /// All columns.
    height: usize,
    /// The newest block of eliminated columns, one strip of rows after the other.
    block: Vec<Row>,
}

impl Front {
    /// Zeros, with `below` rows and columns more than are to be eliminated.
    pub fn reset(&mut self, columns: usize, below: usize) {
        self.columns = columns;
        self.height = columns + below;
        self.stride = self.height.div_ceil(WIDTH);
        self.values.clear();
        self.values.resize(self.stride * self.height, [0.0; WIDTH]);
    }

    /// The number of columns that are eliminated.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// The number of rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Column `j`, of which the rows from `j` on mean something.
    pub fn column(&self, j: usize) -> &[f64] {
        self.values[j * self.stride..][..self.stride].as_flattened()
    }

    /// Entry (i, j), i ≥ j.
    pub fn entry(&mut self, i: usize, j: usize) -> &mut f64 {
        &mut self.values[j * self.stride + i / WIDTH][i % WIDTH]
    }

    /// Adds a matrix, its lower triangle by columns, at these rows and columns, ascending.
    pub fn add(&mut self, places: &[u32], triangle: &[f64]) {
        let mut rest = triangle;
        for (j, &place) in places.iter().enumerate() {
            let (values, after) = rest.split_at(places.len() - j);
            let column = &mut self.values[place as usize * self.stride..][..self.stride];
            let column = column.as_flattened_mut();
            for (&row, value) in places[j..].iter().zip(values) {
                column[row as usize] += value;
            }
            rest = after;
        }
    }

    /// Factorises the columns to be eliminated into R and D, and subtracts R D Rᵀ from the rest. Returns the number of
    /// negative entries of D.
    ///
    /// # Errors
    /// The column whose pivot is zero or not a number.
    pub fn eliminate(&mut self) -> Result<usize, usize> {
        for first in (0..self.columns).step_by(BLOCK) {
            let count = BLOCK.min(self.columns - first);
            Arch::new().dispatch(Eliminate { front: self, first, count })?;
        }
        Ok((0..self.columns).filter(|&j| self.column(j)[j] < 0.0).count())
    }

    /// Appends the lower triangle of what is not eliminated, by columns.
    pub fn rest(&self, to: &mut Vec<f64>) {
        for j in self.columns..self.height {
            to.extend_from_slice(&self.column(j)[j..self.height]);
        }
    }
}

/// Eliminates a block of columns.
struct Eliminate<'a> {
    front: &'a mut Front,
    first: usize,
    count: usize,
}

impl WithSimd for Eliminate<'_> {
    type Output = Result<(), usize>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Result<(), usize> {
        let Self { front: Front { values, stride, height, block, .. }, first, count } = self;
        let (stride, end) = (*stride, first + count);
        let mut pivots = [0.0; BLOCK];
        for k in first..end {
            let (done, after) = values.split_at_mut((k + 1) * stride);
            let column = &mut done[k * stride..];
            let pivot = column.as_flattened()[k];
            let inverse = pivot.recip();
            if !pivot.is_finite() || !inverse.is_finite() {
                return Err(k);
            }
            for (j, other) in (k + 1..end).zip(after.chunks_exact_mut(stride)) {
                let weight = -column.as_flattened()[j] * inverse;
                let from = j / WIDTH;
                add::<S>(simd, weight, &column[from..], &mut other[from..]);
            }
            scale::<S>(simd, inverse, &mut column[k / WIDTH..]);
            column.as_flattened_mut()[k] = pivot;
            pivots[k - first] = pivot;
        }
        // The strips below the block, each of all its columns.
        let below = end / WIDTH;
        block.clear();
        for strip in below..stride {
            block.extend((first..end).map(|k| values[k * stride + strip]));
        }
        let weights = |j: usize| {
            let rows = &block[(j / WIDTH - below) * count..][..count];
            let mut weights = [0.0; BLOCK];
            for k in 0..count {
                weights[k] = -rows[k][j % WIDTH] * pivots[k];
            }
            weights
        };
        let mut j = end;
        while j < *height {
            let from = j / WIDTH;
            let columns = &mut values[j * stride..];
            let block = &block[(from - below) * count..];
            if j + 4 <= *height {
                let weights = [j, j + 1, j + 2, j + 3].map(weights);
                update::<S, 4>(simd, &weights, block, count, columns, stride, from);
                j += 4;
            } else {
                update::<S, 1>(simd, &[weights(j)], block, count, columns, stride, from);
                j += 1;
            }
        }
        Ok(())
    }
}

/// y ← y + a x.
#[inline(always)]
fn add<S: Simd>(simd: S, a: f64, x: &[Row], y: &mut [Row]) {
    let a = simd.splat_f64s(a);
    for (x, y) in x.iter().zip(y) {
        for k in 0..WIDTH / S::F64_LANES {
            let y = strip_mut::<S, WIDTH>(y, k);
            *y = simd.mul_add_e_f64s(a, strip::<S, WIDTH>(x, k), *y);
        }
    }
}

/// x ← a x.
#[inline(always)]
fn scale<S: Simd>(simd: S, a: f64, x: &mut [Row]) {
    let a = simd.splat_f64s(a);
    for x in x {
        for k in 0..WIDTH / S::F64_LANES {
            let x = strip_mut::<S, WIDTH>(x, k);
            *x = simd.mul_f64s(a, *x);
        }
    }
}

/// Adds the columns of a block, weighted, to J columns that follow each other, from a strip on.
#[inline(always)]
fn update<S: Simd, const J: usize>(
    simd: S,
    weights: &[[f64; BLOCK]; J],
    block: &[Row],
    count: usize,
    columns: &mut [Row],
    stride: usize,
    from: usize,
) {
    let mut columns = columns.chunks_exact_mut(stride);
    let columns: [&mut [Row]; J] =
        std::array::from_fn(|_| columns.next().map_or(&mut [][..], |column| &mut column[from..]));
    for (i, rows) in block.chunks_exact(count).enumerate() {
        for k in 0..WIDTH / S::F64_LANES {
            let mut sums: [S::f64s; J] =
                std::array::from_fn(|a| strip::<S, WIDTH>(&columns[a][i], k));
            for (row, b) in rows.iter().zip(0..BLOCK) {
                let row = strip::<S, WIDTH>(row, k);
                for a in 0..J {
                    sums[a] = simd.mul_add_e_f64s(simd.splat_f64s(weights[a][b]), row, sums[a]);
                }
            }
            for a in 0..J {
                *strip_mut::<S, WIDTH>(&mut columns[a][i], k) = sums[a];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A symmetric matrix whose leading minors are far from zero, some negative.
    fn matrix(i: usize, j: usize) -> f64 {
        let sign = if i % 3 == 1 { -1.0 } else { 1.0 };
        if i == j { sign * (40.0 + i as f64) } else { ((i * j + i + j) as f64).sin() }
    }

    #[test]
    fn r_d_rt_and_the_rest_rebuild_the_matrix() {
        let mut front = Front::default();
        for (columns, below) in [(1, 0), (1, 9), (3, 7), (8, 8), (17, 30), (40, 3)] {
            front.reset(columns, below);
            let n = columns + below;
            for j in 0..n {
                (j..n).for_each(|i| *front.entry(i, j) = matrix(i, j));
            }
            let negative = front.eliminate().unwrap();
            assert_eq!(negative, (0..columns).filter(|i| i % 3 == 1).count());
            let r = |i: usize, k: usize| if i == k { 1.0 } else { front.column(k)[i] };
            let mut rest = Vec::new();
            front.rest(&mut rest);
            let mut at = 0;
            for j in 0..n {
                for i in j..n {
                    let terms =
                        (0..columns.min(j + 1)).map(|k| r(i, k) * r(j, k) * front.column(k)[k]);
                    let mut sum: f64 = terms.sum();
                    if j >= columns {
                        sum += rest[at];
                        at += 1;
                    }
                    assert!((sum - matrix(i, j)).abs() < 1e-12, "({i}, {j}) of {n}");
                }
            }
        }
    }

    #[test]
    fn a_zero_pivot_is_named() {
        let mut front = Front::default();
        front.reset(2, 1);
        *front.entry(0, 0) = 2.0;
        *front.entry(1, 0) = 2.0;
        *front.entry(1, 1) = 2.0;
        assert_eq!(front.eliminate(), Err(1));
    }
}
