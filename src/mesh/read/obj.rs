//! Wavefront OBJ: every object and group of the file as one mesh, vertices in the order of the `v` lines.
//!
//! Corners meet where they name the same position, whatever their texture and normal indices are, so seams do
//! not cut the surface. Grouping, materials and comments change nothing.

mod lines;

use tobj::{LoadError, LoadOptions};

use self::lines::{Geometry, Line, lines};
use crate::mesh::error::{Failure, Fault, Place};
use crate::mesh::raw::{RawMesh, SameVertex};

/// Faces are kept whole, so that each can be told from its line; points and lines too, for the same reason.
const OPTIONS: LoadOptions = LoadOptions {
    single_index: false,
    triangulate: false,
    ignore_points: false,
    ignore_lines: false,
};

/// Reads an OBJ file.
pub fn read(text: &[u8]) -> Result<RawMesh, Failure> {
    let mut raw = RawMesh::new(SameVertex::Index);
    let mut vertices = 0_usize;
    for line in lines(text) {
        let number = u32::try_from(line.number).map_err(|_| Fault::TooLarge)?;
        match line.keyword() {
            b"v" => vertices += 1,
            b"p" | b"l" | b"curv" | b"curv2" | b"surf" => {
                raw.left_out.push(Place::Line(number));
            }
            _ => {}
        }
    }

    let mut geometry = Geometry::new(lines(text), vertices);
    let no_materials = |_: &std::path::Path| Err(LoadError::GenericFailure);
    let mesh = match tobj::load_obj_buf(&mut geometry, &OPTIONS, no_materials) {
        Ok((models, _)) => models.into_iter().next().map(|model| model.mesh),
        Err(LoadError::FaceVertexOutOfBounds) => return Err(index_out_of_range(text, vertices)),
        Err(reason) => return Err(unparsable(geometry.at.as_ref(), reason)),
    };

    let mesh = mesh.unwrap_or_default();
    for (&position, &line) in mesh.positions.as_chunks().0.iter().zip(&geometry.positions) {
        raw.position(position, Place::Line(line))?;
    }
    let faces = split_faces(&mesh, usize::from(vertices > 0));
    for (face, &line) in faces.zip(&geometry.faces) {
        raw.face(face, Place::Line(line))?;
    }
    Ok(raw)
}

/// The corners of each face after the first `skipped`, as indices of positions. tobj leaves the arities out
/// when all faces are triangles.
fn split_faces(mesh: &tobj::Mesh, skipped: usize) -> impl Iterator<Item = &[u32]> {
    let mut rest = mesh.indices.as_slice();
    let mut arities = mesh.face_arities.iter();
    let all_triangles = mesh.face_arities.is_empty();
    std::iter::from_fn(move || {
        let arity = if all_triangles {
            (!rest.is_empty()).then_some(3)?
        } else {
            *arities.next()? as usize
        };
        let (face, others) = rest.split_at_checked(arity)?;
        rest = others;
        Some(face)
    })
    .skip(skipped)
}

fn unparsable(at: Option<&Line<'_>>, reason: LoadError) -> Failure {
    let text = at.map_or_else(String::new, |line| {
        let shown = line.text.get(..60).unwrap_or(&line.text);
        String::from_utf8_lossy(shown).into_owned()
    });
    Failure { place: at.map(place), fault: Fault::Unparsable { text, reason } }
}

/// Finds the face that tobj refused without saying which.
fn index_out_of_range(text: &[u8], vertices: usize) -> Failure {
    let mut above = 0_i64;
    for line in lines(text) {
        match line.keyword() {
            b"v" => above += 1,
            b"f" => {
                for word in line.words().skip(1) {
                    let digits = word.split(|&b| b == b'/').next().unwrap_or(word);
                    let parsed = std::str::from_utf8(digits).ok().map(str::parse::<i64>);
                    let index = parsed.and_then(Result::ok).unwrap_or(0);
                    let position = if index < 0 { above + index + 1 } else { index };
                    if position < 1 || position > vertices as i64 {
                        let fault = Fault::IndexOutOfRange { index, vertices };
                        return Failure::at(place(&line), fault);
                    }
                }
            }
            _ => {}
        }
    }
    unparsable(None, LoadError::FaceVertexOutOfBounds)
}

fn place(line: &Line<'_>) -> Place {
    Place::Line(u32::try_from(line.number).unwrap_or(u32::MAX))
}

#[cfg(test)]
mod tests;
