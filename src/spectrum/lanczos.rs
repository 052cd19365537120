//! Block Lanczos: a B-orthonormal basis of the Krylov space of (L + μB)⁻¹B, eight vectors at a time.
//!
//! The operator is self-adjoint in the B-inner product and has the eigenvalues θ = 1/(λ + μ): the lowest λ
//! become dominant. Eight vectors at a time find up to eight copies of an eigenvalue together, and make every
//! product one of tall thin matrices. The basis is kept orthogonal to all of itself and to eigenvectors that are
//! known already.

use std::ops::Range;

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::Dense;
use super::factor::Factor;
use super::panel::{Panel, Row, Square, WIDTH, apply, coefficients, combine, subtract, transform};
use super::rayleigh_ritz::symmetric_eigen;
use super::triangular::Workspace;
use crate::operators::Sparse;

/// A direction shorter than this, relative to the vectors it comes from, is rounding: it is replaced by a random one.
const BREAKDOWN: f64 = 1e-10;

/// A direction shorter than this has lost digits of its orthogonality, and is orthogonalised again.
const SHORT: f64 = 1e-3;

/// New panels are orthogonalised against the whole basis twice in so many times, one right after the other; in between
/// the three-term recurrence keeps them orthogonal but for rounding, which it amplifies from step to step …
const PERIOD: usize = 4;

/// … and when more than this is lost in between, every time. T is as exact as rounding allows while the square of the
/// loss is rounding (Simon 1984).
const SEMI_ORTHOGONAL: f64 = 1e-9;

/// Vectors are orthonormal when their Gram matrix is this close to I.
const ORTHONORMAL: f64 = 1e-13;

/// The basis V, and T = VᵀB(L + μB)⁻¹BV, which is block tridiagonal.
pub struct Krylov<'a> {
    factor: &'a Factor<'a>,
    mass: &'a Sparse,
    /// What the basis is kept orthogonal to, B-orthonormal.
    known: Vec<Panel>,
    /// One panel more than T has blocks: the last has not been multiplied yet.
    basis: Vec<Panel>,
    diagonal: Vec<Square>,
    /// The operator takes the last panel of T to `basis.last()` times the last of these, and to what T says.
    coupling: Vec<Square>,
    /// Too much was lost by not orthogonalising against the whole basis every time.
    every_time: bool,
    rng: ChaCha8Rng,
    workspace: Workspace,
    product: Panel,
}

/// The eigenpairs of T.
pub struct Ritz {
    /// θ, ascending.
    pub values: Vec<f64>,
    /// Their vectors, m×m.
    pub vectors: Dense,
    /// ‖(L + μB)⁻¹Bx − θx‖ in the B-norm.
    pub residuals: Vec<f64>,
}

impl<'a> Krylov<'a> {
    /// A basis with its first panel: random and orthogonal to `known`. The bits depend on the arguments alone.
    pub fn new(factor: &'a Factor<'a>, mass: &'a Sparse, known: Vec<Panel>, seed: u64) -> Self {
        Self::from_start(factor, mass, known, Panel::zeros(mass.rows()), seed)
    }

    /// A basis whose first panel is made of `start`, orthogonal to `known`; columns that are zero become random.
    pub fn from_start(
        factor: &'a Factor<'a>,
        mass: &'a Sparse,
        known: Vec<Panel>,
        mut start: Panel,
        seed: u64,
    ) -> Self {
        let n = mass.rows();
        let mut krylov = Self {
            factor,
            mass,
            known,
            basis: Vec::new(),
            diagonal: Vec::new(),
            coupling: Vec::new(),
            every_time: false,
            rng: ChaCha8Rng::seed_from_u64(seed),
            workspace: factor.workspace(),
            product: Panel::zeros(n),
        };
        krylov.project(&mut start, 0..0);
        let size = longest(&krylov.gram(&start));
        let (first, _) = krylov.orthonormalise(start, size);
        krylov.basis.push(first);
        krylov
    }

    /// The dimension of T.
    pub fn dimension(&self) -> usize {
        self.diagonal.len() * WIDTH
    }

    /// Multiplies the newest panel by the operator, and takes what is new of the result for the next one.
    pub fn grow(&mut self) {
        let newest = self.basis.len() - 1;
        let mut w = Panel::zeros(self.mass.rows());
        apply(self.mass, &self.basis[newest], &mut w);
        self.factor.solve_panel(&mut w, &mut self.workspace);
        // What the three-term recurrence removes first; the rest of the basis sees rounding only.
        let size = longest(&self.gram(&w));
        let near = newest.saturating_sub(1)..newest + 1;
        let local = coefficients(&self.basis[near.clone()], &self.product);
        subtract(&mut w, &self.basis[near.clone()], &local);
        let all = self.every_time || newest % PERIOD >= PERIOD - 2;
        let against = if all { 0..newest + 1 } else { near };
        let global = self.project(&mut w, against);
        let mut diagonal = [[0.0; WIDTH]; WIDTH];
        if let (Some(first), Some(second)) = (local.last(), global.last()) {
            for i in 0..WIDTH {
                for j in 0..WIDTH {
                    diagonal[i][j] =
                        0.5 * (first[i][j] + first[j][i] + second[i][j] + second[j][i]);
                }
            }
        }
        self.diagonal.push(diagonal);
        let (next, coupling) = self.orthonormalise(w, size);
        self.basis.push(next);
        self.coupling.push(coupling);
    }

    /// WᵀBW. Leaves BW in `product`.
    fn gram(&mut self, w: &Panel) -> Square {
        apply(self.mass, w, &mut self.product);
        coefficients(std::slice::from_ref(w), &self.product)[0]
    }

    /// W ← W − VVᵀBW for what is known and for these panels of the basis. Returns the coefficients of the latter.
    fn project(&mut self, w: &mut Panel, against: Range<usize>) -> Vec<Square> {
        let length = longest(&self.gram(w));
        let basis = coefficients(&self.basis[against.clone()], &self.product);
        let known = coefficients(&self.known, &self.product);
        subtract(w, &self.basis[against], &basis);
        subtract(w, &self.known, &known);
        // What was lost of orthogonality since the last time.
        let far = basis.iter().rev().skip(2).flat_map(|c| c.as_flattened());
        let loss = far.fold(0.0_f64, |worst, c| worst.max(c.abs()));
        self.every_time |= loss > SEMI_ORTHOGONAL * length;
        basis
    }

    /// An orthonormal panel Q that is orthogonal to the basis, and R with W = QR; `size` is how long the vectors were
    /// that W is left of. Directions that W does not have are random ones, with zeros in R.
    fn orthonormalise(&mut self, mut w: Panel, size: f64) -> (Panel, Square) {
        let mut r = identity();
        for pass in 0..5 {
            let gram = self.gram(&w);
            if pass > 0 && distance_from_identity(&gram) < ORTHONORMAL {
                break;
            }
            let size = if pass == 0 { size } else { 1.0 };
            let floor = if pass == 0 { BREAKDOWN } else { SHORT } * size;
            let whitening = Whitening::of(&gram, floor);
            transform(&mut w, &whitening.forward);
            r = times(&whitening.backward, &r);
            if whitening.missing.contains(&true) {
                self.replace(&mut w, whitening.missing);
            } else if whitening.shortest < SHORT * size {
                self.project(&mut w, 0..self.basis.len());
            }
        }
        (w, r)
    }

    /// Puts unit vectors into the missing columns, random but orthogonal to the basis.
    fn replace(&mut self, w: &mut Panel, missing: [bool; WIDTH]) {
        for row in w.rows_mut() {
            for (value, _) in row.iter_mut().zip(missing).filter(|(_, missing)| *missing) {
                *value = self.rng.random_range(-1.0..1.0);
            }
        }
        for _ in 0..2 {
            self.project(w, 0..self.basis.len());
        }
        let gram = self.gram(w);
        let mut scale = [[0.0; WIDTH]; WIDTH];
        for i in 0..WIDTH {
            scale[i][i] = if gram[i][i] > 0.0 { gram[i][i].sqrt().recip() } else { 0.0 };
        }
        transform(w, &scale);
    }

    /// The eigenpairs of T, with residuals from the coupling to the panel that comes next.
    pub fn ritz(&self) -> Ritz {
        let m = self.dimension();
        let mut t = Dense::zeros(m, m);
        for (q, block) in self.diagonal.iter().enumerate() {
            write_block(&mut t, q, q, block);
        }
        for (q, block) in self.coupling.iter().enumerate().take(self.diagonal.len() - 1) {
            // Only the lower triangle is read.
            write_block(&mut t, q + 1, q, block);
        }
        let (values, vectors) = symmetric_eigen(&t);
        let residuals = (0..m)
            .map(|j| self.leaving(&vectors, j).iter().map(|v| v * v).sum::<f64>().sqrt())
            .collect();
        Ritz { values, vectors, residuals }
    }

    /// What the operator takes out of the basis from Ritz vector `j`: coefficients of the newest panel.
    fn leaving(&self, vectors: &Dense, j: usize) -> Row {
        let first = vectors.nrows() - WIDTH;
        let mut out = [0.0; WIDTH];
        if let Some(coupling) = self.coupling.last() {
            for (a, out) in out.iter_mut().enumerate() {
                *out = (0..WIDTH).map(|b| coupling[a][b] * vectors[(first + b, j)]).sum();
            }
        }
        out
    }

    /// The operator applied to Ritz vectors, normalised, n×k: V(Ty) and what leaves the basis. It is a step of
    /// inverse iteration for nothing: high frequencies, which rounding left in V, are damped.
    pub fn vectors(&self, ritz: &Ritz, chosen: &[usize]) -> Dense {
        let m = self.dimension();
        let coefficients = |chosen: &[usize]| {
            let mut c = vec![[0.0; WIDTH]; m + WIDTH];
            for (column, &j) in chosen.iter().enumerate() {
                let (theta, leaving) = (ritz.values[j], self.leaving(&ritz.vectors, j));
                let norm = theta.hypot(ritz.residuals[j]);
                for (i, row) in c[..m].iter_mut().enumerate() {
                    row[column] = theta * ritz.vectors[(i, j)] / norm;
                }
                for (row, value) in c[m..].iter_mut().zip(leaving) {
                    row[column] = value / norm;
                }
            }
            c
        };
        let all: Vec<_> = chosen.chunks(WIDTH).map(coefficients).collect();
        let mut x = Dense::zeros(self.mass.rows(), chosen.len());
        for (group, panel) in combine(&self.basis, &all).iter().enumerate() {
            panel.write_columns(&mut x, group * WIDTH);
        }
        x
    }
}

/// How a panel becomes orthonormal: W · forward, with W = (W · forward) · backward.
struct Whitening {
    forward: Square,
    backward: Square,
    /// The columns of the result that W does not span.
    missing: [bool; WIDTH],
    /// The length of the shortest direction that W spans.
    shortest: f64,
}

impl Whitening {
    /// From the Gram matrix of W; directions shorter than `floor` are left out.
    fn of(gram: &Square, floor: f64) -> Self {
        let dense = Dense::from_fn(WIDTH, WIDTH, |i, j| gram[i][j]);
        let (squares, directions) = symmetric_eigen(&dense);
        let mut whitening = Self {
            forward: [[0.0; WIDTH]; WIDTH],
            backward: [[0.0; WIDTH]; WIDTH],
            missing: [true; WIDTH],
            shortest: f64::INFINITY,
        };
        for j in 0..WIDTH {
            let length = squares[j].max(0.0).sqrt();
            // Also false for what is not a number.
            if length > floor {
                whitening.missing[j] = false;
                whitening.shortest = whitening.shortest.min(length);
                for i in 0..WIDTH {
                    whitening.forward[i][j] = directions[(i, j)] / length;
                    whitening.backward[j][i] = directions[(i, j)] * length;
                }
            }
        }
        whitening
    }
}

fn identity() -> Square {
    let mut identity = [[0.0; WIDTH]; WIDTH];
    (0..WIDTH).for_each(|i| identity[i][i] = 1.0);
    identity
}

fn distance_from_identity(gram: &Square) -> f64 {
    let identity = identity();
    gram.as_flattened()
        .iter()
        .zip(identity.as_flattened())
        .map(|(g, i)| (g - i).abs())
        .fold(0.0, f64::max)
}

/// The length of the longest column, from the Gram matrix.
fn longest(gram: &Square) -> f64 {
    (0..WIDTH).map(|i| gram[i][i]).fold(0.0, f64::max).sqrt()
}

fn times(a: &Square, b: &Square) -> Square {
    std::array::from_fn(|i| {
        std::array::from_fn(|j| (0..WIDTH).map(|k| a[i][k] * b[k][j]).sum::<f64>())
    })
}

fn write_block(t: &mut Dense, row: usize, column: usize, block: &Square) {
    for (i, values) in block.iter().enumerate() {
        for (j, &value) in values.iter().enumerate() {
            t[(row * WIDTH + i, column * WIDTH + j)] = value;
        }
    }
}
