//! The content hash of a mesh: what every cache key starts from.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// BLAKE3 over the counts, the positions (`f64`, little-endian) and the triangles, in their order.
///
/// Two files that carry identical numbers share it, whatever their format, name, materials or comments.
/// Negative zero counts as zero.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct MeshHash([u8; 32]);

impl MeshHash {
    pub(super) fn of(vertices: &[[f64; 3]], faces: &[[u32; 3]]) -> Self {
        let mut hasher = blake3::Hasher::new();
        hasher.update(b"chladni mesh 1");
        hasher.update(&(vertices.len() as u64).to_le_bytes());
        hasher.update(&(faces.len() as u64).to_le_bytes());
        let mut bytes = Vec::with_capacity(1 << 16);
        let mut feed = |hasher: &mut blake3::Hasher, word: &[u8], last: bool| {
            bytes.extend_from_slice(word);
            if last || bytes.len() >= 1 << 16 {
                hasher.update(&bytes);
                bytes.clear();
            }
        };
        for coordinate in vertices.iter().flatten() {
            // x + 0.0 turns −0.0 into 0.0 and leaves every other value alone.
            feed(&mut hasher, &(coordinate + 0.0).to_le_bytes(), false);
        }
        for index in faces.iter().flatten() {
            feed(&mut hasher, &index.to_le_bytes(), false);
        }
        feed(&mut hasher, &[], true);
        Self(*hasher.finalize().as_bytes())
    }

    /// The hash with these bytes, which [`as_bytes`](Self::as_bytes) gave.
    pub fn from_bytes(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }

    /// The 32 bytes of the digest.
    pub fn as_bytes(&self) -> &[u8; 32] {
        &self.0
    }
}

impl fmt::Display for MeshHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&blake3::Hash::from_bytes(self.0).to_hex())
    }
}

impl fmt::Debug for MeshHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "MeshHash({self})")
    }
}

/// As its hexadecimal text.
impl Serialize for MeshHash {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for MeshHash {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

impl FromStr for MeshHash {
    type Err = blake3::HexError;

    fn from_str(hex: &str) -> Result<Self, Self::Err> {
        Ok(Self(*blake3::Hash::from_hex(hex)?.as_bytes()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn negative_zero_is_zero_and_order_matters() {
        let faces = [[0, 1, 2]];
        let of = |p: &[[f64; 3]]| MeshHash::of(p, &faces);
        let base = of(&[[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]]);
        assert_eq!(base, of(&[[-0., 0., -0.], [1., 0., 0.], [0., 1., 0.]]));
        assert_ne!(base, of(&[[0., 0., 0.], [0., 1., 0.], [1., 0., 0.]]));
        assert_eq!(base.to_string().parse::<MeshHash>().unwrap(), base);
    }
}
