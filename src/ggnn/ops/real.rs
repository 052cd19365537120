//! The two scalar types of the network, and the dense kernels that both need.

use std::cell::RefCell;
use std::thread::LocalKey;

use dfdx::dtypes::Dtype;
use faer::linalg::matmul::matmul_with_conj;
use faer::{Accum, Conj, MatMut, MatRef, Par};
use pulp::{Arch, NullaryFnOnce};

use super::lane::Lane;
use super::loan::Shelf;
use super::product::{Layout, Panels};

/// `f32`, which trains and predicts, or `f64`, which checks it.
pub trait Real: Dtype + faer::traits::RealField + Lane {
    /// Rounds from double precision.
    fn round(x: f64) -> Self;
    /// Widens to double precision.
    fn wide(self) -> f64;
    /// tanh x.
    fn tanh(self) -> Self;
    /// sin and cos of every entry of `x`. All slices have the same length.
    fn sin_cos_all(x: &[Self], sin: &mut [Self], cos: &mut [Self]);

    /// The buffers that this thread has at hand.
    fn shelf() -> &'static Shelf<Self>;

    /// Room for the factor of a product that is used once.
    fn panels() -> &'static LocalKey<RefCell<Panels<Self>>>;

    /// B = bᵀ for row-major b, n×k, for many products.
    fn pack_transposed(b: &[Self], n: usize, k: usize) -> Panels<Self> {
        Panels::of(Layout::Columns(b, k), k, n)
    }
    /// B = b for row-major b, k×n, for many products.
    fn pack(b: &[Self], k: usize, n: usize) -> Panels<Self> {
        Panels::of(Layout::Rows(b, n), k, n)
    }
    /// dst = A B for row-major a, m×k, and dst, m×n.
    fn multiply(dst: &mut [Self], a: &[Self], m: usize, b: &Panels<Self>) {
        b.multiply(dst, b.columns(), Layout::Rows(a, b.rows()), m, Accum::Replace);
    }
    /// dst = aᵀ b, or dst += aᵀ b, for row-major a, n×p, b, n×q, and dst, p×q.
    fn transposed_product(dst: &mut [Self], a: &[Self], b: &[Self], n: usize, accum: Accum) {
        let [p, q] = [a, b].map(|x| x.len() / n.max(1));
        Self::panels().with_borrow_mut(|panels| {
            panels.pack(Layout::Rows(b, q), n, q);
            panels.multiply(dst, q, Layout::Columns(a, p), p, accum);
        });
    }
    /// sum += Σ value · row, rows as long as the sum.
    fn add_rows<'a>(sum: &mut [Self], rows: impl Iterator<Item = (Self, &'a [Self])> + Clone)
    where
        Self: 'a;
}

impl Real for f64 {
    fn shelf() -> &'static Shelf<Self> {
        thread_local!(static SHELF: RefCell<Vec<Vec<f64>>> = RefCell::default());
        &SHELF
    }
    fn round(x: f64) -> Self {
        x
    }
    fn wide(self) -> f64 {
        self
    }
    fn tanh(self) -> Self {
        f64::tanh(self)
    }
    fn sin_cos_all(x: &[Self], sin: &mut [Self], cos: &mut [Self]) {
        for (x, (sin, cos)) in x.iter().zip(sin.iter_mut().zip(cos)) {
            (*sin, *cos) = x.sin_cos();
        }
    }

    fn panels() -> &'static LocalKey<RefCell<Panels<Self>>> {
        thread_local!(static PANELS: RefCell<Panels<f64>> = RefCell::default());
        &PANELS
    }
    #[inline(always)]
    fn add_rows<'a>(sum: &mut [f64], rows: impl Iterator<Item = (f64, &'a [f64])> + Clone) {
        for (value, row) in rows {
            axpy(value, row, sum);
        }
    }
}

impl Real for f32 {
    fn shelf() -> &'static Shelf<Self> {
        thread_local!(static SHELF: RefCell<Vec<Vec<f32>>> = RefCell::default());
        &SHELF
    }
    fn round(x: f64) -> Self {
        x as f32
    }
    fn wide(self) -> f64 {
        f64::from(self)
    }
    fn tanh(self) -> Self {
        f32::tanh(self)
    }
    fn sin_cos_all(x: &[Self], sin: &mut [Self], cos: &mut [Self]) {
        widely(
            #[inline(always)]
            || sin_cos_f32(x, sin, cos),
        );
    }

    fn panels() -> &'static LocalKey<RefCell<Panels<Self>>> {
        thread_local!(static PANELS: RefCell<Panels<f32>> = RefCell::default());
        &PANELS
    }
    #[inline(always)]
    fn add_rows<'a>(sum: &mut [f32], rows: impl Iterator<Item = (f32, &'a [f32])> + Clone) {
        // So many at a time stay in registers while all rows pass.
        const BLOCK: usize = 64;
        let (blocks, rest) = sum.as_chunks_mut::<BLOCK>();
        let first = blocks.len() * BLOCK;
        for (at, block) in blocks.iter_mut().enumerate() {
            let mut sums = *block;
            for (value, row) in rows.clone() {
                if let Some(row) = row[at * BLOCK..].first_chunk::<BLOCK>() {
                    for i in 0..BLOCK {
                        sums[i] += value * row[i];
                    }
                }
            }
            *block = sums;
        }
        for (value, row) in rows {
            axpy(value, &row[first..], rest);
        }
    }
}

/// Does `work` in registers as wide as the machine has.
///
/// As `FnMut`: what pulp makes of a closure goes through a shim that is called, not inlined, and stays narrow. The closure
/// wants `#[inline(always)]` all the same.
pub fn widely(work: impl FnMut()) {
    struct Widely<F>(F);

    impl<F: FnMut()> NullaryFnOnce for Widely<F> {
        type Output = ();

        #[inline(always)]
        fn call(mut self) {
            (self.0)();
        }
    }

    Arch::new().dispatch(Widely(work));
}

/// dst = a·b, or dst += a·b, on one thread. `dst` is row-major; `a` and `b` may be transposed views.
pub fn gemm<E: Real>(dst: &mut [E], a: MatRef<'_, E>, b: MatRef<'_, E>, accum: Accum) {
    let dst = MatMut::from_row_major_slice_mut(dst, a.nrows(), b.ncols());
    matmul_with_conj(dst, accum, a, Conj::No, b, Conj::No, E::round(1.0), Par::Seq);
}

/// A row-major view.
pub fn view<E>(x: &[E], rows: usize, columns: usize) -> MatRef<'_, E> {
    MatRef::from_row_major_slice(x, rows, columns)
}

/// y += a x, in registers as wide as the machine has.
#[inline(always)]
pub fn axpy<E: Real>(a: E, x: &[E], y: &mut [E]) {
    for (y, &x) in y.iter_mut().zip(x) {
        *y += a * x;
    }
}

/// y += x.
pub fn add<E: Real>(x: &[E], y: &mut [E]) {
    widely(
        #[inline(always)]
        || y.iter_mut().zip(x).for_each(|(y, &x)| *y += x),
    );
}

/// y ← y ∘ x, entry by entry.
pub fn multiply<E: Real>(x: &[E], y: &mut [E]) {
    widely(
        #[inline(always)]
        || y.iter_mut().zip(x).for_each(|(y, &x)| *y *= x),
    );
}

/// Beyond this the reduction by a three-part π/2 loses digits.
const REDUCTION_LIMIT: f32 = 8192.0;

/// sin and cos to about 1 unit in the last place of 1.0: Cody–Waite reduction by multiples of π/2, then the
/// minimax polynomials of Cephes (sinf, cosf) on [−π/4, π/4]. Larger or non-finite arguments go through libm.
#[inline(always)]
fn sin_cos_f32(x: &[f32], sin: &mut [f32], cos: &mut [f32]) {
    let mut out_of_range = false;
    for (&x, (sin, cos)) in x.iter().zip(sin.iter_mut().zip(cos.iter_mut())) {
        // A NaN compares false and is caught as well.
        #[allow(clippy::neg_cmp_op_on_partial_ord)]
        {
            out_of_range |= !(x.abs() <= REDUCTION_LIMIT);
        }
        (*sin, *cos) = sin_cos_reduced(x);
    }
    if out_of_range {
        for (&x, (sin, cos)) in x.iter().zip(sin.iter_mut().zip(cos.iter_mut())) {
            #[allow(clippy::neg_cmp_op_on_partial_ord)]
            if !(x.abs() <= REDUCTION_LIMIT) {
                (*sin, *cos) = x.sin_cos();
            }
        }
    }
}

/// x ← sin x for every entry: the sines of [`Real::sin_cos_all`], bit for bit.
pub fn sin_in_place(x: &mut [f32]) {
    widely(
        #[inline(always)]
        || sin_f32(x),
    );
}

#[inline(always)]
fn sin_f32(x: &mut [f32]) {
    let mut in_range = true;
    for x in &*x {
        in_range &= x.abs() <= REDUCTION_LIMIT;
    }
    if in_range {
        for x in x {
            *x = sin_cos_reduced(*x).0;
        }
    } else {
        x.iter_mut().for_each(|x| *x = sin_anywhere(*x));
    }
}

fn sin_anywhere(x: f32) -> f32 {
    if x.abs() <= REDUCTION_LIMIT { sin_cos_reduced(x).0 } else { x.sin() }
}

#[inline(always)]
fn sin_cos_reduced(x: f32) -> (f32, f32) {
    // Adding 1.5·2²³ rounds to the nearest integer and leaves it in the low bits.
    const ROUND: f32 = 12_582_912.0;
    const PI_2: [f32; 3] = [1.570_312_5, 4.837_513e-4, 7.549_79e-8];
    let shifted = x * std::f32::consts::FRAC_2_PI + ROUND;
    let quadrant = shifted.to_bits();
    let k = shifted - ROUND;
    let r = ((x - k * PI_2[0]) - k * PI_2[1]) - k * PI_2[2];
    let z = r * r;
    let sine = r + r * z * (-0.166_666_55 + z * (8.332_161e-3 + z * -1.951_529_6e-4));
    let cosine =
        1.0 - 0.5 * z + z * z * (4.166_664_6e-2 + z * (-1.388_731_6e-3 + z * 2.443_315_7e-5));
    let swapped = quadrant & 1 == 1;
    let (s, c) = if swapped { (cosine, sine) } else { (sine, cosine) };
    let sign_s = (quadrant & 2) << 30;
    let sign_c = (quadrant.wrapping_add(1) & 2) << 30;
    (f32::from_bits(s.to_bits() ^ sign_s), f32::from_bits(c.to_bits() ^ sign_c))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sine_and_cosine_match_double_precision() {
        let x: Vec<f32> = (-200_000..200_000).map(|i| i as f32 * 1e-4).collect();
        let (mut sin, mut cos) = (vec![0.0; x.len()], vec![0.0; x.len()]);
        f32::sin_cos_all(&x, &mut sin, &mut cos);
        for (i, &x) in x.iter().enumerate() {
            let (s, c) = f64::from(x).sin_cos();
            assert!((f64::from(sin[i]) - s).abs() < 1.3e-7, "sin {x}");
            assert!((f64::from(cos[i]) - c).abs() < 1.3e-7, "cos {x}");
        }
    }

    #[test]
    fn sines_in_place_are_the_same_sines() {
        for reach in [1.0, 1e5] {
            let x: Vec<f32> = (-1000..1000).map(|i| i as f32 * 0.013 * reach).collect();
            let (mut sin, mut cos) = (vec![0.0; x.len()], vec![0.0; x.len()]);
            f32::sin_cos_all(&x, &mut sin, &mut cos);
            let mut found = x;
            sin_in_place(&mut found);
            assert_eq!(found, sin);
        }
        let mut undefined = [0.0, f32::NAN];
        sin_in_place(&mut undefined);
        assert!(undefined[1].is_nan());
    }

    #[test]
    fn large_and_undefined_arguments_go_through_libm() {
        let x = [1e6_f32, -3e9, f32::NAN, f32::INFINITY];
        let (mut sin, mut cos) = ([0.0; 4], [0.0; 4]);
        f32::sin_cos_all(&x, &mut sin, &mut cos);
        assert_eq!((sin[0], cos[1]), (1e6_f32.sin(), (-3e9_f32).cos()));
        assert!(sin[2].is_nan() && sin[3].is_nan() && cos[3].is_nan());
    }
}
