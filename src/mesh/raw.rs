//! What a reader hands to repair: positions and triangles as the file has them, and where each came from.

use std::ops::Range;

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
    /// The names of the objects that the file is made of.
    objects: Vec<Option<String>>,
    /// Which object goes on from where, in the order of the file.
    segments: Vec<Segment>,
}

/// Triangles, polygons and what was left out belong to `object` from these on.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Segment {
    object: usize,
    triangles: usize,
    polygons: usize,
    left_out: usize,
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
            objects: Vec::new(),
            segments: Vec::new(),
        }
    }

    /// Another object begins, under the name that the file gives it; its number.
    pub fn begin_object(&mut self, name: Option<String>) -> usize {
        // What came before the first one has no name.
        if self.objects.is_empty() && !self.triangles.is_empty() {
            self.objects.push(None);
            self.segments.push(Segment { object: 0, triangles: 0, polygons: 0, left_out: 0 });
        }
        self.objects.push(name);
        self.go_on_with(self.objects.len() - 1);
        self.objects.len() - 1
    }

    /// What follows belongs to an object that began before.
    pub fn go_on_with(&mut self, object: usize) {
        let segment = Segment {
            object,
            triangles: self.triangles.len(),
            polygons: self.polygons.len(),
            left_out: self.left_out.len(),
        };
        // One that nothing came of is forgotten.
        match self.segments.last_mut() {
            Some(last) if (Segment { object, ..*last }) == segment => *last = segment,
            _ => self.segments.push(segment),
        }
    }

    /// The objects that have triangles, by number, with their names. None where the file does not tell of objects.
    pub fn objects(&self) -> Vec<(usize, Option<&str>)> {
        let mut has_triangles = vec![false; self.objects.len()];
        for (segment, end) in self.segments_with(|s| s.triangles, self.triangles.len()) {
            has_triangles[segment.object] |= segment.triangles < end;
        }
        let named = self.objects.iter().map(Option::as_deref).enumerate();
        named.filter(|&(object, _)| has_triangles[object]).collect()
    }

    /// One object alone, and for each of its positions the index in the file.
    pub fn only(&self, object: usize) -> Result<(Self, Vec<u32>), Fault> {
        let mut part = Self::new(self.same_vertex);
        let triangles = self.ranges(object, |s| s.triangles, self.triangles.len());
        // An object of a large file may be small: nothing here is as long as the file.
        let own = triangles.clone().flat_map(|range| &self.triangles[range]);
        let mut of_file: Vec<u32> = own.flatten().copied().collect();
        of_file.sort_unstable();
        of_file.dedup();
        for &vertex in &of_file {
            let place = self.position_place(vertex as usize).unwrap_or(Place::Entry(vertex));
            part.position(self.positions[vertex as usize], place)?;
        }
        let in_part = |vertex: u32| of_file.partition_point(|&other| other < vertex) as u32;
        for index in triangles.flatten() {
            let place = self.triangle_place(index).unwrap_or(Place::Entry(number(index)?));
            part.triangle(self.triangles[index].map(in_part), place)?;
        }
        let polygons = self.ranges(object, |s| s.polygons, self.polygons.len());
        part.polygons = polygons.flat_map(|range| &self.polygons[range]).copied().collect();
        let left_out = self.ranges(object, |s| s.left_out, self.left_out.len());
        part.left_out = left_out.flat_map(|range| &self.left_out[range]).copied().collect();
        Ok((part, of_file))
    }

    /// Each segment with where the next one begins in a list of length `end`.
    fn segments_with(
        &self,
        start: impl Fn(&Segment) -> usize + Clone,
        end: usize,
    ) -> impl Iterator<Item = (&Segment, usize)> + Clone {
        let starts = self.segments.iter().skip(1).map(start);
        self.segments.iter().zip(starts.chain(std::iter::once(end)))
    }

    /// Which entries of a list of length `end` belong to an object.
    fn ranges(
        &self,
        object: usize,
        start: impl Fn(&Segment) -> usize + Clone,
        end: usize,
    ) -> impl Iterator<Item = Range<usize>> + Clone {
        let own = self.segments_with(start.clone(), end);
        own.filter(move |(segment, _)| segment.object == object)
            .map(move |(segment, end)| start(segment)..end)
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
    fn an_object_may_go_on_later_and_takes_its_own_positions_along() {
        let mut raw = RawMesh::new(SameVertex::Index);
        for index in 0..7 {
            raw.position([f64::from(index), 0.0, 0.0], Place::Line(index + 1)).unwrap();
        }
        raw.triangle([0, 1, 2], Place::Line(10)).unwrap();
        let wheel = raw.begin_object(Some("wheel".into()));
        raw.face(&[2, 3, 4, 5], Place::Line(11)).unwrap();
        raw.begin_object(Some("empty".into()));
        raw.left_out.push(Place::Line(12));
        raw.go_on_with(wheel);
        raw.triangle([5, 3, 1], Place::Line(13)).unwrap();
        assert_eq!(raw.objects(), [(0, None), (1, Some("wheel"))]);
        let (part, of_file) = raw.only(wheel).unwrap();
        assert_eq!(of_file, [1, 2, 3, 4, 5]);
        assert_eq!(part.triangles, [[1, 2, 3], [1, 3, 4], [4, 2, 0]]);
        assert_eq!((part.positions[4][0], part.position_place(4)), (5.0, Some(Place::Line(6))));
        assert_eq!(part.triangle_place(2), Some(Place::Line(13)));
        assert_eq!((part.polygons.len(), part.left_out.len()), (1, 0));
        let (first, _) = raw.only(0).unwrap();
        assert_eq!((first.triangles.len(), first.polygons.len()), (1, 0));
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
