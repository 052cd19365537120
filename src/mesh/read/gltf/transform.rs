//! Where a node puts its mesh: affine maps of ℝ³ in double precision.

use gltf::scene::Transform;

/// x ↦ A x + t. The rows of `rows` are those of (A | t).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Affine {
    rows: [[f64; 4]; 3],
}

impl Affine {
    pub const IDENTITY: Self =
        Self { rows: [[1., 0., 0., 0.], [0., 1., 0., 0.], [0., 0., 1., 0.]] };

    /// The local transform of a node. A rotation is normalised first: in single precision it never quite is.
    pub fn of(transform: &Transform) -> Self {
        match transform {
            // Column-major; the last row of an affine map is (0, 0, 0, 1).
            Transform::Matrix { matrix } => {
                let [x, y, z, t] = matrix.map(|column| column.map(f64::from));
                Self {
                    rows: [
                        [x[0], y[0], z[0], t[0]],
                        [x[1], y[1], z[1], t[1]],
                        [x[2], y[2], z[2], t[2]],
                    ],
                }
            }
            Transform::Decomposed { translation, rotation, scale } => {
                let t = translation.map(f64::from);
                let s = scale.map(f64::from);
                let [r0, r1, r2] = rotation_matrix(rotation.map(f64::from));
                let row = |r: [f64; 3], t| [r[0] * s[0], r[1] * s[1], r[2] * s[2], t];
                Self { rows: [row(r0, t[0]), row(r1, t[1]), row(r2, t[2])] }
            }
        }
    }

    /// This map after `inner`: parent.then(child) places the child's mesh.
    pub fn then(&self, inner: &Self) -> Self {
        let [p, q, r] = inner.rows;
        let rows = self.rows.map(|[a, b, c, t]| {
            let entry = |i: usize| a * p[i] + b * q[i] + c * r[i];
            [entry(0), entry(1), entry(2), entry(3) + t]
        });
        Self { rows }
    }

    pub fn apply(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        self.rows.map(|[a, b, c, t]| a * x + b * y + c * z + t)
    }

    /// Whether the map turns left hands into right hands: det A < 0.
    pub fn mirrors(&self) -> bool {
        let [[a, b, c, _], [d, e, f, _], [g, h, i, _]] = self.rows;
        a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) < 0.0
    }
}

/// The rows of the rotation of a quaternion (x, y, z, w). A zero quaternion rotates nothing.
fn rotation_matrix(quaternion: [f64; 4]) -> [[f64; 3]; 3] {
    let length = quaternion.iter().map(|c| c * c).sum::<f64>().sqrt();
    if length == 0.0 {
        return [[1., 0., 0.], [0., 1., 0.], [0., 0., 1.]];
    }
    let [x, y, z, w] = quaternion.map(|c| c / length);
    [
        [1. - 2. * (y * y + z * z), 2. * (x * y - z * w), 2. * (x * z + y * w)],
        [2. * (x * y + z * w), 1. - 2. * (x * x + z * z), 2. * (y * z - x * w)],
        [2. * (x * z - y * w), 2. * (y * z + x * w), 1. - 2. * (x * x + y * y)],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: [f64; 3], b: [f64; 3]) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-7)
    }

    #[test]
    fn scale_goes_before_rotation_before_translation() {
        let h = 0.5_f32.sqrt();
        let quarter_turn_about_z = Affine::of(&Transform::Decomposed {
            translation: [10., 0., 0.],
            rotation: [0., 0., h, h],
            scale: [2., 3., 4.],
        });
        assert!(close(quarter_turn_about_z.apply([1., 1., 1.]), [7., 2., 4.]));
        assert!(!quarter_turn_about_z.mirrors());
    }

    #[test]
    fn a_matrix_is_column_major_and_parents_come_last() {
        let mut matrix = [[0.; 4]; 4];
        (matrix[0][0], matrix[1][1], matrix[2][2]) = (-1., 1., 1.);
        matrix[3] = [5., 6., 7., 1.];
        let mirror = Affine::of(&Transform::Matrix { matrix });
        assert_eq!(mirror.apply([1., 0., 0.]), [4., 6., 7.]);
        assert!(mirror.mirrors() && !mirror.then(&mirror).mirrors());
        assert_eq!(mirror.then(&mirror).apply([1., 0., 0.]), [1., 12., 14.]);
        let p = [0.1, -1e300, 3.0];
        assert_eq!(Affine::IDENTITY.then(&Affine::IDENTITY).apply(p), p);
    }
}
