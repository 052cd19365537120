//! The inner product of the mass B, for panels of functions.
//!
//! A diagonal B is a weight of every row. Whatever is asked of a panel W is then answered while a chunk of its rows is
//! in the cache: it loses its parts along some panels V, is multiplied from the right, and meets V and itself in inner
//! products, all in one pass over memory. Any other B is applied to W first, which takes passes of its own.
//!
//! Chunks have a fixed size, and their sums are added in order: the bits of a result do not depend on the number of
//! threads.

use rayon::prelude::*;

use super::panel::{self, CHUNK, Panel, Row, Square, WIDTH};
use crate::operators::Sparse;

/// ⟨x, y⟩ = xᵀBy.
pub enum Metric<'a> {
    /// The diagonal of B.
    Diagonal(Vec<f64>),
    /// B, and room for BW.
    General(&'a Sparse, Panel),
}

/// W ← (W − VC) S.
#[derive(Clone, Copy)]
pub struct Change<'a> {
    /// V.
    pub panels: &'a [&'a Panel],
    /// C, as many as panels.
    pub coefficients: &'a [Square],
    /// S.
    pub transform: &'a Square,
}

/// The inner products of a panel W.
pub struct Products {
    /// VᵀBW for every panel of V.
    pub with: Vec<Square>,
    /// WᵀBW.
    pub own: Square,
}

impl<'a> Metric<'a> {
    /// The metric of a mass matrix.
    pub fn new(mass: &'a Sparse) -> Self {
        let n = mass.rows();
        if mass.nnz() == n && mass.iter().all(|(_, (i, j))| i == j) {
            Self::Diagonal(mass.data().to_vec())
        } else {
            Self::General(mass, Panel::zeros(n))
        }
    }

    /// BX.
    pub fn apply(&self, x: &Panel) -> Panel {
        let mut y = Panel::zeros(x.rows().len());
        match self {
            Self::Diagonal(weights) => panel::scale(weights, x, &mut y),
            Self::General(mass, _) => panel::apply(mass, x, &mut y),
        }
        y
    }

    /// VᵀBW and WᵀBW.
    pub fn products(&mut self, v: &[&Panel], w: &Panel) -> Products {
        let all: Vec<&Panel> = v.iter().copied().chain([w]).collect();
        Products::of(match self {
            Self::Diagonal(weights) => panel::coefficients(&all, [w], Some(weights)),
            Self::General(mass, product) => {
                panel::apply(mass, w, product);
                panel::coefficients(&all, [product], None)
            }
        })
    }

    /// VᵀBW for two panels W.
    pub fn of_two(&mut self, v: &[&Panel], w: [&Panel; 2]) -> Vec<[Square; 2]> {
        match self {
            Self::Diagonal(weights) => panel::coefficients(v, w, Some(weights)),
            Self::General(mass, product) => {
                let [first, second] = w.map(|w| {
                    panel::apply(mass, w, product);
                    panel::coefficients(v, [product], None)
                });
                first.into_iter().zip(second).map(|([a], [b])| [a, b]).collect()
            }
        }
    }

    /// Changes W, and returns VᵀBW and WᵀBW of what has become of it.
    pub fn change(&mut self, w: &mut Panel, change: Change<'_>, v: &[&Panel]) -> Products {
        let chunks = w.rows_mut().par_chunks_mut(CHUNK).enumerate();
        let Self::Diagonal(weights) = self else {
            chunks.for_each(|(chunk, w)| change.make(w, chunk * CHUNK));
            return self.products(v, w);
        };
        let sums = chunks.map(|(chunk, w)| {
            let rows = chunk * CHUNK..chunk * CHUNK + w.len();
            change.make(w, rows.start);
            let with = v.iter().map(|v| &v.rows()[rows.clone()]).chain([&*w]);
            with.map(|v| [panel::gram(v, w, Some(&weights[rows.clone()]))]).collect()
        });
        Products::of(panel::total(sums.collect()))
    }
}

impl Change<'_> {
    /// Changes a chunk of W, whose rows are those from number `first` on.
    fn make(self, w: &mut [Row], first: usize) {
        for (v, c) in self.panels.iter().zip(self.coefficients) {
            panel::subtract(w, &v.rows()[first..first + w.len()], c);
        }
        panel::transform(w, self.transform);
    }
}

impl Products {
    /// From VᵀBW with WᵀBW last.
    fn of(all: Vec<[Square; 1]>) -> Self {
        let mut with: Vec<Square> = all.into_iter().flatten().collect();
        let own = with.pop().unwrap_or_default();
        Self { with, own }
    }

    /// (W − VVᵀBW)ᵀB(W − VVᵀBW) for orthonormal V.
    pub fn left(&self) -> Square {
        let mut left = self.own;
        for with in &self.with {
            for i in 0..WIDTH {
                for j in 0..WIDTH {
                    left[i][j] -= (0..WIDTH).map(|k| with[k][i] * with[k][j]).sum::<f64>();
                }
            }
        }
        left
    }
}
