//! Who works on the rows of a matrix? The thread that has it, or all threads where this one is alone.
//!
//! A batch of several members keeps all threads busy, a member each. A lone member is cut into parts by its rows, and these
//! are dealt. How it is cut depends on its size alone, and sums over parts are taken in their order: so do the bits.

use std::cell::Cell;

use rayon::prelude::*;

/// Rows that are worked on at a time: what a layer makes of them stays in the second-level cache.
pub const ROWS: usize = 48;

/// Rows of which a part is made where parts are summed up.
const SUMMED: usize = 240;

/// The most parts that are summed up.
const MOST_SUMMED: usize = 4;

thread_local! {
    static DEALT: Cell<bool> = const { Cell::new(false) };
}

/// From now on what this thread does with rows is dealt to all threads: for one that has no others beside it. No bit depends
/// on it.
pub fn deal_rows() {
    DEALT.set(true);
}

/// Does `work` on every part, in whatever order.
pub fn for_each<T: Send>(parts: impl Iterator<Item = T>, work: impl Fn(T) + Send + Sync) {
    let mut parts = parts.peekable();
    let Some(first) = parts.next() else { return };
    if !DEALT.get() || parts.peek().is_none() {
        work(first);
        parts.for_each(work);
    } else {
        let parts: Vec<T> = std::iter::once(first).chain(parts).collect();
        parts.into_par_iter().with_max_len(1).for_each(work);
    }
}

/// How many rows of n make a part where parts are summed up.
pub fn rows_of_sum(n: usize) -> usize {
    let parts = (n / SUMMED).clamp(1, MOST_SUMMED);
    n.div_ceil(parts).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_part_is_worked_on_once_dealt_or_not() {
        let visit = || {
            let mut seen = vec![0; 100];
            for_each(seen.chunks_mut(7).enumerate(), |(part, rows)| {
                rows.iter_mut().for_each(|row| *row += part + 1);
            });
            seen
        };
        let alone = visit();
        assert!(alone.iter().enumerate().all(|(row, &seen)| seen == row / 7 + 1));
        deal_rows();
        assert_eq!(visit(), alone);
    }

    #[test]
    fn parts_of_a_sum_are_alike_and_not_many() {
        let parts = |n: usize| n.div_ceil(rows_of_sum(n));
        assert_eq!([0, 1, 144, 500, 2000, 100_000].map(parts), [0, 1, 1, 2, 4, 4]);
        assert_eq!(rows_of_sum(501), 251);
    }
}
