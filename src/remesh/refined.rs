//! A finer sampling of a variant: its triangles cut in four, the new vertices on the mesh that it is a variant of.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::perturb::perturb;
use crate::mesh::TriMesh;
use crate::mesh::closest::ClosestPoint;
use crate::mesh::subdivide::subdivide;

/// Subdivides `variant` so many `times`, and moves every vertex to the closest point of `surface` that leaves its triangles
/// sound; those on the boundary stay.
pub fn refined(variant: &TriMesh, surface: &ClosestPoint<'_>, times: usize) -> TriMesh {
    (0..times).fold(variant.clone(), |mesh, _| {
        // Vertices do not move along the surface: what is drawn has no effect.
        perturb(&subdivide(&mesh), surface, 0.0, &mut ChaCha8Rng::seed_from_u64(0))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::sample::icosphere;

    #[test]
    fn new_vertices_lie_on_the_mesh_and_the_old_ones_stay() {
        let (coarse, fine) = (icosphere(1), icosphere(4));
        let surface = ClosestPoint::on(&fine);
        let refined = refined(&coarse, &surface, 2);
        assert_eq!(refined.faces().len(), 16 * coarse.faces().len());
        for (before, after) in coarse.vertices().iter().zip(refined.vertices()) {
            let moved = before.iter().zip(after).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(moved < 1e-12, "{moved}");
        }
        for &vertex in refined.vertices() {
            let closest = surface.to(vertex).position;
            let off: f64 = (0..3).map(|i| (closest[i] - vertex[i]).powi(2)).sum();
            assert!(off.sqrt() < 1e-12);
        }
        // Nearer to the sphere than the coarse mesh: areas say it.
        let [coarse, refined, fine] = [&coarse, &refined, &fine].map(|mesh| mesh.area().0);
        assert!(refined > coarse + 0.9 * (fine - coarse), "{coarse} {refined} {fine}");
    }
}
