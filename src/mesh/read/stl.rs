//! STL, as text and as bytes: facets of three positions each, in single precision where they are bytes.
//!
//! The format has no indices: corners are one vertex where their positions are equal. Normals and the attribute
//! of a binary facet change nothing; the solids of a text file are its objects.

use super::scan::Scanner;
use super::values::{Layout, Order, Scalar, Values, excerpt};
use crate::mesh::error::{Failure, Fault, Place};
use crate::mesh::raw::{RawMesh, SameVertex};

/// A binary file: a header that may hold anything, the number of facets, and the facets.
const HEADER: usize = 80;
const FACET: usize = 50;

/// Whether the bytes are as many as a binary file of their number of facets has. Hardly any other file does that.
pub fn is_exactly_binary(bytes: &[u8]) -> bool {
    let length = facets(bytes).and_then(|n| n.checked_mul(FACET)?.checked_add(HEADER + 4));
    length == Some(bytes.len())
}

/// Whether the file begins as text does. The header of a binary file may too.
pub fn begins_as_text(bytes: &[u8]) -> bool {
    Scanner::new(bytes).word().is_some_and(|word| word.eq_ignore_ascii_case(b"solid"))
}

/// Reads an STL file.
pub fn read(bytes: &[u8]) -> Result<RawMesh, Failure> {
    // Every real number of facets holds a zero byte; no text does.
    let text = begins_as_text(bytes) && !bytes.contains(&0);
    if text && !is_exactly_binary(bytes) { read_text(bytes) } else { read_binary(bytes) }
}

fn facets(bytes: &[u8]) -> Option<usize> {
    let count = bytes.get(HEADER..)?.first_chunk()?;
    usize::try_from(u32::from_le_bytes(*count)).ok()
}

fn read_binary(bytes: &[u8]) -> Result<RawMesh, Failure> {
    // What looks like a byte order mark is a part of the header.
    let scanner = Scanner::from_line(bytes, 1);
    let mut values = Values::new("STL", scanner, Layout::Bytes(Order::LittleEndian));
    values.list("header", Place::Entry, None);
    values.skip(Scalar::U8, HEADER)?;
    let facets = values.count(Scalar::U32)?;
    let mut raw = RawMesh::new(SameVertex::Position);
    values.list("facet", Place::Face, Some(facets));
    for index in 0..facets {
        values.entry(index)?;
        values.skip(Scalar::F32, 3)?;
        let mut triangle = [0; 3];
        for (corner, j) in triangle.iter_mut().zip(0..) {
            let vertex = u32::try_from(3 * index + j).map_err(|_| Fault::TooLarge)?;
            *corner = raw.position(values.position(Scalar::F32)?, Place::Vertex(vertex))?;
        }
        values.skip(Scalar::U16, 1)?;
        raw.triangle(triangle, values.place())?;
    }
    values.end_of_file()?;
    Ok(raw)
}

fn read_text(bytes: &[u8]) -> Result<RawMesh, Failure> {
    let mut values = Values::new("STL", Scanner::new(bytes), Layout::Words);
    values.list("facet", Place::Face, None);
    let mut raw = RawMesh::new(SameVertex::Position);
    let mut open = false;
    while let Some(word) = values.scanner.word() {
        match word.to_ascii_lowercase().as_slice() {
            b"facet" => facet(&mut values, &mut raw)?,
            // A name follows, of any number of words.
            keyword @ (b"solid" | b"endsolid") => {
                open = keyword == b"solid";
                let name = String::from_utf8_lossy(values.scanner.rest_of_line().trim_ascii());
                if open {
                    raw.begin_object((!name.is_empty()).then(|| name.into_owned()));
                }
            }
            _ => return Err(unexpected(&values, "facet` or `endsolid", word)),
        }
    }
    if open { Err(values.ends_early()) } else { Ok(raw) }
}

fn facet(values: &mut Values<'_>, raw: &mut RawMesh) -> Result<(), Failure> {
    let place = values.place();
    keyword(values, "normal")?;
    values.skip(Scalar::F64, 3)?;
    keyword(values, "outer")?;
    keyword(values, "loop")?;
    let mut triangle = [0; 3];
    for corner in &mut triangle {
        keyword(values, "vertex")?;
        *corner = raw.position(values.position(Scalar::F64)?, values.place())?;
    }
    keyword(values, "endloop")?;
    keyword(values, "endfacet")?;
    raw.triangle(triangle, place)?;
    Ok(())
}

fn keyword(values: &mut Values<'_>, expected: &str) -> Result<(), Failure> {
    match values.scanner.word() {
        Some(word) if word.eq_ignore_ascii_case(expected.as_bytes()) => Ok(()),
        Some(word) => Err(unexpected(values, expected, word)),
        None => Err(values.ends_early()),
    }
}

fn unexpected(values: &Values<'_>, expected: &str, word: &[u8]) -> Failure {
    values.malformed(format!("`{expected}` is expected here, not `{}`", excerpt(word)))
}

#[cfg(test)]
mod tests;
