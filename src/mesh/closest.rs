//! The point of a surface that is closest to a point of space: where it lies, and in which triangle.
//!
//! Triangles are sorted into a tree of boxes once, in O(F log F); a query then visits the boxes that may hold
//! something closer than what was found, O(log F) of them for points near the surface.
//!
//! ```
//! use chladni::mesh::{closest::ClosestPoint, sample::icosphere};
//!
//! let sphere = icosphere(2);
//! let found = ClosestPoint::on(&sphere).to([2.0, 0.0, 0.0]);
//! assert!((found.distance - 1.0).abs() < 0.02);
//! // A function given at the vertices, here the first coordinate, has a value there.
//! let x: Vec<f64> = sphere.vertices().iter().map(|p| p[0]).collect();
//! assert!((found.interpolate(&sphere, &x) - found.position[0]).abs() < 1e-15);
//! ```

use super::trimesh::{TriMesh, area_normal, dot, sub};

/// A point of a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// The triangle that it lies in.
    pub face: usize,
    /// Its barycentric coordinates there: none negative, their sum 1.
    pub weights: [f64; 3],
    /// Where it lies, in input units.
    pub position: [f64; 3],
    /// How far it is from the point that was asked for, in input units.
    pub distance: f64,
}

impl SurfacePoint {
    /// The value here of a function that is linear in every triangle of `mesh`, from its `values` at the vertices.
    pub fn interpolate(&self, mesh: &TriMesh, values: &[f64]) -> f64 {
        let corners = mesh.faces()[self.face].iter().zip(self.weights);
        corners.map(|(&corner, weight)| weight * values[corner as usize]).sum()
    }
}

/// A surface that can be asked for its closest points.
#[derive(Debug)]
pub struct ClosestPoint<'m> {
    mesh: &'m TriMesh,
    /// All triangles, those of one box next to one another.
    faces: Vec<u32>,
    /// A box, the left half of it right after it.
    nodes: Vec<Node>,
}

/// A box around some triangles.
#[derive(Debug)]
struct Node {
    low: [f64; 3],
    high: [f64; 3],
    content: Content,
}

#[derive(Debug)]
enum Content {
    /// A stretch of the triangles.
    Faces(std::ops::Range<usize>),
    /// Two boxes; the left one is the next node.
    Halves { right: usize },
}

/// Boxes of so few triangles are not divided.
const FACES_OF_A_LEAF: usize = 4;

impl<'m> ClosestPoint<'m> {
    /// Sorts the triangles of `mesh`.
    pub fn on(mesh: &'m TriMesh) -> Self {
        let middles: Vec<[f64; 3]> = mesh
            .faces()
            .iter()
            .map(|&face| {
                let [a, b, c] = mesh.corners(face);
                std::array::from_fn(|i| (a[i] + b[i] + c[i]) / 3.0)
            })
            .collect();
        let faces = (0..mesh.faces().len() as u32).collect();
        let mut tree = Self { mesh, faces, nodes: Vec::new() };
        tree.divide(0..mesh.faces().len(), &middles);
        tree
    }

    /// Makes the box of a stretch of triangles, and below it those of its halves: left and right of the median
    /// along the box's longest side.
    fn divide(&mut self, stretch: std::ops::Range<usize>, middles: &[[f64; 3]]) {
        let (low, high) = self.bounds(&self.faces[stretch.clone()]);
        let node = self.nodes.len();
        self.nodes.push(Node { low, high, content: Content::Faces(stretch.clone()) });
        if stretch.len() <= FACES_OF_A_LEAF {
            return;
        }
        let side = sub(high, low);
        let axis =
            (0..3).fold(0, |longest, axis| if side[axis] > side[longest] { axis } else { longest });
        let place = |face: &u32| middles[*face as usize][axis];
        let half = stretch.len() / 2;
        self.faces[stretch.clone()]
            .select_nth_unstable_by(half, |a, b| place(a).total_cmp(&place(b)).then(a.cmp(b)));
        self.divide(stretch.start..stretch.start + half, middles);
        self.nodes[node].content = Content::Halves { right: self.nodes.len() };
        self.divide(stretch.start + half..stretch.end, middles);
    }

    fn bounds(&self, faces: &[u32]) -> ([f64; 3], [f64; 3]) {
        let corners = faces.iter().flat_map(|&f| self.mesh.corners(self.mesh.faces()[f as usize]));
        corners.fold(([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]), |(low, high), p| {
            (std::array::from_fn(|i| low[i].min(p[i])), std::array::from_fn(|i| high[i].max(p[i])))
        })
    }

    /// The surface.
    pub fn mesh(&self) -> &TriMesh {
        self.mesh
    }

    /// The point of the surface that is closest to `point`; of several, one in the triangle of the lowest number.
    pub fn to(&self, point: [f64; 3]) -> SurfacePoint {
        self.closest(point, |_| true).unwrap_or_else(|| self.in_face(0, point))
    }

    /// The closest point in a triangle whose normal is less than a right angle from `normal`, so that what lies on one side
    /// of a thin part stays there; `None` where there is no such triangle.
    pub fn facing(&self, point: [f64; 3], normal: [f64; 3]) -> Option<SurfacePoint> {
        self.closest(point, |face| {
            dot(area_normal(self.mesh.corners(self.mesh.faces()[face])), normal) > 0.0
        })
    }

    /// The closest point in one of the triangles that are `wanted`.
    fn closest(&self, point: [f64; 3], wanted: impl Fn(usize) -> bool) -> Option<SurfacePoint> {
        let mut best: Option<SurfacePoint> = None;
        let rank = |best: Option<SurfacePoint>| {
            best.map_or((f64::INFINITY, usize::MAX), |best| (best.distance, best.face))
        };
        let mut open = vec![0];
        while let Some(node) = open.pop() {
            let Node { low, high, content } = &self.nodes[node];
            if distance_to_box(point, *low, *high) > rank(best).0 {
                continue;
            }
            match content {
                Content::Faces(stretch) => {
                    for face in self.faces[stretch.clone()].iter().map(|&face| face as usize) {
                        let found = self.in_face(face, point);
                        if rank(Some(found)) < rank(best) && wanted(face) {
                            best = Some(found);
                        }
                    }
                }
                &Content::Halves { right } => {
                    let left = node + 1;
                    let distance = |node: usize| {
                        distance_to_box(point, self.nodes[node].low, self.nodes[node].high)
                    };
                    // The nearer one is looked into first.
                    open.extend(if distance(left) <= distance(right) {
                        [right, left]
                    } else {
                        [left, right]
                    });
                }
            }
        }
        best
    }

    fn in_face(&self, face: usize, point: [f64; 3]) -> SurfacePoint {
        let corners = self.mesh.corners(self.mesh.faces()[face]);
        let weights = closest_in_triangle(corners, point);
        let position = weighted(corners, weights);
        let away = sub(position, point);
        SurfacePoint { face, weights, position, distance: dot(away, away).sqrt() }
    }
}

/// How far a point is from an axis-parallel box; 0 inside.
fn distance_to_box(point: [f64; 3], low: [f64; 3], high: [f64; 3]) -> f64 {
    let outside: [f64; 3] =
        std::array::from_fn(|i| (low[i] - point[i]).max(point[i] - high[i]).max(0.0));
    dot(outside, outside).sqrt()
}

/// The barycentric coordinates of the point of a triangle that is closest to `point`: its foot on the plane where that
/// lies inside, and else the closest point of the three sides. A collapsed triangle has sides only.
fn closest_in_triangle(corners: [[f64; 3]; 3], point: [f64; 3]) -> [f64; 3] {
    let foot = foot_on_plane(corners, point);
    if foot.iter().all(|&weight| weight >= 0.0) {
        return foot;
    }
    let sides = [0, 1, 2].map(|i| {
        let (start, end) = (corners[i], corners[(i + 1) % 3]);
        let side = sub(end, start);
        let along = dot(sub(point, start), side) / dot(side, side);
        // A side without length has no direction: its start will do.
        let along = if along.is_nan() { 0.0 } else { along.clamp(0.0, 1.0) };
        let mut weights = [0.0; 3];
        weights[i] = 1.0 - along;
        weights[(i + 1) % 3] = along;
        weights
    });
    let distance = |weights: &[f64; 3]| {
        let away = sub(weighted(corners, *weights), point);
        dot(away, away)
    };
    let closer = |a, b| if distance(&b) < distance(&a) { b } else { a };
    let [first, second, third] = sides;
    closer(closer(first, second), third)
}

/// The barycentric coordinates of a point's foot on the plane of a triangle, by Cramer's rule for the least squares
/// |a + β(b − a) + γ(c − a) − p|²; not numbers where the triangle has no plane.
fn foot_on_plane([a, b, c]: [[f64; 3]; 3], point: [f64; 3]) -> [f64; 3] {
    let (u, v, w) = (sub(b, a), sub(c, a), sub(point, a));
    let (uu, uv, vv, uw, vw) = (dot(u, u), dot(u, v), dot(v, v), dot(u, w), dot(v, w));
    let determinant = uu * vv - uv * uv;
    let (beta, gamma) = ((vv * uw - uv * vw) / determinant, (uu * vw - uv * uw) / determinant);
    [1.0 - beta - gamma, beta, gamma]
}

fn weighted([a, b, c]: [[f64; 3]; 3], [alpha, beta, gamma]: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| alpha * a[i] + beta * b[i] + gamma * c[i])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::sample::icosphere;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Every triangle in turn, and finely sampled: no formula in common with the search.
    fn sampled_distance(mesh: &TriMesh, point: [f64; 3], cuts: usize) -> f64 {
        let samples = mesh.faces().iter().flat_map(|&face| {
            let corners = mesh.corners(face);
            (0..=cuts).flat_map(move |i| {
                (0..=cuts - i).map(move |j| {
                    let weights = [i, j, cuts - i - j].map(|w| w as f64 / cuts as f64);
                    weighted(corners, weights)
                })
            })
        });
        samples.map(|p| dot(sub(p, point), sub(p, point)).sqrt()).fold(f64::INFINITY, f64::min)
    }

    fn some_points(count: usize) -> Vec<[f64; 3]> {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        (0..count).map(|_| std::array::from_fn(|_| rng.random_range(-1.5..1.5))).collect()
    }

    #[test]
    fn the_tree_finds_what_trying_every_triangle_finds() {
        let mesh = icosphere(3);
        let tree = ClosestPoint::on(&mesh);
        for point in some_points(300).into_iter().chain(mesh.vertices().iter().copied()) {
            let tried = (0..mesh.faces().len())
                .map(|face| tree.in_face(face, point))
                .reduce(|a, b| if b.distance < a.distance { b } else { a });
            assert_eq!(Some(tree.to(point)), tried);
        }
    }

    #[test]
    fn no_point_of_a_fine_sampling_is_closer_by_more_than_its_spacing() {
        let mesh = icosphere(0);
        let tree = ClosestPoint::on(&mesh);
        for point in some_points(100) {
            let (found, sampled) = (tree.to(point), sampled_distance(&mesh, point, 60));
            assert!(found.distance <= sampled + 1e-15);
            // Half a spacing away from the foot, the distance is longer by at most 1.1/60.
            assert!(sampled <= found.distance + 0.02, "{sampled} {}", found.distance);
            assert!(found.weights.iter().all(|&w| w >= 0.0));
            assert!((found.weights.iter().sum::<f64>() - 1.0).abs() < 1e-14);
        }
    }

    #[test]
    fn points_of_the_surface_are_their_own_closest_points() {
        let mesh = icosphere(2);
        let tree = ClosestPoint::on(&mesh);
        for &face in mesh.faces() {
            let inside = weighted(mesh.corners(face), [0.2, 0.5, 0.3]);
            let found = tree.to(inside);
            assert!(found.distance < 1e-15);
            let x: Vec<f64> = mesh.vertices().iter().map(|p| 3.0 * p[0] - p[2]).collect();
            let expected = 3.0 * inside[0] - inside[2];
            assert!((found.interpolate(&mesh, &x) - expected).abs() < 1e-14);
        }
    }

    #[test]
    fn collapsed_triangles_have_closest_points_too() {
        let line = vec![[0., 0., 0.], [1., 0., 0.], [2., 0., 0.], [2., 0., 0.]];
        let mesh = TriMesh::new(line, vec![[0, 1, 2], [2, 3, 1]]).unwrap();
        let found = ClosestPoint::on(&mesh).to([0.5, 1.0, 0.0]);
        assert_eq!((found.position, found.distance), ([0.5, 0.0, 0.0], 1.0));
        assert_eq!(ClosestPoint::on(&mesh).to([3.0, 0.0, 0.0]).position, [2.0, 0.0, 0.0]);
    }

    #[test]
    fn what_faces_away_is_not_found() {
        // A thin lens: the closest point of a point inside is on either side.
        let flat = icosphere(3);
        let squeezed = flat.vertices().iter().map(|&[x, y, z]| [x, y, 0.01 * z]).collect();
        let lens = TriMesh::new(squeezed, flat.faces().to_vec()).unwrap();
        let surface = ClosestPoint::on(&lens);
        let inside = [0.1, 0.05, 0.002];
        let up = surface.facing(inside, [0.0, 0.0, 1.0]).unwrap();
        let down = surface.facing(inside, [0.0, 0.0, -1.0]).unwrap();
        assert!(up.position[2] > 0.009 && down.position[2] < -0.009, "{up:?} {down:?}");
        assert_eq!(up, surface.to(inside));
        let half = TriMesh::new(lens.vertices()[..3].to_vec(), vec![[0, 1, 2]]).unwrap();
        let normal = area_normal(half.corners([0, 1, 2])).map(|c| -c);
        assert_eq!(ClosestPoint::on(&half).facing(inside, normal), None);
    }
}
