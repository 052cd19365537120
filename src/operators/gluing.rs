//! Which sides of triangles are one edge.
//!
//! A triangulation is its triangles and the way their sides are glued. Two vertices do not name an edge: flips can
//! make several edges between them, or an edge from a vertex to itself.

use super::Pattern;

/// Side `i` of triangle `f`, from its corner i to the next one; corner i + 2 is opposite. Its number is 3f + i.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Side(u32);

impl Side {
    /// Side `index` of triangle `face`.
    pub fn new(face: usize, index: usize) -> Self {
        Self((3 * face + index) as u32)
    }

    /// Its number.
    pub fn number(self) -> usize {
        self.0 as usize
    }

    /// Its triangle.
    pub fn face(self) -> usize {
        self.number() / 3
    }

    /// Which side of its triangle it is, and at which corner it starts.
    pub fn index(self) -> usize {
        self.number() % 3
    }

    /// The side of the same triangle that starts where this one ends.
    pub fn next(self) -> Self {
        Self::new(self.face(), (self.index() + 1) % 3)
    }

    /// The side of the same triangle that ends where this one starts.
    pub fn previous(self) -> Self {
        Self::new(self.face(), (self.index() + 2) % 3)
    }
}

/// Whether two glued sides run against one another, as where neighbouring triangles agree on which side is out, or
/// along.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Run {
    Against,
    Along,
}

impl Run {
    /// The run after one of the two triangles was turned over.
    pub fn turned(self) -> Self {
        match self {
            Self::Against => Self::Along,
            Self::Along => Self::Against,
        }
    }
}

/// The other side of an edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Mate {
    pub side: Side,
    pub run: Run,
}

/// For every side the one that it is glued to: none on the boundary, and none where three or more triangles meet.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Gluing {
    mates: Vec<Option<Mate>>,
}

/// The sides between two vertices.
#[derive(Clone, Copy)]
enum Between {
    None,
    One(Side),
    Two(Side, Side),
    More,
}

impl Between {
    fn and(self, side: Side) -> Self {
        match self {
            Self::None => Self::One(side),
            Self::One(first) => Self::Two(first, side),
            Self::Two(..) | Self::More => Self::More,
        }
    }
}

impl Gluing {
    /// Glues the triangles of a pattern along common vertices, and finds the vertices on the boundary, ascending.
    pub fn of(pattern: &Pattern, faces: &[[u32; 3]]) -> (Self, Vec<u32>) {
        let ends = |side: Side| [side, side.next()].map(|s| faces[s.face()][s.index()]);
        let mut edges = vec![Between::None; pattern.places()];
        for side in (0..3 * faces.len() as u32).map(Side) {
            let [start, end] = ends(side);
            let [i, j] = [side.index(), side.next().index()];
            let (lower, upper) = if start < end { (i, j) } else { (j, i) };
            let edge = &mut edges[pattern.place(side.face(), lower, upper)];
            *edge = edge.and(side);
        }
        let mut gluing = Self::none(faces.len());
        let mut on_boundary = vec![false; pattern.n()];
        for edge in edges {
            match edge {
                Between::One(side) => {
                    ends(side).into_iter().for_each(|end| on_boundary[end as usize] = true);
                }
                Between::Two(a, b) if ends(a) == ends(b) => gluing.glue(a, b, Run::Along),
                Between::Two(a, b) => gluing.glue(a, b, Run::Against),
                Between::None | Between::More => {}
            }
        }
        let vertices = (0..).zip(on_boundary);
        (gluing, vertices.filter_map(|(vertex, on)| on.then_some(vertex)).collect())
    }

    /// The gluing of so many triangles of which none are neighbours.
    pub fn none(triangles: usize) -> Self {
        Self { mates: vec![None; 3 * triangles] }
    }

    /// What a side is glued to.
    pub fn mate(&self, side: Side) -> Option<Mate> {
        self.mates[side.number()]
    }

    /// Makes two sides one edge.
    pub fn glue(&mut self, a: Side, b: Side, run: Run) {
        self.mates[a.number()] = Some(Mate { side: b, run });
        self.mates[b.number()] = Some(Mate { side: a, run });
    }

    /// The two sides of every edge that has two, each edge once, in the order of their lower sides.
    pub fn edges(&self) -> impl Iterator<Item = (Side, Side)> + '_ {
        let sides = (0..).map(Side).zip(&self.mates);
        sides.filter_map(|(side, mate)| mate.map(|mate| (side, mate.side))).filter(|(a, b)| a < b)
    }

    /// Gives sides other numbers: `(from, to)` with each number on the left at most once and once on the right.
    pub fn renumber<const N: usize>(&mut self, moves: [(Side, Side); N]) {
        let moved = |side| moves.iter().find(|(from, _)| *from == side).map_or(side, |&(_, to)| to);
        let mates = moves.map(|(from, _)| self.mate(from));
        for ((_, to), mate) in moves.into_iter().zip(mates) {
            match mate {
                None => self.mates[to.number()] = None,
                Some(Mate { side, run }) => self.glue(to, moved(side), run),
            }
        }
    }

    /// Turns a triangle over: its corners 0 and 1 change places, and with them its sides 1 and 2.
    pub fn turn_over(&mut self, face: usize) {
        let sides = [0, 1, 2].map(|index| Side::new(face, index));
        self.renumber([(sides[1], sides[2]), (sides[2], sides[1])]);
        for side in sides {
            match self.mate(side) {
                Some(mate) if mate.side.face() != face => {
                    self.glue(side, mate.side, mate.run.turned());
                }
                _ => {}
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Topology, load, sample::icosphere};

    #[test]
    fn the_boundary_is_that_of_the_topology() {
        let files = ["gc_moebius.obj", "gc_hourglass_ico.obj", "spot_829.obj"];
        let meshes = files.map(|file| load(format!("tests/data/meshes/{file}").as_ref()).unwrap());
        for mesh in meshes.map(|ingested| ingested.mesh).into_iter().chain([icosphere(1)]) {
            let topology = Topology::of(&mesh);
            let (gluing, boundary) = Gluing::of(&Pattern::of_mesh(&mesh), mesh.faces());
            assert_eq!(boundary, topology.boundary_vertices);
            let along = gluing.edges().filter(|&(a, _)| gluing.mate(a).unwrap().run == Run::Along);
            assert_eq!(along.count(), topology.misoriented_edges);
        }
    }

    #[test]
    fn three_triangles_at_one_edge_are_not_glued() {
        let faces = [[0, 1, 2], [1, 0, 3], [0, 1, 4]];
        let (gluing, boundary) = Gluing::of(&Pattern::of(5, faces.into_iter()), &faces);
        assert_eq!(gluing.edges().count(), 0);
        assert_eq!(boundary, [0, 1, 2, 3, 4]);
    }

    #[test]
    fn turning_a_triangle_over_twice_changes_nothing() {
        let faces = [[0, 1, 2], [1, 0, 3], [2, 3, 1]];
        let (before, _) = Gluing::of(&Pattern::of(4, faces.into_iter()), &faces);
        let mut gluing = before.clone();
        gluing.turn_over(1);
        let side = Side::new(1, 0);
        assert_eq!(gluing.mate(side), Some(Mate { side: Side::new(0, 0), run: Run::Along }));
        gluing.turn_over(1);
        assert_eq!(gluing, before);
    }
}
