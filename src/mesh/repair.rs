//! From what a file says to the canonical mesh: what was mended, and where each input vertex went.
//!
//! In this order: equal positions become one vertex (glTF and STL only, which repeat them); triangles with
//! a repeated vertex, with no area, or with the vertices of an earlier one are dropped; vertices that no
//! triangle uses are dropped. The order of vertices and triangles stays. Nothing is moved, filled or turned.
//! Dropping a triangle of no area between three different vertices opens a slit of no width there; the topology
//! shows it as a boundary loop.

use std::collections::{HashMap, HashSet};
use std::fmt;

use serde::{Deserialize, Serialize};

use super::error::{Failure, Fault, Place};
use super::raw::{RawMesh, SameVertex};
use super::trimesh::{TriMesh, cross, norm, sub};

/// A triangle counts as having no area up to this multiple of its longest edge squared.
const NO_AREA: f64 = 1e-12;

/// What was changed between the file and the mesh, of each kind how often (and where first, as a [`Tally`]); all zero for a clean
/// triangle mesh.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Repairs<T = Tally> {
    /// Vertices that stood where an earlier one stands and became one with it. Harmless: glTF and STL need them.
    pub welded_vertices: T,
    /// Dropped triangles that named a vertex twice, or two vertices that were welded.
    pub collapsed_faces: T,
    /// Dropped triangles of three vertices in a line.
    pub zero_area_faces: T,
    /// Dropped triangles with the three vertices of an earlier one, in whatever order.
    pub duplicate_faces: T,
    /// Dropped vertices that no remaining triangle uses.
    pub unreferenced_vertices: T,
    /// Faces of more than three corners, split into fans. Their diagonals are ours.
    pub polygons: T,
    /// Points, lines and faces of fewer than three corners, which are no surface.
    pub left_out: T,
}

/// How often something was met, and where first.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct Tally {
    pub count: usize,
    /// The first few places, in the order of the file.
    pub first: Vec<Place>,
}

impl Tally {
    /// How many places are kept.
    pub const SHOWN: usize = 5;

    fn add(&mut self, place: Option<Place>) {
        self.count += 1;
        if self.first.len() < Self::SHOWN {
            self.first.extend(place);
        }
    }

    fn of(places: &[Place]) -> Self {
        Self { count: places.len(), first: places.iter().take(Self::SHOWN).copied().collect() }
    }
}

impl<T> Repairs<T> {
    /// Each kind with what it is called after one, and after any other number.
    fn named(&self) -> [([&'static str; 2], &T); 7] {
        [
            (["welded vertex", "welded vertices"], &self.welded_vertices),
            (["collapsed face dropped", "collapsed faces dropped"], &self.collapsed_faces),
            (["face without area dropped", "faces without area dropped"], &self.zero_area_faces),
            (["duplicate face dropped", "duplicate faces dropped"], &self.duplicate_faces),
            (
                ["unreferenced vertex dropped", "unreferenced vertices dropped"],
                &self.unreferenced_vertices,
            ),
            (["polygon triangulated", "polygons triangulated"], &self.polygons),
            (
                [
                    "point, line or two-corner face left out",
                    "points, lines or two-corner faces left out",
                ],
                &self.left_out,
            ),
        ]
    }
}

fn numbered(count: usize, [one, many]: [&str; 2]) -> String {
    format!("{count} {}", if count == 1 { one } else { many })
}

impl Repairs {
    /// Whether the mesh is the file as it stands.
    pub fn is_empty(&self) -> bool {
        self.named().iter().all(|(_, tally)| tally.count == 0)
    }

    /// How often each was made.
    pub fn counts(&self) -> Repairs<usize> {
        Repairs {
            welded_vertices: self.welded_vertices.count,
            collapsed_faces: self.collapsed_faces.count,
            zero_area_faces: self.zero_area_faces.count,
            duplicate_faces: self.duplicate_faces.count,
            unreferenced_vertices: self.unreferenced_vertices.count,
            polygons: self.polygons.count,
            left_out: self.left_out.count,
        }
    }
}

impl Repairs<usize> {
    /// Those that were made, in words; `None` where none was but welding, which some formats need.
    pub fn in_words(&self) -> Option<String> {
        let others = Self { welded_vertices: 0, ..self.clone() };
        let made = others.named().into_iter().filter(|(_, count)| **count > 0);
        let made: Vec<String> = made.map(|(names, count)| numbered(*count, names)).collect();
        (!made.is_empty()).then(|| made.join(", "))
    }
}

/// One line a kind, each with its first places.
impl fmt::Display for Repairs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut lines = self.named().into_iter().filter(|(_, t)| t.count > 0);
        let mut write = |(names, tally): ([&str; 2], &Tally), start: &str| {
            write!(f, "{start}{}", numbered(tally.count, names))?;
            let mut start = " (";
            for place in &tally.first {
                write!(f, "{start}{place}")?;
                start = "; ";
            }
            match tally.first.len() {
                0 => Ok(()),
                shown if shown < tally.count => f.write_str("; …)"),
                _ => f.write_str(")"),
            }
        };
        if let Some(first) = lines.next() {
            write(first, "")?;
        }
        lines.try_for_each(|line| write(line, "\n"))
    }
}

/// A mended mesh, with its way back to the file.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Repaired {
    pub mesh: TriMesh,
    pub vertex_map: Vec<i64>,
    pub repairs: Repairs,
}

/// Makes the canonical mesh. `vertex_map` has an entry for each position of `raw`: its vertex, or −1.
pub(super) fn repair(raw: &RawMesh) -> Result<Repaired, Failure> {
    for (index, position) in raw.positions.iter().enumerate() {
        if !position.iter().all(|c| c.is_finite()) {
            return Err(Failure {
                place: raw.position_place(index),
                fault: Fault::NotFinite { position: *position },
            });
        }
    }
    let mut repairs = Repairs {
        polygons: Tally::of(&raw.polygons),
        left_out: Tally::of(&raw.left_out),
        ..Repairs::default()
    };
    let representative = weld(raw, &mut repairs);
    let faces = sound_faces(raw, &representative, &mut repairs)?;
    let (vertices, row) = used_vertices(raw, &representative, &faces, &mut repairs);
    let rows = |face: [u32; 3]| face.map(|v| row[v as usize].unwrap_or_default());
    let mesh =
        TriMesh::new(vertices, faces.into_iter().map(rows).collect()).map_err(Fault::Unsound)?;
    let vertex_map =
        representative.iter().map(|&v| row[v as usize].map_or(-1, i64::from)).collect();
    Ok(Repaired { mesh, vertex_map, repairs })
}

/// For each position, the first one that it is one vertex with.
fn weld(raw: &RawMesh, repairs: &mut Repairs) -> Vec<u32> {
    let own = 0..raw.positions.len() as u32;
    if raw.same_vertex == SameVertex::Index {
        return own.collect();
    }
    let mut first_at = HashMap::with_capacity(raw.positions.len());
    own.zip(&raw.positions)
        .map(|(index, position)| {
            // Adding zero makes −0 and 0 one.
            let first = *first_at.entry(position.map(|c| (c + 0.0).to_bits())).or_insert(index);
            if first != index {
                repairs.welded_vertices.add(raw.position_place(index as usize));
            }
            first
        })
        .collect()
}

fn sound_faces(
    raw: &RawMesh,
    representative: &[u32],
    repairs: &mut Repairs,
) -> Result<Vec<[u32; 3]>, Failure> {
    let mut seen = HashSet::with_capacity(raw.triangles.len());
    let mut faces = Vec::with_capacity(raw.triangles.len());
    for (index, triangle) in raw.triangles.iter().enumerate() {
        let face @ [a, b, c] = triangle.map(|v| representative[v as usize]);
        let mut sorted = face;
        sorted.sort_unstable();
        let tally = if a == b || b == c || c == a {
            &mut repairs.collapsed_faces
        } else if !has_area(face.map(|v| raw.positions[v as usize])) {
            &mut repairs.zero_area_faces
        } else if !seen.insert(sorted) {
            &mut repairs.duplicate_faces
        } else {
            faces.push(face);
            continue;
        };
        tally.add(raw.triangle_place(index));
    }
    if faces.is_empty() {
        let fault =
            Fault::NoSurface { vertices: raw.positions.len(), triangles: raw.triangles.len() };
        return Err(fault.into());
    }
    Ok(faces)
}

/// Whether a triangle spans a plane, at any scale of coordinates that doubles can hold.
fn has_area([a, b, c]: [[f64; 3]; 3]) -> bool {
    let edges = [sub(b, a), sub(c, a), sub(c, b)];
    let largest = edges.iter().flatten().fold(0.0, |m: f64, c| m.max(c.abs()));
    let [ab, ac, bc] = edges.map(|edge| edge.map(|c| c / largest));
    let longest = norm(ab).max(norm(ac)).max(norm(bc));
    // False for NaN: all corners in one point, or edges too long for a double.
    0.5 * norm(cross(ab, ac)) > NO_AREA * longest * longest
}

/// The positions that faces use, and the row of each position among them.
fn used_vertices(
    raw: &RawMesh,
    representative: &[u32],
    faces: &[[u32; 3]],
    repairs: &mut Repairs,
) -> (Vec<[f64; 3]>, Vec<Option<u32>>) {
    let mut used = vec![false; raw.positions.len()];
    for &vertex in faces.iter().flatten() {
        used[vertex as usize] = true;
    }
    let mut vertices = Vec::new();
    let mut row = vec![None; raw.positions.len()];
    for (index, position) in raw.positions.iter().enumerate() {
        if used[index] {
            row[index] = Some(vertices.len() as u32);
            vertices.push(*position);
        } else if representative[index] as usize == index {
            repairs.unreferenced_vertices.add(raw.position_place(index));
        }
    }
    (vertices, row)
}

#[cfg(test)]
mod tests;
