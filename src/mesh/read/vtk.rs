//! Legacy VTK, as text and as big-endian bytes: the surface of a `POLYDATA`, or of an `UNSTRUCTURED_GRID` of flat
//! cells, in the classic layout of cells and in that of VTK 5.
//!
//! Polygons and triangle strips are the surface; vertices and lines are left out and said. The data of points and
//! cells, and fields, are passed over. Grids of volumes are refused: which surface of them is meant is not ours to say.

mod cells;
mod file;

use self::cells::{Cells, shapes};
use self::file::File;
use crate::mesh::error::{Failure, Place};
use crate::mesh::raw::{RawMesh, SameVertex};

/// Reads a legacy VTK file.
pub fn read(bytes: &[u8]) -> Result<RawMesh, Failure> {
    let mut file = File::open(bytes)?;
    let mut raw = RawMesh::new(SameVertex::Index);
    let mut grid = None;
    // How many cells have been read: they are numbered through all lists.
    let mut count = 0;
    while let Some(keyword) = file.keyword() {
        let mut cells = |file: &mut File<'_>| {
            let cells = Cells::read(file, raw.positions.len(), count)?;
            count += cells.len();
            Ok::<_, Failure>(cells)
        };
        match keyword.as_str() {
            "POLYGONS" => {
                for (corners, place) in cells(&mut file)?.iter() {
                    raw.face(corners, place)?;
                }
            }
            "TRIANGLE_STRIPS" => {
                for (corners, place) in cells(&mut file)?.iter() {
                    raw.strip(corners, place)?;
                }
            }
            "VERTICES" | "LINES" => {
                raw.left_out.extend(cells(&mut file)?.iter().map(|(_, place)| place));
            }
            "CELLS" if grid.is_none() => grid = Some(cells(&mut file)?),
            "CELL_TYPES" => shapes(&grid.take().unwrap_or_default(), &mut file, &mut raw)?,
            "POINTS" if raw.positions.is_empty() => points(&mut file, &mut raw)?,
            "FIELD" => file.pass_over_field()?,
            "METADATA" => file.pass_over_metadata(),
            // No geometry follows.
            "POINT_DATA" | "CELL_DATA" => break,
            _ => return Err(file.malformed(format!("`{keyword}` is not expected here"))),
        }
    }
    match grid {
        Some(_) => Err(file.malformed("there are CELLS and no CELL_TYPES".to_owned())),
        None => Ok(raw),
    }
}

fn points(file: &mut File<'_>, raw: &mut RawMesh) -> Result<(), Failure> {
    let count = file.count()?;
    let scalar = file.scalar()?;
    let values = file.data();
    values.list("POINTS", Place::Vertex, Some(count));
    for index in 0..count {
        values.entry(index)?;
        raw.position(values.position(scalar)?, values.place())?;
    }
    Ok(())
}

#[cfg(test)]
mod tests;
