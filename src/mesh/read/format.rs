//! Which format are these bytes? The content decides, not the extension: files are renamed, contents are not.

use serde::Serialize;

use super::{off, stl, vtp};
use crate::mesh::error::Fault;

/// The formats that can be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Format {
    /// Wavefront OBJ.
    Obj,
    /// Geomview's OFF.
    Off,
    /// PLY, the polygon file format.
    Ply,
    /// STL, as text or binary.
    Stl,
    /// Legacy VTK.
    Vtk,
    /// VTK's XML files of `PolyData`.
    Vtp,
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
const OTHERS: [(&[u8], &str); 6] = [
    (b"Kaydara FBX", "an FBX file"),
    (b"<?xml", "an XML file"),
    (b"PK\x03\x04", "a ZIP archive"),
    (b"\x1f\x8b", "a file compressed by gzip"),
    (b"BZh", "a file compressed by bzip2"),
    (b"\xfd7zXZ", "a file compressed by xz"),
];

impl Format {
    /// All of them, as they are listed.
    pub const ALL: [Self; 8] =
        [Self::Obj, Self::Off, Self::Ply, Self::Stl, Self::Vtk, Self::Vtp, Self::Gltf, Self::Glb];

    /// What people call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Obj => "OBJ",
            Self::Off => "OFF",
            Self::Ply => "PLY",
            Self::Stl => "STL",
            Self::Vtk => "VTK",
            Self::Vtp => "VTP",
            Self::Gltf => "glTF",
            Self::Glb => "GLB",
        }
    }

    /// How its files end, with the dot.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Obj => ".obj",
            Self::Off => ".off",
            Self::Ply => ".ply",
            Self::Stl => ".stl",
            Self::Vtk => ".vtk",
            Self::Vtp => ".vtp",
            Self::Gltf => ".gltf",
            Self::Glb => ".glb",
        }
    }

    /// The format whose files end in `extension`, without the dot.
    pub fn of_extension(extension: &str) -> Option<Self> {
        let ends = |format: &Self| {
            format.extension().trim_start_matches('.').eq_ignore_ascii_case(extension)
        };
        Self::ALL.into_iter().find(ends)
    }

    /// All formats by name or extension, as in "OBJ, glTF or GLB".
    pub fn listed(by: impl Fn(Self) -> &'static str) -> String {
        let names = Self::ALL.map(by);
        match names.as_slice() {
            [first @ .., last] => format!("{} or {last}", first.join(", ")),
            [] => String::new(),
        }
    }

    /// Recognises a format by content, and by `extension` (without the dot) where the content leaves it open.
    pub(crate) fn of(bytes: &[u8], extension: Option<&str>) -> Result<Self, Fault> {
        let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        if text.is_empty() {
            return Err(Fault::EmptyFile);
        }
        if let Some(format) = Self::by_first_words(text) {
            return Ok(format);
        }
        let first_word = text.trim_ascii_start();
        if let Some((_, name)) = OTHERS.iter().find(|(magic, _)| first_word.starts_with(magic)) {
            return Err(Fault::UnknownFormat { recognised: Some(name) });
        }
        let sniffed = text.get(..SNIFFED).unwrap_or(text);
        let is_text = !sniffed.contains(&0);
        if is_text && sniffed.split(|&b| b == b'\n').any(is_obj_line) {
            return Ok(Self::Obj);
        }
        match extension.and_then(Self::of_extension) {
            // Comments alone, an OFF file without its keyword, a binary STL file cut short.
            Some(format @ (Self::Obj | Self::Off)) if is_text => Ok(format),
            Some(Self::Stl) if !is_text => Ok(Self::Stl),
            _ => Err(Fault::UnknownFormat { recognised: None }),
        }
    }

    fn by_first_words(text: &[u8]) -> Option<Self> {
        let begins = |magic: &[u8]| {
            text.get(..magic.len()).is_some_and(|head| head.eq_ignore_ascii_case(magic))
        };
        if text.starts_with(b"glTF") {
            Some(Self::Glb)
        } else if text.trim_ascii_start().starts_with(b"{") {
            Some(Self::Gltf)
        } else if begins(b"ply\n") || begins(b"ply\r") || begins(b"ply ") {
            Some(Self::Ply)
        } else if begins(b"# vtk datafile") {
            Some(Self::Vtk)
        } else if text.trim_ascii_start().starts_with(b"<") && vtp::has_header(text) {
            Some(Self::Vtp)
        } else if stl::is_exactly_binary(text) || stl::begins_as_text(text) {
            Some(Self::Stl)
        } else if off::has_header(text) {
            Some(Self::Off)
        } else {
            None
        }
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

    fn of(bytes: &[u8], extension: Option<&str>) -> Option<Format> {
        Format::of(bytes, extension).ok()
    }

    #[test]
    fn content_goes_before_extension() {
        assert_eq!(of(b"glTF\x02\0\0\0", Some("obj")), Some(Format::Glb));
        assert_eq!(of(b" \n{\"asset\":{}}", Some("txt")), Some(Format::Gltf));
        assert_eq!(of(b"# made\r\nv 0 0 0\r\n", None), Some(Format::Obj));
        assert_eq!(of(b"\xef\xbb\xbfo thing\n", Some("glb")), Some(Format::Obj));
        assert_eq!(of(b"ply\r\nformat", Some("stl")), Some(Format::Ply));
        assert_eq!(of(b"# vtk DataFile Version 3.0\n", Some("obj")), Some(Format::Vtk));
        assert_eq!(of(b"<VTKFile type=\"PolyData\">", None), Some(Format::Vtp));
        let declared = b"<?xml version=\"1.0\"?>\n<!-- any -->\n<VTKFile>";
        assert_eq!(of(declared, Some("xml")), Some(Format::Vtp));
        assert_eq!(of(b" Solid part\n", Some("vtk")), Some(Format::Stl));
        for header in ["OFF", "COFF", "NOFF", "STCNOFF", "4nOFF", "# made\n\nOFF 3 1 0", "OFF3 1"] {
            assert_eq!(of(format!("{header}\n").as_bytes(), Some("ply")), Some(Format::Off));
        }
    }

    #[test]
    fn the_extension_decides_where_the_content_cannot() {
        assert_eq!(of(b"# nothing here\n", Some("OBJ")), Some(Format::Obj));
        assert_eq!(of(b"3 1 0\n0 0 0\n", Some("off")), Some(Format::Off));
        assert_eq!(of(b"any\0thing", Some("stl")), Some(Format::Stl));
        for text in ["# nothing here\n", "3 1 0\n0 0 0\n", "any\0thing", "OFFER\n", "plywood"] {
            assert_eq!(of(text.as_bytes(), None), None, "{text}");
        }
    }

    #[test]
    fn an_stl_header_may_hold_anything() {
        for header in ["solid", "ply-like", "v 1 2 3\n", ""] {
            let mut bytes = header.as_bytes().to_vec();
            bytes.resize(80, b' ');
            bytes.extend(2_u32.to_le_bytes());
            bytes.resize(84 + 100, 0);
            assert_eq!(of(&bytes, None), Some(Format::Stl));
        }
    }

    #[test]
    fn what_is_not_read_is_named() {
        let message = |bytes: &[u8]| Format::of(bytes, None).unwrap_err().to_string();
        assert!(message(b"<?xml version=\"1.0\"?>\n<COLLADA/>").contains("an XML file"));
        assert!(message(b"\x1f\x8b\x08\0").contains("compressed by gzip"));
        assert!(message(b"BZh91AY").contains("compressed by bzip2"));
        assert!(message(b"\xfd7zXZ\0").contains("compressed by xz"));
        assert!(message(b"PK\x03\x04\x14").contains("a ZIP archive"));
        assert!(message(b"").contains("empty"));
        let listed = "no mesh format that is read; \
            convert the mesh to OBJ, OFF, PLY, STL, VTK, VTP, glTF or GLB";
        assert!(message(b"\x7fELF\0\0v 1 2 3\n").contains(listed));
    }
}
