//! What a reader hands to repair: positions and triangles as the file has them, and where each came from.

use super::error::Place;

/// An unchecked triangle soup with indices. Indices are in range; nothing else is promised.
#[derive(Debug, Clone, PartialEq)]
pub struct RawMesh {
    /// Every position of the file, in its order: OBJ `v` lines; for glTF, the position accessors in the
    /// order in which the scene reaches them, transformed.
    pub positions: Vec<[f64; 3]>,
    /// Triples of zero-based indices into `positions`.
    pub triangles: Vec<[u32; 3]>,
    /// Where positions and triangles came from.
    pub origin: Origin,
    /// Faces of more than three corners, which became fans of triangles around their first corner.
    pub polygons: Vec<Place>,
    /// What is no surface and was left out: points, lines, faces of fewer than three corners.
    pub left_out: Vec<Place>,
}

/// Where the positions and triangles of a [`RawMesh`] stand in its file.
#[derive(Debug, Clone, PartialEq)]
pub enum Origin {
    /// Lines of an OBJ file, counted from 1: one per position, one per triangle. Faces share positions by
    /// index, so equal positions with different indices stay apart.
    Obj { positions: Vec<u32>, triangles: Vec<u32> },
    /// Runs of a glTF document, each ascending in `first`. A glTF file repeats positions along every seam
    /// of normals and textures, so equal positions are one vertex.
    Gltf { positions: Vec<AccessorRun>, triangles: Vec<PrimitiveRun> },
}

/// Positions `first..` up to the next run are the elements of one accessor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AccessorRun {
    pub first: u32,
    pub accessor: u32,
}

/// Triangles `first..` up to the next run are those of one primitive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PrimitiveRun {
    pub first: u32,
    pub mesh: u32,
    pub primitive: u32,
}

impl RawMesh {
    /// Where `positions[index]` stands in the file.
    pub fn position_place(&self, index: usize) -> Option<Place> {
        match &self.origin {
            Origin::Obj { positions, .. } => positions.get(index).copied().map(Place::Line),
            Origin::Gltf { positions, .. } => {
                let index = u32::try_from(index).ok()?;
                let run = last_before(positions, |run| run.first <= index)?;
                Some(Place::Element { accessor: run.accessor, element: index - run.first })
            }
        }
    }

    /// Where `triangles[index]` stands in the file.
    pub fn triangle_place(&self, index: usize) -> Option<Place> {
        match &self.origin {
            Origin::Obj { triangles, .. } => triangles.get(index).copied().map(Place::Line),
            Origin::Gltf { triangles, .. } => {
                let index = u32::try_from(index).ok()?;
                let run = last_before(triangles, |run| run.first <= index)?;
                Some(Place::Triangle {
                    mesh: run.mesh,
                    primitive: run.primitive,
                    triangle: index - run.first,
                })
            }
        }
    }
}

fn last_before<T>(runs: &[T], starts_before: impl Fn(&T) -> bool) -> Option<&T> {
    runs.partition_point(starts_before).checked_sub(1).and_then(|i| runs.get(i))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_looked_up_by_their_first_index() {
        let run = |first, primitive| PrimitiveRun { first, mesh: 7, primitive };
        let raw = RawMesh {
            positions: vec![],
            triangles: vec![],
            origin: Origin::Gltf {
                positions: vec![],
                // The first primitive is empty: its run has the same first index as the next one.
                triangles: vec![run(0, 0), run(0, 1), run(5, 2)],
            },
            polygons: vec![],
            left_out: vec![],
        };
        let place = |primitive, triangle| Some(Place::Triangle { mesh: 7, primitive, triangle });
        assert_eq!(raw.triangle_place(4), place(1, 4));
        assert_eq!(raw.triangle_place(5), place(2, 0));
        assert_eq!(raw.position_place(0), None);
    }
}
