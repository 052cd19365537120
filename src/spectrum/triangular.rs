//! Solves with a supernodal factor A = R D Rᵀ for the eight right-hand sides of a panel.
//!
//! R is unit lower triangular. A supernode is a run of columns with one pattern below its diagonal block. It is cut into
//! tiles of up to eight columns, whose part of a solution stays in registers while the rows below stream by; a tile's
//! values are stored by rows, one tile after the other, so that a solve reads them from one end to the other and back.
//!
//! The elimination tree is cut into a top and a few parts of about equal work, which share no rows but those of the top:
//! each part has its own copy of these, and is worked on by one thread. The cut depends on the pattern alone and sums are
//! taken in the order of the parts, so that the bits of a solution do not depend on the number of threads.

#![allow(
    clippy::needless_range_loop,
    reason = "loops over registers, which an iterator would keep in memory"
)]

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

use super::Pencil;
use super::elimination::Elimination;
use super::front::Front;
use super::multifrontal::{self, BadPivot, Taker};
use super::panel::{Panel, Row, WIDTH, strip, strip_mut};

/// Parts of the elimination tree that are worked on at the same time.
const PARTS: usize = 4;

/// Subtrees are cut while one is larger than this share of all work.
const SHARE: f64 = 1.0 / 16.0;

/// How a pattern is solved with: valid for all factors that have it.
pub struct Plan {
    parts: Vec<Part>,
    top: Part,
    /// Where the values of every supernode begin, and where they end.
    values_at: Vec<usize>,
}

/// Some subtrees of the elimination tree, or its top.
#[derive(Default)]
struct Part {
    tiles: Vec<Tile>,
    /// The rows below the diagonal blocks, as indices into the part's own rows and then those of the top.
    below: Vec<u32>,
    /// The rows of the matrix that are the part's own.
    rows: Vec<u32>,
}

/// Up to eight columns of a supernode.
#[derive(Clone, Copy)]
struct Tile {
    /// The first column, among the part's own rows.
    column: u32,
    /// The number of columns: 1, 2, 4 or 8.
    width: u32,
    /// The rows of the diagonal block below the tile: they follow its columns.
    inside: u32,
    /// The rows below the diagonal block, as a range of `Part::below`.
    below: [u32; 2],
    /// Where its values begin.
    values: usize,
}

/// The values of a factor, supernode by supernode: for every tile its triangle, width × width by rows with D⁻¹ on the
/// diagonal, and then its rows below that.
pub struct Packed(Vec<f64>);

/// Packs fronts as they are eliminated.
struct Packer<'a> {
    plan: &'a Plan,
    /// The values from supernode `first` on.
    values: &'a mut [f64],
    first: usize,
}

/// What a solve writes on the way: the rows of every part, followed by its copy of those of the top.
#[derive(Debug, Clone)]
pub struct Workspace(Vec<Vec<Row>>);

/// The widths of the tiles that so many columns are cut into.
fn widths(columns: usize) -> impl Iterator<Item = usize> {
    let widest = |left: usize| [8, 4, 2, 1].into_iter().find(|&width| width <= left);
    let cut = move |&(left, width): &(usize, usize)| {
        let left = left - width;
        widest(left).map(|width| (left, width))
    };
    std::iter::successors(widest(columns).map(|width| (columns, width)), cut)
        .map(|(_, width)| width)
}

impl Plan {
    /// Cuts the elimination tree.
    pub fn new(elimination: &Elimination) -> Self {
        let (parts, top) = cut(elimination);
        let mut values_at = vec![0];
        for s in 0..elimination.supernodes() {
            let mut left = elimination.columns(s).len();
            let mut end = values_at[s];
            for width in widths(left) {
                end += width * (left + elimination.pattern(s).len());
                left -= width;
            }
            values_at.push(end);
        }
        // For every row of the factor its place among the top's rows, or among its part's.
        let mut place = vec![0_u32; elimination.n()];
        let mut in_top = vec![false; elimination.n()];
        let part = |supernodes: &[usize], place: &mut [u32]| {
            let mut part = Part::default();
            for column in supernodes.iter().flat_map(|&s| elimination.columns(s)) {
                place[column] = part.rows.len() as u32;
                part.rows.push(elimination.order()[column]);
            }
            part
        };
        let supernodes = top;
        let mut top = part(&supernodes, &mut place);
        for &s in &supernodes {
            in_top[elimination.columns(s)].fill(true);
        }
        top.tile(elimination, &supernodes, &values_at, |row| place[row]);
        let parts = parts.into_iter().map(|supernodes| {
            let mut part = part(&supernodes, &mut place);
            let own = part.rows.len() as u32;
            let local = |row: usize| if in_top[row] { own + place[row] } else { place[row] };
            part.tile(elimination, &supernodes, &values_at, local);
            part
        });
        Self { parts: parts.collect(), top, values_at }
    }

    /// Factorises L − σB. Returns the factor and the number of negative entries of D; `None` when there is no memory
    /// for it.
    ///
    /// # Errors
    /// [`BadPivot`].
    pub fn factorise(
        &self,
        pencil: Pencil<'_>,
        sigma: f64,
        elimination: &Elimination,
    ) -> Option<Result<(Packed, usize), BadPivot>> {
        let mut values = Vec::new();
        let fill = self.values_at.last().map_or(0, |&end| end);
        values.try_reserve_exact(fill).ok()?;
        values.resize(fill, 0.0);
        let packer = Packer { plan: self, values: &mut values, first: 0 };
        let negative = multifrontal::factorise(pencil, sigma, elimination, packer);
        Some(negative.map(|negative| (Packed(values), negative)))
    }

    /// Room for solves.
    pub fn workspace(&self) -> Workspace {
        let top = self.top.rows.len();
        let rooms = self.parts.iter().map(|part| vec![[0.0; WIDTH]; part.rows.len() + top]);
        Workspace(rooms.chain([vec![[0.0; WIDTH]; top]]).collect())
    }

    /// X ← (R D Rᵀ)⁻¹ X.
    pub fn solve(&self, packed: &Packed, x: &mut Panel, workspace: &mut Workspace) {
        let rows = x.rows();
        let values = packed.0.as_slice();
        let (top, rooms) = workspace.0.split_last_mut().expect("the top is always there");
        rooms.par_iter_mut().zip(&self.parts).for_each(|(room, part)| {
            let (own, copy) = room.split_at_mut(part.rows.len());
            own.iter_mut().zip(&part.rows).for_each(|(to, &from)| *to = rows[from as usize]);
            copy.fill([0.0; WIDTH]);
            part.run(values, room, Direction::Forward);
        });
        for (i, (sum, &from)) in top.iter_mut().zip(&self.top.rows).enumerate() {
            *sum = rows[from as usize];
            for (room, part) in rooms.iter().zip(&self.parts) {
                let copy = &room[part.rows.len() + i];
                (0..WIDTH).for_each(|j| sum[j] += copy[j]);
            }
        }
        self.top.run(values, top, Direction::Forward);
        self.top.run(values, top, Direction::Backward);
        rooms.par_iter_mut().zip(&self.parts).for_each(|(room, part)| {
            room[part.rows.len()..].copy_from_slice(top);
            part.run(values, room, Direction::Backward);
        });
        let rows = x.rows_mut();
        let all = self.parts.iter().zip(rooms).chain([(&self.top, top)]);
        for (part, room) in all {
            part.rows.iter().zip(&*room).for_each(|(&to, from)| rows[to as usize] = *from);
        }
    }
}

impl Taker for Packer<'_> {
    fn split(self, s: usize) -> (Self, Self) {
        let at = &self.plan.values_at;
        let (before, after) = self.values.split_at_mut(at[s] - at[self.first]);
        let (plan, first) = (self.plan, self.first);
        (Self { plan, values: before, first }, Self { plan, values: after, first: s })
    }

    fn take(&mut self, s: usize, front: &Front) {
        let at = &self.plan.values_at;
        let mut values = &mut self.values[at[s] - at[self.first]..at[s + 1] - at[self.first]];
        let mut first = 0;
        for width in widths(front.columns()) {
            let (tile, after) = values.split_at_mut(width * (front.height() - first));
            for k in 0..width {
                let column = &front.column(first + k)[first..front.height()];
                for (row, &value) in tile.chunks_exact_mut(width).zip(column).skip(k) {
                    row[k] = value;
                }
                tile[k * width + k] = column[k].recip();
            }
            values = after;
            first += width;
        }
    }
}

/// The supernodes of every part and those of the top, each ascending.
fn cut(elimination: &Elimination) -> (Vec<Vec<usize>>, Vec<usize>) {
    let work = elimination.subtree_sums(|columns, below| columns * (columns + below));
    let mut subtrees: Vec<usize> = elimination.roots().collect();
    let total: usize = subtrees.iter().map(|&s| work[s]).sum();
    let heaviest = |subtrees: &[usize]| (0..subtrees.len()).max_by_key(|&i| (work[subtrees[i]], i));
    let mut top = Vec::new();
    while let Some(i) = heaviest(&subtrees) {
        if work[subtrees[i]] as f64 <= SHARE * total as f64 {
            break;
        }
        let s = subtrees.swap_remove(i);
        top.push(s);
        subtrees.extend(elimination.children(s));
    }
    top.sort_unstable();
    // Each to the part with the least so far, the heaviest first.
    subtrees.sort_by_key(|&s| (std::cmp::Reverse(work[s]), s));
    let mut parts = vec![(0, Vec::new()); PARTS];
    for root in subtrees {
        let (load, supernodes) =
            parts.iter_mut().min_by_key(|(load, _)| *load).expect("there are parts");
        *load += work[root];
        supernodes.extend(elimination.subtree(root));
    }
    let sorted = |(_, mut supernodes): (usize, Vec<usize>)| {
        supernodes.sort_unstable();
        supernodes
    };
    (parts.into_iter().map(sorted).collect(), top)
}

impl Part {
    /// Cuts supernodes into tiles; `local` has the part's index for a row of the factor.
    fn tile(
        &mut self,
        elimination: &Elimination,
        supernodes: &[usize],
        values_at: &[usize],
        local: impl Fn(usize) -> u32,
    ) {
        let mut column = 0;
        for &s in supernodes {
            let pattern = elimination.pattern(s);
            let first_below = self.below.len() as u32;
            self.below.extend(pattern.iter().map(|&row| local(row as usize)));
            let below = [first_below, self.below.len() as u32];
            let mut values = values_at[s];
            let mut left = elimination.columns(s).len();
            for width in widths(left) {
                let inside = (left - width) as u32;
                self.tiles.push(Tile { column, width: width as u32, inside, below, values });
                values += width * (left + pattern.len());
                column += width as u32;
                left -= width;
            }
        }
    }

    fn run(&self, values: &[f64], x: &mut [Row], direction: Direction) {
        Arch::new().dispatch(Sweep { part: self, values, x, direction });
    }

    /// The values of a tile: its triangle, the rows inside the diagonal block, and those below it.
    #[inline(always)]
    fn view<'a, const T: usize>(&'a self, tile: &Tile, values: &'a [f64]) -> View<'a, T> {
        let [first, last] = tile.below.map(|at| at as usize);
        let below = &self.below[first..last];
        let rows = T + tile.inside as usize + below.len();
        let values = values[tile.values..tile.values + rows * T].as_chunks::<T>().0;
        let (triangle, values) = values.split_at(T);
        let (inside, outside) = values.split_at(tile.inside as usize);
        View { triangle, inside, outside, below }
    }
}

/// A tile of T columns.
struct View<'a, const T: usize> {
    triangle: &'a [[f64; T]],
    inside: &'a [[f64; T]],
    outside: &'a [[f64; T]],
    /// The rows that `outside` stands for.
    below: &'a [u32],
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Direction {
    /// R⁻¹.
    Forward,
    /// R⁻ᵀ D⁻¹.
    Backward,
}

struct Sweep<'a> {
    part: &'a Part,
    values: &'a [f64],
    x: &'a mut [Row],
    direction: Direction,
}

impl WithSimd for Sweep<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { part, values, x, direction } = self;
        for k in 0..WIDTH / S::F64_LANES {
            if direction == Direction::Forward {
                for tile in &part.tiles {
                    match tile.width {
                        8 => forward::<S, 8>(simd, part.view(tile, values), tile, x, k),
                        4 => forward::<S, 4>(simd, part.view(tile, values), tile, x, k),
                        2 => forward::<S, 2>(simd, part.view(tile, values), tile, x, k),
                        _ => forward::<S, 1>(simd, part.view(tile, values), tile, x, k),
                    }
                }
            } else {
                for tile in part.tiles.iter().rev() {
                    match tile.width {
                        8 => backward::<S, 8>(simd, part.view(tile, values), tile, x, k),
                        4 => backward::<S, 4>(simd, part.view(tile, values), tile, x, k),
                        2 => backward::<S, 2>(simd, part.view(tile, values), tile, x, k),
                        _ => backward::<S, 1>(simd, part.view(tile, values), tile, x, k),
                    }
                }
            }
        }
    }
}

/// R⁻¹ for the columns of a tile: solves their triangle, updates all rows below it.
#[inline(always)]
fn forward<S: Simd, const T: usize>(
    simd: S,
    view: View<'_, T>,
    tile: &Tile,
    x: &mut [Row],
    k: usize,
) {
    let (own, after) = x[tile.column as usize..].split_at_mut(T);
    let mut solved = [simd.splat_f64s(0.0); T];
    for t in 0..T {
        let mut sum = strip::<S, WIDTH>(&own[t], k);
        for u in 0..t {
            sum = simd.mul_add_e_f64s(simd.splat_f64s(view.triangle[t][u]), solved[u], sum);
        }
        *strip_mut::<S, WIDTH>(&mut own[t], k) = sum;
        solved[t] = simd.neg_f64s(sum);
    }
    for (row, values) in after.iter_mut().zip(view.inside) {
        update::<S, T>(simd, strip_mut::<S, WIDTH>(row, k), values, &solved);
    }
    for (&row, values) in view.below.iter().zip(view.outside) {
        update::<S, T>(simd, strip_mut::<S, WIDTH>(&mut x[row as usize], k), values, &solved);
    }
}

/// Adds one row of a tile times what was solved.
#[inline(always)]
fn update<S: Simd, const T: usize>(
    simd: S,
    row: &mut S::f64s,
    values: &[f64; T],
    solved: &[S::f64s; T],
) {
    let mut sum = *row;
    for t in 0..T {
        sum = simd.mul_add_e_f64s(simd.splat_f64s(values[t]), solved[t], sum);
    }
    *row = sum;
}

/// D⁻¹, then R⁻ᵀ, for the columns of a tile, whose rows below are done.
#[inline(always)]
fn backward<S: Simd, const T: usize>(
    simd: S,
    view: View<'_, T>,
    tile: &Tile,
    x: &mut [Row],
    k: usize,
) {
    let mut sums = [simd.splat_f64s(0.0); T];
    for (&row, values) in view.below.iter().zip(view.outside) {
        let row = strip::<S, WIDTH>(&x[row as usize], k);
        for t in 0..T {
            sums[t] = simd.mul_add_e_f64s(simd.splat_f64s(values[t]), row, sums[t]);
        }
    }
    let (own, after) = x[tile.column as usize..].split_at_mut(T);
    for (row, values) in after.iter().zip(view.inside) {
        let row = strip::<S, WIDTH>(row, k);
        for t in 0..T {
            sums[t] = simd.mul_add_e_f64s(simd.splat_f64s(values[t]), row, sums[t]);
        }
    }
    for t in (0..T).rev() {
        let row = strip_mut::<S, WIDTH>(&mut own[t], k);
        let inverse = simd.splat_f64s(view.triangle[t][t]);
        let value = simd.sub_f64s(simd.mul_f64s(*row, inverse), sums[t]);
        *row = value;
        for u in 0..t {
            sums[u] = simd.mul_add_e_f64s(simd.splat_f64s(view.triangle[t][u]), value, sums[u]);
        }
    }
}
