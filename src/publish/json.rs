//! The result documents as bytes, and the values that JSON has no word for.
//!
//! Not-a-number and infinity are written as null and read back as not-a-number. A mesh hash is its hexadecimal
//! text. Keys stand in the order of the fields, two spaces a level, so equal documents are equal bytes.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// The bytes of a document.
pub fn document(value: &impl Serialize) -> Vec<u8> {
    let mut bytes = serde_json::to_vec_pretty(value)
        .expect("the result types hold strings, numbers and lists, which JSON has");
    bytes.push(b'\n');
    bytes
}

/// For `deserialize_with`: a number, or not-a-number for null.
pub(super) fn null_is_nan<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or(f64::NAN))
}

/// For `with`: a mesh hash as its hexadecimal text.
pub(super) mod hash {
    use super::*;
    use crate::mesh::MeshHash;

    pub fn serialize<S: Serializer>(hash: &MeshHash, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(hash)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<MeshHash, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

/// For `with`: as [`hash`], with null for none.
pub(super) mod optional_hash {
    use super::*;
    use crate::mesh::MeshHash;

    pub fn serialize<S: Serializer>(
        hash: &Option<MeshHash>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        hash.map(|hash| hash.to_string()).serialize(serializer)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Option<MeshHash>, D::Error> {
        Option::<String>::deserialize(deserializer)?
            .map(|text| text.parse().map_err(serde::de::Error::custom))
            .transpose()
    }
}
