use super::*;
use crate::mesh::load;
use crate::mesh::sample::icosphere;
use crate::operators::{MassKind, OperatorOptions, Operators};

const ROBUST: OperatorOptions = OperatorOptions {
    laplacian: crate::operators::Laplacian::Cotangent,
    mass: Some(MassKind::Consistent),
    robust: crate::operators::Robust::Intrinsic,
    boundary: crate::operators::Boundary::Neumann,
};

fn glued(mesh: &TriMesh) -> (Pattern, Gluing) {
    let pattern = Pattern::of_mesh(mesh);
    let gluing = Gluing::of(&pattern, mesh.faces()).0;
    (pattern, gluing)
}

/// A sphere drawn out to a spindle: the fewer its vertices and the longer it is, the wilder the flips.
fn spindle(levels: u32, length: f64) -> TriMesh {
    let mesh = icosphere(levels);
    let vertices =
        mesh.vertices().iter().map(|&[x, y, z]| [x, y + 0.1 * x, length * (z + 0.2 * y)]);
    TriMesh::new(vertices.collect(), mesh.faces().to_vec()).unwrap()
}

/// A unit square whose fifth vertex lies close to its lower side.
fn flat_cap() -> TriMesh {
    let vertices = vec![[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.], [0.5, 1e-4, 0.]];
    TriMesh::new(vertices, vec![[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]).unwrap()
}

/// What holds of every triangulation, whatever was done to it.
fn assert_whole(triangulation: &IntrinsicTriangulation) {
    for side in (0..triangulation.vertices.len()).flat_map(|f| [0, 1, 2].map(|i| Side::new(f, i))) {
        let Some(mate) = triangulation.gluing.mate(side) else { continue };
        let back = triangulation.gluing.mate(mate.side).unwrap();
        assert_eq!((back.side, back.run), (side, mate.run));
        assert_eq!(triangulation.length(mate.side), triangulation.length(side));
        let ends = |side: Side| [side, side.next()].map(|side| triangulation.start(side));
        let [start, end] = ends(mate.side);
        let against = if mate.run == super::super::gluing::Run::Against {
            [end, start]
        } else {
            [start, end]
        };
        assert_eq!(ends(side), against);
    }
}

#[test]
fn a_kite_cut_along_its_length_is_cut_across() {
    let vertices = vec![[-2., 0., 0.], [2., 0., 0.], [0., 1., 0.], [0., -1., 0.]];
    // The second triangle either way round.
    for second in [[1, 0, 3], [0, 1, 3], [3, 0, 1]] {
        let mesh = TriMesh::new(vertices.clone(), vec![[0, 1, 2], second]).unwrap();
        let operators = Operators::assemble(&mesh, ROBUST).unwrap();
        let across = TriMesh::new(vertices.clone(), vec![[0, 3, 2], [1, 2, 3]]).unwrap();
        let expected = Operators::assemble(&across, MassKind::Consistent).unwrap();
        assert_eq!(operators.quality.remedies, Some(Remedies { mollification: 0.0, flips: 1 }));
        for i in 0..4 {
            for j in 0..4 {
                for (found, expected) in
                    [(&operators.stiffness, &expected.stiffness), (&operators.mass, &expected.mass)]
                {
                    let [found, expected] = [found, expected].map(|m| m.get(i, j).unwrap_or(&0.0));
                    assert!((found - expected).abs() < 1e-14, "({i}, {j}): {found} {expected}");
                }
            }
        }
        // The network still sees the mesh's own edges.
        let own = Operators::assemble(&mesh, MassKind::Lumped).unwrap();
        assert_eq!(operators.adjacency, own.adjacency);
    }
}

#[test]
fn a_delaunay_mesh_stays_as_it_is() {
    for mesh in
        [icosphere(2), load("tests/data/meshes/gc_hourglass_ico.obj".as_ref()).unwrap().mesh]
    {
        let own = Operators::assemble(&mesh, MassKind::Consistent).unwrap();
        let robust = Operators::assemble(&mesh, ROBUST).unwrap();
        assert_eq!(own.quality.non_delaunay_edges, 0);
        assert_eq!(robust.quality.remedies, Some(Remedies { mollification: 0.0, flips: 0 }));
        for (a, b) in [(&own.stiffness, &robust.stiffness), (&own.mass, &robust.mass)] {
            assert_eq!((a.indptr(), a.indices()), (b.indptr(), b.indices()));
            let worst = a.data().iter().zip(b.data()).map(|(a, b)| (a - b).abs());
            assert!(worst.fold(0.0, f64::max) < 1e-12);
        }
    }
}

#[test]
fn flips_keep_the_surface_and_leave_no_negative_weight() {
    let moebius = load("tests/data/meshes/gc_moebius.obj".as_ref()).unwrap().mesh;
    let meshes = [spindle(0, 3.0), spindle(1, 8.0), spindle(2, 20.0), spindle(3, 5.0), moebius];
    for (number, mesh) in meshes.iter().enumerate() {
        let mut triangulation = IntrinsicTriangulation::of_mesh(mesh, glued(mesh).1);
        let area = |triangulation: &IntrinsicTriangulation| -> f64 {
            triangulation.triangles().unwrap().iter().map(|triangle| triangle.area).sum()
        };
        let before = area(&triangulation);
        let edges = triangulation.gluing.edges().count();
        let flips = triangulation.flip_to_delaunay();
        assert!(flips > 0, "mesh {number}");
        assert_whole(&triangulation);
        assert_eq!(triangulation.gluing.edges().count(), edges);
        assert!((area(&triangulation) / before - 1.0).abs() < 1e-12, "mesh {number}");
        let operators = Operators::assemble(mesh, ROBUST).unwrap();
        assert_eq!(operators.quality.non_delaunay_edges, 0, "mesh {number}");
        if operators.boundary.is_empty() {
            assert_eq!(operators.quality.negative_weights, 0, "mesh {number}");
        }
    }
}

#[test]
fn flips_may_make_an_edge_from_a_vertex_to_itself() {
    let mesh = spindle(1, 100.0);
    let mut triangulation = IntrinsicTriangulation::of_mesh(&mesh, glued(&mesh).1);
    triangulation.flip_to_delaunay();
    assert_whole(&triangulation);
    assert!(triangulation.vertices.iter().any(|[a, b, c]| a == b || b == c || c == a));
    // Constants stay in the kernel, and the mass adds up to the area.
    let operators = Operators::assemble(&mesh, ROBUST).unwrap();
    for row in operators.stiffness.outer_iterator() {
        let scale: f64 = row.data().iter().map(|entry| entry.abs()).sum();
        assert!(row.data().iter().sum::<f64>().abs() < 1e-13 * scale);
    }
    assert!((operators.total_mass() / operators.area.0 - 1.0).abs() < 1e-13);
}

#[test]
fn mollification_is_the_least_that_leaves_room_everywhere() {
    let mesh = flat_cap();
    let (pattern, gluing) = glued(&mesh);
    let mean = mean_edge_length(&mesh, &pattern);
    let mut triangulation = IntrinsicTriangulation::of_mesh(&mesh, gluing);
    let epsilon = triangulation.mollify(mean);
    assert!(epsilon > 0.0);
    let slack = |&[a, b, c]: &[f64; 3]| [a + b - c, b + c - a, c + a - b];
    let least = triangulation.lengths.iter().flat_map(slack).fold(f64::INFINITY, f64::min);
    assert!((least / (1e-5 * mean) - 1.0).abs() < 1e-9);
    assert_eq!(triangulation.mollify(0.9 * mean), 0.0);
}

#[test]
fn lengths_beyond_double_precision_are_an_error() {
    for scale in [1e-200, 1e200] {
        let vertices = flat_cap().vertices().iter().map(|p| p.map(|c| scale * c)).collect();
        let mesh = TriMesh::new(vertices, flat_cap().faces().to_vec()).unwrap();
        let error = Operators::assemble(&mesh, ROBUST).unwrap_err();
        assert!(matches!(error, OperatorError::Collapsed { .. }), "{error}");
    }
}

// ---- the tufted cover

const TUFTED: OperatorOptions =
    OperatorOptions { robust: crate::operators::Robust::Tufted, ..ROBUST };

fn data(name: &str) -> TriMesh {
    load(format!("tests/data/meshes/{name}").as_ref()).unwrap().mesh
}

#[test]
fn the_cover_is_closed_oriented_and_twice_the_surface() {
    let names = ["gc_fan3.obj", "gc_triple_vierbein.obj", "gc_moebius.obj", "lapy_square-mesh.off"];
    for mesh in names.map(data).into_iter().chain([spindle(1, 8.0), flat_cap()]) {
        let pattern = Pattern::of_mesh(&mesh);
        let mut cover = IntrinsicTriangulation::of_cover(&mesh, &pattern);
        let mut twice = 2.0 * mesh.area().0;
        for flipped in [false, true] {
            assert_whole(&cover);
            let sides = 3 * cover.vertices.len();
            assert_eq!((sides, 2 * cover.gluing.edges().count()), (6 * mesh.faces().len(), sides));
            let area: f64 = cover.triangles().unwrap().iter().map(|t| t.area).sum();
            assert!((area / twice - 1.0).abs() < 1e-10);
            if !flipped {
                cover.mollify(mean_edge_length(&mesh, &pattern));
                twice = cover.triangles().unwrap().iter().map(|t| t.area).sum();
                cover.flip_to_delaunay();
            }
        }
    }
}

#[test]
fn a_closed_manifold_mesh_has_two_copies_of_itself_for_a_cover() {
    for mesh in [spindle(2, 20.0), data("spot_829.obj"), data("lapy_torus.off")] {
        let [robust, tufted] =
            [ROBUST, TUFTED].map(|options| Operators::assemble(&mesh, options).unwrap());
        assert!((tufted.area.0 / robust.area.0 - 1.0).abs() < 1e-13);
        let scale = robust.stiffness.data().iter().fold(0.0, |m: f64, x| m.max(x.abs()));
        for (l, (i, j)) in robust.stiffness.iter() {
            let other = tufted.stiffness.get(i, j).copied().unwrap_or(0.0);
            assert!((l - other).abs() < 1e-9 * scale, "({i}, {j}): {l} {other}");
        }
    }
}

#[test]
fn no_weight_of_the_cover_is_negative_and_constants_stay_in_the_kernel() {
    let names = ["gc_fan3.obj", "gc_triple_vierbein.obj", "gc_moebius.obj", "gc_lego.ply"];
    for mesh in names.map(data).into_iter().chain([flat_cap()]) {
        for mass in [MassKind::Lumped, MassKind::Voronoi, MassKind::Consistent] {
            let options = OperatorOptions { mass: Some(mass), ..TUFTED };
            let operators = Operators::assemble(&mesh, options).unwrap();
            let quality = operators.quality;
            assert_eq!((quality.negative_weights, quality.non_delaunay_edges), (0, 0));
            assert!((operators.total_mass() / operators.area.0 - 1.0).abs() < 1e-12);
            for row in operators.stiffness.outer_iterator() {
                let scale: f64 = row.data().iter().map(|entry| entry.abs()).sum();
                assert!(row.data().iter().sum::<f64>().abs() < 1e-13 * scale);
            }
        }
    }
}
