//! `eigen.json`: eigenpairs and mesh as one JSON document, for programs without numpy.
//!
//! As compact as JSON is: one line, every number in the shortest decimals that are the same double. Eigenvectors come one
//! after the other, each with its n values.

use serde::{Serialize, Serializer};

use crate::mesh::MeshHash;
use crate::publish::npz::EigenArrays;
use crate::spectrum::Dense;
use crate::spectrum::pencil::column;

#[derive(Serialize)]
struct Document<'a> {
    schema: &'static str,
    mesh: Mesh<'a>,
    mass_kind: &'static str,
    mass: &'a [f64],
    eigenvalues: &'a [f64],
    #[serde(serialize_with = "columns")]
    eigenvectors: &'a Dense,
}

#[derive(Serialize)]
struct Mesh<'a> {
    hash: MeshHash,
    vertices: &'a [[f64; 3]],
    faces: &'a [[u32; 3]],
}

fn columns<S: Serializer>(x: &Dense, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq((0..x.ncols()).map(|j| column(x, j)))
}

/// The bytes of `eigen.json`.
pub fn to_json(arrays: &EigenArrays<'_>) -> Vec<u8> {
    let document = Document {
        schema: "chladni-eigen-json-1",
        mesh: Mesh {
            hash: arrays.mesh.hash(),
            vertices: arrays.mesh.vertices(),
            faces: arrays.mesh.faces(),
        },
        mass_kind: arrays.mass_kind.name(),
        mass: arrays.mass,
        eigenvalues: &arrays.pairs.values,
        eigenvectors: &arrays.pairs.vectors,
    };
    let mut bytes =
        serde_json::to_vec(&document).expect("the document holds strings, numbers and lists");
    bytes.push(b'\n');
    bytes
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::super::fixture::Fixture;
    use super::*;

    #[test]
    fn every_number_reads_back_exactly() {
        let fixture = Fixture::new();
        let document: Value = serde_json::from_slice(&to_json(&fixture.arrays())).unwrap();
        let numbers = |value: &Value| -> Vec<f64> {
            value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
        };
        assert_eq!(document["schema"], "chladni-eigen-json-1");
        assert_eq!(numbers(&document["eigenvalues"]), fixture.pairs.values);
        for j in 0..2 {
            let found = numbers(&document["eigenvectors"][j]);
            assert_eq!(found, column(&fixture.pairs.vectors, j));
        }
        for (i, vertex) in fixture.mesh.vertices().iter().enumerate() {
            assert_eq!(numbers(&document["mesh"]["vertices"][i]), vertex);
        }
        assert_eq!(document["mesh"]["faces"].as_array().unwrap().len(), 80);
        assert_eq!(document["mesh"]["hash"], fixture.mesh.hash().to_string());
    }
}
