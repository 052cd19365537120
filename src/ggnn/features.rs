//! What the network reads at every vertex.

use serde::{Deserialize, Serialize};

use crate::mesh::TriMesh;

/// How coordinates are prepared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Normalise {
    /// Centred at the surface's centroid and scaled to unit area, so that nothing depends on units.
    #[default]
    Area,
    /// As they are in the file.
    None,
}

/// Coordinates are the three input features d of a vertex.
pub const COORDINATES: usize = 3;

/// The coordinates of every vertex, row-major n×3, prepared as asked.
pub fn coordinates(mesh: &TriMesh, normalise: Normalise) -> Vec<f64> {
    let points = mesh.vertices().iter();
    match normalise {
        Normalise::None => points.flatten().copied().collect(),
        Normalise::Area => {
            let areas = mesh.vertex_areas();
            let area: f64 = areas.iter().sum();
            let mut centroid = [0.0; 3];
            for (point, weight) in mesh.vertices().iter().zip(&areas) {
                (0..3).for_each(|c| centroid[c] += weight / area * point[c]);
            }
            let scale = area.sqrt();
            points
                .flat_map(|point| {
                    std::array::from_fn::<f64, 3, _>(|c| (point[c] - centroid[c]) / scale)
                })
                .collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::sample::icosphere;

    #[test]
    fn normalised_coordinates_do_not_depend_on_place_or_units() {
        let mesh = icosphere(1);
        let moved = mesh.vertices().iter().map(|p| p.map(|c| 250.0 * c + 31.0)).collect();
        let moved = TriMesh::new(moved, mesh.faces().to_vec()).unwrap();
        let (a, b) = (coordinates(&mesh, Normalise::Area), coordinates(&moved, Normalise::Area));
        assert!(a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-12));
        assert_ne!(coordinates(&mesh, Normalise::None), coordinates(&moved, Normalise::None));
    }
}
