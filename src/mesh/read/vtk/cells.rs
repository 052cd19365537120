//! The lists of cells of a legacy VTK file, in both layouts.
//!
//! Classic: `POLYGONS n size`, then n times the number of corners and the corners, `size` numbers in all.
//! VTK 5: `POLYGONS n+1 size`, then `OFFSETS type` with n+1 numbers, where each cell begins and the last one ends in
//! what follows, and `CONNECTIVITY type` with the `size` corners.

use super::file::File;
use crate::mesh::error::{Failure, Fault, Place};
use crate::mesh::raw::{Places, RawMesh};
use crate::mesh::read::values::Scalar;

/// A list of cells, their corners in range.
#[derive(Default)]
pub struct Cells {
    corners: Vec<u32>,
    /// Where the corners of each cell end.
    ends: Vec<usize>,
    places: Places,
}

impl Cells {
    /// Reads what follows the keyword. `first` is the number of the list's first cell.
    pub fn read(file: &mut File<'_>, vertices: usize, first: usize) -> Result<Self, Failure> {
        let (count, size) = (file.count()?, file.count()?);
        let mut cells = Self::default();
        if file.next_line_is("OFFSETS") {
            cells.read_vtk5(file, [count, size], vertices, first)?;
        } else {
            cells.read_classic(file, [count, size], vertices, first)?;
        }
        Ok(cells)
    }

    fn read_classic(
        &mut self,
        file: &mut File<'_>,
        [count, size]: [usize; 2],
        vertices: usize,
        first: usize,
    ) -> Result<(), Failure> {
        let values = file.data();
        values.list("cell", Place::Cell, Some(count));
        let mut left = size;
        for index in 0..count {
            values.entry(first.saturating_add(index))?;
            let corners = values.count(Scalar::I32)?;
            let place = values.place();
            left = corners.checked_add(1).and_then(|taken| left.checked_sub(taken)).ok_or_else(
                || values.malformed(format!("the cells take more than {size} numbers")),
            )?;
            for _ in 0..corners {
                self.corners.push(values.vertex(Scalar::I32, vertices)?);
            }
            self.end(place);
        }
        match left {
            0 => Ok(()),
            _ => Err(values.malformed(format!("the cells take {left} fewer than {size} numbers"))),
        }
    }

    fn read_vtk5(
        &mut self,
        file: &mut File<'_>,
        [count, size]: [usize; 2],
        vertices: usize,
        first: usize,
    ) -> Result<(), Failure> {
        let offsets = offsets(file, [count, size])?;
        if file.keyword().as_deref() != Some("CONNECTIVITY") {
            return Err(file.malformed("CONNECTIVITY is expected here".to_owned()));
        }
        let scalar = file.scalar()?;
        let values = file.data();
        values.list("CONNECTIVITY", Place::Cell, Some(size));
        for (index, ends) in offsets.windows(2).enumerate() {
            values.entry(first.saturating_add(index))?;
            while ends.last().is_some_and(|&end| self.corners.len() < end) {
                self.corners.push(values.vertex(scalar, vertices)?);
            }
            self.end(values.place());
        }
        Ok(())
    }

    fn end(&mut self, place: Place) {
        self.ends.push(self.corners.len());
        self.places.push(place);
    }

    pub fn len(&self) -> usize {
        self.ends.len()
    }

    /// The corners and the place of each cell.
    pub fn iter(&self) -> impl Iterator<Item = (&[u32], Place)> {
        let mut start = 0;
        self.ends.iter().enumerate().filter_map(move |(index, &end)| {
            let corners = self.corners.get(start..end)?;
            start = end;
            Some((corners, self.places.get(index)?))
        })
    }
}

/// Reads `OFFSETS`: from 0 up to `size`, never down.
fn offsets(file: &mut File<'_>, [count, size]: [usize; 2]) -> Result<Vec<usize>, Failure> {
    // The keyword is there, or this would be the classic layout.
    file.keyword();
    let scalar = file.scalar()?;
    let values = file.data();
    values.list("OFFSETS", Place::Entry, Some(count));
    let mut offsets = Vec::new();
    for index in 0..count {
        values.entry(index)?;
        let offset = values.count(scalar)?;
        if offset < offsets.last().copied().unwrap_or_default() {
            return Err(values.malformed("the offsets do not ascend".to_owned()));
        }
        offsets.push(offset);
    }
    match (offsets.first(), offsets.last()) {
        (None, _) if size == 0 => Ok(offsets),
        (Some(0), Some(&last)) if last == size => Ok(offsets),
        _ => Err(values.malformed(format!("the offsets do not run from 0 to {size}"))),
    }
}

/// Reads what follows `CELL_TYPES`, and makes faces of the cells of a grid.
pub fn shapes(grid: &Cells, file: &mut File<'_>, raw: &mut RawMesh) -> Result<(), Failure> {
    let count = file.count()?;
    if count != grid.len() {
        let problem = format!("there are {count} CELL_TYPES for {} CELLS", grid.len());
        return Err(file.malformed(problem));
    }
    let values = file.data();
    values.list("CELL_TYPES", Place::Cell, Some(count));
    for (index, (corners, place)) in grid.iter().enumerate() {
        values.entry(index)?;
        // The numbers of vtkCellType.h.
        match (values.integer(Scalar::I32)?, corners) {
            // Nothing, points and lines.
            (0..=4, _) => raw.left_out.push(place),
            // A triangle, a polygon, a quadrilateral.
            (5 | 7 | 9, _) => raw.face(corners, place)?,
            (6, _) => raw.strip(corners, place)?,
            // A pixel is a quadrilateral whose corners go row by row.
            (8, &[a, b, c, d]) => raw.face(&[a, b, d, c], place)?,
            (kind, _) => {
                return Err(values.failure(Fault::NotRead {
                    what: format!("cell type {kind}, a volume or a curved cell,"),
                    remedy: "save the surface as POLYDATA (in ParaView: Extract Surface)",
                }));
            }
        }
    }
    Ok(())
}
