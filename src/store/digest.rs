//! What names a piece of content: its BLAKE3 digest.
//!
//! Equal content has an equal [`Digest`], whoever computed it and when. Keys of later stages are built from the
//! digests of their inputs, so a stage whose output did not change leaves every later key as it was.

use std::fmt;
use std::str::FromStr;

/// The BLAKE3 digest of some content. It prints as 64 hexadecimal digits and parses from them.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Digest([u8; 32]);

impl Digest {
    /// The digest of `bytes`.
    pub fn of(bytes: &[u8]) -> Self {
        Self(*blake3::hash(bytes).as_bytes())
    }

    /// A digest that was computed elsewhere, such as the content hash of an input.
    pub const fn from_bytes(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }

    /// The 32 bytes.
    pub const fn as_bytes(&self) -> &[u8; 32] {
        &self.0
    }
}

impl fmt::Display for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&blake3::Hash::from_bytes(self.0).to_hex())
    }
}

impl fmt::Debug for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Digest({self})")
    }
}

impl FromStr for Digest {
    type Err = blake3::HexError;

    fn from_str(hex: &str) -> Result<Self, Self::Err> {
        Ok(Self(*blake3::Hash::from_hex(hex)?.as_bytes()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The BLAKE3 test vector of the empty input (github.com/BLAKE3-team/BLAKE3, test_vectors.json).
    const EMPTY: &str = "af1349b9f5f9a1a6a0404dea36dcc9499bcb25c9adc112b7cc9a93cae41f3262";

    #[test]
    fn it_is_blake3_and_prints_as_it_parses() {
        let digest = Digest::of(b"");
        assert_eq!(digest.to_string(), EMPTY);
        assert_eq!(format!("{digest:?}"), format!("Digest({EMPTY})"));
        assert_eq!(EMPTY.parse::<Digest>().unwrap(), digest);
        assert!("af13".parse::<Digest>().is_err());
    }
}
