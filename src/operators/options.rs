//! Which Laplacian: the choice between (5), (7) and (12), and the mass that goes with each.

use std::fmt;

use schemars::{JsonSchema, Schema};
use serde::de::{Error, Unexpected, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::{MassKind, OperatorError};
use crate::schema::as_written;

/// A discrete Laplacian, as the symmetric pencil (L, B) of (8) that has its eigenpairs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Laplacian {
    /// (12): the cotangent stiffness, with the consistent mass unless another is asked for.
    Fem,
    /// (7): the cotangent stiffness, with the lumped mass unless another is asked for.
    #[default]
    Cotangent,
    /// (5): I − W, as (D − A, D). It sees edges and no lengths: its eigenvalues are numbers without a unit, at most 2. It cannot be
    /// trained.
    Graph,
}

impl Laplacian {
    /// The mass that it has unless another is asked for.
    pub fn default_mass(self) -> MassKind {
        match self {
            Self::Fem => MassKind::Consistent,
            Self::Cotangent => MassKind::Lumped,
            Self::Graph => MassKind::Degree,
        }
    }

    /// Whether it can have this mass. The three masses made of areas go with the cotangent stiffness, by whichever
    /// name it is asked for; the degrees go with the graph.
    pub fn accepts(self, mass: MassKind) -> bool {
        (self == Self::Graph) == (mass == MassKind::Degree)
    }

    /// The name used in files, tables and keys.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fem => "fem",
            Self::Cotangent => "cotangent",
            Self::Graph => "graph",
        }
    }
}

/// What holds on the boundary of the surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Boundary {
    /// The normal derivative vanishes.
    #[default]
    Neumann,
    /// The function vanishes. A mesh without boundary cannot have this.
    Dirichlet,
}

impl Boundary {
    /// The name used in files, tables and keys.
    pub fn name(self) -> &'static str {
        match self {
            Self::Neumann => "neumann",
            Self::Dirichlet => "dirichlet",
        }
    }

    /// The vertices where a function is 0, of a mesh with these on its boundary.
    pub fn fixed(self, rim: &[u32]) -> &[u32] {
        match self {
            Self::Neumann => &[],
            Self::Dirichlet => rim,
        }
    }
}

/// Which triangles of the surface operators are assembled on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, JsonSchema)]
#[schemars(transform = Robust::as_written)]
pub enum Robust {
    /// The mesh's own.
    #[default]
    Off,
    /// Those of the intrinsic Delaunay triangulation of the surface, its thinnest triangles made a little wider.
    Intrinsic,
    /// The same on the tufted cover of the surface (Sharp and Crane 2020), which takes two sheets of it and halves what they add up
    /// to: no weight is negative then, at edges of three and more triangles and on the boundary either. On a closed manifold mesh it
    /// is what true is.
    Tufted,
}

impl Robust {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Off, Self::Intrinsic, Self::Tufted];

    /// The name used in keys.
    pub fn name(self) -> &'static str {
        match self {
            Self::Off => "false",
            Self::Intrinsic => "true",
            Self::Tufted => TUFTED,
        }
    }

    /// The schema of the variants' names as one of what stands in a file for them.
    fn as_written(schema: &mut Schema) {
        as_written(schema, &Self::ALL);
    }
}

const TUFTED: &str = "tufted";

impl From<bool> for Robust {
    fn from(robust: bool) -> Self {
        if robust { Self::Intrinsic } else { Self::Off }
    }
}

impl Serialize for Robust {
    fn serialize<S: Serializer>(&self, out: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Off => out.serialize_bool(false),
            Self::Intrinsic => out.serialize_bool(true),
            Self::Tufted => out.serialize_str(TUFTED),
        }
    }
}

impl<'de> Deserialize<'de> for Robust {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        struct Named;

        impl Visitor<'_> for Named {
            type Value = Robust;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("true, false or \"tufted\"")
            }

            fn visit_bool<E: Error>(self, robust: bool) -> Result<Robust, E> {
                Ok(robust.into())
            }

            fn visit_str<E: Error>(self, name: &str) -> Result<Robust, E> {
                if name == TUFTED {
                    Ok(Robust::Tufted)
                } else {
                    Err(E::invalid_value(Unexpected::Str(name), &self))
                }
            }
        }

        from.deserialize_any(Named)
    }
}

/// Which operators are assembled, and which problem they pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct OperatorOptions {
    /// Which Laplacian. The first two share the cotangent stiffness and differ in their masses.
    pub laplacian: Laplacian,
    /// The mass matrix.
    #[serde(with = "auto")]
    #[schemars(schema_with = "auto::schema")]
    pub mass: Option<MassKind>,
    /// Which triangles they are assembled on: for meshes with slivers. The network still sees the edges of the mesh, and the graph
    /// Laplacian stays what it is.
    pub robust: Robust,
    /// What holds on the boundary.
    pub boundary: Boundary,
}

impl OperatorOptions {
    /// The mass that is meant.
    ///
    /// # Errors
    /// [`OperatorError::Mass`] when the Laplacian cannot have the one that was asked for.
    pub fn mass_kind(&self) -> Result<MassKind, OperatorError> {
        let laplacian = self.laplacian;
        match self.mass {
            None => Ok(laplacian.default_mass()),
            Some(mass) if laplacian.accepts(mass) => Ok(mass),
            Some(mass) => Err(OperatorError::Mass { laplacian, mass }),
        }
    }
}

/// A mass and the Laplacian that it goes with, on the triangles of the mesh.
impl From<MassKind> for OperatorOptions {
    fn from(mass: MassKind) -> Self {
        let laplacian = match mass {
            MassKind::Degree => Laplacian::Graph,
            MassKind::Lumped | MassKind::Voronoi | MassKind::Consistent => Laplacian::Cotangent,
        };
        Self { laplacian, mass: Some(mass), ..Self::default() }
    }
}

/// `auto` for no choice.
mod auto {
    use schemars::{JsonSchema, Schema, SchemaGenerator};
    use serde::de::Error;
    use serde::{Deserialize, Deserializer, Serializer};
    use serde_json::json;

    use super::MassKind;
    use crate::schema::choices;

    const NAMES: [&str; 5] = ["auto", "lumped", "voronoi", "consistent", "degree"];

    pub fn serialize<S: Serializer>(mass: &Option<MassKind>, out: S) -> Result<S::Ok, S::Error> {
        out.serialize_str(mass.map_or("auto", MassKind::name))
    }

    /// Those of [`MassKind`], and `auto`.
    pub fn schema(generator: &mut SchemaGenerator) -> Schema {
        let mut schema = MassKind::json_schema(generator);
        let auto = json!({
            "const": "auto",
            "description": "Lumped for \"cotangent\", consistent for \"fem\", degree for \"graph\".",
        });
        if let Some(values) = choices(&mut schema) {
            values.insert(0, auto);
        }
        schema
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Option<MassKind>, D::Error> {
        let name = String::deserialize(from)?;
        let mass = MassKind::ALL.into_iter().find(|mass| mass.name() == name);
        let known = mass.is_some() || name == "auto";
        if known { Ok(mass) } else { Err(D::Error::unknown_variant(&name, &NAMES)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_laplacian_accepts_its_own_mass_and_the_graph_no_other() {
        for laplacian in [Laplacian::Fem, Laplacian::Cotangent, Laplacian::Graph] {
            assert!(laplacian.accepts(laplacian.default_mass()));
            let accepted = MassKind::ALL.into_iter().filter(|&mass| laplacian.accepts(mass));
            assert_eq!(accepted.count(), if laplacian == Laplacian::Graph { 1 } else { 3 });
        }
    }

    #[test]
    fn a_mass_that_does_not_fit_is_named_with_those_that_do() {
        let options = OperatorOptions { laplacian: Laplacian::Graph, ..MassKind::Voronoi.into() };
        assert_eq!(
            options.mass_kind().unwrap_err().to_string(),
            "the graph Laplacian has no voronoi mass; leave the mass out, or choose degree"
        );
    }

    #[test]
    fn robust_is_a_boolean_or_a_name() {
        let options = |text: &str| toml::from_str::<OperatorOptions>(text);
        for robust in Robust::ALL {
            let written =
                toml::to_string(&OperatorOptions { robust, ..Default::default() }).unwrap();
            assert_eq!(options(&written).unwrap().robust, robust, "{written}");
        }
        assert_eq!(options("robust = true").unwrap().robust, Robust::Intrinsic);
        let error = options("robust = \"tuffed\"").unwrap_err().to_string();
        assert!(error.contains("true, false or \"tufted\""), "{error}");
    }

    #[test]
    fn masses_are_read_and_written_by_name() {
        let options = |text: &str| toml::from_str::<OperatorOptions>(text);
        assert_eq!(options("mass = \"auto\"").unwrap().mass, None);
        assert_eq!(options("mass = \"voronoi\"").unwrap().mass, Some(MassKind::Voronoi));
        let error = options("mass = \"lumpy\"").unwrap_err().to_string();
        assert!(error.contains("lumpy") && error.contains("auto"), "{error}");
        for mass in MassKind::ALL {
            assert!(error.contains(mass.name()), "{error}");
            let written = toml::to_string(&OperatorOptions::from(mass)).unwrap();
            assert_eq!(options(&written).unwrap(), OperatorOptions::from(mass));
        }
    }
}
