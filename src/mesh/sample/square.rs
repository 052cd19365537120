//! The square [0, π]² of the paper's section VI-A: a tenth of the vertices on the boundary, all at random, Delaunay.
//!
//! The corners are always vertices, so that the domain is the square. What else lies on a side lies one to each of equal parts
//! of it, anywhere in that part. Triangles may be as thin as chance makes them: the paper wants them so.

use std::f64::consts::PI;

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use spade::{DelaunayTriangulation, Point2, Triangulation};

use crate::mesh::TriMesh;

/// A sampling with `n` ≥ 5 vertices; `None` where two of them fell on the same place.
pub(super) fn sample(n: usize, rng: &mut ChaCha8Rng) -> Option<TriMesh> {
    let on_boundary = (n / 10).max(4);
    let mut plane = DelaunayTriangulation::<Point2<f64>>::new();
    for side in 0..4 {
        // What four sides do not share evenly, the first ones have.
        let between = (on_boundary - 4 + 3 - side) / 4;
        let part = PI / between.max(1) as f64;
        let inner = (0..between).map(|i| part * (i as f64 + rng.random_range(0.0..1.0)));
        for along in std::iter::once(0.0).chain(inner) {
            let (x, y) = match side {
                0 => (along, 0.0),
                1 => (PI, along),
                2 => (PI - along, PI),
                _ => (0.0, PI - along),
            };
            plane.insert(Point2::new(x, y)).ok()?;
        }
    }
    for _ in on_boundary..n {
        let [x, y] = std::array::from_fn(|_| rng.random_range(0.0..PI));
        plane.insert(Point2::new(x, y)).ok()?;
    }
    let vertices = plane.vertices().map(|v| [v.position().x, v.position().y, 0.0]).collect();
    let faces = plane.inner_faces().map(|face| face.vertices().map(|v| v.index() as u32));
    TriMesh::new(vertices, faces.collect()).ok()
}

#[cfg(test)]
mod tests {
    use crate::mesh::sample::Shape;

    #[test]
    fn a_tenth_of_the_vertices_lies_on_the_boundary_and_the_corners_do() {
        for (n, expected) in [(20, 4), (144, 14), (162, 16), (236, 23), (932, 93)] {
            let mesh = Shape::Square.sample(n, 0, 1).unwrap();
            let on = |x: f64| x == 0.0 || x == std::f64::consts::PI;
            let count = |both: bool| {
                let is_there =
                    |p: &&[f64; 3]| if both { on(p[0]) && on(p[1]) } else { on(p[0]) || on(p[1]) };
                mesh.vertices().iter().filter(is_there).count()
            };
            assert_eq!((count(false), count(true)), (expected, 4), "{n}");
        }
    }
}
