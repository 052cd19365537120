//! VTK's XML files of `PolyData` (`.vtp`): the surface of all their pieces, in every encoding that VTK writes.
//!
//! Polygons and triangle strips are the surface; vertices and lines are left out and said. The data of points and
//! cells, and fields, are passed over. The other datasets of the family (`.vtu`, `.vti` …) are refused by name:
//! which surface of a volume is meant is not ours to say.

mod array;
mod base64;
mod document;
mod tags;

use self::array::Decoder;
use self::document::{Array, CellArrays, Document, Piece};
use super::values::Values;
use crate::mesh::error::{Failure, Place};
use crate::mesh::raw::{RawMesh, SameVertex, number};

/// Whether the first tag of the file, after what XML may have before it, is `VTKFile`.
pub fn has_header(text: &[u8]) -> bool {
    tags::Tags::new(text).next().is_some_and(|tag| tag.name == b"VTKFile")
}

/// Reads a VTP file.
pub fn read(bytes: &[u8]) -> Result<RawMesh, Failure> {
    let document = Document::read(bytes)?;
    let mut decoder = Decoder::new(&document, bytes.len());
    let mut raw = RawMesh::new(SameVertex::Index);
    // Cells are numbered through all lists of all pieces.
    let mut cells = 0;
    for piece in &document.pieces {
        let first = number(raw.positions.len())?;
        positions(piece, &mut decoder, &mut raw)?;
        for list in [&piece.vertices, &piece.lines] {
            each_cell(list, piece.points, &mut decoder, &mut cells, |_, place| {
                raw.left_out.push(place);
                Ok(())
            })?;
        }
        each_cell(&piece.polygons, piece.points, &mut decoder, &mut cells, |corners, place| {
            corners.iter_mut().for_each(|corner| *corner += first);
            Ok(raw.face(corners, place)?)
        })?;
        each_cell(&piece.strips, piece.points, &mut decoder, &mut cells, |corners, place| {
            corners.iter_mut().for_each(|corner| *corner += first);
            Ok(raw.strip(corners, place)?)
        })?;
    }
    Ok(raw)
}

fn positions<'a>(
    piece: &Piece<'a>,
    decoder: &mut Decoder<'a>,
    raw: &mut RawMesh,
) -> Result<(), Failure> {
    if piece.points == 0 {
        return Ok(());
    }
    let Some(array) = &piece.positions else {
        return Err(document::malformed(piece.line, "the piece has no Points".to_owned()));
    };
    if array.components != 3 {
        let problem = format!("its points have {} coordinates in place of 3", array.components);
        return Err(document::malformed(array.line, problem));
    }
    let numbers = decoder.open(array, piece.points.checked_mul(3))?;
    let mut values = numbers.values();
    values.list("point", Place::Vertex, Some(piece.points));
    let first = raw.positions.len();
    for index in 0..piece.points {
        values.entry(first + index)?;
        let position = values.position(array.scalar)?;
        raw.position(position, values.place())?;
    }
    values.end_of_file()
}

/// Hands the corners of each cell of a list to `each`, as indices of the points of their piece, with its place.
/// `number` is that of the list's first cell, and becomes that of the next list's.
fn each_cell<'a>(
    list: &CellArrays<'a>,
    points: usize,
    decoder: &mut Decoder<'a>,
    number: &mut usize,
    mut each: impl FnMut(&mut [u32], Place) -> Result<(), Failure>,
) -> Result<(), Failure> {
    if list.count == 0 {
        return Ok(());
    }
    let missing = |name: &str| {
        let problem = format!("{} cells are promised without their `{name}`", list.count);
        document::malformed(list.line, problem)
    };
    let connectivity = list.connectivity.as_ref().ok_or_else(|| missing("connectivity"))?;
    let ends = list.offsets.as_ref().ok_or_else(|| missing("offsets"))?;
    let ends = offsets(ends, list.count, decoder)?;
    let numbers = decoder.open(connectivity, ends.last().copied())?;
    let mut values: Values<'_> = numbers.values();
    values.list("connectivity", Place::Cell, Some(list.count));
    let mut corners = Vec::new();
    let mut start = 0;
    for end in ends {
        values.entry(*number)?;
        corners.clear();
        for _ in start..end {
            corners.push(values.vertex(connectivity.scalar, points)?);
        }
        each(&mut corners, values.place())?;
        start = end;
        *number += 1;
    }
    values.end_of_file()
}

/// Where the corners of each of `count` cells end: never down.
fn offsets<'a>(
    array: &Array<'a>,
    count: usize,
    decoder: &mut Decoder<'a>,
) -> Result<Vec<usize>, Failure> {
    let numbers = decoder.open(array, Some(count))?;
    let mut values = numbers.values();
    values.list("offsets", Place::Entry, Some(count));
    let mut ends: Vec<usize> = Vec::new();
    for index in 0..count {
        values.entry(index)?;
        let end = values.count(array.scalar)?;
        if ends.last().is_some_and(|&last| end < last) {
            return Err(values.malformed("the offsets do not ascend".to_owned()));
        }
        ends.push(end);
    }
    values.end_of_file()?;
    Ok(ends)
}

#[cfg(test)]
mod tests;
