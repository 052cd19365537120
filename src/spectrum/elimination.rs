//! The order in which a factorisation eliminates rows, and what fills in: columns with one pattern, supernodes, and the
//! tree that they form.
//!
//! A supernode is a run of columns that have the same rows below their diagonal block: its pattern. Its parent is the
//! supernode of the first of these rows, and eliminating it touches nothing but ancestors. Order and patterns are faer's
//! (approximate minimum degree); the numbering is a postorder, so that a subtree is a run of supernodes.

use std::ops::Range;

use faer::Side;
use faer::sparse::SymbolicSparseColMat;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky, supernodal::SymbolicSupernodalCholesky,
};
use faer::sparse::linalg::{SupernodalThreshold, SymbolicSupernodalParams};

use super::{Pencil, SpectrumError};

/// Which neighbouring supernodes become one: up to four columns together, where that stores no zeros. Zeros are solved
/// with in vain, and an eigensolver solves a hundred times as often as it factorises.
const RELAX: [(usize, f64); 1] = [(4, 0.0)];

/// The parent of a root.
const NONE: u32 = u32::MAX;

/// The elimination of the pattern of L − σB: valid for every σ.
#[derive(Debug, Clone)]
pub struct Elimination {
    /// The row of the matrix for every row of the factor.
    order: Vec<u32>,
    /// The row of the factor for every row of the matrix.
    place: Vec<u32>,
    /// The first column of every supernode, and n.
    begin: Vec<u32>,
    /// The rows below the diagonal blocks, ascending, one supernode after the other.
    patterns: Vec<u32>,
    pattern_at: Vec<usize>,
    /// The first supernode of every subtree.
    first: Vec<u32>,
    parent: Vec<u32>,
}

impl Elimination {
    /// Orders and analyses the pattern of a pencil.
    ///
    /// # Errors
    /// [`SpectrumError::OutOfMemory`].
    pub fn new(pencil: Pencil<'_>) -> Result<Self, SpectrumError> {
        let parameters = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
            supernodal_params: SymbolicSupernodalParams { relax: Some(&RELAX) },
            ..Default::default()
        };
        let pattern = lower_pattern(pencil);
        let symbolic = factorize_symbolic_cholesky(
            pattern.as_ref(),
            Side::Lower,
            SymmetricOrdering::Amd,
            parameters,
        )
        .map_err(|_| SpectrumError::OutOfMemory { n: pencil.n() })?;
        let (order, place) = symbolic.perm().expect("AMD always gives an order").arrays();
        Ok(Self::from_supernodes(order, place, supernodes(&symbolic)))
    }

    fn from_supernodes(
        order: &[u32],
        place: &[u32],
        symbolic: &SymbolicSupernodalCholesky<u32>,
    ) -> Self {
        let count = symbolic.n_supernodes();
        let columns =
            |s: usize| symbolic.supernode_begin()[s] as usize..symbolic.supernode_end()[s] as usize;
        let mut of_column = vec![0_u32; order.len()];
        (0..count).for_each(|s| of_column[columns(s)].fill(s as u32));
        let parent = |s: usize| {
            let first = symbolic.supernode(s).pattern().first();
            first.map_or(NONE, |&row| of_column[row as usize])
        };
        let parents: Vec<u32> = (0..count).map(parent).collect();
        // faer's numbering is a postorder of one tree, but not always of several.
        let numbering = postorder(&parents);
        let (mut renumbered, mut moved) = (vec![0_u32; count], vec![0_u32; order.len()]);
        let (mut begin, mut new_order) = (vec![0_u32], Vec::with_capacity(order.len()));
        for (new, &old) in numbering.iter().enumerate() {
            renumbered[old] = new as u32;
            for column in columns(old) {
                moved[column] = new_order.len() as u32;
                new_order.push(order[column]);
            }
            begin.push(new_order.len() as u32);
        }
        let (mut patterns, mut pattern_at) = (Vec::new(), vec![0]);
        for &old in &numbering {
            let rows = symbolic.supernode(old).pattern().iter().map(|&row| moved[row as usize]);
            let start = patterns.len();
            patterns.extend(rows);
            patterns[start..].sort_unstable();
            pattern_at.push(patterns.len());
        }
        let above = |&old: &usize| match parents[old] {
            NONE => NONE,
            parent => renumbered[parent as usize],
        };
        let parent: Vec<u32> = numbering.iter().map(above).collect();
        let mut first: Vec<u32> = (0..count as u32).collect();
        for s in (0..count).filter(|&s| parent[s] != NONE) {
            let above = parent[s] as usize;
            first[above] = first[above].min(first[s]);
        }
        let place = place.iter().map(|&row| moved[row as usize]).collect();
        Self { order: new_order, place, begin, patterns, pattern_at, first, parent }
    }

    /// The number of rows.
    pub fn n(&self) -> usize {
        self.order.len()
    }

    /// The row of the matrix for every row of the factor.
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// The row of the factor for every row of the matrix.
    pub fn place(&self) -> &[u32] {
        &self.place
    }

    /// The number of supernodes. They are numbered so that the descendants of each come right before it.
    pub fn supernodes(&self) -> usize {
        self.first.len()
    }

    /// The columns of a supernode.
    pub fn columns(&self, s: usize) -> Range<usize> {
        self.begin[s] as usize..self.begin[s + 1] as usize
    }

    /// The rows below the diagonal block of a supernode, ascending.
    pub fn pattern(&self, s: usize) -> &[u32] {
        &self.patterns[self.pattern_at[s]..self.pattern_at[s + 1]]
    }

    /// The rows of a supernode's front: its columns, and the rows below them.
    pub fn rows(&self, s: usize) -> impl Iterator<Item = usize> {
        self.columns(s).chain(self.pattern(s).iter().map(|&row| row as usize))
    }

    /// A supernode and all its descendants.
    pub fn subtree(&self, s: usize) -> Range<usize> {
        self.first[s] as usize..s + 1
    }

    /// The children of a supernode, the last first.
    pub fn children(&self, s: usize) -> impl Iterator<Item = usize> {
        self.siblings(self.first[s] as usize, s)
    }

    /// The supernodes without a parent, the last first.
    pub fn roots(&self) -> impl Iterator<Item = usize> {
        self.siblings(0, self.supernodes())
    }

    /// The roots of the subtrees that make up a run of supernodes.
    fn siblings(&self, first: usize, end: usize) -> impl Iterator<Item = usize> {
        let before = move |end: usize| (end > first).then(|| end - 1);
        std::iter::successors(before(end), move |&s| before(self.first[s] as usize))
    }

    /// The supernode that eliminates the first row of a supernode's pattern.
    pub fn parent(&self, s: usize) -> Option<usize> {
        (self.parent[s] != NONE).then_some(self.parent[s] as usize)
    }

    /// For every supernode the sum of `cost(columns, rows below)` over its subtree.
    pub fn subtree_sums(&self, cost: impl Fn(usize, usize) -> usize) -> Vec<usize> {
        let mut sums = vec![0; self.supernodes()];
        for s in 0..self.supernodes() {
            sums[s] += cost(self.columns(s).len(), self.pattern(s).len());
            if let Some(parent) = self.parent(s) {
                sums[parent] += sums[s];
            }
        }
        sums
    }
}

/// The nodes of a forest in an order in which the descendants of each come right before it.
fn postorder(parents: &[u32]) -> Vec<usize> {
    let mut children = vec![Vec::new(); parents.len()];
    let mut open = Vec::new();
    for (node, &parent) in parents.iter().enumerate() {
        match parent {
            NONE => open.push(node),
            parent => children[parent as usize].push(node),
        }
    }
    // Every node before its descendants, the last child first, read backwards.
    let mut order = Vec::with_capacity(parents.len());
    while let Some(node) = open.pop() {
        order.push(node);
        open.append(&mut children[node]);
    }
    order.reverse();
    order
}

fn supernodes(symbolic: &SymbolicCholesky<u32>) -> &SymbolicSupernodalCholesky<u32> {
    match symbolic.raw() {
        SymbolicCholeskyRaw::Supernodal(symbolic) => symbolic,
        SymbolicCholeskyRaw::Simplicial(_) => unreachable!("a supernodal analysis was asked for"),
    }
}

/// The lower triangle of the union of the patterns of L and B, in compressed columns.
fn lower_pattern(pencil: Pencil<'_>) -> SymbolicSparseColMat<u32> {
    // The matrices are symmetric: row i of the upper triangle is column i of the lower one.
    let n = pencil.n();
    let mut pointers = vec![0_u32];
    let mut rows: Vec<u32> = Vec::with_capacity(pencil.stiffness.nnz() / 2 + n);
    for (l, b) in pencil.stiffness.outer_iterator().zip(pencil.mass.outer_iterator()) {
        let i = pointers.len() - 1;
        let start = rows.len();
        let below = l.indices().iter().chain(b.indices()).filter(|&&j| j >= i);
        rows.extend(below.map(|&j| j as u32));
        rows[start..].sort_unstable();
        let mut end = start;
        for k in start..rows.len() {
            if k == start || rows[k] != rows[k - 1] {
                rows[end] = rows[k];
                end += 1;
            }
        }
        rows.truncate(end);
        pointers.push(rows.len() as u32);
    }
    SymbolicSparseColMat::new_checked(n, n, pointers, None, rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::sample::icosphere;
    use crate::operators::{MassKind, Operators};

    #[test]
    fn a_subtree_is_a_run_of_supernodes_and_patterns_lie_among_ancestors() {
        for levels in [0, 2, 4] {
            let operators = Operators::assemble(&icosphere(levels), MassKind::Lumped).unwrap();
            let elimination = Elimination::new(Pencil::from(&operators)).unwrap();
            let mut seen = vec![false; elimination.supernodes()];
            for s in 0..elimination.supernodes() {
                let mut end = s;
                for child in elimination.children(s) {
                    assert_eq!(elimination.parent(child), Some(s));
                    assert_eq!(elimination.subtree(child).end, end);
                    end = elimination.subtree(child).start;
                    seen[child] = true;
                    // What a child touches, its parent eliminates or touches too.
                    for row in elimination.pattern(child) {
                        let own = elimination.columns(s).contains(&(*row as usize));
                        assert!(own || elimination.pattern(s).binary_search(row).is_ok());
                    }
                }
                assert_eq!(end, elimination.subtree(s).start);
            }
            elimination.roots().for_each(|root| seen[root] = true);
            assert!(seen.iter().all(|&seen| seen));
        }
    }

    #[test]
    fn descendants_come_right_before_each_node_of_a_forest() {
        // Two trees whose nodes are mixed: 0 and 2 under 4, 1 and 3 under 5.
        let order = postorder(&[4, 5, 4, 5, NONE, NONE]);
        assert_eq!(order, [0, 2, 4, 1, 3, 5]);
    }

    #[test]
    fn the_order_is_a_permutation() {
        let operators = Operators::assemble(&icosphere(3), MassKind::Consistent).unwrap();
        let elimination = Elimination::new(Pencil::from(&operators)).unwrap();
        for (row, &of_matrix) in elimination.order().iter().enumerate() {
            assert_eq!(elimination.place()[of_matrix as usize] as usize, row);
        }
    }
}
