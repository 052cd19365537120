//! One coarser sampling of a surface: quadric edge collapses (meshoptimizer) steered by a random perturbation.

use rand::Rng;

use crate::mesh::TriMesh;
use crate::mesh::trimesh::{InvalidMesh, norm, sub};

/// Simplifies `mesh` to about `vertices` vertices.
///
/// The collapses are chosen on a copy whose vertices are moved at random by up to `jitter` mean edge lengths, so
/// that every draw keeps another subset; the vertices that are kept return to their places on the surface.
///
/// # Errors
/// When nothing but degenerate triangles is left.
pub fn simplify(
    mesh: &TriMesh,
    vertices: usize,
    jitter: f64,
    rng: &mut impl Rng,
) -> Result<TriMesh, InvalidMesh> {
    let area = mesh.area().0.sqrt();
    let reach = jitter * mean_edge(mesh) / area;
    let origin = mesh.vertices()[0];
    // meshoptimizer works in single precision: unit area around a vertex keeps the digits that matter.
    let jittered: Vec<[f32; 3]> = mesh
        .vertices()
        .iter()
        .map(|&p| sub(p, origin).map(|c| (c / area + reach * rng.random_range(-1.0..1.0)) as f32))
        .collect();
    let indices: Vec<u32> = mesh.faces().iter().flatten().copied().collect();
    let faces = (mesh.faces().len() as f64 * vertices as f64 / mesh.n() as f64).round() as usize;
    let kept = meshopt::simplify_decoder(
        &indices,
        &jittered,
        3 * faces,
        f32::MAX,
        meshopt::SimplifyOptions::Regularize,
        None,
    );
    compact(mesh, &kept)
}

/// The triangles `indices` with the vertices that they use, in their old order.
fn compact(mesh: &TriMesh, indices: &[u32]) -> Result<TriMesh, InvalidMesh> {
    let mut used = vec![false; mesh.n()];
    indices.iter().for_each(|&i| used[i as usize] = true);
    let mut renumbered = vec![0; mesh.n()];
    let mut vertices = Vec::new();
    for (i, _) in used.iter().enumerate().filter(|&(_, &used)| used) {
        renumbered[i] = vertices.len() as u32;
        vertices.push(mesh.vertices()[i]);
    }
    let faces = indices
        .chunks_exact(3)
        .map(|t| [t[0], t[1], t[2]].map(|i| renumbered[i as usize]))
        .collect();
    TriMesh::new(vertices, faces)
}

fn mean_edge(mesh: &TriMesh) -> f64 {
    let total: f64 = mesh
        .faces()
        .iter()
        .map(|&face| {
            let [a, b, c] = mesh.corners(face);
            norm(sub(a, b)) + norm(sub(b, c)) + norm(sub(c, a))
        })
        .sum();
    total / (3.0 * mesh.faces().len() as f64)
}
