//! Flips of edges until the triangulation is the intrinsic Delaunay one: cot α + cot β ≥ 0 at every edge of two
//! triangles.
//!
//! An edge that is not Delaunay is the diagonal of a convex quadrilateral, since α + β > π leaves less than π at
//! either of its ends: it can be flipped, and the flip makes it Delaunay. Edges wait in a queue in the order of their
//! sides, so the result is the same every time. Flips come to an end (Bobenko and Springborn 2007); rounding cannot
//! make them turn in circles for ever, since their number has a limit, and what is left then shows in the quality.

use std::collections::VecDeque;

use super::IntrinsicTriangulation;
use crate::operators::gluing::{Mate, Run, Side};

/// Far more flips an edge than any surface has been seen to need.
const MOST_FLIPS_PER_SIDE: usize = 100;

/// Below this, relative to the two cotangents, a negative sum is rounding.
const ROUNDING: f64 = 1e-10;

/// Whether an edge with these cotangents opposite to it is Delaunay: cot α + cot β ≥ 0, but for rounding.
pub fn is_delaunay(alpha: f64, beta: f64) -> bool {
    // Written so that what is not a number wants no flip.
    let crossed = alpha + beta < -ROUNDING * (1.0 + alpha.abs() + beta.abs());
    !crossed
}

impl IntrinsicTriangulation {
    /// Flips edges until all are Delaunay, and returns how often.
    pub(super) fn flip_to_delaunay(&mut self) -> usize {
        let sides = 3 * self.vertices.len();
        let mut queue: VecDeque<Side> = self.gluing.edges().map(|(side, _)| side).collect();
        let mut queued = vec![false; sides];
        queue.iter().for_each(|side| queued[side.number()] = true);
        let mut flips = 0;
        while let Some(side) = queue.pop_front() {
            queued[side.number()] = false;
            if flips == MOST_FLIPS_PER_SIDE * sides || !self.wants_flip(side) {
                continue;
            }
            for outer in self.flip(side) {
                if !std::mem::replace(&mut queued[outer.number()], true) {
                    queue.push_back(outer);
                }
            }
            flips += 1;
        }
        flips
    }

    /// Whether there is an edge between two different triangles here, and it is not Delaunay. (The two angles in one
    /// triangle that is glued to itself never add up to π.)
    fn wants_flip(&self, side: Side) -> bool {
        let opposite = |side: Side| self.triangle(side.face()).cotangents[side.previous().index()];
        self.gluing.mate(side).is_some_and(|Mate { side: mate, .. }| {
            side.face() != mate.face() && !is_delaunay(opposite(side), opposite(mate))
        })
    }

    /// Replaces the edge p–q between the triangles (p, q, r) and (q, p, s) by r–s: they become (r, s, q) and (s, r, p).
    /// Returns the four sides around them.
    fn flip(&mut self, pq: Side) -> [Side; 4] {
        let qp = self.mate_against(pq);
        let (f, g) = (pq.face(), qp.face());
        let [qr, rp, ps, sq] = [pq.next(), pq.previous(), qp.next(), qp.previous()];
        let [p, q, r, s] = [pq, qp, rp, sq].map(|side| self.start(side));
        let rs = self.other_diagonal(pq, qp);
        let lengths = [qr, rp, ps, sq].map(|side| self.length(side));
        let outer = [Side::new(f, 2), Side::new(g, 1), Side::new(g, 2), Side::new(f, 1)];
        self.gluing.renumber([(qr, outer[0]), (rp, outer[1]), (ps, outer[2]), (sq, outer[3])]);
        self.gluing.glue(Side::new(f, 0), Side::new(g, 0), Run::Against);
        self.vertices[f] = [r, s, q];
        self.vertices[g] = [s, r, p];
        self.lengths[f] = [rs, lengths[3], lengths[0]];
        self.lengths[g] = [rs, lengths[1], lengths[2]];
        outer
    }

    /// The side that `side` is glued to, its triangle turned over where it has to be for the two to run against one
    /// another.
    fn mate_against(&mut self, side: Side) -> Side {
        let mate =
            |this: &Self| this.gluing.mate(side).expect("an edge of two triangles is flipped");
        let Mate { side: other, run } = mate(self);
        if run == Run::Along {
            let face = other.face();
            self.gluing.turn_over(face);
            self.vertices[face].swap(0, 1);
            self.lengths[face].swap(1, 2);
        }
        mate(self).side
    }

    /// The distance of r and s when the triangles (p, q, r) and (q, p, s) lie in one plane, p at its origin and q on
    /// its first axis.
    fn other_diagonal(&self, pq: Side, qp: Side) -> f64 {
        let base = self.length(pq);
        let height = |side: Side| 2.0 * self.triangle(side.face()).area / base;
        let along =
            |from_p: f64, from_q: f64| 0.5 * (base + (from_p - from_q) * (from_p + from_q) / base);
        let r = along(self.length(pq.previous()), self.length(pq.next()));
        let s = along(self.length(qp.next()), self.length(qp.previous()));
        (r - s).hypot(height(pq) + height(qp))
    }
}
