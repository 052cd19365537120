//! PLY, as text and as bytes of either order: the elements `vertex`, `face` and `tristrips` of a file that may hold
//! any others.
//!
//! Positions are the properties x, y and z, of whatever type and wherever they stand; the corners of faces and
//! strips are the list `vertex_indices` or `vertex_index`. All else is passed over unread.

mod header;

use self::header::{Element, Header, Kind, Property};
use super::scan::Scanner;
use super::values::Values;
use crate::mesh::error::{Failure, Place};
use crate::mesh::raw::{RawMesh, SameVertex};

/// Reads a PLY file.
pub fn read(bytes: &[u8]) -> Result<RawMesh, Failure> {
    let mut scanner = Scanner::new(bytes);
    let Header { layout, elements } = Header::read(&mut scanner)?;
    // Faces may stand before their vertices.
    let named = |name| elements.iter().find(|element: &&Element| element.name == name);
    let vertices = named("vertex").map_or(0, |element| element.count);
    let mut values = Values::new("PLY", scanner, layout);
    let mut raw = RawMesh::new(SameVertex::Index);
    for element in &elements {
        match element.name.as_str() {
            "vertex" => positions(element, &mut values, &mut raw)?,
            "face" => faces(element, &mut values, vertices, &mut raw)?,
            "tristrips" => strips(element, &mut values, vertices, &mut raw)?,
            _ => pass_over(element, &mut values)?,
        }
    }
    values.end_of_file()?;
    Ok(raw)
}

fn positions(element: &Element, values: &mut Values<'_>, raw: &mut RawMesh) -> Result<(), Failure> {
    if element.count == 0 {
        return Ok(());
    }
    let axes = [element.scalar("x")?, element.scalar("y")?, element.scalar("z")?];
    values.list("vertex", Place::Vertex, Some(element.count));
    for index in 0..element.count {
        values.entry(index)?;
        let mut position = [0.0; 3];
        for (at, property) in element.properties.iter().enumerate() {
            match (axes.iter().position(|&axis| axis == at), property.kind) {
                (Some(axis), Kind::Scalar(scalar)) => position[axis] = values.float(scalar)?,
                _ => pass_over_one(property, values)?,
            }
        }
        values.end_of_entry()?;
        raw.position(position, values.place())?;
    }
    Ok(())
}

fn faces(
    element: &Element,
    values: &mut Values<'_>,
    vertices: usize,
    raw: &mut RawMesh,
) -> Result<(), Failure> {
    values.list("face", Place::Face, Some(element.count));
    let mut corners = Vec::new();
    indices(element, values, |values, indices| {
        corners.clear();
        for &index in indices {
            corners.push(values.in_range(index, vertices)?);
        }
        Ok(raw.face(&corners, values.place())?)
    })
}

fn strips(
    element: &Element,
    values: &mut Values<'_>,
    vertices: usize,
    raw: &mut RawMesh,
) -> Result<(), Failure> {
    values.list("tristrips", Place::Strip, Some(element.count));
    let mut corners = Vec::new();
    indices(element, values, |values, indices| {
        // −1 ends a strip and begins the next.
        for strip in indices.split(|&index| index == -1).filter(|strip| !strip.is_empty()) {
            corners.clear();
            for &index in strip {
                corners.push(values.in_range(index, vertices)?);
            }
            raw.strip(&corners, values.place())?;
        }
        Ok(())
    })
}

/// Hands the list of vertex indices of each entry to `each`.
fn indices(
    element: &Element,
    values: &mut Values<'_>,
    mut each: impl FnMut(&Values<'_>, &[i64]) -> Result<(), Failure>,
) -> Result<(), Failure> {
    if element.count == 0 {
        return Ok(());
    }
    let corners = element.corners()?;
    let mut indices = Vec::new();
    for entry in 0..element.count {
        values.entry(entry)?;
        indices.clear();
        for (at, property) in element.properties.iter().enumerate() {
            match property.kind {
                Kind::List { count, item } if at == corners => {
                    for _ in 0..values.count(count)? {
                        indices.push(values.integer(item)?);
                    }
                }
                _ => pass_over_one(property, values)?,
            }
        }
        values.end_of_entry()?;
        each(values, &indices)?;
    }
    Ok(())
}

fn pass_over(element: &Element, values: &mut Values<'_>) -> Result<(), Failure> {
    // Entries without properties take no room, however many there are.
    if element.properties.is_empty() {
        return Ok(());
    }
    values.list(&element.name, Place::Entry, Some(element.count));
    for index in 0..element.count {
        values.entry(index)?;
        for property in &element.properties {
            pass_over_one(property, values)?;
        }
        values.end_of_entry()?;
    }
    Ok(())
}

fn pass_over_one(property: &Property, values: &mut Values<'_>) -> Result<(), Failure> {
    match property.kind {
        Kind::Scalar(scalar) => values.skip(scalar, 1),
        Kind::List { count, item } => {
            let count = values.count(count)?;
            values.skip(item, count)
        }
    }
}

#[cfg(test)]
mod tests;
