//! What a reader hands to repair: positions and triangles as the file has them, and where each came from.

use super::error::{Fault, Place};

/// A triangle soup with indices, checked in nothing but their range.
#[derive(Debug, Clone, PartialEq)]
pub struct RawMesh {
    /// Every position of the file, in its order: see [`Ingested::vertex_map`](super::Ingested::vertex_map).
    pub positions: Vec<[f64; 3]>,
    /// Triples of zero-based indices into `positions`.
    pub triangles: Vec<[u32; 3]>,
    /// What makes two corners one vertex.
    pub same_vertex: SameVertex,
    /// Faces of more than three corners, which became fans of triangles around their first corner.
    pub polygons: Vec<Place>,
    /// What is no surface and was left out: points, lines, faces of fewer than three corners.
    pub left_out: Vec<Place>,
    position_places: Places,
    triangle_places: Places,
}

/// What makes two corners one vertex.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SameVertex {
    /// Their index: faces share vertices, and equal positions with different indices stay apart.
    Index,
    /// Their position: the format repeats positions, for every facet or along every seam.
    Position,
}

impl RawMesh {
    /// Without any position.
    pub fn new(same_vertex: SameVertex) -> Self {
        Self {
            positions: Vec::new(),
            triangles: Vec::new(),
            same_vertex,
            polygons: Vec::new(),
            left_out: Vec::new(),
            position_places: Places::default(),
            triangle_places: Places::default(),
        }
    }

    /// Appends a position; its index.
    pub fn position(&mut self, position: [f64; 3], place: Place) -> Result<u32, Fault> {
        let index = number(self.positions.len())?;
        self.positions.push(position);
        self.position_places.push(place);
        Ok(index)
    }

    /// Appends a triangle.
    pub fn triangle(&mut self, corners: [u32; 3], place: Place) -> Result<(), Fault> {
        number(self.triangles.len())?;
        self.triangles.push(corners);
        self.triangle_places.push(place);
        Ok(())
    }

    /// Appends a face of however many corners, as a fan around its first.
    pub fn face(&mut self, corners: &[u32], place: Place) -> Result<(), Fault> {
        let [first, rest @ ..] = corners else {
            self.left_out.push(place);
            return Ok(());
        };
        match rest.len() {
            0 | 1 => self.left_out.push(place),
            2 => {}
            _ => self.polygons.push(place),
        }
        for pair in rest.windows(2) {
            if let [second, third] = *pair {
                self.triangle([*first, second, third], place)?;
            }
        }
        Ok(())
    }

    /// Appends a strip of triangles, each with the two corners before its last.
    pub fn strip(&mut self, corners: &[u32], place: Place) -> Result<(), Fault> {
        if corners.len() < 3 {
            self.left_out.push(place);
        }
        for index in 0..corners.len().saturating_sub(2) {
            let [a, b, c] = strip_corners(index).map(|corner| corners.get(corner).copied());
            if let (Some(a), Some(b), Some(c)) = (a, b, c) {
                self.triangle([a, b, c], place)?;
            }
        }
        Ok(())
    }

    /// Where `positions[index]` stands in the file.
    pub fn position_place(&self, index: usize) -> Option<Place> {
        self.position_places.get(index)
    }

    /// Where `triangles[index]` stands in the file.
    pub fn triangle_place(&self, index: usize) -> Option<Place> {
        self.triangle_places.get(index)
    }
}

/// The corners of a strip that its triangle `index` joins: every other one is turned, so that all wind alike.
pub fn strip_corners(index: usize) -> [usize; 3] {
    [index, index + 1 + index % 2, index + 2 - index % 2]
}

/// `count` as a number of positions or triangles.
pub fn number(count: usize) -> Result<u32, Fault> {
    u32::try_from(count).map_err(|_| Fault::TooLarge)
}

/// The place of each entry of a list, as runs of entries that stand one after the other.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Places {
    len: usize,
    /// The index of a run's first entry, and its place.
    runs: Vec<(usize, Place)>,
}

impl Places {
    pub fn push(&mut self, place: Place) {
        let goes_on = |&(first, start): &(usize, Place)| start.further(self.len - first);
        if self.runs.last().and_then(goes_on) != Some(place) {
            self.runs.push((self.len, place));
        }
        self.len += 1;
    }

    pub fn get(&self, index: usize) -> Option<Place> {
        let run = self.runs.partition_point(|&(first, _)| first <= index).checked_sub(1)?;
        let (first, start) = *self.runs.get(run)?;
        if index < self.len { start.further(index - first) } else { None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_remembered_in_runs() {
        let listed = [Place::Line(4), Place::Line(5), Place::Line(5), Place::Vertex(6)];
        let elements = (0..3).map(|element| Place::Element { accessor: 1, element });
        let all: Vec<_> = listed.into_iter().chain(elements).collect();
        let mut places = Places::default();
        all.iter().for_each(|&place| places.push(place));
        assert_eq!((0..7).filter_map(|i| places.get(i)).collect::<Vec<_>>(), all);
        assert_eq!((places.runs.len(), places.get(7)), (4, None));
    }

    #[test]
    fn fans_and_strips_wind_one_way() {
        let place = Place::Line(1);
        let mut raw = RawMesh::new(SameVertex::Index);
        raw.face(&[0, 1, 2, 3], place).unwrap();
        raw.strip(&[0, 1, 3, 2, 4], place).unwrap();
        assert_eq!(raw.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 3], [1, 2, 3], [3, 2, 4]]);
        assert_eq!((raw.polygons.len(), raw.left_out.len()), (1, 0));
        for corners in [&[][..], &[0], &[0, 1]] {
            raw.face(corners, place).unwrap();
            raw.strip(corners, place).unwrap();
        }
        assert_eq!((raw.triangles.len(), raw.left_out.len()), (5, 6));
    }
}
