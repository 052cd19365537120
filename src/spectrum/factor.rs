//! Sparse factorisations L − σB = R D Rᵀ, by faer: one symbolic analysis, any number of shifts.
//!
//! The same factorisation serves three ends: solves with a positive definite matrix (σ < 0), solves with an
//! indefinite one (σ inside the spectrum), and counting, since D has as many negative entries as there are
//! eigenvalues below σ (Sylvester). It is not pivoted and not regularised: an indefinite one may lose digits, which
//! its users have to measure.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::ldlt::factor::{LdltError, LdltRegularization};
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
    supernodal::{SupernodalLdltRef, SymbolicSupernodalCholesky},
};
use faer::sparse::linalg::{SupernodalThreshold, SymbolicSupernodalParams};
use faer::sparse::{SparseColMat, SymbolicSparseColMat};
use faer::{Par, Side};

use super::panel::{Panel, WIDTH};
use super::triangular::{Packed, Plan, Workspace};
use super::{Dense, Pencil, SpectrumError};

/// Which neighbouring supernodes become one: up to four columns together, where that stores no zeros. Wide supernodes
/// factorise faster, zeros are solved with in vain; an eigensolver solves a hundred times as often as it factorises.
const RELAX: [(usize, f64); 1] = [(4, 0.0)];

/// The fill-reducing analysis of the pattern of L − σB: valid for every σ.
pub struct Analysis<'a> {
    pencil: Pencil<'a>,
    lower: Lower,
    symbolic: SymbolicCholesky<usize>,
    plan: Plan,
}

/// L − σB = R D Rᵀ, ready for solves with several right-hand sides.
pub struct Factor<'s> {
    analysis: &'s Analysis<'s>,
    packed: Packed,
}

impl<'a> Analysis<'a> {
    /// Orders and analyses the pattern of the pencil.
    ///
    /// # Errors
    /// [`SpectrumError::OutOfMemory`].
    pub fn new(pencil: Pencil<'a>) -> Result<Self, SpectrumError> {
        let lower = Lower::of(pencil);
        let parameters = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
            supernodal_params: SymbolicSupernodalParams { relax: Some(&RELAX) },
            ..Default::default()
        };
        let symbolic = factorize_symbolic_cholesky(
            lower.matrix.symbolic(),
            Side::Lower,
            SymmetricOrdering::Amd,
            parameters,
        )
        .map_err(|_| SpectrumError::OutOfMemory { n: pencil.n() })?;
        let order = symbolic.perm().expect("AMD always gives an order").arrays().0;
        let plan = Plan::new(supernodes(&symbolic), order);
        Ok(Self { pencil, lower, symbolic, plan })
    }

    /// R D Rᵀ of L − σB.
    ///
    /// # Errors
    /// [`SpectrumError::Breakdown`] when a pivot is zero or not a number, [`SpectrumError::OutOfMemory`].
    pub fn factor(&self, sigma: f64) -> Result<Factor<'_>, SpectrumError> {
        let values = self.factorise(sigma)?;
        Ok(self.packed(&values))
    }

    /// R D Rᵀ of L + μB, μ > 0, which is positive definite.
    ///
    /// # Errors
    /// Those of [`Self::factor`]; [`SpectrumError::Breakdown`] also when a pivot is negative.
    pub fn positive(&self, mu: f64) -> Result<Factor<'_>, SpectrumError> {
        let values = self.factorise(-mu)?;
        match self.diagonal(&values).position(|d| d.is_nan() || d <= 0.0) {
            None => Ok(self.packed(&values)),
            Some(pivot) => Err(SpectrumError::Breakdown { sigma: -mu, pivot }),
        }
    }

    /// The number of negative entries of D: of eigenvalues below σ.
    ///
    /// # Errors
    /// Those of [`Self::factor`].
    pub fn negative_pivots(&self, sigma: f64) -> Result<usize, SpectrumError> {
        let values = self.factorise(sigma)?;
        Ok(self.diagonal(&values).filter(|&d| d < 0.0).count())
    }

    /// The values of all supernodes.
    fn factorise(&self, sigma: f64) -> Result<Vec<f64>, SpectrumError> {
        let matrix = self.lower.shifted(self.pencil, sigma);
        let out_of_memory = || SpectrumError::OutOfMemory { n: self.pencil.n() };
        let mut values = Vec::new();
        let fill = self.symbolic.len_val();
        values.try_reserve_exact(fill).map_err(|_| out_of_memory())?;
        values.resize(fill, 0.0);
        let scratch =
            self.symbolic.factorize_numeric_ldlt_scratch::<f64>(Par::Seq, Default::default());
        let mut scratch = MemBuffer::try_new(scratch).map_err(|_| out_of_memory())?;
        self.symbolic
            .factorize_numeric_ldlt(
                &mut values,
                matrix.as_ref(),
                Side::Lower,
                LdltRegularization::default(),
                Par::Seq,
                MemStack::new(&mut scratch),
                Default::default(),
            )
            .map_err(|LdltError::ZeroPivot { index }| SpectrumError::Breakdown {
                sigma,
                pivot: index,
            })?;
        Ok(values)
    }

    /// D, in elimination order.
    fn diagonal<'v>(&'v self, values: &'v [f64]) -> impl Iterator<Item = f64> + 'v {
        let symbolic = self.supernodes();
        let factor = SupernodalLdltRef::new(symbolic, values);
        (0..symbolic.n_supernodes()).flat_map(move |s| {
            let block = factor.supernode(s).val();
            (0..block.ncols()).map(move |j| block[(j, j)])
        })
    }

    fn packed(&self, values: &[f64]) -> Factor<'_> {
        Factor { analysis: self, packed: self.plan.pack(self.supernodes(), values) }
    }

    fn supernodes(&self) -> &SymbolicSupernodalCholesky<usize> {
        supernodes(&self.symbolic)
    }
}

fn supernodes(symbolic: &SymbolicCholesky<usize>) -> &SymbolicSupernodalCholesky<usize> {
    match symbolic.raw() {
        SymbolicCholeskyRaw::Supernodal(symbolic) => symbolic,
        SymbolicCholeskyRaw::Simplicial(_) => unreachable!("a supernodal analysis was asked for"),
    }
}

impl Factor<'_> {
    /// Room for [`Self::solve_panel`].
    pub fn workspace(&self) -> Workspace {
        self.analysis.plan.workspace()
    }

    /// X ← (L − σB)⁻¹ X for the eight columns of a panel.
    pub fn solve_panel(&self, x: &mut Panel, workspace: &mut Workspace) {
        self.analysis.plan.solve(&self.packed, x, workspace);
    }

    /// X ← (L − σB)⁻¹ X, whatever the number of columns.
    pub fn solve_in_place(&self, x: &mut Dense) {
        let mut workspace = self.workspace();
        for first in (0..x.ncols()).step_by(WIDTH) {
            let mut panel = Panel::from_columns(x, first);
            self.solve_panel(&mut panel, &mut workspace);
            panel.write_columns(x, first);
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

    fn shifted(&self, pencil: Pencil<'_>, sigma: f64) -> SparseColMat<usize, f64> {
        let mut matrix = self.matrix.clone();
        let pointers = self.matrix.symbolic().col_ptr().to_vec();
        let rows = self.matrix.symbolic().row_idx().to_vec();
        let values = matrix.val_mut();
        for (source, scale) in [(pencil.stiffness, 1.0), (pencil.mass, -sigma)] {
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
                for (sigma, columns) in [(-0.7, 1), (-0.7, 3), (4.0, 11)] {
                    let x = Dense::from_fn(pencil.n(), columns, |i, j| ((i + 3 * j) as f64).sin());
                    let mut y = product(pencil.stiffness, &x);
                    y -= faer::Scale(sigma) * product(pencil.mass, &x);
                    let factor = analysis.factor(sigma).unwrap();
                    factor.solve_in_place(&mut y);
                    assert!((&y - &x).norm_max() < 1e-11);
                    // Below 4 the sphere has 0 and three times 2.
                    let below = analysis.negative_pivots(sigma).unwrap();
                    assert_eq!(below, if sigma > 0.0 { 4 } else { 0 });
                }
            }
        }
    }
}
