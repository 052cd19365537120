//! The functions between layers: sin as in (28) and (29), and the two that the paper's Table 2 compares it with.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::loan::Loan;
use super::real::{Real, sin_in_place, widely};

/// A function that is applied to every entry, in the encoder and in every layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Activation {
    /// sin x.
    #[default]
    Sin,
    /// tanh x.
    Tanh,
    /// max(x, 0); not a number stays what it is.
    Relu,
}

impl Activation {
    /// In the order of their codes in a stored block.
    pub const ALL: [Self; 3] = [Self::Sin, Self::Tanh, Self::Relu];

    /// The values σ(x) and the slopes σ′(x) of all entries.
    pub fn apply<E: Real>(self, x: &[E]) -> Activated<E> {
        // Values are given away to a tensor, slopes come back after the backward pass.
        let (mut values, mut slopes) = (vec![E::default(); x.len()], Loan::of(x.len()));
        self.apply_to(x, &mut values, &mut slopes);
        Activated { values, slopes }
    }

    /// The same, to buffers as long as x.
    pub fn apply_to<E: Real>(self, x: &[E], values: &mut [E], slopes: &mut [E]) {
        match self {
            Self::Sin => E::sin_cos_all(x, values, slopes),
            Self::Tanh => tanh_all(x, values, slopes),
            Self::Relu => relu_all(x, values, slopes),
        }
    }

    /// x ← σ(x) for every entry: the values of [`Self::apply`].
    pub fn in_place(self, x: &mut [f32]) {
        match self {
            Self::Sin => sin_in_place(x),
            Self::Tanh => x.iter_mut().for_each(|x| *x = x.tanh()),
            Self::Relu => x.iter_mut().for_each(|x| *x = if *x <= 0.0 { 0.0 } else { *x }),
        }
    }
}

/// What an activation makes of some entries.
#[derive(Debug)]
pub struct Activated<E: Real> {
    /// σ(x).
    pub values: Vec<E>,
    /// σ′(x).
    pub slopes: Loan<E>,
}

/// tanh′ = 1 − tanh².
fn tanh_all<E: Real>(x: &[E], values: &mut [E], slopes: &mut [E]) {
    let one = E::round(1.0);
    for (&x, (value, slope)) in x.iter().zip(values.iter_mut().zip(slopes)) {
        *value = x.tanh();
        *slope = one - *value * *value;
    }
}

fn relu_all<E: Real>(x: &[E], values: &mut [E], slopes: &mut [E]) {
    let (zero, one) = (E::default(), E::round(1.0));
    widely(
        #[inline(always)]
        || {
            for (&x, (value, slope)) in x.iter().zip(values.iter_mut().zip(slopes.iter_mut())) {
                let off = x <= zero;
                *value = if off { zero } else { x };
                *slope = if off { zero } else { one };
            }
        },
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Central differences, away from ReLU's corner.
    #[test]
    fn slopes_are_derivatives_of_values() {
        let x: Vec<f64> = (-40..40).map(|i| 0.1 * f64::from(i) + 0.05).collect();
        let moved = |by: f64| x.iter().map(|x| x + by).collect::<Vec<_>>();
        for activation in Activation::ALL {
            let step = 1e-5;
            let [up, down] = [step, -step].map(|by| activation.apply(&moved(by)).values);
            let Activated { slopes, .. } = activation.apply(&x);
            for (i, slope) in slopes.iter().enumerate() {
                let difference = (up[i] - down[i]) / (2.0 * step);
                assert!((slope - difference).abs() < 1e-9, "{activation:?} at {}", x[i]);
            }
        }
    }

    #[test]
    fn values_in_place_are_the_same_values() {
        let x: Vec<f32> = (-400..400).map(|i| 0.03 * i as f32).collect();
        for activation in Activation::ALL {
            let mut found = x.clone();
            activation.in_place(&mut found);
            assert_eq!(found, activation.apply(&x).values, "{activation:?}");
        }
    }

    #[test]
    fn what_is_not_a_number_stays_so() {
        for activation in Activation::ALL {
            assert!(activation.apply(&[f32::NAN]).values[0].is_nan(), "{activation:?}");
        }
    }
}
