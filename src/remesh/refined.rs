//! A finer sampling of a variant: its triangles cut in four, its vertices on the mesh that it is a variant of.

use super::relax::relaxed;
use crate::mesh::TriMesh;
use crate::mesh::closest::ClosestPoint;
use crate::mesh::subdivide::subdivide;

/// Subdivides `variant` so many `times`, every time with its vertices moved onto `surface` and its triangles made even; what is
/// on the boundary stays.
pub fn refined(variant: &TriMesh, surface: &ClosestPoint<'_>, times: usize) -> TriMesh {
    (0..times).fold(variant.clone(), |mesh, _| relaxed(&subdivide(&mesh), surface))
}

#[cfg(test)]
mod tests {
    use super::super::{Family, FamilyRecipe};
    use super::*;
    use crate::mesh::topology::component_labels;
    use crate::mesh::{load, sample::icosphere};
    use crate::operators::{Boundary, MassKind, Operators};
    use crate::spectrum::{Problem, factor::Analysis, fem};

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
    fn a_refined_variant_has_the_eigenvalues_of_its_mesh() {
        let mesh = load("tests/data/meshes/spot_829.obj".as_ref()).unwrap().mesh;
        let surface = ClosestPoint::on(&mesh);
        let recipe =
            FamilyRecipe { members: 2, vertices: 400.into(), seed: 3, ..FamilyRecipe::default() };
        let expected = lowest_eigenvalues(&subdivide(&subdivide(&mesh)));
        // A family of one would be the mesh itself.
        let variant = Family::of(&mesh, &recipe).unwrap().members.remove(1);
        let refined = refined(&variant, &surface, 3);
        let off = refined.vertices().iter().filter(|&&p| surface.to(p).distance > 1e-9).count();
        assert!(off < refined.n() / 500, "{off}");
        let error = |mesh: &TriMesh| {
            let found = lowest_eigenvalues(mesh);
            let each = found.iter().zip(&expected).map(|(a, b)| (a / b - 1.0).abs());
            each.fold(0.0, f64::max)
        };
        let (refined, cut) = (error(&refined), error(&subdivide(&subdivide(&variant))));
        assert!(refined < 0.012 && refined < 0.5 * cut, "{refined} {cut}");
    }

    /// λ₂ … λ₁₀ by finite elements, for unit area.
    fn lowest_eigenvalues(mesh: &TriMesh) -> Vec<f64> {
        let operators = Operators::assemble(mesh, MassKind::Lumped).unwrap();
        let problem = Problem::new(&operators, Boundary::Neumann, &component_labels(mesh)).unwrap();
        let analysis = Analysis::new(problem.pencil()).unwrap();
        let values = fem::lowest(&problem, &analysis, 10).unwrap().pairs.values;
        values[1..10].iter().map(|value| value * operators.total_mass()).collect()
    }
}
