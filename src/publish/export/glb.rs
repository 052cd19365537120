//! The mesh in the colours of its eigenfunctions as binary glTF 2.0: one figure for each, in a row along x.
//!
//! All figures share positions, in single precision, and triangles; each is a node `phi_k` with a mesh whose COLOR_0 is φ_k
//! and whose `extras` have λ_k. Colours are viridis from −max |φ_k| to max |φ_k|, as in the pictures; glTF takes colours of
//! vertices in linear light.

use colorous::VIRIDIS;
use serde_json::{Value, json};

use super::TooLarge;
use crate::mesh::TriMesh;
use crate::spectrum::Eigenpairs;
use crate::spectrum::pencil::column;

/// From one figure to the next, in widths of the mesh.
const STEP: f32 = 1.25;

/// Types of numbers, as the specification calls them.
const FLOAT: u32 = 5126;
const UNSIGNED_INT: u32 = 5125;
const UNSIGNED_SHORT: u32 = 5123;

/// What a view is for: ARRAY_BUFFER, or ELEMENT_ARRAY_BUFFER.
const VERTICES: u32 = 34962;
const INDICES: u32 = 34963;

/// The bytes of the file of `mesh` and its K eigenfunctions, n×K.
///
/// # Errors
/// When there would be 4 GiB or more.
pub fn to_glb(mesh: &TriMesh, pairs: &Eigenpairs) -> Result<Vec<u8>, TooLarge> {
    let [n, m, k] = [mesh.n(), mesh.faces().len(), pairs.len()].map(|count| count as u64);
    // Positions, triangles, colours, all of whole words.
    let lengths = [12 * n, 12 * m].into_iter().chain((0..k).map(|_| 8 * n));
    let binary: u64 = 12 * n + 12 * m + 8 * n * k;
    let mut text = document(mesh, pairs, lengths, binary).to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let bytes = 12 + 8 + text.len() as u64 + 8 + binary;
    let whole = u32::try_from(bytes).map_err(|_| TooLarge { bytes })?;
    let mut bytes = Vec::with_capacity(whole as usize);
    let chunk = |length: u64, kind: &[u8; 4]| [&(length as u32).to_le_bytes()[..], kind].concat();
    bytes.extend(b"glTF");
    bytes.extend(2_u32.to_le_bytes());
    bytes.extend(whole.to_le_bytes());
    bytes.extend(chunk(text.len() as u64, b"JSON"));
    bytes.extend(text);
    bytes.extend(chunk(binary, b"BIN\0"));
    bytes.extend(mesh.vertices().iter().flatten().flat_map(|&c| (c as f32).to_le_bytes()));
    bytes.extend(mesh.faces().iter().flatten().flat_map(|index| index.to_le_bytes()));
    for j in 0..pairs.len() {
        let function = column(&pairs.vectors, j);
        let limit = function.iter().fold(0.0_f64, |limit, value| limit.max(value.abs()));
        let colours = function.iter().flat_map(|value| colour(value / limit));
        bytes.extend(colours.flat_map(u16::to_le_bytes));
    }
    Ok(bytes)
}

/// Red, green, blue and opacity, in linear light, of a value from −1 to 1.
fn colour(value: f64) -> [u16; 4] {
    let place = if value.is_finite() { 0.5 + 0.5 * value } else { 0.5 };
    let colour = VIRIDIS.eval_continuous(place.clamp(0.0, 1.0));
    let [r, g, b] = [colour.r, colour.g, colour.b].map(|channel| {
        // IEC 61966-2-1.
        let c = f64::from(channel) / 255.0;
        let linear = if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) };
        (linear * f64::from(u16::MAX)).round() as u16
    });
    [r, g, b, u16::MAX]
}

/// The document; buffer view i is accessor i, and has the i-th of these lengths.
fn document(
    mesh: &TriMesh,
    pairs: &Eigenpairs,
    lengths: impl Iterator<Item = u64>,
    binary: u64,
) -> Value {
    let (n, m) = (mesh.n(), mesh.faces().len());
    let positions = || mesh.vertices().iter().map(|p| p.map(|c| c as f32));
    let bound = |pick: fn(f32, f32) -> f32| {
        positions().reduce(|a, b| [0, 1, 2].map(|i| pick(a[i], b[i]))).unwrap_or_default()
    };
    let (min, max) = (bound(f32::min), bound(f32::max));
    let step = STEP * (max[0] - min[0]);
    let mut offset = 0;
    let views: Vec<Value> = lengths
        .enumerate()
        .map(|(i, length)| {
            let target = if i == 1 { INDICES } else { VERTICES };
            let view =
                json!({ "buffer": 0, "byteOffset": offset, "byteLength": length, "target": target });
            offset += length;
            view
        })
        .collect();
    let mut accessors = vec![
        json!({ "bufferView": 0, "componentType": FLOAT, "count": n, "type": "VEC3", "min": min, "max": max }),
        json!({ "bufferView": 1, "componentType": UNSIGNED_INT, "count": 3 * m, "type": "SCALAR" }),
    ];
    let (mut meshes, mut nodes) = (Vec::new(), Vec::new());
    for (j, lambda) in pairs.values.iter().enumerate() {
        let name = format!("phi_{}", j + 1);
        accessors.push(json!({
            "bufferView": 2 + j, "componentType": UNSIGNED_SHORT, "normalized": true, "count": n, "type": "VEC4",
        }));
        let attributes = json!({ "POSITION": 0, "COLOR_0": 2 + j });
        let primitive = json!({ "attributes": attributes, "indices": 1, "material": 0 });
        meshes.push(
            json!({ "name": name, "primitives": [primitive], "extras": { "lambda": lambda } }),
        );
        nodes.push(json!({ "name": name, "mesh": j, "translation": [step * j as f32, 0.0, 0.0] }));
    }
    json!({
        "asset": { "version": "2.0", "generator": concat!("chladni ", env!("CARGO_PKG_VERSION")) },
        "scene": 0,
        "scenes": [{ "nodes": (0..nodes.len()).collect::<Vec<_>>() }],
        "nodes": nodes,
        "meshes": meshes,
        "materials": [{
            "pbrMetallicRoughness": { "metallicFactor": 0.0, "roughnessFactor": 1.0 },
            "doubleSided": true,
        }],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{ "byteLength": binary }],
    })
}

#[cfg(test)]
mod tests {
    use super::super::fixture::Fixture;
    use super::*;

    #[test]
    fn the_gltf_crate_reads_every_figure() {
        let Fixture { mesh, pairs, .. } = Fixture::new();
        let gltf = gltf::Gltf::from_slice(&to_glb(&mesh, &pairs).unwrap()).unwrap();
        let blob = gltf.blob.as_deref().unwrap();
        let nodes: Vec<_> = gltf.default_scene().unwrap().nodes().collect();
        assert_eq!(nodes.len(), 2);
        for (j, node) in nodes.iter().enumerate() {
            assert_eq!(node.name(), Some(format!("phi_{}", j + 1).as_str()));
            let primitive = node.mesh().unwrap().primitives().next().unwrap();
            let reader = primitive.reader(|_| Some(blob));
            let positions: Vec<[f32; 3]> = reader.read_positions().unwrap().collect();
            let expected = mesh.vertices().iter().map(|p| p.map(|c| c as f32));
            assert_eq!(positions, expected.collect::<Vec<_>>());
            let indices: Vec<u32> = reader.read_indices().unwrap().into_u32().collect();
            assert_eq!(indices, mesh.faces().as_flattened());
            let colours: Vec<[u16; 4]> = reader.read_colors(0).unwrap().into_rgba_u16().collect();
            let function = column(&pairs.vectors, j);
            let limit = function.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
            let expected: Vec<_> = function.iter().map(|value| colour(value / limit)).collect();
            assert_eq!(colours, expected);
        }
        let [first, second] = [0, 1].map(|j| nodes[j].transform().decomposed().0);
        assert_eq!(first, [0.0; 3]);
        assert!(second[0] > 2.0, "beside the first, which is 2 wide");
    }

    #[test]
    fn the_ends_of_the_map_are_purple_and_yellow_and_zero_is_its_middle() {
        let [low, middle, high] = [-1.0, 0.0, 1.0].map(colour);
        assert!(low[2] > low[1] && high[0] > high[2] && high[1] > high[2]);
        assert_eq!(colour(f64::NAN), middle);
        assert!([low, middle, high].iter().all(|colour| colour[3] == u16::MAX));
    }
}
