//! ShapeDNA: the lowest eigenvalues of a shape, by themselves a fingerprint that does not change as it bends.
//!
//! M. Reuter, F.-E. Wolter and N. Peinecke, Laplace–Beltrami spectra as "Shape-DNA" of surfaces and solids, Computer-Aided
//! Design 38 (2006). Scaling a surface by s divides λ by s²; normalised, shapes of different sizes can be compared.

/// What λ is multiplied by, so that size does not count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Normalisation {
    /// The surface area.
    Area(f64),
    /// The volume that a closed surface encloses, to the power ⅔.
    Volume(f64),
    /// The inverse of the first λ > 0, which is then 1.
    FirstEigenvalue(f64),
}

/// λ₁ … λ_K without a unit, length K.
pub fn shape_dna(values: &[f64], normalisation: Normalisation) -> Vec<f64> {
    let factor = match normalisation {
        Normalisation::Area(area) => area,
        Normalisation::Volume(volume) => volume.powf(2.0 / 3.0),
        Normalisation::FirstEigenvalue(first) => first.recip(),
    };
    values.iter().map(|value| value * factor).collect()
}

/// The Euclidean distance of two fingerprints, over as many eigenvalues as both have.
pub fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

/// The distances between all of m shapes, m rows of m; over as many eigenvalues as all have, so that they are distances in
/// one space.
pub fn distances(shapes: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let k = shapes.iter().map(Vec::len).min().unwrap_or(0);
    let row = |a: &Vec<f64>| shapes.iter().map(|b| distance(&a[..k], &b[..k])).collect();
    shapes.iter().map(row).collect()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    /// l(l + 1)/r² of a sphere of radius r, to degree 3.
    fn sphere(radius: f64) -> Vec<f64> {
        let degrees = (0..4_i32).flat_map(|l| std::iter::repeat_n(l, 2 * l as usize + 1));
        degrees.map(|l| f64::from(l * (l + 1)) / radius.powi(2)).collect()
    }

    #[test]
    fn all_spheres_are_one_shape_however_large() {
        for radius in [0.01_f64, 1.0, 300.0] {
            let (area, volume) = (4.0 * PI * radius.powi(2), 4.0 / 3.0 * PI * radius.powi(3));
            let values = sphere(radius);
            for (normalisation, of_the_unit) in [
                (Normalisation::Area(area), 4.0 * PI),
                (Normalisation::Volume(volume), (4.0 / 3.0 * PI).powf(2.0 / 3.0)),
                (Normalisation::FirstEigenvalue(values[1]), 0.5),
            ] {
                let expected = sphere(1.0).into_iter().map(|value| value * of_the_unit);
                for (found, expected) in shape_dna(&values, normalisation).iter().zip(expected) {
                    assert!((found - expected).abs() <= 1e-13 * expected, "{normalisation:?}");
                }
            }
        }
    }

    #[test]
    fn distances_are_a_metric_over_what_all_have() {
        let shapes = [vec![0.0, 3.0, 4.0], vec![0.0, 0.0, 0.0], vec![0.0, 3.0]];
        assert_eq!(distance(&shapes[0], &shapes[1]), 5.0);
        let expected = [[0.0, 3.0, 0.0], [3.0, 0.0, 3.0], [0.0, 3.0, 0.0]].map(|row| row.to_vec());
        assert_eq!(distances(&shapes), expected);
        assert!(distances(&[]).is_empty());
    }
}
