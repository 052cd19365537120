//! Whether a mesh lies where the trained shape lay: the network reads coordinates, so a turned mesh is another shape to
//! it.
//!
//! Compared are moments of the coordinates that the network reads, integrated over the surface: remeshing changes them by
//! the square of the edge length, turning, mirroring and bending by much more. Equal moments prove nothing.

use serde::{Deserialize, Serialize};

use super::features::{COORDINATES, Normalise, coordinates};
use crate::mesh::TriMesh;

/// Moments of prepared coordinates x over a surface, divided by its area.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Moments {
    /// m = ∫x.
    pub mean: [f64; COORDINATES],
    /// C = ∫(x − m)(x − m)ᵀ.
    pub covariance: [[f64; COORDINATES]; COORDINATES],
    /// s = ∫|x − m|²(x − m), which tells a shape from its mirror image where it is not symmetric.
    pub skewness: [f64; COORDINATES],
}

impl Moments {
    /// The moments of the coordinates of `mesh`, prepared as the network reads them.
    pub fn of(mesh: &TriMesh, normalise: Normalise) -> Self {
        let points = coordinates(mesh, normalise);
        let points = points.as_chunks::<COORDINATES>().0;
        let areas = mesh.vertex_areas();
        let total: f64 = areas.iter().sum();
        let weighted = || points.iter().zip(areas.iter().map(|area| area / total));
        let mut moments = Self {
            mean: [0.0; COORDINATES],
            covariance: [[0.0; COORDINATES]; COORDINATES],
            skewness: [0.0; COORDINATES],
        };
        for (x, weight) in weighted() {
            (0..COORDINATES).for_each(|i| moments.mean[i] += weight * x[i]);
        }
        for (x, weight) in weighted() {
            let d: [f64; COORDINATES] = std::array::from_fn(|i| x[i] - moments.mean[i]);
            let square: f64 = d.iter().map(|d| d * d).sum();
            for i in 0..COORDINATES {
                moments.skewness[i] += weight * square * d[i];
                (0..COORDINATES).for_each(|j| moments.covariance[i][j] += weight * d[i] * d[j]);
            }
        }
        moments
    }

    /// How far two surfaces are apart: the largest difference of a moment, relative to the size of this one.
    pub fn difference(&self, other: &Self) -> f64 {
        let size = (0..COORDINATES).map(|i| self.covariance[i][i]).sum::<f64>().sqrt();
        let apart = |a: &[f64], b: &[f64]| {
            a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
        };
        let covariance = apart(self.covariance.as_flattened(), other.covariance.as_flattened());
        let [mean, skewness] =
            [apart(&self.mean, &other.mean), apart(&self.skewness, &other.skewness)];
        [mean / size, covariance / size.powi(2), skewness / size.powi(3)]
            .into_iter()
            .fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spot() -> TriMesh {
        crate::mesh::load("tests/data/meshes/spot_829.obj".as_ref()).unwrap().mesh
    }

    fn moved(mesh: &TriMesh, by: impl Fn([f64; 3]) -> [f64; 3]) -> TriMesh {
        let vertices = mesh.vertices().iter().map(|&p| by(p)).collect();
        TriMesh::new(vertices, mesh.faces().to_vec()).unwrap()
    }

    #[test]
    fn samplings_are_alike_and_turned_or_mirrored_shapes_are_not() {
        let spot = spot();
        let of = |mesh: &TriMesh| Moments::of(mesh, Normalise::Area);
        let differs = |mesh: &TriMesh| of(&spot).difference(&of(mesh));
        let recipe = crate::remesh::FamilyRecipe { members: 2, ..Default::default() };
        for variant in crate::remesh::Family::of(&spot, &recipe).unwrap().members {
            assert!(differs(&variant) < 0.02, "{}", differs(&variant));
        }
        assert!(differs(&moved(&spot, |p| p.map(|c| 3.0 * c + 7.0))) < 1e-12);
        assert!(differs(&moved(&spot, |[x, y, z]| [y, -x, z])) > 0.1);
        // Half a turn keeps the covariance.
        assert!(differs(&moved(&spot, |[x, y, z]| [-x, y, -z])) > 0.1);
        assert!(differs(&moved(&spot, |[x, y, z]| [x, y, -z])) > 0.1);
        let placed = |mesh: &TriMesh| Moments::of(mesh, Normalise::None);
        let shifted = moved(&spot, |[x, y, z]| [x + 1.0, y, z]);
        assert!(placed(&spot).difference(&placed(&shifted)) > 0.5);
    }
}
