//! The entries of a wide register, in either precision: what a kernel needs of pulp, under one name.

use std::fmt::Debug;

use pulp::Simd;

/// A number of which a register holds several.
pub trait Lane: Copy + Default + Debug + PartialEq + Send + Sync + 'static {
    /// A register.
    type Register<S: Simd>: Copy;

    /// How many numbers a register holds.
    fn lanes<S: Simd>() -> usize {
        size_of::<Self::Register<S>>() / size_of::<Self>()
    }

    /// x in every lane.
    fn splat<S: Simd>(simd: S, x: Self) -> Self::Register<S>;
    /// a b + c, rounded once where the machine can.
    fn mul_add<S: Simd>(
        simd: S,
        a: Self::Register<S>,
        b: Self::Register<S>,
        c: Self::Register<S>,
    ) -> Self::Register<S>;
    /// As many whole registers as there are.
    fn registers<S: Simd>(x: &[Self]) -> &[Self::Register<S>];
    /// The same, to be written.
    fn registers_mut<S: Simd>(x: &mut [Self]) -> &mut [Self::Register<S>];
    /// A register whose first lanes are x, the others zero.
    fn load_part<S: Simd>(simd: S, x: &[Self]) -> Self::Register<S>;
    /// Writes the first lanes.
    fn store_part<S: Simd>(simd: S, x: &mut [Self], register: Self::Register<S>);
}

macro_rules! lane {
    ($number:ty, $register:ident, $splat:ident, $mul_add:ident, $slice:ident, $slice_mut:ident, $load:ident, $store:ident) => {
        impl Lane for $number {
            type Register<S: Simd> = S::$register;

            #[inline(always)]
            fn splat<S: Simd>(simd: S, x: Self) -> S::$register {
                simd.$splat(x)
            }
            #[inline(always)]
            fn mul_add<S: Simd>(
                simd: S,
                a: S::$register,
                b: S::$register,
                c: S::$register,
            ) -> S::$register {
                simd.$mul_add(a, b, c)
            }
            #[inline(always)]
            fn registers<S: Simd>(x: &[Self]) -> &[S::$register] {
                S::$slice(x).0
            }
            #[inline(always)]
            fn registers_mut<S: Simd>(x: &mut [Self]) -> &mut [S::$register] {
                S::$slice_mut(x).0
            }
            #[inline(always)]
            fn load_part<S: Simd>(simd: S, x: &[Self]) -> S::$register {
                simd.$load(x)
            }
            #[inline(always)]
            fn store_part<S: Simd>(simd: S, x: &mut [Self], register: S::$register) {
                simd.$store(x, register);
            }
        }
    };
}

lane!(
    f32,
    f32s,
    splat_f32s,
    mul_add_e_f32s,
    as_simd_f32s,
    as_mut_simd_f32s,
    partial_load_f32s,
    partial_store_f32s
);
lane!(
    f64,
    f64s,
    splat_f64s,
    mul_add_e_f64s,
    as_simd_f64s,
    as_mut_simd_f64s,
    partial_load_f64s,
    partial_store_f64s
);
