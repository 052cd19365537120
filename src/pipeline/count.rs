//! `train.k`: a number of eigenpairs, or a share of the vertices, `"10%"`.

use std::fmt;

use schemars::JsonSchema;
use serde::de::{Deserialize, Deserializer, Error, Unexpected, Visitor};
use serde::ser::{Serialize, Serializer};

/// How many eigenpairs.
#[derive(Debug, Clone, Copy, PartialEq, JsonSchema)]
#[schemars(untagged)]
pub enum Count {
    /// A number: so many.
    Number(usize),
    /// Or so many for a hundred vertices, rounded; at least one.
    Percent(#[schemars(with = "String", pattern(r"^ *[0-9.]+ *%$"))] f64),
}

impl Count {
    /// How many that are of `n` vertices.
    pub fn of(self, n: usize) -> usize {
        match self {
            Self::Number(k) => k,
            Self::Percent(percent) => ((percent / 100.0 * n as f64).round() as usize).max(1),
        }
    }
}

impl From<usize> for Count {
    fn from(k: usize) -> Self {
        Self::Number(k)
    }
}

impl fmt::Display for Count {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(k) => write!(f, "{k}"),
            Self::Percent(percent) => write!(f, "{percent}%"),
        }
    }
}

impl Serialize for Count {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Number(k) => serializer.serialize_u64(*k as u64),
            Self::Percent(_) => serializer.collect_str(self),
        }
    }
}

impl<'de> Deserialize<'de> for Count {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(NumberOrShare)
    }
}

struct NumberOrShare;

impl Visitor<'_> for NumberOrShare {
    type Value = Count;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a whole number, or a share of the vertices such as \"10%\"")
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<Count, E> {
        let percent = text.strip_suffix('%').and_then(|number| number.trim().parse().ok());
        percent.map(Count::Percent).ok_or_else(|| E::invalid_value(Unexpected::Str(text), &self))
    }

    fn visit_u64<E: Error>(self, k: u64) -> Result<Count, E> {
        let number = usize::try_from(k).map(Count::Number);
        number.map_err(|_| E::invalid_value(Unexpected::Unsigned(k), &self))
    }

    fn visit_i64<E: Error>(self, k: i64) -> Result<Count, E> {
        let number = usize::try_from(k).map(Count::Number);
        number.map_err(|_| E::invalid_value(Unexpected::Signed(k), &self))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_or_a_share_goes_there_and_back() {
        for (count, text) in [
            (Count::Number(8), "8"),
            (Count::Percent(10.0), "\"10%\""),
            (Count::Percent(0.5), "\"0.5%\""),
        ] {
            assert_eq!(serde_json::to_string(&count).unwrap(), text);
            assert_eq!(serde_json::from_str::<Count>(text).unwrap(), count);
        }
        for wrong in ["-1", "2.5", "\"ten\"", "\"10\"", "[]"] {
            assert!(serde_json::from_str::<Count>(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_share_is_of_the_vertices_and_never_none() {
        assert_eq!([144, 162, 3].map(|n| Count::Percent(10.0).of(n)), [14, 16, 1]);
        assert_eq!(Count::Number(8).of(3), 8);
    }
}
