//! How the triangles of a mesh are shaped: the lengths of its edges and the angles of its faces.

use serde::Serialize;

use super::trimesh::{TriMesh, cross, dot, norm, sub};

/// Edge lengths and angles of a mesh.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Shape {
    /// The shortest edge, the median and the longest, in input units.
    pub shortest_edge: f64,
    pub median_edge: f64,
    pub longest_edge: f64,
    /// The smallest and the largest angle, in degrees.
    pub smallest_angle: f64,
    pub largest_angle: f64,
    /// How many angles lie in [0°, 10°), [10°, 20°) … [170°, 180°].
    pub angles: [usize; 18],
}

impl Shape {
    /// Measures a mesh.
    pub fn of(mesh: &TriMesh) -> Self {
        let mut shape = Self {
            shortest_edge: 0.0,
            median_edge: 0.0,
            longest_edge: 0.0,
            smallest_angle: 180.0,
            largest_angle: 0.0,
            angles: [0; 18],
        };
        let mut edges = Vec::with_capacity(3 * mesh.faces().len());
        for &face in mesh.faces() {
            let corners = mesh.corners(face);
            for i in 0..3 {
                let (j, k) = ((i + 1) % 3, (i + 2) % 3);
                edges.push([face[i].min(face[j]), face[i].max(face[j])]);
                shape.add(angle(corners[i], corners[j], corners[k]));
            }
        }
        edges.sort_unstable();
        edges.dedup();
        let at = |vertex: u32| mesh.vertices()[vertex as usize];
        let mut lengths: Vec<f64> = edges.iter().map(|&[a, b]| norm(sub(at(b), at(a)))).collect();
        lengths.sort_unstable_by(f64::total_cmp);
        let length = |index: usize| lengths.get(index).copied().unwrap_or_default();
        shape.shortest_edge = length(0);
        shape.median_edge = length(lengths.len() / 2);
        shape.longest_edge = length(lengths.len().saturating_sub(1));
        shape
    }

    fn add(&mut self, degrees: f64) {
        self.smallest_angle = self.smallest_angle.min(degrees);
        self.largest_angle = self.largest_angle.max(degrees);
        let bin = (degrees / 10.0) as usize;
        self.angles[bin.min(17)] += 1;
    }
}

/// The angle at `p` in the triangle (p, q, r), in degrees.
fn angle(p: [f64; 3], q: [f64; 3], r: [f64; 3]) -> f64 {
    let (u, v) = (sub(q, p), sub(r, p));
    norm(cross(u, v)).atan2(dot(u, v)).to_degrees()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_cut_in_two() {
        let vertices = vec![[0., 0., 0.], [2., 0., 0.], [2., 2., 0.], [0., 2., 0.]];
        let shape = Shape::of(&TriMesh::new(vertices, vec![[0, 1, 2], [0, 2, 3]]).unwrap());
        assert_eq!((shape.shortest_edge, shape.median_edge), (2.0, 2.0));
        assert_eq!(shape.longest_edge, 8_f64.sqrt());
        assert!((shape.smallest_angle - 45.0).abs() < 1e-13 && shape.largest_angle == 90.0);
        assert_eq!((shape.angles[4], shape.angles[9], shape.angles.iter().sum()), (4, 2, 6));
    }
}
