//! Sparse factorisations of L + μB, by faer: one symbolic analysis, any number of shifts.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::ldlt::factor::{LdltError, LdltRegularization};
use faer::linalg::cholesky::llt::factor::{LltError, LltRegularization};
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky, simplicial::SimplicialLdltRef, supernodal::SupernodalLdltRef,
};
use faer::sparse::{SparseColMat, SymbolicSparseColMat};
use faer::{Conj, Par, Side};

use super::{Dense, Pencil, SpectrumError};

/// The fill-reducing analysis of the pattern of L + μB: valid for every μ.
pub struct Analysis<'a> {
    pencil: Pencil<'a>,
    lower: Lower,
    symbolic: SymbolicCholesky<usize>,
}

/// L + μB = RᵀR with μ > 0: solves with several right-hand sides.
pub struct Cholesky<'s> {
    symbolic: &'s SymbolicCholesky<usize>,
    values: Vec<f64>,
}

impl<'a> Analysis<'a> {
    /// Orders and analyses the pattern of the pencil.
    pub fn new(pencil: Pencil<'a>) -> Result<Self, SpectrumError> {
        let lower = Lower::of(pencil);
        let symbolic = factorize_symbolic_cholesky(
            lower.matrix.symbolic(),
            Side::Lower,
            SymmetricOrdering::Amd,
            CholeskySymbolicParams::default(),
        )
        .map_err(|_| SpectrumError::OutOfMemory { n: pencil.n() })?;
        Ok(Self { pencil, lower, symbolic })
    }

    /// Cholesky of L + μB, μ > 0.
    pub fn cholesky(&self, mu: f64) -> Result<Cholesky<'_>, SpectrumError> {
        let matrix = self.lower.shifted(self.pencil, mu);
        let mut values = vec![0.0; self.symbolic.len_val()];
        let scratch =
            self.symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default());
        self.symbolic
            .factorize_numeric_llt(
                &mut values,
                matrix.as_ref(),
                Side::Lower,
                LltRegularization::default(),
                Par::Seq,
                MemStack::new(&mut self.buffer(scratch)?),
                Default::default(),
            )
            .map_err(|LltError::NonPositivePivot { index }| SpectrumError::Breakdown {
                shift: mu,
                pivot: index,
            })?;
        Ok(Cholesky { symbolic: &self.symbolic, values })
    }

    /// The diagonal D of L − σB = R D Rᵀ, unregularised, in elimination order.
    pub fn ldlt_diagonal(&self, sigma: f64) -> Result<Vec<f64>, SpectrumError> {
        let matrix = self.lower.shifted(self.pencil, -sigma);
        let mut values = vec![0.0; self.symbolic.len_val()];
        let scratch =
            self.symbolic.factorize_numeric_ldlt_scratch::<f64>(Par::Seq, Default::default());
        self.symbolic
            .factorize_numeric_ldlt(
                &mut values,
                matrix.as_ref(),
                Side::Lower,
                LdltRegularization::default(),
                Par::Seq,
                MemStack::new(&mut self.buffer(scratch)?),
                Default::default(),
            )
            .map_err(|LdltError::ZeroPivot { index }| SpectrumError::Breakdown {
                shift: -sigma,
                pivot: index,
            })?;
        Ok(diagonal(self.symbolic.raw(), &values))
    }

    fn buffer(&self, scratch: faer::dyn_stack::StackReq) -> Result<MemBuffer, SpectrumError> {
        MemBuffer::try_new(scratch).map_err(|_| SpectrumError::OutOfMemory { n: self.pencil.n() })
    }
}

impl Cholesky<'_> {
    /// X ← (L + μB)⁻¹ X.
    pub fn solve_in_place(&self, x: &mut Dense) {
        let scratch = self.symbolic.solve_in_place_scratch::<f64>(x.ncols(), Par::Seq);
        let mut buffer = MemBuffer::new(scratch);
        LltRef::new(self.symbolic, &self.values).solve_in_place_with_conj(
            Conj::No,
            x.as_mut(),
            Par::Seq,
            MemStack::new(&mut buffer),
        );
    }
}

fn diagonal(symbolic: &SymbolicCholeskyRaw<usize>, values: &[f64]) -> Vec<f64> {
    match symbolic {
        SymbolicCholeskyRaw::Simplicial(symbolic) => {
            let values = SimplicialLdltRef::new(symbolic, values).values();
            symbolic.col_ptr()[..symbolic.ncols()].iter().map(|&start| values[start]).collect()
        }
        SymbolicCholeskyRaw::Supernodal(symbolic) => {
            let factor = SupernodalLdltRef::new(symbolic, values);
            (0..symbolic.n_supernodes())
                .flat_map(|s| {
                    let block = factor.supernode(s).val();
                    (0..block.ncols()).map(move |j| block[(j, j)])
                })
                .collect()
        }
    }
}

/// The lower triangle of the union of the patterns of L and B, in compressed columns.
struct Lower {
    matrix: SparseColMat<usize, f64>,
}

impl Lower {
    fn of(pencil: Pencil<'_>) -> Self {
        // The matrices are symmetric: row i of the upper triangle is column i of the lower one.
        let n = pencil.n();
        let mut pointers = vec![0];
        let mut rows = Vec::with_capacity(pencil.stiffness.nnz() / 2 + n);
        for (l, b) in pencil.stiffness.outer_iterator().zip(pencil.mass.outer_iterator()) {
            let i = pointers.len() - 1;
            let start = rows.len();
            rows.extend(l.indices().iter().chain(b.indices()).copied().filter(|&j| j >= i));
            rows[start..].sort_unstable();
            let mut end = start;
            for k in start..rows.len() {
                if k == start || rows[k] != rows[k - 1] {
                    rows[end] = rows[k];
                    end += 1;
                }
            }
            rows.truncate(end);
            pointers.push(rows.len());
        }
        let values = vec![0.0; rows.len()];
        let symbolic = SymbolicSparseColMat::new_checked(n, n, pointers, None, rows);
        Self { matrix: SparseColMat::new(symbolic, values) }
    }

    fn shifted(&self, pencil: Pencil<'_>, mu: f64) -> SparseColMat<usize, f64> {
        let mut matrix = self.matrix.clone();
        let pointers = self.matrix.symbolic().col_ptr().to_vec();
        let rows = self.matrix.symbolic().row_idx().to_vec();
        let values = matrix.val_mut();
        for (source, scale) in [(pencil.stiffness, 1.0), (pencil.mass, mu)] {
            for (i, row) in source.outer_iterator().enumerate() {
                let mut at = pointers[i];
                for (j, &value) in row.iter().filter(|&(j, _)| j >= i) {
                    // Both are sorted, and the pattern holds every j: the walk always finds it.
                    while rows[at] != j {
                        at += 1;
                    }
                    values[at] += scale * value;
                }
            }
        }
        matrix
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::sample::icosphere;
    use crate::operators::{MassKind, Operators};
    use crate::spectrum::pencil::product;

    #[test]
    fn the_factor_solves_what_it_was_made_from() {
        for kind in [MassKind::Lumped, MassKind::Consistent] {
            for levels in [1, 3] {
                let operators = Operators::assemble(&icosphere(levels), kind).unwrap();
                let pencil = Pencil::from(&operators);
                let analysis = Analysis::new(pencil).unwrap();
                let mu = 0.7;
                let x = Dense::from_fn(pencil.n(), 3, |i, j| ((i + 3 * j) as f64).sin());
                let mut y = product(pencil.stiffness, &x);
                y += faer::Scale(mu) * product(pencil.mass, &x);
                analysis.cholesky(mu).unwrap().solve_in_place(&mut y);
                assert!((&y - &x).norm_max() < 1e-11);
            }
        }
    }
}
