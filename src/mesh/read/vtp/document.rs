//! What a VTP file consists of, before any number is read: its pieces, and where each array of theirs has its
//! numbers.

use super::tags::{Kind, Tag, Tags};
use crate::mesh::error::{Failure, Fault, Place};
use crate::mesh::read::values::{Order, Scalar, excerpt, parse};

/// A file of `PolyData`.
pub struct Document<'a> {
    /// Of all numbers that are bytes.
    pub order: Order,
    /// Of the numbers of bytes that stand before an array.
    pub header: Scalar,
    /// Whether arrays that are bytes are compressed by zlib.
    pub compressed: bool,
    pub pieces: Vec<Piece<'a>>,
    pub appended: Option<Appended<'a>>,
}

/// What follows `<AppendedData encoding="…">_`: the arrays that are elsewhere named by their offsets, to the end of
/// the file.
#[derive(Clone, Copy)]
pub struct Appended<'a> {
    pub encoding: Encoding,
    pub bytes: &'a [u8],
}

#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    Raw,
    Base64,
}

/// Points, and lists of cells between them.
pub struct Piece<'a> {
    pub line: u32,
    pub points: usize,
    pub positions: Option<Array<'a>>,
    pub vertices: CellArrays<'a>,
    pub lines: CellArrays<'a>,
    pub strips: CellArrays<'a>,
    pub polygons: CellArrays<'a>,
}

/// A list of cells: all their corners, and where those of each end.
pub struct CellArrays<'a> {
    pub line: u32,
    pub count: usize,
    pub connectivity: Option<Array<'a>>,
    pub offsets: Option<Array<'a>>,
}

/// A `DataArray`.
pub struct Array<'a> {
    pub line: u32,
    pub scalar: Scalar,
    pub components: usize,
    pub content: Content<'a>,
}

/// Where the numbers of an array are.
pub enum Content<'a> {
    /// Here, as text that begins on this line.
    Text(&'a [u8], u32),
    /// Here, as base64.
    Inline(&'a [u8]),
    /// So many bytes into what is appended.
    Appended(usize),
}

/// The parts of a piece that have arrays which are read.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Part {
    Points,
    Verts,
    Lines,
    Strips,
    Polys,
}

impl Part {
    fn of(name: &[u8]) -> Option<Self> {
        Some(match name {
            b"Points" => Self::Points,
            b"Verts" => Self::Verts,
            b"Lines" => Self::Lines,
            b"Strips" => Self::Strips,
            b"Polys" => Self::Polys,
            _ => return None,
        })
    }
}

impl<'a> Document<'a> {
    /// Finds the parts of a file whose first tag is `VTKFile`.
    pub fn read(bytes: &'a [u8]) -> Result<Self, Failure> {
        let mut tags = Tags::new(bytes);
        let first = tags.next().ok_or_else(|| malformed(1, "it has no tags".to_owned()))?;
        let mut document = Self::of_header(&first)?;
        let mut part = None;
        let mut ended = false;
        while let Some(tag) = tags.next() {
            match (tag.name, tag.kind) {
                (b"Piece", Kind::Open | Kind::Empty) => {
                    document.pieces.push(Piece::of(&tag)?);
                    part = None;
                }
                (b"DataArray", Kind::Open | Kind::Empty) => {
                    let content = match tag.kind {
                        Kind::Open => content(bytes, &mut tags, &tag)?,
                        _ => (&[][..], tag.line),
                    };
                    let piece = document.pieces.last_mut();
                    if let (Some(piece), Some(part)) = (piece, part) {
                        piece.keep(part, &tag, content)?;
                    }
                }
                (b"AppendedData", Kind::Open) => {
                    document.appended = Some(appended(bytes, &tag)?);
                    // What follows may be no text.
                    ended = bytes.trim_ascii_end().ends_with(b"</VTKFile>");
                    break;
                }
                (b"VTKFile", Kind::Close) => {
                    ended = true;
                    break;
                }
                (name, Kind::Open) if Part::of(name).is_some() => part = Part::of(name),
                (b"PointData" | b"CellData" | b"FieldData", Kind::Open) => part = None,
                (name, Kind::Close) if part.is_some() && Part::of(name) == part => part = None,
                _ => {}
            }
        }
        if ended {
            Ok(document)
        } else {
            let (entries, promised) = ("closing tag".to_owned(), None);
            Err(Fault::EndsEarly { entries, promised }.into())
        }
    }

    fn of_header(tag: &Tag<'a>) -> Result<Self, Failure> {
        let refuse = |what: String, remedy| {
            Err(Failure::at(Place::Line(tag.line), Fault::NotRead { what, remedy }))
        };
        match tag.attribute("type") {
            Some(b"PolyData") => {}
            other => {
                return refuse(
                    format!("the VTK dataset {}", excerpt(other.unwrap_or(b"without a type"))),
                    "save the surface as PolyData (in ParaView: Extract Surface)",
                );
            }
        }
        let compressed = match tag.attribute("compressor") {
            None | Some(b"") => false,
            Some(b"vtkZLibDataCompressor") => true,
            Some(other) => {
                return refuse(
                    format!("data compressed by {}", excerpt(other)),
                    "save with the zlib compressor, or without",
                );
            }
        };
        let order = match tag.attribute("byte_order") {
            None | Some(b"LittleEndian") => Order::LittleEndian,
            Some(b"BigEndian") => Order::BigEndian,
            Some(other) => return Err(unknown(tag, "byte_order", other)),
        };
        let header = match tag.attribute("header_type") {
            None | Some(b"UInt32") => Scalar::U32,
            Some(b"UInt64") => Scalar::U64,
            Some(other) => return Err(unknown(tag, "header_type", other)),
        };
        Ok(Self { order, header, compressed, pieces: Vec::new(), appended: None })
    }
}

/// The text of an array, and the line on which it begins; what is between tags of its own is information about it.
fn content<'a>(
    bytes: &'a [u8],
    tags: &mut Tags<'a>,
    array: &Tag<'a>,
) -> Result<(&'a [u8], u32), Failure> {
    let (mut depth, mut before, mut found) = (0_usize, *array, (&[][..], array.line));
    for tag in tags {
        let text = bytes.get(before.end..tag.start).unwrap_or_default();
        if depth == 0 && !text.trim_ascii().is_empty() {
            found = (text, before.line);
        }
        match tag.kind {
            Kind::Open => depth += 1,
            Kind::Close if depth > 0 => depth -= 1,
            Kind::Close => return Ok(found),
            Kind::Empty => {}
        }
        before = tag;
    }
    Err(malformed(array.line, "the array is not closed".to_owned()))
}

fn appended<'a>(bytes: &'a [u8], tag: &Tag<'a>) -> Result<Appended<'a>, Failure> {
    let encoding = match tag.attribute("encoding") {
        Some(b"raw") => Encoding::Raw,
        None | Some(b"base64") => Encoding::Base64,
        Some(other) => return Err(unknown(tag, "encoding", other)),
    };
    let rest = bytes.get(tag.end..).unwrap_or_default().trim_ascii_start();
    match rest.strip_prefix(b"_") {
        Some(bytes) => Ok(Appended { encoding, bytes }),
        None => Err(malformed(tag.line, "no `_` begins the appended data".to_owned())),
    }
}

impl<'a> Piece<'a> {
    fn of(tag: &Tag<'a>) -> Result<Self, Failure> {
        let list = |name| {
            let count = count(tag, name)?;
            Ok::<_, Failure>(CellArrays {
                line: tag.line,
                count,
                connectivity: None,
                offsets: None,
            })
        };
        Ok(Self {
            line: tag.line,
            points: count(tag, "NumberOfPoints")?,
            positions: None,
            vertices: list("NumberOfVerts")?,
            lines: list("NumberOfLines")?,
            strips: list("NumberOfStrips")?,
            polygons: list("NumberOfPolys")?,
        })
    }

    /// Takes note of an array; one that no part asks for is passed over.
    fn keep(&mut self, part: Part, tag: &Tag<'a>, content: (&'a [u8], u32)) -> Result<(), Failure> {
        let list = match part {
            Part::Points => {
                self.positions = Some(Array::of(tag, content)?);
                return Ok(());
            }
            Part::Verts => &mut self.vertices,
            Part::Lines => &mut self.lines,
            Part::Strips => &mut self.strips,
            Part::Polys => &mut self.polygons,
        };
        match tag.attribute("Name") {
            Some(b"connectivity") => list.connectivity = Some(Array::of(tag, content)?),
            Some(b"offsets") => list.offsets = Some(Array::of(tag, content)?),
            _ => {}
        }
        Ok(())
    }
}

impl<'a> Array<'a> {
    fn of(tag: &Tag<'a>, (text, line): (&'a [u8], u32)) -> Result<Self, Failure> {
        let scalar = match tag.attribute("type").unwrap_or_default() {
            b"Int8" => Scalar::I8,
            b"UInt8" => Scalar::U8,
            b"Int16" => Scalar::I16,
            b"UInt16" => Scalar::U16,
            b"Int32" => Scalar::I32,
            b"UInt32" => Scalar::U32,
            b"Int64" => Scalar::I64,
            b"UInt64" => Scalar::U64,
            b"Float32" => Scalar::F32,
            b"Float64" => Scalar::F64,
            other => return Err(unknown(tag, "type", other)),
        };
        let content = match tag.attribute("format") {
            None | Some(b"ascii") => Content::Text(text, line),
            Some(b"binary") => Content::Inline(text),
            Some(b"appended") => Content::Appended(count(tag, "offset")?),
            Some(other) => return Err(unknown(tag, "format", other)),
        };
        let components = match tag.attribute("NumberOfComponents") {
            None => 1,
            Some(_) => count(tag, "NumberOfComponents")?,
        };
        Ok(Self { line: tag.line, scalar, components, content })
    }
}

/// The number in an attribute; 0 where it is missing.
fn count(tag: &Tag<'_>, name: &str) -> Result<usize, Failure> {
    match tag.attribute(name) {
        None => Ok(0),
        Some(text) => {
            parse(text, "a count").map_err(|fault| Failure::at(Place::Line(tag.line), fault))
        }
    }
}

fn unknown(tag: &Tag<'_>, attribute: &str, value: &[u8]) -> Failure {
    malformed(tag.line, format!("the {attribute} `{}` is unknown", excerpt(value)))
}

pub fn malformed(line: u32, problem: String) -> Failure {
    Failure::at(Place::Line(line), Fault::Malformed { format: "VTP", problem })
}
