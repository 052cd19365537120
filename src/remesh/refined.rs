//! A finer sampling of a variant: its triangles cut in four, its vertices on the mesh that it is a variant of.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::perturb::perturb;
use super::relax::relaxed;
use crate::mesh::TriMesh;
use crate::mesh::closest::ClosestPoint;
use crate::mesh::subdivide::subdivide;

/// Subdivides `variant` so many `times`, every time with its vertices moved onto `surface`; what is on the boundary stays.
///
/// Where the surface is much finer than the variant, the triangles are made even too. Else its own edges are creases, which
/// even triangles would cut: then vertices move to the closest points that leave their triangles sound.
pub fn refined(variant: &TriMesh, surface: &ClosestPoint<'_>, times: usize) -> TriMesh {
    let is_smooth = 4 * variant.n() < surface.mesh().n();
    (0..times).fold(variant.clone(), |mesh, _| {
        let mesh = subdivide(&mesh);
        if is_smooth {
            relaxed(&mesh, surface)
        } else {
            // Vertices do not move along the surface: what is drawn has no effect.
            perturb(&mesh, surface, 0.0, &mut ChaCha8Rng::seed_from_u64(0))
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::sample::icosphere;

    #[test]
    fn its_vertices_lie_on_the_mesh_and_its_area_is_nearer() {
        let (coarse, fine) = (icosphere(1), icosphere(4));
        let surface = ClosestPoint::on(&fine);
        let refined = refined(&coarse, &surface, 2);
        assert_eq!(refined.faces().len(), 16 * coarse.faces().len());
        assert!(refined.vertices().iter().all(|&p| surface.to(p).distance < 1e-12));
        // Nearer to the sphere than the coarse mesh: areas say it.
        let [coarse, refined, fine] = [&coarse, &refined, &fine].map(|mesh| mesh.area().0);
        assert!(refined > coarse + 0.9 * (fine - coarse), "{coarse} {refined} {fine}");
    }

    #[test]
    fn on_a_coarser_surface_the_vertices_of_the_variant_stay() {
        let (variant, coarse) = (icosphere(2), icosphere(1));
        // The vertices of the coarse one are the first of the finer one.
        let refined = refined(&coarse, &ClosestPoint::on(&coarse), 1);
        assert_eq!(refined.n(), variant.n());
        for (before, after) in coarse.vertices().iter().zip(refined.vertices()) {
            let moved = before.iter().zip(after).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(moved < 1e-12, "{moved}");
        }
    }
}
