//! What names a piece of work: the key under which its result is stored.
//!
//! Every stage is a pure function, so its result is determined by what goes in, and a [`CacheKey`] is the BLAKE3
//! of exactly that. Each part is there because two results that differ in it must not share an entry:
//!
//! - *stage name*: two stages may have the same parameters and inputs;
//! - *stage version*: raised when the code of a stage changes what it computes, so that old results are not found;
//! - *parameters*, by name, in a canonical spelling (one spelling per value, or equal work has two keys);
//! - *inputs*, by name, as content digests and in order: never paths or times, which say nothing about content;
//! - *seed*: the same stage with other random numbers is other work;
//! - *precision*: `f32` and `f64` results of the same stage differ.

use std::fmt;
use std::str::FromStr;

use super::Digest;

/// The key of one piece of work. It prints as 64 hexadecimal digits and parses from them.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct CacheKey(Digest);

impl CacheKey {
    /// A key from its 32 bytes.
    pub const fn from_bytes(bytes: [u8; 32]) -> Self {
        Self(Digest::from_bytes(bytes))
    }

    /// The 32 bytes.
    pub const fn as_bytes(&self) -> &[u8; 32] {
        self.0.as_bytes()
    }
}

impl fmt::Display for CacheKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl fmt::Debug for CacheKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "CacheKey({self})")
    }
}

impl FromStr for CacheKey {
    type Err = blake3::HexError;

    fn from_str(hex: &str) -> Result<Self, Self::Err> {
        Ok(Self(hex.parse()?))
    }
}

/// Collects what determines a result, part by part. The order of the calls is part of the key.
///
/// ```
/// use chladni::store::{Digest, KeyBuilder};
///
/// let mesh = Digest::of(b"a mesh");
/// let key = |k: &str| {
///     KeyBuilder::new("fem", 1)
///         .param("k", k)
///         .input("mesh", &mesh)
///         .finish(0, "f64")
/// };
/// assert_eq!(key("10"), key("10"));
/// assert_ne!(key("10"), key("12"));
/// ```
#[derive(Debug, Clone)]
#[must_use = "a key is made by `finish`"]
pub struct KeyBuilder {
    hasher: blake3::Hasher,
}

/// What a part of a key is; hashed in front of it, so that a parameter is never taken for an input.
#[derive(Debug, Clone, Copy)]
enum Part {
    Stage = 1,
    Parameter = 2,
    Input = 3,
    Seed = 4,
    Precision = 5,
}

impl KeyBuilder {
    /// Starts the key of a stage by its name and the version of its code.
    pub fn new(stage: &str, version: u32) -> Self {
        // A derive-key context separates these hashes from every other use of BLAKE3.
        let hasher = blake3::Hasher::new_derive_key("chladni store 1 cache key");
        Self { hasher }.part(Part::Stage, stage, &version.to_le_bytes())
    }

    /// Adds a parameter: its name and the canonical spelling of its value.
    pub fn param(self, name: &str, value: impl AsRef<[u8]>) -> Self {
        self.part(Part::Parameter, name, value.as_ref())
    }

    /// Adds an input by the digest of its content.
    pub fn input(self, name: &str, content: &Digest) -> Self {
        self.part(Part::Input, name, content.as_bytes())
    }

    /// Closes the key with the two parts that no stage may forget: the seed (0 for a stage without random
    /// numbers) and the precision of the arithmetic, such as `"f64"`.
    #[must_use]
    pub fn finish(self, seed: u64, precision: &str) -> CacheKey {
        let closed =
            self.part(Part::Seed, "", &seed.to_le_bytes()).part(Part::Precision, precision, &[]);
        CacheKey(Digest::from_bytes(*closed.hasher.finalize().as_bytes()))
    }

    /// Feeds one part: its kind, then name and value, each behind its length. The sequence of parts can be read
    /// back from what is hashed, so no two different sequences hash the same bytes.
    fn part(mut self, kind: Part, name: &str, value: &[u8]) -> Self {
        self.hasher.update(&[kind as u8]);
        for bytes in [name.as_bytes(), value] {
            self.hasher.update(&(bytes.len() as u64).to_le_bytes());
            self.hasher.update(bytes);
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    fn base() -> KeyBuilder {
        KeyBuilder::new("train", 3)
    }

    #[test]
    fn every_part_and_every_boundary_counts() {
        let (x, y) = (Digest::of(b"x"), Digest::of(b"y"));
        let keys = [
            base().finish(0, "f32"),
            base().finish(1, "f32"),
            base().finish(0, "f64"),
            KeyBuilder::new("train", 4).finish(0, "f32"),
            KeyBuilder::new("verify", 3).finish(0, "f32"),
            base().param("a", "bc").finish(0, "f32"),
            base().param("ab", "c").finish(0, "f32"),
            base().param("", "abc").finish(0, "f32"),
            base().param("a", "b").param("c", "").finish(0, "f32"),
            base().param("c", "").param("a", "b").finish(0, "f32"),
            base().param("a", x.as_bytes()).finish(0, "f32"),
            base().input("a", &x).finish(0, "f32"),
            base().input("a", &y).finish(0, "f32"),
            base().input("a", &x).input("a", &y).finish(0, "f32"),
            base().input("a", &y).input("a", &x).finish(0, "f32"),
        ];
        let different: HashSet<_> = keys.iter().collect();
        assert_eq!(different.len(), keys.len());
    }

    /// A key that changes means that everything is computed again after an upgrade.
    #[test]
    fn keys_stay_the_same_between_versions() {
        let key = base().param("k", "10").input("mesh", &Digest::of(b"mesh")).finish(7, "f64");
        assert_eq!(
            key.to_string(),
            "2a3284326c409122ed9ede74e7050f82f5546b26a92ec01fd8b9901ea5d646dc"
        );
        assert_eq!(key.to_string().parse::<CacheKey>().unwrap(), key);
        assert_eq!(CacheKey::from_bytes(*key.as_bytes()), key);
        assert_eq!(format!("{key:?}"), format!("CacheKey({key})"));
    }
}
