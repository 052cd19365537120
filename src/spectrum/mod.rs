//! Eigenpairs of Lφ = λBφ (8): reference solvers, and the certificate that judges any set of pairs.
//!
//! - [`pencil`]: the pair (L, B) and its products
//! - [`matrix_free`]: the same products as sums over triangles
//! - [`eigenpairs`]: values with vectors, their sign and their basis inside a cluster
//! - [`cluster`]: which eigenvalues are compared as one subspace
//! - [`rayleigh_ritz`]: small dense eigenproblems, and projection onto a subspace
//! - [`factor`]: sparse factorisations L − σB = R D Rᵀ; `elimination`: their order and fill; `multifrontal` and `front`:
//!   their numbers; `triangular`: solves with them
//! - [`problem`]: the pencil of a mesh with its boundary condition
//! - [`panel`]: eight functions side by side, and products of such blocks
//! - `metric`: the inner product of the mass, for panels
//! - `lanczos`: a Krylov space grown by panels
//! - [`fem`]: shift-invert block Lanczos, the reference
//! - [`refine`]: the lowest eigenpairs from functions that are nearly theirs
//! - [`nullspace`]: the eigenfunctions of λ = 0
//! - [`mpgd`]: the paper's Algorithm 1, the second opinion
//! - [`inertia`]: the exact number of eigenvalues below a shift
//! - [`dual_norm`]: norms of residuals that bound eigenvalue errors
//! - [`closed_form`]: eigenpairs that have a formula
//! - [`certificate`]: what was checked of a set of eigenpairs

pub mod certificate;
pub mod closed_form;
pub mod cluster;
pub mod dual_norm;
pub mod eigenpairs;
mod elimination;
pub mod factor;
pub mod fem;
mod front;
pub mod inertia;
mod lanczos;
pub mod matrix_free;
mod metric;
pub mod mpgd;
mod multifrontal;
pub mod nullspace;
pub mod panel;
pub mod pencil;
pub mod problem;
pub mod rayleigh_ritz;
pub mod refine;
mod triangular;

pub use certificate::Certificate;
pub use eigenpairs::Eigenpairs;
pub use matrix_free::TrianglePencil;
pub use pencil::Pencil;
pub use problem::Problem;

/// A dense column-major matrix, one function on the mesh a column.
pub type Dense = faer::Mat<f64>;

/// Why a spectrum could not be computed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SpectrumError {
    /// More pairs were asked for than the mesh has vertices.
    #[error(
        "{asked} eigenpairs were asked for, but the problem has only {n} free vertices; ask for fewer (train.k, or -k)"
    )]
    TooMany { asked: usize, n: usize },
    /// The factorisation met a pivot that is zero or not a number: a sliver's cotangent has swamped the rest.
    #[error(
        "the factorisation of L − σB with σ = {sigma:.3e} broke down at pivot {pivot}; \
         the mesh has triangles too thin for double precision: remesh it, or remove its slivers"
    )]
    Breakdown { sigma: f64, pivot: usize },
    /// L + μB has negative pivots, which only rounding can bring about.
    #[error(
        "L + μB with μ = {mu:.3e} is not positive definite: {negative} pivots are negative; \
         the mesh has triangles too thin for double precision: remesh it, or remove its slivers"
    )]
    Indefinite { mu: f64, negative: usize },
    /// The Krylov space filled up before the residuals were small enough.
    #[error(
        "the eigensolver stopped after {iterations} blocks with residuals {excess:.1e} times what is asked; the mesh is \
         too badly conditioned: look at it with `chladni info`, or set operators.robust = true"
    )]
    NotConverged { iterations: usize, excess: f64 },
    /// Dirichlet conditions on a closed surface.
    #[error(
        "the mesh has no boundary, so there is nothing to hold to zero; use the Neumann condition"
    )]
    NoBoundary,
    /// Dirichlet conditions where every vertex lies on the boundary.
    #[error(
        "all {vertices} vertices lie on the boundary, so that Dirichlet conditions leave nothing; refine the mesh"
    )]
    NoInterior { vertices: usize },
    /// There was no memory for the factor.
    #[error("there is not enough memory to factorise a matrix with {n} rows")]
    OutOfMemory { n: usize },
}
