//! The bytes that a glTF document refers to: its binary chunk, base64 inside it, files beside it.

use std::fs::File;
use std::io::Read;
use std::path::{Component, Path, PathBuf};

use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::DecodePaddingMode;
use base64::engine::general_purpose::{GeneralPurpose, GeneralPurposeConfig};
use gltf::buffer::Source;
use gltf::{Buffer, Document};

use crate::mesh::error::Fault;

/// Reads every buffer of `document`; `folder` is where the document lies. Each has the length it promises.
pub fn resolve(
    document: &Document,
    mut blob: Option<Vec<u8>>,
    folder: &Path,
) -> Result<Vec<Vec<u8>>, Fault> {
    document
        .buffers()
        .map(|buffer| {
            let bytes = read(&buffer, &mut blob, folder);
            let checked = bytes.and_then(|bytes| match bytes.len() {
                got if got >= buffer.length() => Ok(bytes),
                got => Err(format!(
                    "holds {got} bytes where the document says {}; the file is cut short, or belongs to another document",
                    buffer.length()
                )),
            });
            checked.map_err(|problem| Fault::Buffer {
                buffer: buffer.index(),
                problem,
            })
        })
        .collect()
}

fn read(buffer: &Buffer<'_>, blob: &mut Option<Vec<u8>>, folder: &Path) -> Result<Vec<u8>, String> {
    match buffer.source() {
        Source::Bin => blob
            .take()
            .ok_or_else(|| "the document has no binary chunk for it; export it again".to_owned()),
        Source::Uri(uri) => match uri.strip_prefix("data:") {
            Some(data) => decode(data),
            None => read_beside(folder, uri, buffer.length()),
        },
    }
}

fn decode(data: &str) -> Result<Vec<u8>, String> {
    let Some((_, text)) = data.split_once(";base64,") else {
        return Err("its data URI is not base64; export it again".to_owned());
    };
    // Padding is often left out.
    let config =
        GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent);
    GeneralPurpose::new(&STANDARD, config)
        .decode(text)
        .map_err(|error| format!("its base64 is damaged ({error}); export it again"))
}

fn read_beside(folder: &Path, uri: &str, length: usize) -> Result<Vec<u8>, String> {
    let path = PathBuf::from(percent_decoded(uri));
    let relative =
        path.components().all(|part| !matches!(part, Component::Prefix(_) | Component::RootDir));
    if uri.contains("://") || !relative {
        return Err(format!(
            "`{uri}` is not beside the document; put the file there and name it without a folder"
        ));
    }
    let path = folder.join(path);
    let complain = |error: std::io::Error| {
        format!("{} cannot be read: {error}; a .gltf has to lie beside its buffers", path.display())
    };
    let file = File::open(&path).map_err(complain)?;
    if !file.metadata().map_err(complain)?.is_file() {
        return Err(format!("{} is not a file", path.display()));
    }
    let mut bytes = Vec::new();
    file.take(length as u64).read_to_end(&mut bytes).map_err(complain)?;
    Ok(bytes)
}

/// `%20` and its like in a URI, as the bytes they stand for.
pub fn percent_decoded(uri: &str) -> String {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let [byte, tail @ ..] = rest {
        rest = tail;
        let hex = (*byte == b'%').then(|| tail.split_at_checked(2)).flatten();
        let decoded = hex.and_then(|(digits, tail)| {
            let digits = std::str::from_utf8(digits).ok()?;
            Some((u8::from_str_radix(digits, 16).ok()?, tail))
        });
        match decoded {
            Some((decoded, tail)) => {
                bytes.push(decoded);
                rest = tail;
            }
            None => bytes.push(*byte),
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_uris_decode_with_and_without_padding() {
        assert_eq!(decode("a/b;base64,AAEC/w==").unwrap(), [0, 1, 2, 255]);
        assert_eq!(decode(";base64,AAEC/w").unwrap(), [0, 1, 2, 255]);
        assert!(decode("a/b;base64,A!").unwrap_err().contains("damaged"));
        assert!(decode("text/plain,abc").unwrap_err().contains("base64"));
    }

    #[test]
    fn files_are_looked_for_beside_the_document() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a b.bin"), [1, 2, 3, 4]).unwrap();
        let read = |uri| read_beside(folder.path(), uri, 3);
        assert_eq!(read("a%20b.bin").unwrap(), [1, 2, 3]);
        assert!(read("c.bin").unwrap_err().contains("c.bin cannot be read"));
        assert!(read("/etc/hostname").unwrap_err().contains("not beside"));
        assert!(read("https://x.org/a.bin").unwrap_err().contains("not beside"));
        assert!(read(".").is_err());
    }

    #[test]
    fn percent_signs_that_encode_nothing_stay() {
        assert_eq!(percent_decoded("100%.bin"), "100%.bin");
        assert_eq!(percent_decoded("%C3%A9%zz"), "é%zz");
    }
}
