//! Differentiable operations on dfdx's tape, fused for this network, each with its backward by hand.
//!
//! A tensor of `n` vertices and `h` features is row-major, n×h. Every operation takes plain parameters and one
//! traced input, computes in one pass, and pushes one backward closure.
//!
//! - [`real`]: the scalar types, dense products, sine and cosine in bulk
//! - [`product`]: products with a matrix that is packed once
//! - [`lane`]: wide registers of either precision
//! - [`dealt`]: rows that all threads work on
//! - [`loan`]: buffers that one step leaves to the next
//! - [`graph`]: sparse times dense
//! - [`activation`]: the functions between layers
//! - [`encoder`]: ENC of (28)
//! - [`decoder`]: DEC of (27), where it is trained
//! - [`sggc`]: the SGGC layers of (29), with their neighbours and without
//! - [`gcn`], [`gat`]: the layers that the paper compares it with
//! - [`rayleigh`]: the Rayleigh quotient of a solved head, what `ritz` trains on
//! - [`losses`]: the paper's loss terms (24)–(26)

pub mod activation;
pub mod dealt;
pub mod decoder;
pub mod encoder;
pub mod gat;
pub mod gcn;
pub mod graph;
pub mod lane;
pub mod loan;
pub mod losses;
pub mod product;
pub mod rayleigh;
pub mod real;
pub mod sggc;

#[cfg(test)]
pub(crate) mod finite_differences;

use dfdx::shapes::{HasShape, Shape};
use dfdx::tensor::{Cpu, Tensor};

use real::Real;

/// A matrix with sizes known at run time, row-major.
pub type Matrix<E, T = dfdx::tensor::NoneTape> = Tensor<(usize, usize), E, Cpu, T>;
/// A vector with its length known at run time.
pub type Vector<E, T = dfdx::tensor::NoneTape> = Tensor<(usize,), E, Cpu, T>;
/// A number.
pub type Scalar<E, T = dfdx::tensor::NoneTape> = Tensor<(), E, Cpu, T>;

/// The entries of a tensor, in the order it was made in.
///
/// One memcpy, where `as_vec` walks the strides entry by entry; so the tensor must not be a permuted view. Nothing
/// here makes one: every operation ends in `tensor_from_vec`.
pub fn entries<S: Shape, E: Real, T>(x: &Tensor<S, E, Cpu, T>) -> Vec<E> {
    let mut entries = vec![E::default(); x.shape().num_elements()];
    x.copy_into(&mut entries);
    entries
}

/// [`entries`] in a buffer that comes back.
pub fn lent<S: Shape, E: Real, T>(x: &Tensor<S, E, Cpu, T>) -> loan::Loan<E> {
    let mut entries = loan::Loan::of(x.shape().num_elements());
    x.copy_into(&mut entries);
    entries
}
