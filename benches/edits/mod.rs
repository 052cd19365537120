//! What people do to a mesh between two saves: a patch that is moved, or the same shape with other triangles.

use std::fmt::Write;

use chladni::mesh::TriMesh;
use chladni::remesh::{Family, FamilyRecipe, Operation};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// One change of a mesh.
pub struct Edit {
    /// In words.
    pub what: String,
    /// The mesh after it.
    pub mesh: TriMesh,
}

/// Change number `number` of a session with this seed: two of three move a patch of a radius of 5 to 25 % of √area by a tenth to
/// a half of that radius along its normal, the third makes other triangles of the same shape.
pub fn edit(mesh: &TriMesh, seed: u64, number: u64) -> Edit {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(number);
    match number % 3 {
        2 => remeshed(mesh, &mut rng),
        _ => moved_patch(mesh, &mut rng),
    }
}

fn moved_patch(mesh: &TriMesh, rng: &mut ChaCha8Rng) -> Edit {
    let size = mesh.area().0.sqrt();
    let (centre, radius) = (rng.random_range(0..mesh.n()), size * rng.random_range(0.05..0.25));
    let side = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
    let height = side * radius * rng.random_range(0.1..0.5);
    let normal = normal(mesh, centre as u32);
    let middle = mesh.vertices()[centre];
    let moved = |&point: &[f64; 3]| -> [f64; 3] {
        let distance: f64 = (0..3).map(|c| (point[c] - middle[c]).powi(2)).sum::<f64>().sqrt();
        let weight = (1.0 - (distance / radius).powi(2)).max(0.0).powi(2);
        std::array::from_fn(|c| point[c] + height * weight * normal[c])
    };
    let vertices = mesh.vertices().iter().map(moved).collect();
    let what = format!("patch {:.0} % by {:+.1} %", 100.0 * radius / size, 100.0 * height / size);
    Edit { what, mesh: valid(vertices, mesh.faces().to_vec()) }
}

fn remeshed(mesh: &TriMesh, rng: &mut ChaCha8Rng) -> Edit {
    let (what, operations) = match rng.random_range(0..3) {
        0 => ("other vertices", vec![Operation::Perturb]),
        1 => ("other vertices and edges", vec![Operation::Perturb, Operation::Flip]),
        _ => ("simplified anew", vec![Operation::Subdivide, Operation::Simplify]),
    };
    let recipe = FamilyRecipe {
        members: 2,
        operations,
        vertices: mesh.n().into(),
        seed: rng.random(),
        ..FamilyRecipe::default()
    };
    match Family::of(mesh, &recipe) {
        Ok(mut family) => Edit { what: what.into(), mesh: family.members.remove(0) },
        // Patches that were moved into one another have none.
        Err(_) => moved_patch(mesh, rng),
    }
}

/// The unit normal at a vertex.
fn normal(mesh: &TriMesh, vertex: u32) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for face in mesh.faces().iter().filter(|face| face.contains(&vertex)) {
        let [a, b, c] = face.map(|i| mesh.vertices()[i as usize]);
        let [u, v] = [b, c].map(|p| [p[0] - a[0], p[1] - a[1], p[2] - a[2]]);
        let cross =
            [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        (0..3).for_each(|i| sum[i] += cross[i]);
    }
    let length = sum.iter().map(|x| x * x).sum::<f64>().sqrt();
    sum.map(|x| x / length)
}

fn valid(vertices: Vec<[f64; 3]>, faces: Vec<[u32; 3]>) -> TriMesh {
    TriMesh::new(vertices, faces).expect("moving vertices keeps a mesh valid")
}

/// A mesh as the text of an OBJ file.
pub fn obj(mesh: &TriMesh) -> String {
    let mut text = String::new();
    for [x, y, z] in mesh.vertices() {
        let _ = writeln!(text, "v {x:?} {y:?} {z:?}");
    }
    for [a, b, c] in mesh.faces() {
        let _ = writeln!(text, "f {} {} {}", a + 1, b + 1, c + 1);
    }
    text
}
