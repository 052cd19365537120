//! Which format are these bytes? The content decides, not the extension: files are renamed, contents are not.

use serde::Serialize;

use crate::mesh::error::Fault;

/// The formats that can be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Format {
    /// Wavefront OBJ.
    Obj,
    /// glTF 2.0, JSON with buffers beside or inside it.
    Gltf,
    /// glTF 2.0 in its binary container.
    Glb,
}

/// How much of a file is looked at.
const SNIFFED: usize = 64 << 10;

/// Keywords that open a line of an OBJ file and of no other format that starts with text.
const OBJ_KEYWORDS: [&[u8]; 12] =
    [b"v", b"vt", b"vn", b"vp", b"f", b"l", b"p", b"o", b"g", b"s", b"mtllib", b"usemtl"];

/// Formats that are met often and not read, by their first bytes.
const KNOWN: [(&[u8], &str); 6] = [
    (b"ply", "a PLY file"),
    (b"OFF", "an OFF file"),
    (b"solid", "an STL file"),
    (b"# vtk", "a VTK file"),
    (b"Kaydara FBX", "an FBX file"),
    (b"<?xml", "an XML file"),
];

impl Format {
    /// Recognises a format by content, and by `extension` (without the dot) where the content leaves it open.
    pub(crate) fn of(bytes: &[u8], extension: Option<&str>) -> Result<Self, Fault> {
        let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        if text.is_empty() {
            return Err(Fault::EmptyFile);
        }
        if text.starts_with(b"glTF") {
            return Ok(Self::Glb);
        }
        if text.trim_ascii_start().starts_with(b"{") {
            return Ok(Self::Gltf);
        }
        if let Some((_, name)) = KNOWN.iter().find(|(magic, _)| text.starts_with(magic)) {
            return Err(Fault::UnknownFormat { recognised: Some(name) });
        }
        let sniffed = text.get(..SNIFFED).unwrap_or(text);
        let named_obj = extension.is_some_and(|e| e.eq_ignore_ascii_case("obj"));
        if !sniffed.contains(&0) && (named_obj || sniffed.split(|&b| b == b'\n').any(is_obj_line)) {
            return Ok(Self::Obj);
        }
        Err(Fault::UnknownFormat { recognised: None })
    }
}

fn is_obj_line(line: &[u8]) -> bool {
    let line = line.trim_ascii_start();
    let word = line.split(u8::is_ascii_whitespace).next().unwrap_or(line);
    OBJ_KEYWORDS.contains(&word)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn content_goes_before_extension() {
        let of = |bytes: &[u8], extension| Format::of(bytes, extension).ok();
        assert_eq!(of(b"glTF\x02\0\0\0", Some("obj")), Some(Format::Glb));
        assert_eq!(of(b" \n{\"asset\":{}}", Some("txt")), Some(Format::Gltf));
        assert_eq!(of(b"# made\r\nv 0 0 0\r\n", None), Some(Format::Obj));
        assert_eq!(of(b"\xef\xbb\xbfo thing\n", Some("glb")), Some(Format::Obj));
        // Nothing but a comment: only the extension can say what it is meant to be.
        assert_eq!(of(b"# nothing here\n", Some("OBJ")), Some(Format::Obj));
        assert_eq!(of(b"# nothing here\n", None), None);
    }

    #[test]
    fn what_is_not_read_is_named() {
        let message = |bytes: &[u8]| Format::of(bytes, None).unwrap_err().to_string();
        assert!(message(b"ply\nformat ascii 1.0\n").contains("PLY"));
        assert!(message(b"").contains("empty"));
        assert!(message(b"\x7fELF\0\0v 1 2 3\n").contains("neither OBJ nor glTF"));
    }
}
