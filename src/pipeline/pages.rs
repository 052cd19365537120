//! `publish.report`: `true`, `false`, or `"auto"`.

use std::fmt;

use schemars::{JsonSchema, Schema};
use serde::de::{Deserialize, Deserializer, Error, Unexpected, Visitor};
use serde::ser::{Serialize, Serializer};

use crate::schema::as_written;

/// Whether pages for people are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, JsonSchema)]
#[schemars(transform = Pages::as_written)]
pub enum Pages {
    /// When `chladni run` shows its results on a terminal.
    #[default]
    Auto,
    /// Always.
    Written,
    /// Never.
    None,
}

const AUTO: &str = "auto";

impl Pages {
    const ALL: [Self; 3] = [Self::Auto, Self::Written, Self::None];

    /// The schema of the variants' names as one of what stands in a file for them.
    fn as_written(schema: &mut Schema) {
        as_written(schema, &Self::ALL);
    }
}

impl Serialize for Pages {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Auto => serializer.serialize_str(AUTO),
            Self::Written => serializer.serialize_bool(true),
            Self::None => serializer.serialize_bool(false),
        }
    }
}

impl<'de> Deserialize<'de> for Pages {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(AutoOrNot)
    }
}

struct AutoOrNot;

impl Visitor<'_> for AutoOrNot {
    type Value = Pages;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "true, false or \"{AUTO}\"")
    }

    fn visit_bool<E: Error>(self, written: bool) -> Result<Pages, E> {
        Ok(if written { Pages::Written } else { Pages::None })
    }

    fn visit_str<E: Error>(self, name: &str) -> Result<Pages, E> {
        if name == AUTO {
            Ok(Pages::Auto)
        } else {
            Err(E::invalid_value(Unexpected::Str(name), &self))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_truth_or_auto_goes_there_and_back() {
        for (pages, text) in
            [(Pages::Auto, "\"auto\""), (Pages::Written, "true"), (Pages::None, "false")]
        {
            assert_eq!(serde_json::to_string(&pages).unwrap(), text);
            assert_eq!(serde_json::from_str::<Pages>(text).unwrap(), pages);
        }
        assert!(serde_json::from_str::<Pages>("\"yes\"").is_err());
    }
}
