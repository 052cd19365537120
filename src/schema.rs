//! What JSON Schemas say of enums whose values stand in a file under other names than those of their variants.

use schemars::Schema;
use serde::Serialize;
use serde_json::{Value, json};

/// The choices of the schema of an enum; none where it is of something else.
pub fn choices(schema: &mut Schema) -> Option<&mut Vec<Value>> {
    schema.get_mut("oneOf")?.as_array_mut()
}

/// Puts what is written of each of `values` in the place of its variant's name; they are in the order of the variants.
pub fn as_written<T: Serialize>(schema: &mut Schema, values: &[T]) {
    for (choice, value) in choices(schema).into_iter().flatten().zip(values) {
        *choice = json!({ "const": value, "description": choice["description"] });
    }
}
