//! `family.vertices`: a number, or the range `[fewest, most]` that members draw theirs from.

use rand::Rng;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// About how many vertices members have.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(from = "Written", into = "Written")]
pub struct Resolution {
    /// No member is asked for fewer.
    pub fewest: usize,
    /// No member is asked for more.
    pub most: usize,
}

impl Resolution {
    /// A number of vertices, uniformly in the range, but none that is less than [`Self::fewest`].
    pub fn draw(self, rng: &mut impl Rng) -> usize {
        if self.fewest < self.most {
            rng.random_range(self.fewest..=self.most)
        } else {
            self.fewest
        }
    }
}

impl From<usize> for Resolution {
    fn from(vertices: usize) -> Self {
        Self { fewest: vertices, most: vertices }
    }
}

/// How it stands in a file.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "a number of vertices, or the range [fewest, most]")]
enum Written {
    One(usize),
    Range([usize; 2]),
}

impl From<Written> for Resolution {
    fn from(written: Written) -> Self {
        match written {
            Written::One(vertices) => vertices.into(),
            Written::Range([fewest, most]) => Self { fewest, most },
        }
    }
}

impl From<Resolution> for Written {
    fn from(Resolution { fewest, most }: Resolution) -> Self {
        if fewest == most { Self::One(fewest) } else { Self::Range([fewest, most]) }
    }
}
