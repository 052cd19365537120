//! `verify.mpgd_step`: the name `"exact"`, or a number α.

use std::borrow::Cow;
use std::fmt;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{Deserialize, Deserializer, Error, Visitor};
use serde::ser::{Serialize, Serializer};

/// How far M-PGD goes in one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MpgdStep {
    /// To the lowest quotient along the direction.
    Exact,
    /// α times the projected gradient.
    Fixed(f64),
}

impl JsonSchema for MpgdStep {
    fn schema_name() -> Cow<'static, str> {
        "MpgdStep".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "oneOf": [
            { "const": EXACT, "description": "To the lowest quotient along its direction." },
            {
                "type": "number",
                "exclusiveMinimum": 0.0,
                "description": "A number α: the paper's fixed step, which goes down the plain \"gradient\" alone.",
            },
        ] })
    }
}

const EXACT: &str = "exact";

impl Serialize for MpgdStep {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Exact => serializer.serialize_str(EXACT),
            Self::Fixed(alpha) => serializer.serialize_f64(*alpha),
        }
    }
}

impl<'de> Deserialize<'de> for MpgdStep {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(NameOrNumber)
    }
}

struct NameOrNumber;

impl Visitor<'_> for NameOrNumber {
    type Value = MpgdStep;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "\"{EXACT}\" or a positive number, the fixed step α")
    }

    fn visit_str<E: Error>(self, name: &str) -> Result<MpgdStep, E> {
        if name == EXACT {
            Ok(MpgdStep::Exact)
        } else {
            Err(E::invalid_value(serde::de::Unexpected::Str(name), &self))
        }
    }

    fn visit_f64<E: Error>(self, alpha: f64) -> Result<MpgdStep, E> {
        Ok(MpgdStep::Fixed(alpha))
    }

    fn visit_i64<E: Error>(self, alpha: i64) -> Result<MpgdStep, E> {
        Ok(MpgdStep::Fixed(alpha as f64))
    }

    fn visit_u64<E: Error>(self, alpha: u64) -> Result<MpgdStep, E> {
        Ok(MpgdStep::Fixed(alpha as f64))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_or_a_number_goes_there_and_back() {
        for (step, text) in [
            (MpgdStep::Exact, "\"exact\""),
            (MpgdStep::Fixed(0.001), "0.001"),
            (MpgdStep::Fixed(1e-300), "1e-300"),
        ] {
            assert_eq!(serde_json::to_string(&step).unwrap(), text);
            assert_eq!(serde_json::from_str::<MpgdStep>(text).unwrap(), step);
        }
        assert_eq!(serde_json::from_str::<MpgdStep>("2").unwrap(), MpgdStep::Fixed(2.0));
        assert!(serde_json::from_str::<MpgdStep>("[]").is_err());
    }
}
