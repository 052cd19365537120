//! The on-disk cache: artifacts of any stage, found again by the key of the work that made them.

mod digest;
mod key;

pub use digest::Digest;
pub use key::{CacheKey, KeyBuilder};
