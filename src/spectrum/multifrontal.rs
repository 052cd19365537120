//! L − σB = R D Rᵀ numerically, front by front (Duff & Reid 1983).
//!
//! The [`Front`] of a supernode sums up the entries of the matrix and what the children left, eliminates the supernode's
//! columns, and leaves the rest to the parent. So a factorisation that only counts the signs of D stores no factor, and
//! subtrees are independent of each other: they are worked on in parallel. What a front adds up, and in which order,
//! depends on the pattern alone; so do the bits.
//!
//! It is not pivoted and not regularised: that of an indefinite matrix may lose digits, which its users have to measure.

use std::ops::Range;

use crossbeam::queue::SegQueue;
use rayon::prelude::*;

use super::Pencil;
use super::elimination::Elimination;
use super::front::Front;

/// Subtrees with no more than this share of all work are not divided among threads.
const SHARE: f64 = 1.0 / 64.0;

/// A pivot that is zero or not a number: its place in elimination order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BadPivot(pub usize);

/// Who takes the eliminated columns of every supernode.
pub trait Taker: Send + Sized {
    /// The part for the supernodes before `s`, and that for those from `s` on.
    fn split(self, s: usize) -> (Self, Self);

    /// The columns of R and D of supernode `s`.
    fn take(&mut self, s: usize, front: &Front);
}

/// Nobody: the signs of D are all that is wanted.
impl Taker for () {
    fn split(self, _: usize) -> (Self, Self) {
        ((), ())
    }

    fn take(&mut self, _: usize, _: &Front) {}
}

/// Factorises L − σB. Returns the number of negative entries of D.
///
/// # Errors
/// [`BadPivot`].
pub fn factorise<T: Taker>(
    pencil: Pencil<'_>,
    sigma: f64,
    elimination: &Elimination,
    taker: T,
) -> Result<usize, BadPivot> {
    let matrix = Shifted { pencil, sigma, elimination };
    let units = units(elimination);
    let mut takers = split(taker, &units);
    // As many as threads have been at work at once.
    let rooms: SegQueue<Room> = SegQueue::new();
    // What a unit has left, until its parent uses it.
    let mut left: Vec<Option<Left>> = units.iter().map(|_| None).collect();
    let levels = units.iter().map(|unit| unit.level + 1).max().unwrap_or(0);
    for level in 0..levels {
        let mut ready = Vec::new();
        for (u, unit) in units.iter().enumerate().filter(|(_, unit)| unit.level == level) {
            let children = unit.children.iter().filter_map(|&child| left[child].take()).collect();
            ready.extend(takers[u].take().map(|taker| (u, children, taker)));
        }
        let run = |(u, children, taker): (usize, Vec<Left>, T)| {
            let mut room = rooms.pop().unwrap_or_default();
            let left = matrix.eliminate(&units[u].supernodes, &children, taker, &mut room)?;
            rooms.push(room);
            Ok((u, left))
        };
        let done: Result<Vec<_>, BadPivot> = ready.into_par_iter().map(run).collect();
        done?.into_iter().for_each(|(u, rest)| left[u] = Some(rest));
    }
    Ok(left.iter().flatten().map(|left| left.negative).sum())
}

/// What one thread does at a time: a small subtree, or one supernode above the small subtrees.
struct Unit {
    supernodes: Range<usize>,
    /// Whose roots are the children of the first supernode, ascending; none for a subtree.
    children: Vec<usize>,
    /// Above those of all children: units of one level are independent.
    level: usize,
}

/// The units, ascending.
fn units(elimination: &Elimination) -> Vec<Unit> {
    let work = elimination.subtree_sums(|columns, below| columns * (columns + below).pow(2));
    let total: usize = elimination.roots().map(|root| work[root]).sum();
    let small = |s: usize| work[s] as f64 <= SHARE * total as f64;
    let mut units: Vec<Unit> = Vec::new();
    let mut s = 0;
    while s < elimination.supernodes() {
        // The largest small subtree that begins here, or the supernode itself.
        let ancestors = std::iter::successors(Some(s), |&s| elimination.parent(s));
        let root = ancestors
            .take_while(|&root| elimination.subtree(root).start == s && small(root))
            .last();
        let unit = match root {
            Some(root) => Unit { supernodes: s..root + 1, children: vec![], level: 0 },
            None => {
                let unit_of =
                    |child: usize| units.partition_point(|unit| unit.supernodes.end <= child);
                let mut children: Vec<usize> = elimination.children(s).map(unit_of).collect();
                children.reverse();
                let level = children.iter().map(|&child| units[child].level + 1).max();
                Unit { supernodes: s..s + 1, children, level: level.unwrap_or(0) }
            }
        };
        s = unit.supernodes.end;
        units.push(unit);
    }
    units
}

/// A taker for every unit.
fn split<T: Taker>(taker: T, units: &[Unit]) -> Vec<Option<T>> {
    let mut rest = taker;
    let mut takers = Vec::with_capacity(units.len());
    for unit in units {
        let (own, after) = rest.split(unit.supernodes.end);
        takers.push(Some(own));
        rest = after;
    }
    takers
}

/// What the elimination of a subtree leaves to the parent of its root.
struct Left {
    root: usize,
    /// The lower triangle over the pattern of the root, by columns.
    values: Vec<f64>,
    /// The negative entries of D in the subtree.
    negative: usize,
}

/// What a thread works in.
#[derive(Default)]
struct Room {
    front: Front,
    /// What the subtrees within a run have left, the latest last.
    stack: Vec<f64>,
    /// Where the rows of the factor lie in the front; of those that it does not have, nothing that means anything.
    place: Vec<u32>,
    /// The rows of a child in its parent.
    places: Vec<u32>,
}

/// L − σB in elimination order.
struct Shifted<'a> {
    pencil: Pencil<'a>,
    sigma: f64,
    elimination: &'a Elimination,
}

impl Shifted<'_> {
    /// Eliminates a run of supernodes that ends with the root of a subtree. `children` are those of the first supernode.
    fn eliminate<T: Taker>(
        &self,
        supernodes: &Range<usize>,
        children: &[Left],
        mut taker: T,
        room: &mut Room,
    ) -> Result<Left, BadPivot> {
        let mut negative: usize = children.iter().map(|left| left.negative).sum();
        // The supernodes whose rest is on the stack, and where it begins.
        let mut waiting: Vec<(usize, usize)> = Vec::new();
        let Room { front, stack, place, places } = room;
        stack.clear();
        place.resize(self.elimination.n(), 0);
        for s in supernodes.clone() {
            front.reset(self.elimination.columns(s).len(), self.elimination.pattern(s).len());
            for (local, row) in self.elimination.rows(s).enumerate() {
                place[row] = local as u32;
            }
            self.assemble(s, front, place);
            let mut add = |child: usize, values: &[f64]| {
                places.clear();
                let rows = self.elimination.pattern(child).iter();
                places.extend(rows.map(|&row| place[row as usize]));
                front.add(places, values);
            };
            for left in children.iter().filter(|_| s == supernodes.start) {
                add(left.root, &left.values);
            }
            let within = self.elimination.subtree(s).start.max(supernodes.start);
            let own = waiting.partition_point(|&(child, _)| child < within);
            let bottom = waiting.get(own).map_or(stack.len(), |&(_, start)| start);
            for (k, &(child, start)) in waiting.iter().enumerate().skip(own) {
                let end = waiting.get(k + 1).map_or(stack.len(), |&(_, next)| next);
                add(child, &stack[start..end]);
            }
            waiting.truncate(own);
            stack.truncate(bottom);
            let first = self.elimination.columns(s).start;
            negative += front.eliminate().map_err(|column| BadPivot(first + column))?;
            taker.take(s, front);
            waiting.push((s, bottom));
            front.rest(stack);
        }
        Ok(Left { root: supernodes.end - 1, values: stack.clone(), negative })
    }

    /// The entries of L − σB in the columns of a supernode.
    fn assemble(&self, s: usize, front: &mut Front, place: &[u32]) {
        let elimination = self.elimination;
        for (j, column) in elimination.columns(s).enumerate() {
            let i = elimination.order()[column] as usize;
            for (matrix, scale) in [(self.pencil.stiffness, 1.0), (self.pencil.mass, -self.sigma)] {
                let entries = matrix.outer_view(i);
                for (i, &value) in entries.iter().flat_map(|entries| entries.iter()) {
                    let row = elimination.place()[i] as usize;
                    if row >= column {
                        *front.entry(place[row] as usize, j) += scale * value;
                    }
                }
            }
        }
    }
}
