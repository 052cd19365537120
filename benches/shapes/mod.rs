//! Shapes that are sampled anew for every member of a family.

use chladni::mesh::TriMesh;
use chladni::mesh::sample::icosphere;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use spade::{DelaunayTriangulation, Point2, Triangulation};

/// A geodesic sphere, turned at random, its vertices shifted along the surface.
pub fn ball(levels: u32, seed: u64, member: u64) -> TriMesh {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(member);
    let mesh = icosphere(levels);
    let edge = (4.0 * std::f64::consts::PI / mesh.n() as f64).sqrt();
    let mut axis = [0.0; 3].map(|_: f64| rng.random_range(-1.0..1.0));
    let length = axis.iter().map(|x| x * x).sum::<f64>().sqrt();
    axis.iter_mut().for_each(|x| *x /= length);
    let (sin, cos) = rng.random_range(0.0..std::f64::consts::TAU).sin_cos();
    let vertices = mesh.vertices().iter().map(|&[x, y, z]| {
        let [a, b, c] = axis;
        let along = (1.0 - cos) * (a * x + b * y + c * z);
        let turned = [
            cos * x + sin * (b * z - c * y) + along * a,
            cos * y + sin * (c * x - a * z) + along * b,
            cos * z + sin * (a * y - b * x) + along * c,
        ];
        let moved = turned.map(|v| v + 0.25 * edge * rng.random_range(-1.0..1.0));
        let length = moved.iter().map(|x| x * x).sum::<f64>().sqrt();
        moved.map(|v| v / length)
    });
    TriMesh::new(vertices.collect(), mesh.faces().to_vec()).expect("a sphere is a valid mesh")
}

/// The side of the square.
pub const SIDE: f64 = std::f64::consts::PI;

/// The paper's square [0, π]²: a tenth of the vertices on the boundary, the others at random, Delaunay. `along` says how far along
/// its side vertex number i of so many lies; number 0 is the corner.
pub fn square(
    n: usize,
    seed: u64,
    member: u64,
    along: impl Fn(usize, usize, &mut ChaCha8Rng) -> f64,
) -> TriMesh {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(member);
    let per_side = n / 10 / 4;
    let mut triangulation = DelaunayTriangulation::<Point2<f64>>::new();
    for i in 0..per_side {
        for side in 0..4 {
            let t = along(i, per_side, &mut rng);
            let (x, y) = [(t, 0.0), (SIDE, t), (SIDE - t, SIDE), (0.0, SIDE - t)][side];
            triangulation.insert(Point2::new(x, y)).expect("a finite point");
        }
    }
    while triangulation.num_vertices() < n {
        let point = Point2::new(rng.random_range(0.0..SIDE), rng.random_range(0.0..SIDE));
        triangulation.insert(point).expect("a finite point");
    }
    let vertices = triangulation.vertices().map(|v| [v.position().x, v.position().y, 0.0]);
    let faces = triangulation.inner_faces().map(|f| f.vertices().map(|v| v.index() as u32));
    TriMesh::new(vertices.collect(), faces.collect()).expect("a triangulation is a valid mesh")
}
