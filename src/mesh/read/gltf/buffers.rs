//! The bytes that a glTF document refers to: its binary chunk, base64 inside it, files beside it.

use std::collections::HashMap;
use std::fs::File;
use std::io::{Error, Read};
use std::path::{Component, Path, PathBuf};
use std::rc::Rc;

use base64::Engine;
use base64::alphabet::STANDARD;
use base64::engine::DecodePaddingMode;
use base64::engine::general_purpose::{GeneralPurpose, GeneralPurposeConfig};
use gltf::buffer::{Source, View};
use gltf::{Buffer, Document};

use crate::mesh::error::Fault;
use crate::mesh::read::values::excerpt;

/// The bytes of every buffer, each of at least the length that the document says.
pub struct Buffers {
    all: Vec<Rc<Vec<u8>>>,
    beside: usize,
}

impl Buffers {
    /// Reads every buffer of `document`; `folder` is where the document lies.
    pub fn resolve(
        document: &Document,
        blob: Option<Vec<u8>>,
        folder: &Path,
    ) -> Result<Self, Fault> {
        let mut sources = Sources::new(blob, folder);
        document.buffers().for_each(|buffer| sources.want(&buffer));
        let read = document.buffers().map(|buffer| {
            let bytes = sources.read(&buffer).and_then(|bytes| match bytes.len() {
                got if got >= buffer.length() => Ok(bytes),
                got => Err(format!(
                    "holds {got} bytes where the document says {}; the file is cut short, or belongs to another document",
                    buffer.length()
                )),
            });
            bytes.map_err(|problem| Fault::Buffer { buffer: buffer.index(), problem })
        });
        let all = read.collect::<Result<_, _>>()?;
        Ok(Self { all, beside: sources.bytes })
    }

    /// How many bytes came of files beside the document, what several buffers name counted once.
    pub fn beside(&self) -> usize {
        self.beside
    }

    /// The bytes of a view; none where it leaves its buffer.
    pub fn view(&self, view: &View<'_>) -> Option<&[u8]> {
        let end = view.offset().checked_add(view.length())?;
        self.all.get(view.buffer().index())?.get(view.offset()..end)
    }
}

/// Where buffers come from.
struct Sources<'a> {
    blob: Option<Vec<u8>>,
    folder: &'a Path,
    /// The largest length that a buffer wants of a file.
    wanted: HashMap<PathBuf, usize>,
    /// The files that were read: many buffers may name one.
    files: HashMap<PathBuf, Rc<Vec<u8>>>,
    /// What all of them hold.
    bytes: usize,
}

impl<'a> Sources<'a> {
    fn new(blob: Option<Vec<u8>>, folder: &'a Path) -> Self {
        Self { blob, folder, wanted: HashMap::new(), files: HashMap::new(), bytes: 0 }
    }

    fn want(&mut self, buffer: &Buffer<'_>) {
        let Source::Uri(uri) = buffer.source() else { return };
        if uri.starts_with("data:") {
            return;
        }
        if let Ok(path) = beside(self.folder, uri) {
            let wanted = self.wanted.entry(path).or_default();
            *wanted = (*wanted).max(buffer.length());
        }
    }

    fn read(&mut self, buffer: &Buffer<'_>) -> Result<Rc<Vec<u8>>, String> {
        let bytes = match buffer.source() {
            Source::Bin => self.blob.take().ok_or_else(|| {
                "the document has no binary chunk for it; export it again".to_owned()
            }),
            Source::Uri(uri) => match uri.strip_prefix("data:") {
                Some(data) => decode(data),
                None => return self.file(uri, buffer.length()),
            },
        };
        bytes.map(Rc::new)
    }

    /// A file beside the document.
    fn file(&mut self, uri: &str, length: usize) -> Result<Rc<Vec<u8>>, String> {
        let path = beside(self.folder, uri)?;
        if let Some(read) = self.files.get(&path) {
            return Ok(read.clone());
        }
        let length = self.wanted.get(&path).copied().unwrap_or(length);
        let bytes = read_file(&path, length).map_err(|error| {
            let uri = excerpt(uri.as_bytes());
            format!("{uri} cannot be read: {error}; a .gltf has to lie beside its buffers")
        })?;
        self.bytes += bytes.len();
        let bytes = Rc::new(bytes);
        self.files.insert(path, bytes.clone());
        Ok(bytes)
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

/// The one path of the file that a URI names, where it has one.
fn beside(folder: &Path, uri: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(percent_decoded(uri));
    let relative =
        path.components().all(|part| !matches!(part, Component::Prefix(_) | Component::RootDir));
    if uri.contains("://") || !relative {
        return Err(format!(
            "`{}` is not beside the document; put the file there and name it without a folder",
            excerpt(uri.as_bytes())
        ));
    }
    let path = folder.join(path);
    Ok(path.canonicalize().unwrap_or(path))
}

/// The first `length` bytes, but no more than the system says that the file has. A pipe would be waited for, and some files of the
/// system never end.
fn read_file(path: &Path, length: usize) -> Result<Vec<u8>, Error> {
    let metadata = path.metadata()?;
    if !metadata.is_file() {
        return Err(Error::other("it is not a regular file"));
    }
    let mut bytes = Vec::new();
    File::open(path)?.take(metadata.len().min(length as u64)).read_to_end(&mut bytes)?;
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
        let mut sources = Sources::new(None, folder.path());
        sources.wanted.insert(beside(folder.path(), "a b.bin").unwrap(), 3);
        let mut read = |uri| sources.file(uri, 1);
        let first = read("a%20b.bin").unwrap();
        assert_eq!(*first, [1, 2, 3]);
        assert!(Rc::ptr_eq(&first, &read("./a b.bin").unwrap()));
        assert!(read("parts/c.bin").unwrap_err().contains("parts/c.bin cannot be read"));
        assert!(read("/etc/hostname").unwrap_err().contains("not beside"));
        assert!(read("https://x.org/a.bin").unwrap_err().contains("not beside"));
        assert!(read(".").unwrap_err().contains("not a regular file"));
        let hostile = format!("http://\u{1b}[2J\n{}", "x".repeat(1 << 20));
        let message = read(&hostile).unwrap_err();
        assert!(message.len() < 200 && !message.contains(char::is_control), "{message}");
        assert_eq!(sources.bytes, 3);
    }

    #[cfg(unix)]
    #[test]
    fn pipes_and_files_without_an_end_are_not_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe.bin");
        let made = std::process::Command::new("mkfifo").arg(&pipe).status();
        if made.is_ok_and(|status| status.success()) {
            assert!(read_file(&pipe, 9).unwrap_err().to_string().contains("regular"));
        }
        assert!(read_file("/dev/zero".as_ref(), 9).is_err());
        match read_file("/proc/self/pagemap".as_ref(), 1 << 40) {
            Ok(bytes) => assert!(bytes.is_empty()),
            // Not everybody may read it, and not everybody has it.
            Err(error) => assert_ne!(error.kind(), std::io::ErrorKind::OutOfMemory),
        }
    }

    #[test]
    fn percent_signs_that_encode_nothing_stay() {
        assert_eq!(percent_decoded("100%.bin"), "100%.bin");
        assert_eq!(percent_decoded("%C3%A9%zz"), "é%zz");
    }
}
