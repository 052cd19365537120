//! Holds a hand-written backward against central differences, in double precision.

use dfdx::prelude::*;

use super::{Matrix, Scalar};

/// Reads the gradients of the inputs, in their order.
pub type ReadGradients = Box<dyn FnOnce(&Gradients<f64, Cpu>) -> Vec<Vec<f64>>>;

/// Checks the gradient of `loss` with respect to every entry of every input.
///
/// `loss` builds the scalar from the inputs on the given tape.
pub fn check(
    inputs: &[Vec<f64>],
    loss: impl Fn(
        &Cpu,
        &[Vec<f64>],
        OwnedTape<f64, Cpu>,
    ) -> (Scalar<f64, OwnedTape<f64, Cpu>>, ReadGradients),
) {
    let device = Cpu::default();
    let value = |inputs: &[Vec<f64>]| loss(&device, inputs, OwnedTape::default()).0.as_vec()[0];
    let (traced, read) = loss(&device, inputs, OwnedTape::default());
    let gradients = read(&traced.backward());
    let step = 1e-5;
    for (which, input) in inputs.iter().enumerate() {
        let scale = gradients[which].iter().fold(1e-3_f64, |m, g| m.max(g.abs()));
        for entry in 0..input.len() {
            let at = |delta: f64| {
                let mut moved = inputs.to_vec();
                moved[which][entry] += delta;
                value(&moved)
            };
            // Fourth order: the truncation error is below rounding.
            let difference =
                (8.0 * (at(step) - at(-step)) - (at(2.0 * step) - at(-2.0 * step))) / (12.0 * step);
            let error = (gradients[which][entry] - difference).abs() / scale;
            assert!(
                error < 1e-7,
                "input {which}, entry {entry}: gradient {} but difference {difference}",
                gradients[which][entry]
            );
        }
    }
}

/// Reproducible values in (−1, 1).
pub fn values(len: usize, seed: u64) -> Vec<f64> {
    (0..len).map(|i| ((i as f64 + 1.0) * (seed as f64 * 0.7 + 1.3)).sin() * 0.9).collect()
}

/// A scalar that depends on every entry in its own way.
pub fn weighted_sum<T: Tape<f64, Cpu>>(x: Matrix<f64, T>) -> Scalar<f64, T> {
    let (n, h) = *x.shape();
    let weights = x.device().tensor_from_vec(values(n * h, 11), (n, h));
    (x * weights).sum::<(), _>()
}
