use super::*;

fn raw(
    same_vertex: SameVertex,
    positions: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
    places: [fn(u32) -> Place; 2],
) -> RawMesh {
    let mut raw = RawMesh::new(same_vertex);
    for (position, index) in positions.into_iter().zip(0..) {
        raw.position(position, places[0](index)).unwrap();
    }
    for (triangle, index) in triangles.into_iter().zip(0..) {
        raw.triangle(triangle, places[1](index)).unwrap();
    }
    raw
}

fn obj(positions: Vec<[f64; 3]>, triangles: Vec<[u32; 3]>) -> RawMesh {
    let places: [fn(u32) -> Place; 2] = [|i| Place::Line(i + 1), |i| Place::Line(i + 101)];
    raw(SameVertex::Index, positions, triangles, places)
}

fn gltf(positions: Vec<[f64; 3]>, triangles: Vec<[u32; 3]>) -> RawMesh {
    let places: [fn(u32) -> Place; 2] = [
        |element| Place::Element { accessor: 4, element },
        |triangle| Place::Triangle { mesh: 2, primitive: 1, triangle },
    ];
    raw(SameVertex::Position, positions, triangles, places)
}

fn corners() -> Vec<[f64; 3]> {
    vec![[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]]
}

fn tally(count: usize, lines: &[u32]) -> Tally {
    Tally { count, first: lines.iter().copied().map(Place::Line).collect() }
}

#[test]
fn a_clean_mesh_is_left_alone() {
    let raw = obj(corners(), vec![[0, 1, 2], [0, 2, 3]]);
    let repaired = repair(&raw).unwrap();
    assert!(repaired.repairs.is_empty());
    assert_eq!(repaired.repairs.to_string(), "");
    assert_eq!(repaired.vertex_map, [0, 1, 2, 3]);
    assert_eq!(repaired.mesh.vertices(), raw.positions);
    assert_eq!(repaired.mesh.faces(), raw.triangles);
}

#[test]
fn every_kind_of_bad_face_is_dropped_counted_and_placed() {
    let mut positions = corners();
    positions.insert(1, [7., 7., 7.]); // never used
    positions.push([2., 2., 0.]); // used by a face without area only
    let faces = vec![[0, 2, 3], [0, 2, 2], [3, 0, 2], [0, 3, 5], [2, 0, 3], [0, 3, 4]];
    let repaired = repair(&obj(positions, faces)).unwrap();
    assert_eq!(repaired.vertex_map, [0, -1, 1, 2, 3, -1]);
    assert_eq!(repaired.mesh.faces(), [[0, 1, 2], [0, 2, 3]]);
    let repairs = repaired.repairs;
    assert_eq!(repairs.collapsed_faces, tally(1, &[102]));
    assert_eq!(repairs.duplicate_faces, tally(2, &[103, 105]));
    assert_eq!(repairs.zero_area_faces, tally(1, &[104]));
    assert_eq!(repairs.unreferenced_vertices, tally(2, &[2, 6]));
    assert_eq!(repairs.welded_vertices, Tally::default());
    assert_eq!(
        repairs.to_string(),
        "1 collapsed face dropped (line 102)\n\
         1 face without area dropped (line 104)\n\
         2 duplicate faces dropped (line 103; line 105)\n\
         2 unreferenced vertices dropped (line 2; line 6)"
    );
}

#[test]
fn equal_positions_are_one_vertex_in_gltf_and_not_in_obj() {
    let mut positions = corners();
    positions.extend([[-0., 0., 0.], [1., 1., -0.]]);
    let faces = vec![[0, 1, 2], [4, 5, 3], [0, 4, 1]];
    let welded = repair(&gltf(positions.clone(), faces.clone())).unwrap();
    assert_eq!(welded.vertex_map, [0, 1, 2, 3, 0, 2]);
    assert_eq!(welded.mesh.faces(), [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(welded.repairs.welded_vertices.count, 2);
    assert_eq!(welded.repairs.welded_vertices.first[0], Place::Element { accessor: 4, element: 4 });
    assert_eq!(
        welded.repairs.collapsed_faces.first,
        [Place::Triangle { mesh: 2, primitive: 1, triangle: 2 }]
    );
    let apart = repair(&obj(positions, faces)).unwrap();
    assert_eq!(apart.mesh.n(), 6);
    assert_eq!(apart.repairs.zero_area_faces.count, 1);
}

#[test]
fn no_area_is_judged_by_shape_not_by_size() {
    for scale in [1e-200, 1e-9, 1.0, 1e150] {
        let at = |height: f64| [[0., 0., 0.], [scale, 0., 0.], [0.5 * scale, height * scale, 0.]];
        assert!(has_area(at(1.0)) && has_area(at(1e-11)), "at {scale}");
        assert!(!has_area(at(1e-12)) && !has_area(at(0.0)), "at {scale}");
    }
    assert!(!has_area([[3., 3., 3.]; 3]));
}

#[test]
fn only_the_first_places_are_kept() {
    let mut faces = vec![[0, 1, 2]; 9];
    faces.push([0, 2, 3]);
    let repairs = repair(&obj(corners(), faces)).unwrap().repairs;
    assert_eq!(repairs.duplicate_faces, tally(8, &[102, 103, 104, 105, 106]));
    assert!(repairs.to_string().ends_with("line 106; …)"));
}

#[test]
fn numbers_that_are_none_and_surfaces_that_are_none_are_errors() {
    let mut positions = corners();
    positions[2][1] = f64::NAN;
    let failure = repair(&obj(positions, vec![[0, 1, 3]])).unwrap_err();
    assert_eq!(failure.place, Some(Place::Line(3)));
    assert!(failure.fault.to_string().contains("(1, NaN, 0)"));

    let failure = repair(&obj(corners(), vec![[0, 0, 1]])).unwrap_err();
    let message = failure.fault.to_string();
    assert!(message.contains("4 vertices and 1 triangles"), "{message}");
}
