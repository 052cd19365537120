//! From a `DataArray` to its numbers, whichever way they are written.
//!
//! An array of bytes has a header: how many bytes follow; or, where it is compressed, the number of blocks, the size
//! of a block and that of the last one where it is shorter, and the compressed size of each block.

use std::borrow::Cow;
use std::io::Read;

use flate2::read::ZlibDecoder;

use super::base64::Base64;
use super::document::{Appended, Array, Content, Document, Encoding, malformed};
use crate::mesh::error::{Failure, Fault, Place};
use crate::mesh::read::scan::Scanner;
use crate::mesh::read::values::{Layout, Order, Scalar, Values};

/// How many numbers are read per byte of the file, and how often a byte of it may be decoded. Compression makes more numbers
/// than there are bytes, and so do arrays that name the same bytes; no mesh comes near this.
const PER_BYTE: usize = 4;

/// Reads the arrays of a document, and no more numbers than its size can mean.
pub struct Decoder<'a> {
    order: Order,
    header: Scalar,
    compressed: bool,
    appended: Option<Appended<'a>>,
    /// Numbers that may still be read.
    left: usize,
    /// Encoded bytes that may still be decoded.
    encoded: usize,
}

/// The numbers of an array, decoded.
pub struct Numbers<'a> {
    bytes: Cow<'a, [u8]>,
    layout: Layout,
    /// Where they begin, if they are text.
    line: u32,
}

impl Numbers<'_> {
    pub fn values(&self) -> Values<'_> {
        let scanner = Scanner::from_line(&self.bytes, self.line);
        Values::new("VTP", scanner, self.layout)
    }
}

impl<'a> Decoder<'a> {
    /// For a document of so many bytes.
    pub fn new(document: &Document<'a>, size: usize) -> Self {
        let &Document { order, header, compressed, appended, .. } = document;
        let left = size.saturating_mul(PER_BYTE);
        Self { order, header, compressed, appended, left, encoded: left }
    }

    /// The numbers of an array that has to have `count` of them; none for a count beyond all memory.
    pub fn open(
        &mut self,
        array: &Array<'a>,
        count: Option<usize>,
    ) -> Result<Numbers<'a>, Failure> {
        let left = count.and_then(|count| self.left.checked_sub(count));
        let (Some(count), Some(left)) = (count, left) else {
            let problem = "its counts are far larger than the file".to_owned();
            return Err(malformed(array.line, problem));
        };
        self.left = left;
        let bytes = match (&array.content, self.appended) {
            (&Content::Text(text, line), _) => {
                return Ok(Numbers { bytes: Cow::Borrowed(text), layout: Layout::Words, line });
            }
            (&Content::Inline(text), _) => {
                self.decoded(Source::Base64(Base64::new(text)), count, array)?
            }
            (&Content::Appended(offset), Some(Appended { encoding, bytes })) => {
                let bytes = bytes.get(offset..).unwrap_or_default();
                let source = match encoding {
                    Encoding::Raw => Source::Raw(bytes),
                    Encoding::Base64 => Source::Base64(Base64::new(bytes)),
                };
                self.decoded(source, count, array)?
            }
            (Content::Appended(_), None) => {
                let problem = "the array is appended, and nothing is".to_owned();
                return Err(malformed(array.line, problem));
            }
        };
        Ok(Numbers { bytes, layout: Layout::Bytes(self.order), line: array.line })
    }

    /// The bytes of `count` numbers.
    fn decoded(
        &mut self,
        mut source: Source<'a>,
        count: usize,
        array: &Array<'a>,
    ) -> Result<Cow<'a, [u8]>, Failure> {
        let before = source.len();
        let bytes = self.decode(&mut source, count, array)?;
        let spent = before - source.len();
        let too_often =
            || malformed(array.line, "its arrays name the same bytes over and over".to_owned());
        self.encoded = self.encoded.checked_sub(spent).ok_or_else(too_often)?;
        Ok(bytes)
    }

    fn decode(
        &self,
        source: &mut Source<'a>,
        count: usize,
        array: &Array<'a>,
    ) -> Result<Cow<'a, [u8]>, Failure> {
        let size = count.saturating_mul(array.scalar.size());
        let holds = |bytes: usize| {
            let problem = format!("the array holds {bytes} bytes where {size} are promised");
            malformed(array.line, problem)
        };
        if size == 0 {
            return Ok(Cow::Borrowed(&[]));
        }
        let first = self.word(source).ok_or_else(|| ends_early(array))?;
        if !self.compressed {
            if first != size {
                return Err(holds(first));
            }
            return source.take(size).ok_or_else(|| ends_early(array));
        }
        let (blocks, block) = (first, self.word(source));
        let last = self.word(source);
        let (Some(block), Some(last)) = (block, last) else { return Err(ends_early(array)) };
        // Blocks without content would be as many as anybody likes.
        let full = blocks.checked_sub(usize::from(last > 0));
        let full = full.filter(|&full| full == 0 || block > 0);
        let total = full.and_then(|full| full.checked_mul(block)?.checked_add(last));
        if total != Some(size) {
            return Err(holds(total.unwrap_or_default()));
        }
        let mut sizes = Vec::new();
        for _ in 0..blocks {
            sizes.push(self.word(source).ok_or_else(|| ends_early(array))?);
        }
        let mut bytes = Vec::new();
        for (number, compressed) in sizes.into_iter().enumerate() {
            let packed = source.take(compressed).ok_or_else(|| ends_early(array))?;
            let whole = if number + 1 == blocks && last > 0 { last } else { block };
            let before = bytes.len();
            let read = ZlibDecoder::new(&*packed).take(whole as u64).read_to_end(&mut bytes);
            if read.is_err() || bytes.len() - before != whole {
                let problem = format!("block {number} of the array cannot be decompressed");
                return Err(malformed(array.line, problem));
            }
        }
        Ok(Cow::Owned(bytes))
    }

    /// The next number of a header.
    fn word(&self, source: &mut Source<'a>) -> Option<usize> {
        let bytes = source.take(self.header.size())?;
        let scanner = Scanner::from_line(&bytes, 1);
        let mut values = Values::new("VTP", scanner, Layout::Bytes(self.order));
        values.count(self.header).ok()
    }
}

/// The bytes of arrays, one after the other.
enum Source<'a> {
    Raw(&'a [u8]),
    Base64(Base64<'a>),
}

impl<'a> Source<'a> {
    /// What is left of it as it stands in the file.
    fn len(&self) -> usize {
        match self {
            Self::Raw(bytes) => bytes.len(),
            Self::Base64(text) => text.len(),
        }
    }

    fn take(&mut self, count: usize) -> Option<Cow<'a, [u8]>> {
        match self {
            Self::Raw(bytes) => {
                let (taken, rest) = bytes.split_at_checked(count)?;
                *bytes = rest;
                Some(Cow::Borrowed(taken))
            }
            Self::Base64(text) => text.take(count).map(Cow::Owned),
        }
    }
}

fn ends_early(array: &Array<'_>) -> Failure {
    let (entries, promised) = ("array".to_owned(), None);
    Failure::at(Place::Line(array.line), Fault::EndsEarly { entries, promised })
}
