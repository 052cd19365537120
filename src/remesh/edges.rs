//! Which triangles meet at an edge, and how two of them exchange their diagonal.

use std::collections::HashMap;

/// The triangles of every edge, under its vertices in ascending order.
#[derive(Debug, Default)]
pub struct Edges {
    owners: HashMap<[u32; 2], Owners>,
}

#[derive(Debug, Clone, Copy)]
enum Owners {
    One(usize),
    Two([usize; 2]),
    /// An edge where more than two meet: never exchanged.
    Many,
}

/// Two triangles a → b → c and b → a → d that meet at the edge ab.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pair {
    /// Their numbers.
    faces: [usize; 2],
    a: u32,
    b: u32,
    /// The corner of the first that is not at the edge.
    c: u32,
    /// That of the second.
    d: u32,
}

impl Pair {
    /// The two as they are.
    pub fn triangles(&self) -> [[u32; 3]; 2] {
        let &Self { a, b, c, d, .. } = self;
        [[a, b, c], [b, a, d]]
    }

    /// The two that meet at the edge cd instead.
    pub fn exchanged(&self) -> [[u32; 3]; 2] {
        let &Self { a, b, c, d, .. } = self;
        [[a, d, c], [d, b, c]]
    }

    /// The four edges around.
    pub fn around(&self) -> [[u32; 2]; 4] {
        let &Self { a, b, c, d, .. } = self;
        [[a, d], [a, c], [b, d], [b, c]].map(ascending)
    }
}

impl Edges {
    /// The edges of these triangles.
    pub fn of(faces: &[[u32; 3]]) -> Self {
        let mut edges = Self::default();
        edges.owners.reserve(faces.len() * 3 / 2);
        for (face, &corners) in faces.iter().enumerate() {
            for side in sides(corners) {
                edges
                    .owners
                    .entry(side)
                    .and_modify(|owners| {
                        *owners = match *owners {
                            Owners::One(other) => Owners::Two([other, face]),
                            Owners::Two(_) | Owners::Many => Owners::Many,
                        }
                    })
                    .or_insert(Owners::One(face));
            }
        }
        edges
    }

    /// All edges, in ascending order.
    pub fn all(&self) -> Vec<[u32; 2]> {
        let mut all: Vec<_> = self.owners.keys().copied().collect();
        all.sort_unstable();
        all
    }

    /// The two triangles at an edge, if their diagonal could be exchanged: there are two that agree on which side is out, and
    /// the other diagonal is no edge yet.
    pub fn pair(&self, faces: &[[u32; 3]], [a, b]: [u32; 2]) -> Option<Pair> {
        let &Owners::Two([f, g]) = self.owners.get(&[a, b])? else { return None };
        // From a to b in one triangle, from b to a in the other.
        let (c, d) = match (opposite(faces[f], a, b), opposite(faces[g], b, a)) {
            (Some(c), Some(d)) => (c, d),
            _ => (opposite(faces[g], a, b)?, opposite(faces[f], b, a)?),
        };
        let is_free = c != d && !self.owners.contains_key(&ascending([c, d]));
        is_free.then_some(Pair { faces: [f, g], a, b, c, d })
    }

    /// Exchanges the diagonal of a pair.
    pub fn exchange(&mut self, faces: &mut [[u32; 3]], pair: &Pair) {
        self.owners.remove(&ascending([pair.a, pair.b]));
        self.owners.insert(ascending([pair.c, pair.d]), Owners::Two(pair.faces));
        for (face, corners) in pair.faces.into_iter().zip(pair.exchanged()) {
            faces[face] = corners;
            for side in sides(corners) {
                if pair.around().contains(&side) {
                    self.hand_over(side, pair.faces, face);
                }
            }
        }
    }

    /// What one of two triangles owned is now owned by `to`.
    fn hand_over(&mut self, side: [u32; 2], from: [usize; 2], to: usize) {
        if let Some(owners) = self.owners.get_mut(&side) {
            *owners = match *owners {
                Owners::One(_) => Owners::One(to),
                Owners::Two([first, second]) if from.contains(&first) => Owners::Two([second, to]),
                Owners::Two([first, _]) => Owners::Two([first, to]),
                Owners::Many => Owners::Many,
            };
        }
    }
}

fn ascending([a, b]: [u32; 2]) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

fn sides([a, b, c]: [u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]].map(ascending)
}

/// The third corner of a triangle that runs from `a` to `b`.
fn opposite(face: [u32; 3], a: u32, b: u32) -> Option<u32> {
    (0..3).find(|&i| face[i] == a && face[(i + 1) % 3] == b).map(|i| face[(i + 2) % 3])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::sample::icosphere;

    #[test]
    fn after_exchanges_the_edges_are_those_of_the_triangles() {
        let mut faces = icosphere(2).faces().to_vec();
        let mut edges = Edges::of(&faces);
        let mut exchanged = 0;
        for edge in edges.all().into_iter().step_by(3) {
            if let Some(pair) = edges.pair(&faces, edge) {
                edges.exchange(&mut faces, &pair);
                exchanged += 1;
            }
        }
        assert!(exchanged > 100);
        let anew = Edges::of(&faces);
        assert_eq!(edges.all(), anew.all());
        let owners = |edges: &Edges, edge| match edges.owners[edge] {
            Owners::Two([f, g]) => [f.min(g), f.max(g)],
            other => panic!("{other:?}"),
        };
        for edge in &anew.all() {
            assert_eq!(owners(&edges, edge), owners(&anew, edge));
        }
    }

    #[test]
    fn an_edge_of_three_triangles_or_of_one_has_no_pair() {
        let faces = [[0, 1, 2], [1, 0, 3], [0, 1, 4]];
        let edges = Edges::of(&faces);
        assert!(edges.all().iter().all(|&edge| edges.pair(&faces, edge).is_none()));
    }
}
