//! Wavefront OBJ: every object and group of the file as one mesh, vertices in the order of the `v` lines.
//!
//! Corners meet where they name the same position, whatever their texture and normal indices are, so seams do
//! not cut the surface. Materials and comments change nothing. Its objects are those of its `o` lines, or where there are none the
//! groups of its `g` lines; a name that comes again goes on with what it named before.

mod lines;

use std::collections::HashMap;

use tobj::{LoadError, LoadOptions};

use self::lines::{Geometry, Line, lines};
use crate::mesh::error::{Failure, Fault, Place};
use crate::mesh::raw::{RawMesh, SameVertex};
use crate::mesh::read::values::excerpt;

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
    let mut grouping = Grouping::default();
    // The last line, where it is a face of too few corners.
    let mut short = None;
    for line in lines(text) {
        let number = u32::try_from(line.number).map_err(|_| Fault::TooLarge)?;
        let keyword = line.keyword();
        short = (keyword == b"f" && line.words().count() < 4).then_some(Place::Line(number));
        match keyword {
            b"v" => vertices += 1,
            b"p" | b"l" | b"curv" | b"curv2" | b"surf" => grouping.left_out.push(number),
            b"o" => grouping.objects.begins(&line, number),
            b"g" => grouping.groups.begins(&line, number),
            _ => {}
        }
    }
    let is_open = !text.ends_with(b"\n") || text.trim_ascii_end().ends_with(b"\\");
    if let Some(place) = short.filter(|_| is_open) {
        let entries = "face".to_owned();
        return Err(Failure::at(place, Fault::EndsEarly { entries, promised: None }));
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
        grouping.until(line, &mut raw);
        raw.face(face, Place::Line(line))?;
    }
    grouping.until(u32::MAX, &mut raw);
    Ok(raw)
}

/// What stands beside geometry.
#[derive(Default)]
struct Grouping {
    objects: Named,
    groups: Named,
    /// Lines that are no surface.
    left_out: Vec<u32>,
    /// How many of the lines were taken note of, of names and of these.
    noted: (usize, usize),
    /// The numbers of the objects that have begun, by name.
    begun: Vec<Option<usize>>,
}

/// Lines that name what follows.
#[derive(Default)]
struct Named {
    names: Vec<String>,
    index: HashMap<Vec<u8>, u32>,
    /// Their numbers, and which name.
    lines: Vec<(u32, u32)>,
}

impl Named {
    fn begins(&mut self, line: &Line<'_>, number: u32) {
        let name = line.words().skip(1).collect::<Vec<_>>().join(&b' ');
        let next = self.names.len() as u32;
        let which = *self.index.entry(name).or_insert_with_key(|name| {
            self.names.push(String::from_utf8_lossy(name).into_owned());
            next
        });
        self.lines.push((number, which));
    }
}

impl Grouping {
    /// Takes note of what stands before a line.
    fn until(&mut self, line: u32, raw: &mut RawMesh) {
        let named = if self.objects.lines.is_empty() { &self.groups } else { &self.objects };
        self.begun.resize(named.names.len(), None);
        let (mut names, mut others) = self.noted;
        let next = |done: usize| named.lines.get(done).filter(|&&(number, _)| number < line);
        let next_other = |done: usize| self.left_out.get(done).filter(|&&number| number < line);
        loop {
            match (next(names), next_other(others)) {
                (Some(&(number, which)), other) if other.is_none_or(|&other| number < other) => {
                    names += 1;
                    let begun = &mut self.begun[which as usize];
                    match begun {
                        Some(object) => raw.go_on_with(*object),
                        None => {
                            let name = named.names[which as usize].clone();
                            let name = (!name.is_empty()).then_some(name);
                            *begun = Some(raw.begin_object(name));
                        }
                    }
                }
                (_, Some(&number)) => {
                    others += 1;
                    raw.left_out.push(Place::Line(number));
                }
                _ => break,
            }
        }
        self.noted = (names, others);
    }
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
    let text = at.map_or_else(String::new, |line| excerpt(&line.text));
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
