//! What a user sees of reading a mesh: the same numbers give the same mesh whatever file they come in, what is
//! mended is said, and what cannot be read says why.

use std::path::{Path, PathBuf};

use chladni::mesh::{Fault, Format, Ingested, MeshError, Place, load, load_bytes};

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/meshes").join(name)
}

fn read(name: &str) -> Ingested {
    load(&data(name)).unwrap_or_else(|error| panic!("{error}"))
}

fn obj(text: &str) -> Result<Ingested, MeshError> {
    load_bytes(Path::new("test.obj"), text.as_bytes())
}

/// The cube [0, 1]³ as quads, outwards.
const CUBE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n\
    f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";

/// A GLB of one primitive: the positions as f32, the triangles as u16.
fn glb(positions: &[[f32; 3]], triangles: &[[u16; 3]]) -> Vec<u8> {
    let mut bin: Vec<u8> = positions.iter().flatten().flat_map(|c| c.to_le_bytes()).collect();
    let split = bin.len();
    bin.extend(triangles.iter().flatten().flat_map(|i| i.to_le_bytes()));
    let length = bin.len();
    bin.resize(length.next_multiple_of(4), 0);
    let mut json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
        "meshes":[{{"name":"any","primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":{},"type":"VEC3"}},
                     {{"bufferView":1,"componentType":5123,"count":{},"type":"SCALAR"}}],
        "bufferViews":[{{"buffer":0,"byteLength":{split}}},
                       {{"buffer":0,"byteOffset":{split},"byteLength":{}}}],
        "buffers":[{{"byteLength":{length}}}]}}"#,
        positions.len(),
        3 * triangles.len(),
        length - split,
    )
    .into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut out = b"glTF\x02\0\0\0".to_vec();
    let total = 12 + 8 + json.len() + 8 + bin.len();
    out.extend((total as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", json), (b"BIN\0", bin)] {
        out.extend((chunk.len() as u32).to_le_bytes());
        out.extend(kind);
        out.extend(chunk);
    }
    out
}

// ---- the same mesh, whatever its clothes

#[test]
fn a_seamed_mesh_is_one_closed_surface() {
    // 829 vertices, as tests/data/meshes/README.md says, although each is named with several normals.
    let spot = read("spot_829.obj");
    let topology = &spot.topology;
    assert_eq!((spot.mesh.n(), spot.mesh.faces().len()), (829, 1654));
    assert_eq!((topology.euler_characteristic, topology.components), (2, 1));
    assert!(topology.is_closed() && topology.is_manifold() && topology.is_oriented());
    assert!(spot.repairs.is_empty(), "{}", spot.repairs);
    assert_eq!(spot.vertex_map, (0..829).collect::<Vec<_>>());
    assert_eq!(spot.format, Format::Obj);
}

#[test]
fn obj_and_glb_of_the_same_numbers_share_their_hash() {
    let cube = obj(CUBE).unwrap();
    let positions: Vec<_> = cube.mesh.vertices().iter().map(|p| p.map(|c| c as f32)).collect();
    let triangles: Vec<_> = cube.mesh.faces().iter().map(|f| f.map(|i| i as u16)).collect();
    // A wrong extension does not matter: the content says what it is.
    let same = load_bytes(Path::new("cube.obj"), &glb(&positions, &triangles)).unwrap();
    assert_eq!(same.format, Format::Glb);
    assert_eq!(same.mesh, cube.mesh);
    assert_eq!(same.mesh.hash(), cube.mesh.hash());
    // Cut along every edge, as exporters do: welding finds the eight corners again, in another order.
    let corners: Vec<_> = triangles.iter().flatten().map(|&i| positions[i as usize]).collect();
    let cut: Vec<_> = (0..12).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let welded = load_bytes(Path::new("cube.glb"), &glb(&corners, &cut)).unwrap();
    assert_eq!(welded.topology, cube.topology);
    assert_eq!(welded.repairs.welded_vertices.count, 28);
    assert_eq!(&welded.vertex_map[..6], [0, 1, 2, 0, 2, 3]);
}

#[test]
fn comments_materials_groups_normals_and_colours_do_not_change_the_hash() {
    let plain = obj(CUBE).unwrap().mesh.hash();
    let dressed = CUBE
        .replace("f 5", "# a comment\nusemtl red\ng side\ns 1\nf 5")
        .replace("f 2 3 7 6", "o other\nvt 0 0\nvt 1 0\nvn 0 0 1\nf 2/1/1 3/2 7//1 6/1/1 # c")
        .replace("v 1 1 1\n", "v 1 1 1 0.5 0.5 0.5\r\n");
    let dressed = format!("\u{feff}mtllib none.mtl\no cube\n{dressed}l 1 2\n");
    assert_ne!(dressed, CUBE);
    assert_eq!(obj(&dressed).unwrap().mesh.hash(), plain);
    assert_ne!(obj(&CUBE.replace("v 1 1 1", "v 1 1 1.5")).unwrap().mesh.hash(), plain);
}

#[test]
fn groups_that_use_vertices_out_of_order_do_not_change_the_hash() {
    let grouped = CUBE.replacen("f 4 3 2 1", "g top\nf 4 3 2 1\ng rest", 1);
    assert_eq!(obj(&grouped).unwrap().mesh.hash(), obj(CUBE).unwrap().mesh.hash());
}

#[test]
fn polygons_are_split_and_said() {
    let cube = obj(CUBE).unwrap();
    let topology = &cube.topology;
    assert_eq!((topology.vertices, topology.faces), (8, 12));
    assert_eq!(topology.euler_characteristic, 2);
    assert!(topology.is_oriented());
    assert_eq!(cube.mesh.area().0, 6.0);
    assert_eq!(cube.repairs.polygons.count, 6);
    assert_eq!(cube.repairs.polygons.first[0], Place::Line(9));
}

#[test]
fn negative_indices_count_backwards() {
    let cube = read("trimesh_negative_indices.obj");
    assert_eq!((cube.mesh.n(), cube.mesh.faces().len()), (8, 12));
    assert_eq!(cube.topology.euler_characteristic, 2);
    assert_eq!(cube.mesh.area().0, 24.0);
}

// ---- repairs

#[test]
fn what_is_dropped_is_counted_placed_and_mapped() {
    let text = "v 9 9 9\nv 0 0 0\nv 1 0 0\nv 0.5 0 0\nv 0 1 0\n\
        f 2 3 5\nf 5 3 2\nf 2 4 3\nf 2 2 5\n";
    let triangle = obj(text).unwrap();
    assert_eq!(triangle.vertex_map, [-1, 0, 1, -1, 2]);
    assert_eq!(triangle.mesh.faces(), [[0, 1, 2]]);
    let repairs = &triangle.repairs;
    assert_eq!(repairs.duplicate_faces.first, [Place::Line(7)]);
    assert_eq!(repairs.zero_area_faces.first, [Place::Line(8)]);
    assert_eq!(repairs.collapsed_faces.first, [Place::Line(9)]);
    assert_eq!(repairs.unreferenced_vertices.first, [Place::Line(1), Place::Line(4)]);
    let json = serde_json::to_value(repairs).unwrap();
    assert_eq!(json["zero_area_faces"]["count"], 1);
    assert_eq!(json["zero_area_faces"]["first"][0]["line"], 8);
}

#[test]
fn a_face_of_two_corners_is_left_out() {
    let triangle = read("trimesh_notenoughindices.obj");
    assert_eq!(triangle.mesh.faces(), [[0, 1, 2]]);
    assert_eq!(triangle.repairs.left_out.first, [Place::Line(9)]);
}

// ---- glTF: expected values computed from the files with Python's json and struct alone: accessors unpacked
// one element at a time, node matrices multiplied in double precision, positions compared for equality.

fn assert_box(mesh: &Ingested, low: [f64; 3], high: [f64; 3]) {
    let bound = |pick: fn(f64, f64) -> f64| {
        let vertices = mesh.mesh.vertices();
        let folded = vertices.iter().copied();
        folded.reduce(|a, b| std::array::from_fn(|i| pick(a[i], b[i])))
    };
    for (got, expected) in [(bound(f64::min), low), (bound(f64::max), high)] {
        let got = got.unwrap();
        let close = got.iter().zip(expected).all(|(g, e)| (g - e).abs() < 2e-6);
        assert!(close, "{got:?} is not {expected:?}");
    }
}

fn signed_volume(mesh: &Ingested) -> f64 {
    let faces = mesh.mesh.faces().iter();
    let corners = faces.map(|&face| mesh.mesh.corners(face));
    let det = |[a, b, c]: [[f64; 3]; 3]| {
        (0..3)
            .map(|i| {
                let (j, k) = ((i + 1) % 3, (i + 2) % 3);
                a[i] * (b[j] * c[k] - b[k] * c[j])
            })
            .sum::<f64>()
    };
    corners.map(det).sum::<f64>() / 6.0
}

#[test]
fn nested_node_transforms_are_applied() {
    let blocks = read("trimesh_nested.glb");
    assert_box(
        &blocks,
        [-1.1670133173465729, -2.3365952462825526, -0.26938149333000183],
        [0.269381474666595, 0.9999999365371792, 0.26938149333000183],
    );
    assert!((blocks.mesh.area().0 - 8.677204211648291).abs() < 1e-6);
    assert!((signed_volume(&blocks) - 0.8987790543021933).abs() < 1e-6);
    let topology = &blocks.topology;
    assert_eq!((topology.vertices, topology.faces, topology.components), (24, 36, 3));
    assert_eq!(topology.euler_characteristic, 6);
    assert!(topology.is_closed() && topology.is_oriented());
    assert_eq!(blocks.repairs.welded_vertices.count, 48);
    assert_eq!(blocks.vertex_map.len(), 72);
}

#[test]
fn interleaved_buffers_are_read_by_their_stride() {
    let cube = read("trimesh_BoxInterleaved.glb");
    assert_box(&cube, [-0.5; 3], [0.5; 3]);
    assert_eq!((cube.mesh.n(), cube.mesh.faces().len()), (8, 12));
    assert_eq!(cube.topology.euler_characteristic, 2);
    assert_eq!(cube.mesh.area().0, 6.0);
    assert_eq!(signed_volume(&cube), 1.0);
}

#[test]
fn missing_indices_count_up_and_storeys_share_their_floors() {
    let building = read("trimesh_no_indices_3storybuilding.glb");
    assert_box(
        &building,
        [-23.207141876220703, 0.0, 0.0],
        [32.87300109863281, 9.0, 63.36140823364258],
    );
    assert_eq!(building.vertex_map.len(), 216);
    // Each storey is two closed prisms, wall to wall, with a floor and a ceiling of its own: of 72 faces the
    // 8 between storeys come twice. With one left of each, 12 edges have three faces, 8 four and 2 six.
    assert_eq!(building.repairs.duplicate_faces.count, 8);
    assert_eq!((building.mesh.n(), building.mesh.faces().len()), (24, 64));
    assert!(building.topology.is_closed() && !building.topology.is_manifold());
    assert_eq!(building.topology.non_manifold_edges, 22);
}

// ---- OFF, PLY, VTK, STL: expected values computed from the files with Python's split and struct alone

fn assert_counts(mesh: &Ingested, format: Format, counts: [usize; 3], euler: i64, area: f64) {
    let topology = &mesh.topology;
    assert_eq!(mesh.format, format);
    assert_eq!([topology.vertices, topology.edges, topology.faces], counts);
    assert_eq!(topology.euler_characteristic, euler);
    assert!((mesh.mesh.area().0 - area).abs() < 1e-12 * area, "{}", mesh.mesh.area().0);
}

#[test]
fn an_icosahedron_from_off() {
    let mesh = read("lapy_icosahedron.off");
    assert_counts(&mesh, Format::Off, [12, 30, 20], 2, 38.29816559284123);
    assert_eq!(mesh.mesh.vertices()[1], [1.788854, 0.0, 0.894427]);
    assert!(mesh.topology.is_closed() && mesh.repairs.is_empty());
}

#[test]
fn a_brick_of_single_precision_from_binary_ply() {
    let mesh = read("gc_lego.ply");
    assert_counts(&mesh, Format::Ply, [1649, 4720, 3072], 1, 0.36987300077455876);
    assert_box(&mesh, [-0.25, 0.0, -0.5], [0.5, 0.0, 0.25]);
    assert_eq!(mesh.topology.boundary_vertices.len(), 224);
}

#[test]
fn a_cube_from_vtk_keeps_its_decimal_numbers() {
    let mesh = read("lapy_cubeTria.vtk");
    assert_counts(&mesh, Format::Vtk, [2402, 7200, 4800], 2, 6.0);
    // The file says `float` and 0.05.
    assert_eq!(mesh.mesh.vertices()[1], [0.05, 0.05, 0.0]);
    assert!(mesh.topology.is_closed() && mesh.repairs.is_empty());
}

/// One polyhedron, written by VTK 9.7 in every encoding that it has; coordinates and cells as they were given to it.
#[test]
fn what_vtk_writes_is_one_mesh_in_every_encoding() {
    let ascii = read("vtk_ascii.vtp");
    assert_counts(&ascii, Format::Vtp, [8, 18, 12], 2, 6.010283510872622);
    assert_eq!(ascii.mesh.vertices()[7], [0.1, 1.1, 1.0]);
    assert_eq!(ascii.mesh.faces()[..2], [[3, 2, 1], [3, 1, 0]]);
    assert_eq!(ascii.mesh.faces()[8..10], [[2, 3, 6], [3, 7, 6]]);
    assert!(ascii.topology.is_closed() && ascii.topology.is_manifold());
    // Two vertices and a line; three quadrilaterals.
    assert_eq!((ascii.repairs.left_out.count, ascii.repairs.polygons.count), (3, 3));
    for encoding in ["inline", "inline_zlib", "base64", "base64_zlib", "raw", "raw_zlib"] {
        let other = read(&format!("vtk_{encoding}.vtp"));
        assert_eq!((&other.mesh, other.format), (&ascii.mesh, Format::Vtp), "{encoding}");
    }
    let refused = load(&data("vtk_lz4.vtp")).unwrap_err().to_string();
    assert!(refused.contains("line 2: data compressed by vtkLZ4DataCompressor"), "{refused}");
}

#[test]
fn a_hundred_loose_triangles_from_binary_stl() {
    let mesh = read("trimesh_soup.stl");
    assert_counts(&mesh, Format::Stl, [300, 300, 100], 100, 14.578912785299483);
    assert_eq!(mesh.topology.components, 100);
}

// ---- surfaces that are not simply closed: expected values from an independent count over the OBJ lines

#[test]
fn the_moebius_strip_has_one_edge_and_one_side() {
    let strip = read("gc_moebius.obj");
    let topology = &strip.topology;
    assert_eq!((topology.vertices, topology.edges, topology.faces), (280, 728, 448));
    assert_eq!((topology.euler_characteristic, topology.boundary_loops), (0, 1));
    assert_eq!(topology.boundary_vertices.len(), 112);
    assert!(topology.is_manifold());
    assert_eq!(topology.misoriented_edges, 4);
    assert_eq!(strip.repairs.polygons.count, 224);
}

#[test]
fn the_hourglass_is_two_spheres_that_share_a_vertex() {
    // Two icosahedra, 12 + 12 − 1 vertices: closed and oriented, one component as the Laplacian sees it
    // (they share a row), χ = 2 + 2 − 1, pinched in the shared vertex.
    let hourglass = read("gc_hourglass_ico.obj");
    let topology = &hourglass.topology;
    assert_eq!((topology.vertices, topology.edges, topology.faces), (23, 60, 40));
    assert_eq!((topology.euler_characteristic, topology.components), (3, 1));
    assert_eq!((topology.non_manifold_vertices, topology.non_manifold_edges), (1, 0));
    assert!(topology.is_closed() && topology.is_oriented());
}

// ---- errors

fn message(path: &str, bytes: &[u8]) -> String {
    load_bytes(Path::new(path), bytes).unwrap_err().to_string()
}

#[test]
fn errors_name_the_file_the_line_and_the_remedy() {
    let nan = message("a.obj", b"v 0 0 0\n# c\nv 1 nan 0\nv 0 1 0\nf 1 2 3\n");
    assert_eq!(
        nan,
        "a.obj, line 3: the position (1, NaN, 0) is not finite; repair the vertex in the program that wrote it"
    );
    // Too large for a double is infinite.
    assert!(message("a.obj", b"v 1e999 0 0\n").contains("line 1: the position (inf"));
    let range = message("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n\nf 1 2 3\nf 1 2 4\n");
    assert!(range.starts_with("a.obj, line 6: vertex index 4 is out of range"));
    let word = message("a.obj", b"v 0 0 0\nv 1 0,5 0\n");
    assert!(word.starts_with("a.obj, line 2: cannot read `v 1 0,5 0`"), "{word}");
}

#[test]
fn files_that_are_no_mesh_say_so() {
    assert!(message("a.obj", b"").contains("the file is empty"));
    assert!(message("a.obj", b"# nothing\n").contains("no surface"));
    assert!(message("a.obj", b"v 0 0 0\nv 1 0 0\nl 1 2\n").contains("no surface"));
    assert!(message("a.gltf", br#"{"asset":{"version":"2.0"}}"#).contains("no surface"));
    assert!(message("a.gltf", b"{}").contains("asset"));
    assert!(message("a.gltf", b"{\"asset\":").contains("not a valid glTF"));
    assert!(message("a.ply", b"ply\nformat").contains("not a valid PLY file"));
    assert!(message("a.off", b"OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n").contains("no surface"));
    assert!(message("a.stl", b"solid a\nendsolid a\n").contains("no surface"));
    let garbage: Vec<u8> = (0..4096_u32).map(|i| (i * i % 251) as u8).collect();
    for name in ["a.obj", "a.ply", "a.glb", "a.gltf", "a"] {
        assert!(message(name, &garbage).contains("no mesh format that is read"));
    }
    let only_name = load(&data("trimesh_face_in_group_name.obj")).unwrap_err();
    let no_surface = Fault::NoSurface { vertices: 1, triangles: 0 };
    assert_eq!(only_name.fault.to_string(), no_surface.to_string());
    let missing = load(&data("none.obj")).unwrap_err();
    assert!(matches!(missing.fault, Fault::Unreadable(_)));
    assert!(missing.to_string().contains("none.obj: cannot be read"));
}

#[test]
fn a_truncated_file_is_an_error_wherever_it_is_cut() {
    for name in ["trimesh_nested.glb", "trimesh_BoxInterleaved.glb"] {
        let whole = std::fs::read(data(name)).unwrap();
        for cut in (0..whole.len()).step_by(97) {
            let message = message(name, &whole[..cut]);
            let reason = if cut == 0 { "empty" } else { "cut short" };
            assert!(message.contains(reason), "cut at {cut}: {message}");
        }
    }
}

#[test]
fn damaged_bytes_never_panic() {
    for name in ["trimesh_nested.glb", "trimesh_BoxInterleaved.glb", "trimesh_negative_indices.obj"]
    {
        let whole = std::fs::read(data(name)).unwrap();
        for at in 0..whole.len() {
            for value in [0, b'9', 0xff] {
                let mut damaged = whole.clone();
                damaged[at] = value;
                if let Err(error) = load_bytes(Path::new(name), &damaged) {
                    assert!(error.to_string().len() > name.len() + 20, "{error}");
                }
            }
        }
    }
}
