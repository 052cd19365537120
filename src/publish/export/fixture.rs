//! What the tests of the formats write: a mesh with two functions.

use crate::mesh::TriMesh;
use crate::mesh::sample::icosphere;
use crate::operators::MassKind;
use crate::publish::npz::EigenArrays;
use crate::spectrum::{Dense, Eigenpairs};

pub struct Fixture {
    pub mesh: TriMesh,
    pub pairs: Eigenpairs,
    mass: Vec<f64>,
}

impl Fixture {
    pub fn new() -> Self {
        let mesh = icosphere(1);
        let vectors = Dense::from_fn(mesh.n(), 2, |i, j| (i as f64 + 0.1).sin() * (j as f64 - 0.3));
        let pairs = Eigenpairs { values: vec![0.0, 2.5e-7], vectors };
        let mass = mesh.vertex_areas();
        Self { mesh, pairs, mass }
    }

    pub fn arrays(&self) -> EigenArrays<'_> {
        let (mesh, pairs, mass) = (&self.mesh, &self.pairs, &self.mass);
        EigenArrays {
            mesh,
            pairs,
            mass,
            mass_kind: MassKind::Lumped,
            vertex_map: &[0, -1],
            file_vertices: None,
        }
    }
}
