//! What is behind every pixel: the nearest triangle, and where on it. One raster serves all functions on a mesh.

use super::view::{View, cross};
use crate::mesh::TriMesh;

/// A square of pixels, row by row from the top.
pub struct Raster {
    size: usize,
    /// What is seen; `None` beside the mesh.
    pub samples: Vec<Option<Sample>>,
}

/// How far apart two depths in neighbouring pixels may be for one piece of surface, in pixels.
const STEP: f32 = 12.0;

/// A point of the surface.
#[derive(Debug, Clone, Copy)]
pub struct Sample {
    /// The vertices of its triangle, and what each of them is worth there.
    corners: [u32; 3],
    weights: [f32; 3],
    /// How bright it is.
    pub light: f32,
    depth: f32,
}

impl Sample {
    /// The linear function there that has these values at the vertices.
    fn value(&self, values: &[f64]) -> f64 {
        let corners = self.corners.iter().zip(self.weights);
        corners.map(|(&vertex, weight)| f64::from(weight) * values[vertex as usize]).sum()
    }
}

impl Raster {
    /// What is seen of a mesh.
    pub fn of(mesh: &TriMesh, view: View, size: usize) -> Self {
        let lights: Vec<f64> = normals(mesh).into_iter().map(|n| view.light(n)).collect();
        let places: Vec<[f64; 3]> = mesh.vertices().iter().map(|p| view.place(p, size)).collect();
        let mut samples = vec![None; size * size];
        for &face in mesh.faces() {
            let corners = face.map(|v| v as usize);
            let [a, b, c] = corners.map(|v| places[v]);
            let area = turn(a, b, c);
            if area == 0.0 {
                continue;
            }
            let between = |axis: usize| {
                let ends = [a[axis], b[axis], c[axis]];
                let first = ends.iter().copied().fold(f64::INFINITY, f64::min).floor().max(0.0);
                let last = ends.iter().copied().fold(0.0, f64::max).ceil().min(size as f64);
                first as usize..last as usize
            };
            for (row, column) in between(1).flat_map(|row| between(0).map(move |x| (row, x))) {
                let p = [column as f64 + 0.5, row as f64 + 0.5, 0.0];
                let weights = [turn(p, b, c), turn(a, p, c), turn(a, b, p)].map(|w| w / area);
                if weights.iter().any(|&w| w < 0.0) {
                    continue;
                }
                let mean =
                    |of: [f64; 3]| weights.iter().zip(of).map(|(w, x)| w * x).sum::<f64>() as f32;
                let depth = mean([a[2], b[2], c[2]]);
                let seen: &mut Option<Sample> = &mut samples[row * size + column];
                if seen.is_none_or(|seen| depth > seen.depth) {
                    let light = mean(corners.map(|v| lights[v]));
                    let weights = weights.map(|w| w as f32);
                    *seen = Some(Sample { corners: face, weights, light, depth });
                }
            }
        }
        Self { size, samples }
    }

    /// The function with these values at the vertices; NaN beside the mesh.
    pub fn values(&self, values: &[f64]) -> Vec<f64> {
        let value = |sample: &Option<Sample>| sample.map_or(f64::NAN, |seen| seen.value(values));
        self.samples.iter().map(value).collect()
    }

    /// Where a function changes its sign that has these values in the pixels, as a line of twice `half` pixels.
    pub fn nodal_line(&self, values: &[f64], half: usize) -> Vec<bool> {
        let size = self.size;
        let crosses = |at: usize, other: usize| {
            let changes = (values[at] > 0.0) != (values[other] > 0.0);
            let near = |a: Sample, b: Sample| (a.depth - b.depth).abs() < STEP;
            changes && self.samples[at].zip(self.samples[other]).is_some_and(|(a, b)| near(a, b))
        };
        let mut line = vec![false; size * size];
        for (row, column) in (0..size).flat_map(|row| (0..size).map(move |x| (row, x))) {
            let at = row * size + column;
            let right = column + 1 < size && crosses(at, at + 1);
            let below = row + 1 < size && crosses(at, at + size);
            if right || below {
                for i in row.saturating_sub(half - 1)..(row + half).min(size) {
                    let first = column.saturating_sub(half - 1);
                    line[i * size + first..i * size + (column + half).min(size)].fill(true);
                }
            }
        }
        line
    }
}

/// Twice the signed area of a triangle in the plane of the picture.
fn turn(a: [f64; 3], b: [f64; 3], c: [f64; 3]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
}

/// The normals at the vertices, weighted by area.
fn normals(mesh: &TriMesh) -> Vec<[f64; 3]> {
    let mut normals = vec![[0.0; 3]; mesh.n()];
    for face in mesh.faces() {
        let [a, b, c] = face.map(|v| mesh.vertices()[v as usize]);
        let minus = |p: [f64; 3]| [p[0] - a[0], p[1] - a[1], p[2] - a[2]];
        let normal = cross(minus(b), minus(c));
        for &v in face {
            normals[v as usize].iter_mut().zip(normal).for_each(|(sum, x)| *sum += x);
        }
    }
    normals
}
