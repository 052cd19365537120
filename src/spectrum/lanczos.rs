//! Block Lanczos: a B-orthonormal basis of the Krylov space of (L + μB)⁻¹B, eight vectors at a time.
//!
//! The operator is self-adjoint in the B-inner product and has the eigenvalues θ = 1/(λ + μ): the lowest λ
//! become dominant. Eight vectors at a time find up to eight copies of an eigenvalue together, and make every
//! product one of tall thin matrices.
//!
//! A product W = (L + μB)⁻¹BVⱼ loses its parts along the last two panels, which are all that exact arithmetic would find;
//! what is left is made orthonormal by its Gram matrix; and both once more, with the eigenvectors that are known already.
//! That takes three passes over W and these panels: every pass computes the products that the next one needs.
//!
//! Rounding brings back the rest of the basis, and every step amplifies it by as much as the longest product is longer
//! than what is left of W. The loss of orthogonality is estimated by this rule, and before it becomes large the last two
//! panels are orthogonalised together against the basis before them, which is read twice. T is as exact as rounding
//! allows while the square of the loss is rounding (Simon 1984).

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::Dense;
use super::factor::Factor;
use super::metric::{Change, Metric, Products};
use super::panel::{Panel, Row, Square, WIDTH, rotate, subtract_from};
use super::rayleigh_ritz::symmetric_eigen;
use super::triangular::Workspace;
use crate::operators::Sparse;

/// A direction shorter than this, relative to the vectors it comes from, is rounding: it is replaced by a random one.
const BREAKDOWN: f64 = 1e-10;

/// A direction shorter than this has lost digits of its orthogonality, and is orthogonalised again.
const SHORT: f64 = 1e-3;

/// The most that a panel may have lost of its orthogonality when it is orthogonalised again: the square is rounding. What
/// is multiplied has lost a hundredth of it at most. Measured on spheres, tori, squares and animals for k = 10 … 100, T
/// then is as exact as with a basis that is orthogonal throughout, and two or three steps pass in between.
const SEMI_ORTHOGONAL: f64 = 1e-8;

/// The loss that the estimate begins with when panels have been orthogonalised. What is measured then is a third of the
/// estimate in the median, and was above it, by a quarter, once in 352 times.
const ROUNDING: f64 = 1e-16;

/// By how much the growth of the loss may increase from one step to the next.
const MARGIN: f64 = 2.0;

/// Vectors are orthonormal when their Gram matrix is this close to I.
const ORTHONORMAL: f64 = 1e-13;

/// Panels that the three-term recurrence connects with the next.
const RECENT: usize = 2;

/// The basis V, and T = VᵀB(L + μB)⁻¹BV, which is block tridiagonal.
pub struct Krylov<'a> {
    factor: Factor<'a>,
    workspace: Workspace,
    metric: Metric<'a>,
    basis: Basis,
    diagonal: Vec<Square>,
    /// The operator takes the last panel of T to the last of the basis times the last of these, and to what T says.
    coupling: Vec<Square>,
    /// The length of the longest product.
    longest: f64,
    /// By how much the last step has amplified the loss of orthogonality.
    growth: f64,
    /// The estimated loss of orthogonality of the last two panels …
    loss: f64,
    /// … which begins with this.
    rounding: f64,
    rng: ChaCha8Rng,
}

struct Basis {
    /// What the basis is kept orthogonal to, B-orthonormal.
    known: Vec<Panel>,
    /// One panel more than T has blocks: the last has not been multiplied yet.
    panels: Vec<Panel>,
}

/// W = VC + QR.
struct Decomposition {
    /// The last square of C.
    along: Square,
    /// R.
    across: Square,
    /// Q, orthonormal and orthogonal to V.
    next: Panel,
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
    pub fn new(factor: Factor<'a>, mass: &'a Sparse, known: Vec<Panel>, seed: u64) -> Self {
        Self::from_start(factor, mass, known, Panel::zeros(mass.rows()), seed)
    }

    /// A basis whose first panel is made of `start`, orthogonal to `known`; columns that are zero become random.
    pub fn from_start(
        factor: Factor<'a>,
        mass: &'a Sparse,
        known: Vec<Panel>,
        start: Panel,
        seed: u64,
    ) -> Self {
        let mut krylov = Self {
            workspace: factor.workspace(),
            factor,
            metric: Metric::new(mass),
            basis: Basis { known, panels: Vec::new() },
            diagonal: Vec::new(),
            coupling: Vec::new(),
            longest: 0.0,
            growth: 1.0,
            loss: ROUNDING,
            rounding: ROUNDING,
            rng: ChaCha8Rng::seed_from_u64(seed),
        };
        let first = krylov.decompose(start).next;
        // The lengths of what it was made of say nothing of the operator.
        (krylov.longest, krylov.growth, krylov.loss) = (0.0, 1.0, ROUNDING);
        krylov.basis.panels.push(first);
        krylov
    }

    /// The dimension of T.
    pub fn dimension(&self) -> usize {
        self.diagonal.len() * WIDTH
    }

    /// Multiplies the newest panel by the operator, and takes what is new of the result for the next one.
    pub fn grow(&mut self) {
        let Some(newest) = self.basis.panels.last() else { return };
        let mut w = self.metric.apply(newest);
        self.factor.solve_panel(&mut w, &mut self.workspace);
        let Decomposition { along, across, next } = self.decompose(w);
        self.diagonal.push(symmetric(&along));
        self.coupling.push(across);
        self.basis.panels.push(next);
        if MARGIN * self.growth * self.loss > SEMI_ORTHOGONAL {
            self.purge();
        }
    }

    /// Splits W into its parts in the basis and across it. Directions that it does not have are random ones, with zeros
    /// in R.
    fn decompose(&mut self, mut w: Panel) -> Decomposition {
        let [recent, near, all] = [self.basis.recent(), self.basis.near(), self.basis.all()];
        let (mut along, mut across) = ([[0.0; WIDTH]; WIDTH], identity());
        let mut against = &recent[..];
        let mut products = self.metric.products(against, &w);
        let size = longest(&products.own);
        self.longest = self.longest.max(size);
        for pass in 0..5 {
            let (size, floor) = if pass == 0 { (size, BREAKDOWN * size) } else { (1.0, SHORT) };
            let whitening = Whitening::of(&products.left(), floor);
            if let Some(newest) = products.with.last() {
                along = plus(&along, &times(newest, &across));
            }
            across = times(&whitening.backward, &across);
            let mut thorough = whitening.shortest < SHORT * size;
            if pass == 0 {
                self.growth = self.longest / whitening.shortest;
                self.loss = self.rounding + self.growth * self.loss;
                thorough |= self.loss > SEMI_ORTHOGONAL;
            }
            let next = match (thorough, pass) {
                (true, _) => &all[..],
                (false, 0) => &near[..],
                (false, _) => &[],
            };
            let change = Change {
                panels: against,
                coefficients: &products.with,
                transform: &whitening.forward,
            };
            (products, against) = (self.metric.change(&mut w, change, next), next);
            if whitening.missing.contains(&true) {
                randomise(&mut w, whitening.missing, &mut self.rng);
                (products, against) = (orthogonalise(&mut w, &all, &mut self.metric), &all);
            } else if pass > 0
                && next.is_empty()
                && distance_from_identity(&products.own) < ORTHONORMAL
            {
                break;
            }
        }
        Decomposition { along, across, next: w }
    }

    /// Orthogonalises the last two panels against the whole basis before them. So little is taken away that they stay
    /// orthonormal.
    fn purge(&mut self) {
        let panels = &mut self.basis.panels;
        let before = panels.len() - RECENT;
        let (far, last) = panels.split_at_mut(before);
        let far: Vec<&Panel> = far.iter().collect();
        let coefficients = self.metric.of_two(&far, [&last[0], &last[1]]);
        subtract_from(last, &far, &coefficients);
        let all = coefficients.as_flattened().as_flattened().as_flattened();
        let lost = all.iter().fold(0.0_f64, |lost, c| lost.max(c.abs()));
        // Where more was lost than estimated, the next time it is sooner.
        self.rounding *= (lost / self.loss).max(1.0);
        self.loss = self.rounding;
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

    /// The operator applied to Ritz vectors, normalised, eight to a panel: V(Ty) and what leaves the basis. It is a step
    /// of inverse iteration for nothing: high frequencies, which rounding left in V, are damped. They are written over
    /// the basis, of which nothing else is left.
    pub fn vectors(self, ritz: &Ritz, chosen: &[usize]) -> Vec<Panel> {
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
        let Self { basis, factor, workspace, metric, .. } = self;
        drop((factor, workspace, metric));
        let mut panels = basis.panels;
        rotate(&mut panels, &all);
        panels
    }
}

impl Basis {
    /// The panels that the next one is coupled with.
    fn recent(&self) -> Vec<&Panel> {
        self.panels[self.panels.len().saturating_sub(RECENT)..].iter().collect()
    }

    /// The same, and what is known.
    fn near(&self) -> Vec<&Panel> {
        self.known.iter().chain(self.recent()).collect()
    }

    /// Everything.
    fn all(&self) -> Vec<&Panel> {
        self.known.iter().chain(&self.panels).collect()
    }
}

/// Puts random values into the missing columns.
fn randomise(w: &mut Panel, missing: [bool; WIDTH], rng: &mut ChaCha8Rng) {
    for row in w.rows_mut() {
        for (value, _) in row.iter_mut().zip(missing).filter(|(_, missing)| *missing) {
            *value = rng.random_range(-1.0..1.0);
        }
    }
}

/// Orthogonalises W against `all`, and makes its columns unit vectors. Returns the products that are left.
fn orthogonalise(w: &mut Panel, all: &[&Panel], metric: &mut Metric<'_>) -> Products {
    let mut products = metric.products(all, w);
    for _ in 0..2 {
        let change = Change { panels: all, coefficients: &products.with, transform: &identity() };
        products = metric.change(w, change, all);
    }
    let mut scale = identity();
    for (i, row) in scale.iter_mut().enumerate() {
        let square = products.own[i][i];
        row[i] = if square > 0.0 { square.sqrt().recip() } else { 0.0 };
    }
    let change = Change { panels: &[], coefficients: &[], transform: &scale };
    metric.change(w, change, all)
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

/// (A + Aᵀ)/2.
fn symmetric(a: &Square) -> Square {
    std::array::from_fn(|i| std::array::from_fn(|j| 0.5 * (a[i][j] + a[j][i])))
}

fn plus(a: &Square, b: &Square) -> Square {
    std::array::from_fn(|i| std::array::from_fn(|j| a[i][j] + b[i][j]))
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
