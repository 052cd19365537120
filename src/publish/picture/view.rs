//! Where one looks at a mesh from: straight down on a flat one, a little from above on any other, without perspective.

use crate::mesh::TriMesh;

/// A direction of projection, and the part of space that is in the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// To the right, up, and towards the eye: orthonormal.
    axes: [[f64; 3]; 3],
    /// What is in the middle of the picture, along the axes.
    centre: [f64; 3],
    /// Half of what is in the picture, from side to side.
    reach: f64,
    /// Whether slopes show: not on a flat mesh.
    lit: bool,
}

/// Which axis points up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Up {
    /// As in OBJ and glTF.
    Y,
    /// As in surfaces of revolution here.
    Z,
}

/// From where a mesh is seen whose y points up.
const EYE: [f64; 3] = [0.45, 0.35, 0.82];

/// A mesh that is this thin, relative to its width, is flat.
const FLAT: f64 = 1e-6;

/// Part of the picture that stays free.
const MARGIN: f64 = 0.04;

impl View {
    /// The view of a whole mesh.
    pub fn of(mesh: &TriMesh, up: Up) -> Self {
        let extent = |axis: [f64; 3]| {
            let along = mesh.vertices().iter().map(|&p| dot(p, axis));
            along.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)))
        };
        let width = |(least, most): (f64, f64)| most - least;
        let [x, y, z] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(extent).map(width);
        let lit = z > FLAT * x.max(y);
        let (eye, upwards) = match (lit, up) {
            (false, _) => ([0.0, 0.0, 1.0], [0.0, 1.0, 0.0]),
            (true, Up::Y) => (EYE, [0.0, 1.0, 0.0]),
            (true, Up::Z) => ([EYE[0], -EYE[2], EYE[1]], [0.0, 0.0, 1.0]),
        };
        let towards = unit(eye);
        let right = unit(cross(upwards, towards));
        let axes = [right, cross(towards, right), towards];
        let ends = axes.map(extent);
        let across = ends.map(width).into_iter().take(2).fold(0.0, f64::max);
        let reach = across / 2.0 / (1.0 - 2.0 * MARGIN);
        let centre = ends.map(|(least, most)| (least + most) / 2.0);
        Self { axes, centre, reach: if reach > 0.0 { reach } else { 1.0 }, lit }
    }

    /// To the right, up, and towards the eye.
    pub fn axes(&self) -> [[f64; 3]; 3] {
        self.axes
    }

    /// Whether slopes show: not on a flat mesh.
    pub fn lit(&self) -> bool {
        self.lit
    }

    /// The middle of the mesh and the radius of a ball around it, however it is turned.
    pub fn ball(&self, mesh: &TriMesh) -> ([f64; 3], f64) {
        let ends = [0, 1, 2].map(|i| {
            let along = mesh.vertices().iter().map(|p| p[i]);
            along.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)))
        });
        let centre = ends.map(|(least, most)| (least + most) / 2.0);
        let away = |p: &[f64; 3]| (0..3).map(|i| (p[i] - centre[i]).powi(2)).sum::<f64>().sqrt();
        let radius = mesh.vertices().iter().map(away).fold(0.0, f64::max);
        (centre, if radius > 0.0 { radius } else { 1.0 })
    }

    /// How near the eye a point is.
    pub fn depth(&self, p: &[f64; 3]) -> f64 {
        dot(*p, self.axes[2])
    }

    /// Where a point is in a picture of `size` pixels a side, from its upper left corner, and how near the eye; all in pixels.
    pub(super) fn place(&self, p: &[f64; 3], size: usize) -> [f64; 3] {
        let scale = size as f64 / (2.0 * self.reach);
        let [x, y, z] = [0, 1, 2].map(|i| (dot(*p, self.axes[i]) - self.centre[i]) * scale);
        let middle = size as f64 / 2.0;
        [middle + x, middle - y, z]
    }

    /// How bright a surface with this normal, of any length, is: 1 where it faces the eye.
    pub(super) fn light(&self, normal: [f64; 3]) -> f64 {
        if self.lit { 0.55 + 0.45 * dot(unit(normal), self.axes[2]).abs() } else { 1.0 }
    }
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

pub(super) fn cross([a, b, c]: [f64; 3], [x, y, z]: [f64; 3]) -> [f64; 3] {
    [b * z - c * y, c * x - a * z, a * y - b * x]
}

fn unit(a: [f64; 3]) -> [f64; 3] {
    let length = dot(a, a).sqrt();
    if length > 0.0 { a.map(|x| x / length) } else { [0.0, 0.0, 1.0] }
}
