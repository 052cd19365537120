use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use super::*;

/// A quarter of the unit square's border, and the square: positions as f32, little-endian.
const CORNERS: [[f32; 3]; 4] = [[0., 0., 0.], [1., 0., 0.], [1., 1., 0.], [0., 1., 0.]];

/// A document of one buffer: the bytes, then views, accessors, meshes, nodes and scenes as JSON.
fn document(bytes: &[u8], rest: &str) -> Vec<u8> {
    let uri = STANDARD.encode(bytes);
    format!(
        r#"{{"asset":{{"version":"2.0"}},
        "buffers":[{{"byteLength":{},"uri":"data:application/octet-stream;base64,{uri}"}}],{rest}}}"#,
        bytes.len()
    )
    .into_bytes()
}

fn corner_bytes() -> Vec<u8> {
    let flat = CORNERS.iter().flatten();
    flat.flat_map(|c| c.to_le_bytes()).collect()
}

const VIEW: &str = r#""bufferViews":[{"buffer":0,"byteLength":48}]"#;
const ACCESSOR: &str =
    r#""accessors":[{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3"}]"#;
const ONE_NODE: &str = r#""nodes":[{"mesh":0}],"scenes":[{"nodes":[0]}]"#;

fn mode(mode: u32) -> String {
    format!(
        r#"{VIEW},{ACCESSOR},{ONE_NODE},"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"mode":{mode}}}]}}]"#
    )
}

fn parse(bytes: &[u8], rest: &str) -> Result<RawMesh, Failure> {
    read(&document(bytes, rest), Path::new("test.gltf"))
}

fn message(bytes: &[u8], rest: &str) -> String {
    parse(bytes, rest).unwrap_err().fault.to_string()
}

#[test]
fn strips_and_fans_wind_as_the_format_says() {
    // Without bounds of the positions, and without a default scene, which are both common.
    let strip = parse(&corner_bytes(), &mode(5)).unwrap();
    assert_eq!(strip.triangles, [[0, 1, 2], [1, 3, 2]]);
    assert_eq!(strip.positions[2], [1.0, 1.0, 0.0]);
    let fan = parse(&corner_bytes(), &mode(6)).unwrap();
    assert_eq!(fan.triangles, [[1, 2, 0], [2, 3, 0]]);
}

#[test]
fn what_is_no_surface_is_left_out_and_said() {
    let place = Place::Primitive { mesh: 0, primitive: 0 };
    for points_or_lines in 0..4 {
        let raw = parse(&corner_bytes(), &mode(points_or_lines)).unwrap();
        assert_eq!((raw.triangles.len(), raw.left_out), (0, vec![place]));
    }
    // Four vertices are a triangle and a bit.
    let raw = parse(&corner_bytes(), &mode(4)).unwrap();
    assert_eq!((raw.triangles, raw.left_out), (vec![[0, 1, 2]], vec![place]));
}

#[test]
fn a_mirroring_node_keeps_the_outside_out() {
    let rest = mode(5).replace(r#"{"mesh":0}"#, r#"{"mesh":0,"scale":[-1,1,1]}"#);
    let raw = parse(&corner_bytes(), &rest).unwrap();
    assert_eq!(raw.positions[1], [-1.0, 0.0, 0.0]);
    assert_eq!(raw.triangles, [[0, 2, 1], [1, 2, 3]]);
}

#[test]
fn instances_are_copies_and_shared_accessors_are_read_once() {
    let primitive = r#"{"attributes":{"POSITION":0},"mode":5}"#;
    let rest = format!(
        r#"{VIEW},{ACCESSOR},"meshes":[{{"primitives":[{primitive},{primitive}]}}],
        "nodes":[{{"mesh":0}},{{"mesh":0,"translation":[0,0,2],"children":[0]}}],"scenes":[{{"nodes":[1]}}]"#
    );
    let raw = parse(&corner_bytes(), &rest).unwrap();
    // Node 1 and its child, two primitives each, four positions each.
    assert_eq!((raw.positions.len(), raw.triangles.len()), (8, 8));
    assert_eq!(raw.positions[4], [0.0, 0.0, 2.0]);
    assert_eq!(raw.position_place(6), Some(Place::Element { accessor: 0, element: 2 }));
    assert_eq!(raw.triangle_place(3), Some(Place::Triangle { mesh: 0, primitive: 1, triangle: 1 }));
}

#[test]
fn sparse_positions_are_put_in_their_places() {
    let mut bytes = vec![2, 0, 0, 0];
    bytes.extend([5_f32, 6., 7.].iter().flat_map(|c| c.to_le_bytes()));
    let views = r#""bufferViews":[{"buffer":0,"byteLength":4},{"buffer":0,"byteLength":12,"byteOffset":4}]"#;
    let sparse = |count: &str| {
        mode(4).replace(VIEW, views).replace(
            ACCESSOR,
            &format!(
                r#""accessors":[{{"componentType":5126,"count":{count},"type":"VEC3","sparse":{{"count":1,
                "indices":{{"bufferView":0,"componentType":5121}},"values":{{"bufferView":1}}}}}}]"#
            ),
        )
    };
    let raw = parse(&bytes, &sparse("3")).unwrap();
    assert_eq!(raw.positions, [[0.; 3], [0.; 3], [5., 6., 7.]]);
    assert!(message(&bytes, &sparse("2")).contains("sparse index"));
    assert!(message(&bytes, &sparse("1000000000000")).contains("far larger"));
}

#[test]
fn an_index_out_of_range_names_its_triangle() {
    let mut bytes = corner_bytes();
    bytes.extend([0, 1, 2, 0, 2, 4].map(|i: u16| i.to_le_bytes()).concat());
    let rest = format!(
        r#"{ONE_NODE},
        "bufferViews":[{{"buffer":0,"byteLength":48}},{{"buffer":0,"byteOffset":48,"byteLength":12}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3"}},
                     {{"bufferView":1,"componentType":5123,"count":6,"type":"SCALAR"}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}}]"#
    );
    let failure = parse(&bytes, &rest).unwrap_err();
    let place = Place::Triangle { mesh: 0, primitive: 0, triangle: 1 };
    assert_eq!(failure.place, Some(place));
    assert!(failure.fault.to_string().contains("vertex index 4"));
    let floats = rest.replace("5123", "5126").replace("count\":6", "count\":3");
    assert!(message(&bytes, &floats).contains("unsigned integers"));
}

#[test]
fn counts_and_offsets_beyond_the_buffer_are_errors() {
    let damaged = |from: &str, to: &str| message(&corner_bytes(), &mode(4).replace(from, to));
    assert!(damaged("\"count\":4", "\"count\":5").contains("5 elements are promised and 4"));
    assert!(damaged("\"count\":4", "\"count\":18446744073709551615").contains("promised"));
    let offset = "\"byteOffset\":18446744073709551615,\"count\":4";
    assert!(damaged("\"count\":4", offset).contains("outside"));
    let view = "\"byteOffset\":18446744073709551615,\"byteLength\":48}";
    assert!(damaged("\"byteLength\":48}", view).contains("outside"));
    assert!(damaged("\"byteLength\":48}", "\"byteLength\":60}").contains("outside"));
    assert!(damaged("VEC3", "VEC2").contains("three floats"));
    assert!(damaged("5126", "5122").contains("quantisation"));
    // An empty accessor is no error here; the mesh without a surface will be one.
    let empty = mode(4).replace("\"count\":4", "\"count\":0");
    assert!(parse(&corner_bytes(), &empty).unwrap().triangles.is_empty());
}

#[test]
fn missing_and_short_buffers_are_errors() {
    let rest = mode(4);
    let json = String::from_utf8(document(&corner_bytes(), &rest)).unwrap();
    let start = json.find("\"uri\"").unwrap();
    let end = start + json[start..].find('}').unwrap();
    let with = |uri: &str| {
        let json = format!("{}{uri}{}", &json[..start], &json[end..]);
        let failure = read(json.as_bytes(), Path::new("nowhere/test.gltf")).unwrap_err();
        failure.fault.to_string()
    };
    assert!(with(r#""uri":"a.bin""#).contains("a.bin cannot be read"));
    assert!(with(r#""name":"b""#).contains("no binary chunk"));
    assert!(with(r#""uri":"data:;base64,AAAA""#).contains("3 bytes where the document says 48"));
}

#[test]
fn nodes_must_be_a_tree_and_instances_few() {
    let nodes = |nodes: &str| message(&corner_bytes(), &mode(4).replace(ONE_NODE, nodes));
    let cycle = r#""nodes":[{"children":[1]},{"children":[0]}],"scenes":[{"nodes":[0]}]"#;
    assert!(nodes(cycle).contains("node 0 is reached twice"));
    let diamond = r#""nodes":[{"children":[1,2]},{"children":[3]},{"children":[3]},{"mesh":0}],"scenes":[{"nodes":[0]}]"#;
    assert!(nodes(diamond).contains("node 3 is reached twice"));
    // A thousand nodes that each show the mesh: 4000 positions, from a few kilobytes. Well within bounds,
    // unless the mesh has a million primitives.
    let many = vec![r#"{"mesh":0}"#; 1000].join(",");
    let roots: Vec<String> = (0..1000).map(|i| i.to_string()).collect();
    let scene = format!(r#""nodes":[{many}],"scenes":[{{"nodes":[{}]}}]"#, roots.join(","));
    let rest = mode(4).replace(ONE_NODE, &scene);
    assert_eq!(parse(&corner_bytes(), &rest).unwrap().positions.len(), 4000);
    // A small file may hold a scene of many equal parts: a thousand of 24 corners.
    let parts = rest
        .replace("\"count\":4", "\"count\":24")
        .replace("\"byteLength\":48", "\"byteLength\":288");
    assert_eq!(parse(&vec![0; 288], &parts).unwrap().positions.len(), 24_000);
    let zeros = vec![0; 12 * 3000];
    let rest = rest
        .replace("\"byteLength\":48", "\"byteLength\":36000")
        .replace("\"count\":4", "\"count\":3000");
    assert!(message(&zeros, &rest).contains("too often"));
}
