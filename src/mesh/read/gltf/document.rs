//! The JSON of a glTF file, reduced to its geometry and checked, and the binary chunk that may follow it.
//!
//! The `gltf` crate checks all indices of a document, but stops at anything that is amiss, and panics at some
//! headers. So the header is checked before, and what is no geometry (materials, images, animations, skins) is
//! removed: it cannot fail a file whose surface is sound.

use gltf::json::validation::Checked;
use gltf::json::{Root, Value};
use gltf::{Document, Gltf, Semantic, binary};

use crate::mesh::error::Fault;
use crate::mesh::read::values::{excerpt, excerpt_of};

/// Required extensions that do not touch positions and triangles, by the beginning of their names.
const HARMLESS: [&str; 6] = [
    "KHR_materials_",
    "KHR_texture_",
    "EXT_texture_",
    "MSFT_texture_",
    "KHR_lights_punctual",
    "KHR_animation_pointer",
];

/// Parses a `.gltf` or a `.glb`. The second part is the binary chunk of a GLB.
pub fn parse(bytes: &[u8]) -> Result<(Document, Option<Vec<u8>>), Fault> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    if bytes.starts_with(b"glTF") {
        check_header(bytes)?;
    }
    let Gltf { document, blob } = Gltf::from_slice_without_validation(bytes).map_err(invalid)?;
    let mut root = document.into_json();
    if let Some(name) = root
        .extensions_required
        .iter()
        .find(|name| !HARMLESS.iter().any(|prefix| name.starts_with(prefix)))
    {
        return Err(Fault::RequiredExtension { name: excerpt(name.as_bytes()) });
    }
    keep_geometry(&mut root)?;
    let document = Document::from_json(root).map_err(invalid)?;
    Ok((document, blob))
}

/// A GLB header is 12 bytes, the last four of which are the length of the file.
fn check_header(bytes: &[u8]) -> Result<(), Fault> {
    let promised = bytes
        .get(8..)
        .and_then(|rest| rest.first_chunk())
        .map(|length| u32::from_le_bytes(*length) as usize);
    match promised {
        Some(promised) if promised < 12 => Err(Fault::InvalidDocument(format!(
            "the GLB header gives the impossible length {promised}"
        ))),
        Some(promised) if promised <= bytes.len() => Ok(()),
        Some(promised) => Err(Fault::TruncatedGlb(format!("{} of {promised} bytes", bytes.len()))),
        None => Err(Fault::TruncatedGlb("the header is incomplete".to_owned())),
    }
}

fn keep_geometry(root: &mut Root) -> Result<(), Fault> {
    root.extensions = None;
    root.extensions_required.clear();
    root.animations.clear();
    root.cameras.clear();
    root.images.clear();
    root.materials.clear();
    root.samplers.clear();
    root.skins.clear();
    root.textures.clear();
    for node in &mut root.nodes {
        node.camera = None;
        node.skin = None;
        node.extensions = None;
    }
    for primitive in root.meshes.iter_mut().flat_map(|mesh| &mut mesh.primitives) {
        primitive.material = None;
        primitive.targets = None;
        primitive.attributes.retain(|name, _| *name == Checked::Valid(Semantic::Positions));
        for accessor in primitive.attributes.values() {
            let index = accessor.value();
            let Some(accessor) = root.accessors.get_mut(index) else {
                return Err(Fault::InvalidDocument(format!(
                    "POSITION names accessor {index}, which does not exist"
                )));
            };
            // The bounds are asked for by the format, often missing, and never used here.
            accessor.min = Some(Value::from(vec![0; 3]));
            accessor.max = Some(Value::from(vec![0; 3]));
        }
    }
    Ok(())
}

fn invalid(error: gltf::Error) -> Fault {
    match error {
        gltf::Error::Binary(
            binary::Error::Io(_) | binary::Error::Length { .. } | binary::Error::ChunkLength { .. },
        ) => Fault::TruncatedGlb("a chunk is incomplete".to_owned()),
        gltf::Error::Binary(binary::Error::Version(version)) => {
            Fault::InvalidDocument(format!("it is GLB version {version}, and version 2 is read"))
        }
        gltf::Error::Validation(errors) => Fault::InvalidDocument(
            errors
                .iter()
                .take(3)
                .map(|(path, error)| format!("{path}: {error}"))
                .collect::<Vec<_>>()
                .join("; "),
        ),
        // It may quote all of the document.
        other => Fault::InvalidDocument(excerpt_of(other.to_string().as_bytes(), 200)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(bytes: &[u8]) -> String {
        parse(bytes).unwrap_err().to_string()
    }

    #[test]
    fn impossible_headers_are_errors_not_panics() {
        assert!(message(b"glTF").contains("header"));
        assert!(message(b"glTF\x02\0\0\0\0\0\0\0").contains("impossible length 0"));
        assert!(message(b"glTF\x02\0\0\0\x0c\0\0\0").contains("chunk"));
        assert!(message(b"glTF\x02\0\0\0\xff\0\0\0").contains("12 of 255 bytes"));
        assert!(message(b"glTF\x01\0\0\0\x0c\0\0\0").contains("version 1"));
    }

    #[test]
    fn extensions_that_hide_geometry_are_refused_by_name() {
        let with = |name: &str| {
            let json =
                format!(r#"{{"asset":{{"version":"2.0"}},"extensionsRequired":["{name}"]}}"#);
            parse(json.as_bytes()).map_err(|fault| fault.to_string())
        };
        assert!(with("KHR_materials_unlit").is_ok());
        let refused = with("EXT_meshopt_compression").unwrap_err();
        assert!(refused.contains("EXT_meshopt_compression"), "{refused}");
        assert!(refused.contains("without meshopt"), "{refused}");
        let refused = with("KHR_mesh_quantization").unwrap_err();
        assert!(refused.contains("with floating-point positions"), "{refused}");
    }

    #[test]
    fn a_position_accessor_must_exist() {
        let json = r#"{"asset":{"version":"2.0"},
            "meshes":[{"primitives":[{"attributes":{"POSITION":3}}]}]}"#;
        assert!(message(json.as_bytes()).contains("accessor 3"));
    }
}
