//! Eigenpairs of Lφ = λBφ (8): reference solvers, and the certificate that judges any set of pairs.
//!
//! - [`pencil`]: the pair (L, B) and its products
//! - [`eigenpairs`]: values with vectors, their sign and their basis inside a cluster
//! - [`cluster`]: which eigenvalues are compared as one subspace
//! - [`rayleigh_ritz`]: small dense eigenproblems, and projection onto a subspace
//! - [`factor`]: sparse factorisations L + μB = RᵀR and L − σB = R D Rᵀ
//! - [`fem`]: shift-invert block Lanczos, the reference
//! - [`nullspace`]: the eigenfunctions of λ = 0
//! - [`mpgd`]: the paper's Algorithm 1, the second opinion
//! - [`inertia`]: the exact number of eigenvalues below a shift
//! - [`certificate`]: what was checked of a set of eigenpairs

pub mod certificate;
pub mod cluster;
pub mod eigenpairs;
pub mod factor;
pub mod fem;
pub mod inertia;
pub mod mpgd;
pub mod nullspace;
pub mod pencil;
pub mod rayleigh_ritz;

pub use certificate::Certificate;
pub use eigenpairs::Eigenpairs;
pub use pencil::Pencil;

/// A dense column-major matrix, one function on the mesh a column.
pub type Dense = faer::Mat<f64>;

/// Why a spectrum could not be computed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SpectrumError {
    /// More pairs were asked for than the mesh has vertices.
    #[error("{asked} eigenpairs were asked for, but the mesh has only {n} vertices; lower train.k")]
    TooMany { asked: usize, n: usize },
    /// The factorisation met a pivot that is zero or not a number: a sliver's cotangent has swamped the rest.
    #[error(
        "the factorisation of L + {shift:.3e} B broke down at pivot {pivot}; \
         the mesh has triangles too thin for double precision: remesh it, or remove its slivers"
    )]
    Breakdown { shift: f64, pivot: usize },
    /// The iteration ended before the residual was small enough.
    #[error(
        "the reference solver stopped after {iterations} iterations with residual {residual:.3e} \
         where {goal:.3e} was asked; the mesh is too badly conditioned: look at it with `chladni info`"
    )]
    NotConverged { iterations: usize, residual: f64, goal: f64 },
    /// There was no memory for the factor.
    #[error("there is not enough memory to factorise a matrix with {n} rows")]
    OutOfMemory { n: usize },
}
