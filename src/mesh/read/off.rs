//! Geomview's OFF, as text: a header, counts, a line a vertex, a line a face.
//!
//! The header is `OFF` with prefixes that say what follows x y z on each vertex line (`N` normals, `C` colours,
//! `ST` texture coordinates): no business of ours, nor are the colours that follow the corners of a face. The
//! header may be missing, and the counts may stand on its line. `#` starts a comment.

use super::scan::Scanner;
use super::values::{Layout, Scalar, Values, parse};
use crate::mesh::error::{Failure, Fault, Place};
use crate::mesh::raw::{RawMesh, SameVertex};

/// Whether the first word of `text` is a header.
pub fn has_header(text: &[u8]) -> bool {
    Scanner::new(text).with_comments(b'#').word().is_some_and(|word| header(word).is_some())
}

/// Reads an OFF file.
pub fn read(text: &[u8]) -> Result<RawMesh, Failure> {
    let scanner = Scanner::new(text).with_comments(b'#');
    let mut values = Values::new("OFF", scanner, Layout::Lines);
    let [vertices, faces] = counts(&mut values)?;
    let mut raw = RawMesh::new(SameVertex::Index);
    values.list("vertex", Place::Vertex, Some(vertices));
    for index in 0..vertices {
        values.entry(index)?;
        raw.position(values.position(Scalar::F64)?, values.place())?;
    }
    values.list("face", Place::Face, Some(faces));
    let mut corners = Vec::new();
    for index in 0..faces {
        values.entry(index)?;
        corners.clear();
        for _ in 0..values.count(Scalar::I64)? {
            corners.push(values.vertex(Scalar::I64, vertices)?);
        }
        raw.face(&corners, values.place())?;
    }
    // What is left of the last line is its colour.
    values.scanner.skip_line();
    values.end_of_file()?;
    Ok(raw)
}

/// How many vertices and faces there are. How many edges is seldom true, and not needed.
fn counts(values: &mut Values<'_>) -> Result<[usize; 2], Failure> {
    values.list("header", Place::Entry, None);
    values.entry(0)?;
    let mut word = values.scanner.word_of_line();
    if let Some(header) = word.and_then(header) {
        if header.dimensions {
            return Err(values.failure(Fault::NotRead {
                what: "OFF with four or more coordinates a vertex".to_owned(),
                remedy: "export three",
            }));
        }
        word = if header.rest.is_empty() { values.scanner.word() } else { Some(header.rest) };
    }
    if word.is_some_and(|word| word.eq_ignore_ascii_case(b"BINARY")) {
        let what = "binary OFF".to_owned();
        return Err(values.failure(Fault::NotRead { what, remedy: "export it as text" }));
    }
    let counts = [word, values.scanner.word_of_line()].map(|word| match word {
        Some(word) => parse(word, "a count").map_err(|fault| values.failure(fault)),
        None => Err(values.malformed("the counts of vertices and faces are missing".to_owned())),
    });
    let [vertices, faces] = counts;
    Ok([vertices?, faces?])
}

struct Header<'a> {
    /// Whether the vertices have another number of coordinates than three.
    dimensions: bool,
    /// What follows `OFF` without a blank: a count, in files that forgot the line break.
    rest: &'a [u8],
}

fn header(word: &[u8]) -> Option<Header<'_>> {
    let mut rest = word;
    let mut dimensions = false;
    for prefix in ["ST", "C", "N", "4", "n"] {
        if let Some(further) = rest.strip_prefix(prefix.as_bytes()) {
            rest = further;
            dimensions |= matches!(prefix, "4" | "n");
        }
    }
    let rest = rest.strip_prefix(b"OFF")?;
    rest.iter().all(u8::is_ascii_digit).then_some(Header { dimensions, rest })
}

#[cfg(test)]
mod tests;
