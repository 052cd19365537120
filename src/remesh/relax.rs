//! Even triangles: vertices move to the middle of those around them, along the surface, and edges are exchanged until they are
//! Delaunay.
//!
//! Thin triangles between points of a surface need not lie along it, however small they are (Schwarz's lantern): area and
//! stiffness of such a sampling do not converge to those of the surface. Even ones do.

use super::edges::Edges;
use super::perturb::faces_around;
use crate::mesh::closest::ClosestPoint;
use crate::mesh::trimesh::{area_normal, cross, dot, norm, sub, unit};
use crate::mesh::{Topology, TriMesh};

/// How often vertices move and edges are exchanged, one after the other.
const SWEEPS: usize = 3;

/// No triangle turns further than this at once: the cosine of 60°.
const LEAST_COSINE: f64 = 0.5;

/// An exchange may leave an edge between triangles that meet at this angle, or at a sharper one that was there before: the
/// cosine of 45°.
const FLAT: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// Moves the vertices of `mesh` onto `surface` and makes its triangles even. Vertices on the boundary stay.
pub fn relaxed(mesh: &TriMesh, surface: &ClosestPoint<'_>) -> TriMesh {
    let mut fixed = vec![false; mesh.n()];
    Topology::of(mesh).boundary_vertices.iter().for_each(|&i| fixed[i as usize] = true);
    let mut vertices = mesh.vertices().to_vec();
    let mut faces = mesh.faces().to_vec();
    for _ in 0..SWEEPS {
        move_to_middles(&mut vertices, &faces, &fixed, surface);
        make_delaunay(&vertices, &mut faces);
    }
    TriMesh::new(vertices, faces)
        .expect("what moves stays finite, and every vertex keeps its triangles")
}

/// Moves every free vertex to the centroid of the triangles around it, within its tangent plane, and from there to the closest
/// point of the surface that faces the same side; half or a quarter of the way where a triangle would turn over.
fn move_to_middles(
    vertices: &mut [[f64; 3]],
    faces: &[[u32; 3]],
    fixed: &[bool],
    surface: &ClosestPoint<'_>,
) {
    let around = faces_around(vertices.len(), faces);
    let mut before = Vec::new();
    for (vertex, own) in around.iter().enumerate().filter(|&(vertex, _)| !fixed[vertex]) {
        let home = vertices[vertex];
        before.clear();
        before.extend(own.iter().map(|&face| area_normal(corners(vertices, faces[face]))));
        let Some(normal) = unit(before.iter().fold([0.0; 3], |sum, &n| plus(sum, 1.0, n))) else {
            continue;
        };
        let step = to_middle(vertices, faces, home, own, &before, normal);
        let mut try_at = |place: [f64; 3]| {
            vertices[vertex] = place;
            let sound = own.iter().zip(&before).all(|(&face, &old)| {
                let new = area_normal(corners(vertices, faces[face]));
                dot(old, new) >= LEAST_COSINE * norm(old) * norm(new)
            });
            if !sound {
                vertices[vertex] = home;
            }
            sound
        };
        let on_surface = |share| Some(surface.facing(plus(home, share, step), normal)?.position);
        let moved = [1.0, 0.5, 0.25, 0.0].into_iter().filter_map(on_surface).any(&mut try_at);
        if let (false, Some(foot)) = (moved, on_surface(0.0)) {
            // The surface is far or steep here: part of the way, and the rest when its neighbours have moved.
            [0.5, 0.25].into_iter().any(|share| try_at(plus(home, share, sub(foot, home))));
        }
    }
}

/// The way from a vertex to the centroid of the triangles around it, in its tangent plane.
fn to_middle(
    vertices: &[[f64; 3]],
    faces: &[[u32; 3]],
    home: [f64; 3],
    own: &[usize],
    normals: &[[f64; 3]],
    normal: [f64; 3],
) -> [f64; 3] {
    let (mut sum, mut areas) = ([0.0; 3], 0.0);
    for (&face, &n) in own.iter().zip(normals) {
        let [a, b, c] = corners(vertices, faces[face]);
        let (area, middle) = (norm(n), plus(plus(a, 1.0, b), 1.0, c));
        sum = plus(sum, area / 3.0, middle);
        areas += area;
    }
    if areas == 0.0 {
        return [0.0; 3];
    }
    let way = sub(sum.map(|s| s / areas), home);
    plus(way, -dot(way, normal), normal)
}

/// Exchanges edges until the angles opposite to every one add up to no more than π, but for those where the surface would
/// become more of a roof.
fn make_delaunay(vertices: &[[f64; 3]], faces: &mut [[u32; 3]]) {
    let mut edges = Edges::of(faces);
    let mut open = edges.all();
    // In space there is no proof that exchanges end, as there is in the plane.
    let mut left = 20 * open.len();
    while let Some(edge) = open.pop() {
        left -= 1;
        if left == 0 {
            return;
        }
        let Some(pair) = edges.pair(faces, edge) else { continue };
        let [[a, b, c], [_, _, d]] = pair.triangles();
        let [a, b, c, d] = [a, b, c, d].map(|corner| vertices[corner as usize]);
        if cotangent(a, b, c) + cotangent(a, b, d) < -1e-9
            && is_flat_enough(
                pair.triangles().map(|face| corners(vertices, face)),
                pair.exchanged().map(|face| corners(vertices, face)),
            )
        {
            edges.exchange(faces, &pair);
            open.extend(pair.around());
        }
    }
}

/// Whether no two of the `old` and `new` triangles face further apart than the old ones do, or than is flat.
fn is_flat_enough(old: [[[f64; 3]; 3]; 2], new: [[[f64; 3]; 3]; 2]) -> bool {
    let normals = || {
        let [n, m, k, l] = [old[0], old[1], new[0], new[1]].map(|face| unit(area_normal(face)));
        Some([n?, m?, k?, l?])
    };
    let Some([n, m, k, l]) = normals() else { return false };
    let least = dot(n, m).min(FLAT);
    [(k, l), (k, n), (k, m), (l, n), (l, m)].into_iter().all(|(x, y)| dot(x, y) >= least)
}

/// The cotangent of the angle at c between a and b.
fn cotangent(a: [f64; 3], b: [f64; 3], c: [f64; 3]) -> f64 {
    let (u, v) = (sub(a, c), sub(b, c));
    dot(u, v) / norm(cross(u, v)).max(f64::MIN_POSITIVE)
}

fn corners(vertices: &[[f64; 3]], face: [u32; 3]) -> [[f64; 3]; 3] {
    face.map(|corner| vertices[corner as usize])
}

/// x + a y.
fn plus(x: [f64; 3], a: f64, y: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| x[i] + a * y[i])
}

#[cfg(test)]
mod tests {
    use super::super::perturb::perturb;
    use super::super::thickness::thinnest;
    use super::*;
    use crate::mesh::sample::icosphere;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn uneven_triangles_become_even_on_the_same_surface() {
        let sphere = icosphere(4);
        let surface = ClosestPoint::on(&sphere);
        let uneven = perturb(&icosphere(3), &surface, 0.6, &mut ChaCha8Rng::seed_from_u64(1));
        let even = relaxed(&uneven, &surface);
        assert_eq!(Topology::of(&uneven), Topology::of(&even));
        assert!(thinnest(&even) > 0.3 && thinnest(&even) > 1.5 * thinnest(&uneven));
        assert!(even.vertices().iter().all(|&p| surface.to(p).distance < 1e-12));
        assert!((even.area().0 / sphere.area().0 - 1.0).abs() < 0.01);
    }

    #[test]
    fn after_exchanges_no_edge_of_a_plane_has_angles_that_add_up_to_more_than_two_right_ones() {
        // A grid whose every diagonal is the longer one.
        let (vertices, mut faces) = sheared_grid(9);
        make_delaunay(&vertices, &mut faces);
        let edges = Edges::of(&faces);
        let mut inner = 0;
        for edge in edges.all() {
            let Some(pair) = edges.pair(&faces, edge) else { continue };
            let [[a, b, c], [_, _, d]] = pair.triangles();
            let [a, b, c, d] = [a, b, c, d].map(|corner| vertices[corner as usize]);
            assert!(cotangent(a, b, c) + cotangent(a, b, d) > -1e-8);
            inner += 1;
        }
        assert!(inner > 100);
    }

    #[test]
    fn the_boundary_stays() {
        let (vertices, faces) = sheared_grid(7);
        let mesh = TriMesh::new(vertices, faces).unwrap();
        let even = relaxed(&mesh, &ClosestPoint::on(&mesh));
        let boundary = Topology::of(&mesh).boundary_vertices;
        assert_eq!(boundary, Topology::of(&even).boundary_vertices);
        for i in boundary {
            assert_eq!(mesh.vertices()[i as usize], even.vertices()[i as usize]);
        }
        assert!((even.area().0 - mesh.area().0).abs() < 1e-12);
    }

    /// n×n squares, sheared, each cut along its longer diagonal.
    fn sheared_grid(n: u32) -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
        let at = |i: u32, j: u32| i * (n + 1) + j;
        let vertices = (0..=n)
            .flat_map(|i| {
                (0..=n).map(move |j| [f64::from(i) + 0.4 * f64::from(j), f64::from(j), 0.0])
            })
            .collect();
        let cells = (0..n).flat_map(|i| (0..n).map(move |j| (i, j)));
        let cut = |(i, j)| {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        };
        (vertices, cells.flat_map(cut).collect())
    }
}
