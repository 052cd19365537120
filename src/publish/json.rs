//! The result documents as bytes, and the values that JSON has no word for.
//!
//! Not-a-number and infinity are written as null and read back as not-a-number. A mesh hash is its hexadecimal
//! text. Keys stand in the order of the fields, two spaces a level, so equal documents are equal bytes.

use serde::{Deserialize, Deserializer, Serialize};

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
