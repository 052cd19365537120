//! The same triangles with other vertices: each moves at random along the surface.

use rand::Rng;

use super::thickness::thickness;
use crate::mesh::closest::ClosestPoint;
use crate::mesh::trimesh::{area_normal, cross, dot, norm, sub, unit};
use crate::mesh::{Topology, TriMesh};

/// A triangle may not turn further than this from where it was: the cosine of 45°.
const LEAST_COSINE: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// A triangle keeps at least this share of its thickness.
const KEPT_THICKNESS: f64 = 0.5;

/// Moves every vertex within its tangent plane by up to `reach` times the mean length of its edges, uniformly in a disc,
/// and from there to the closest point of `surface`.
///
/// A move that would turn or flatten a triangle is halved, and after that again; then the vertex stays. Vertices on the
/// boundary stay, so that the boundary does.
pub fn perturb(
    mesh: &TriMesh,
    surface: &ClosestPoint<'_>,
    reach: f64,
    rng: &mut impl Rng,
) -> TriMesh {
    let mut fixed = vec![false; mesh.n()];
    Topology::of(mesh).boundary_vertices.iter().for_each(|&i| fixed[i as usize] = true);
    let around = faces_around(mesh.n(), mesh.faces());
    let mut vertices = mesh.vertices().to_vec();
    for (vertex, faces) in around.iter().enumerate() {
        // Drawn for every vertex, so that whether one can move changes nothing for those after it.
        let polar =
            (rng.random_range(0.0_f64..1.0).sqrt(), rng.random_range(0.0..std::f64::consts::TAU));
        if fixed[vertex] {
            continue;
        }
        let home = vertices[vertex];
        let step = tangential(mesh, vertex, faces, polar);
        for share in [reach, 0.5 * reach, 0.25 * reach] {
            let target = std::array::from_fn(|i| home[i] + share * step[i]);
            vertices[vertex] = surface.to(target).position;
            if faces.iter().all(|&face| is_sound(mesh, &vertices, face)) {
                break;
            }
            vertices[vertex] = home;
        }
    }
    TriMesh::new(vertices, mesh.faces().to_vec())
        .expect("finite vertices with a valid mesh's triangles are a valid mesh")
}

/// The triangles around every vertex.
pub(super) fn faces_around(n: usize, faces: &[[u32; 3]]) -> Vec<Vec<usize>> {
    let mut around = vec![Vec::new(); n];
    for (face, corners) in faces.iter().enumerate() {
        corners.iter().for_each(|&corner| around[corner as usize].push(face));
    }
    around
}

/// The vector with these polar coordinates in the tangent plane of a vertex, in mean lengths of its edges.
fn tangential(
    mesh: &TriMesh,
    vertex: usize,
    faces: &[usize],
    (radius, angle): (f64, f64),
) -> [f64; 3] {
    let p = mesh.vertices()[vertex];
    let (mut normal, mut length) = ([0.0; 3], 0.0);
    for &face in faces {
        let corners = mesh.faces()[face];
        let n = area_normal(mesh.corners(corners));
        normal = std::array::from_fn(|i| normal[i] + n[i]);
        length += corners.iter().map(|&c| norm(sub(mesh.vertices()[c as usize], p))).sum::<f64>();
    }
    // Every triangle has two sides at the vertex.
    let scale = radius * length / (2 * faces.len()) as f64;
    let Some(normal) = unit(normal) else { return [0.0; 3] };
    // The axis that is furthest from the normal spans the plane with it.
    let axis =
        (0..3).fold(0, |best, i| if normal[i].abs() < normal[best].abs() { i } else { best });
    let along = std::array::from_fn(|i| f64::from(i == axis) - normal[axis] * normal[i]);
    let Some(along) = unit(along) else { return [0.0; 3] };
    let across = cross(normal, along);
    std::array::from_fn(|i| scale * (angle.cos() * along[i] + angle.sin() * across[i]))
}

/// Whether a triangle still faces where it faced in `mesh`, and is not much thinner.
fn is_sound(mesh: &TriMesh, vertices: &[[f64; 3]], face: usize) -> bool {
    let corners = mesh.faces()[face];
    let (before, after) = (mesh.corners(corners), corners.map(|c| vertices[c as usize]));
    let (old, new) = (area_normal(before), area_normal(after));
    dot(old, new) >= LEAST_COSINE * norm(old) * norm(new)
        && thickness(after) >= KEPT_THICKNESS * thickness(before)
}

#[cfg(test)]
mod tests {
    use super::super::thickness::thinnest;
    use super::*;
    use crate::mesh::sample::icosphere;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    fn rng() -> ChaCha8Rng {
        ChaCha8Rng::seed_from_u64(3)
    }

    #[test]
    fn vertices_move_and_stay_on_the_surface() {
        let mesh = icosphere(2);
        let surface = ClosestPoint::on(&mesh);
        let moved = perturb(&mesh, &surface, 0.3, &mut rng());
        assert_eq!(moved.faces(), mesh.faces());
        assert!(moved.vertices().iter().all(|&p| surface.to(p).distance < 1e-14));
        let stayed = moved.vertices().iter().zip(mesh.vertices()).filter(|(a, b)| a == b).count();
        assert!(stayed < mesh.n() / 20, "{stayed}");
        assert!(thinnest(&moved) >= KEPT_THICKNESS * thinnest(&mesh));
        let ratio = moved.area().0 / mesh.area().0;
        assert!((0.97..1.001).contains(&ratio), "{ratio}");
    }

    #[test]
    fn no_triangle_turns_over_however_far_vertices_are_sent() {
        let mesh = icosphere(2);
        let moved = perturb(&mesh, &ClosestPoint::on(&mesh), 3.0, &mut rng());
        let out = |corners: [[f64; 3]; 3]| dot(area_normal(corners), corners[0]) > 0.0;
        assert!(moved.faces().iter().all(|&face| out(moved.corners(face))));
    }

    #[test]
    fn the_boundary_stays() {
        let sphere = icosphere(2);
        let faces: Vec<[u32; 3]> = sphere.faces()[..120].to_vec();
        let used: Vec<u32> = (0..sphere.n() as u32)
            .filter(|vertex| faces.iter().flatten().any(|corner| corner == vertex))
            .collect();
        let place = |old: u32| used.iter().position(|&v| v == old).unwrap() as u32;
        let vertices = used.iter().map(|&v| sphere.vertices()[v as usize]).collect();
        let mesh = TriMesh::new(vertices, faces.iter().map(|f| f.map(place)).collect()).unwrap();
        let moved = perturb(&mesh, &ClosestPoint::on(&mesh), 0.3, &mut rng());
        let boundary = Topology::of(&mesh).boundary_vertices;
        assert!(!boundary.is_empty() && moved != mesh);
        for i in boundary {
            assert_eq!(moved.vertices()[i as usize], mesh.vertices()[i as usize]);
        }
    }
}
