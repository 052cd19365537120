//! Whether a mesh can be predicted with a model ([`Unfit`] says why not), and whether it looks like the trained shape
//! ([`Unlike`] says why not: predictions are made all the same).

use super::Model;
use crate::ggnn::likeness::Moments;
use crate::mesh::topology::component_labels;
use crate::mesh::{Topology, TriMesh};
use crate::operators::{Boundary, Laplacian};
use crate::spectrum::nullspace::multiplicity;

/// Why a model cannot predict what was asked on a mesh.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Unfit {
    /// More eigenpairs than it has.
    #[error(
        "the model has {has} eigenpairs, and {asked} were asked for; ask for fewer (-k, or train.k), or run its \
         pipeline again with a larger train.k, which trains only the missing blocks"
    )]
    TooMany { asked: usize, has: usize },
    /// λ = 0 has another multiplicity, so that every k would mean another eigenfunction.
    #[error(
        "the model was trained on a surface of {trained} and the mesh has {mesh} components: the eigenfunctions of one \
         are not those of the other; train on this mesh",
        trained = if *trained == 1 { "one component".into() } else { format!("{trained} components") }
    )]
    Components { trained: usize, mesh: usize },
    /// Dirichlet conditions on a closed surface.
    #[error(
        "the model was trained with Dirichlet conditions, and the mesh has no boundary to hold to zero; \
         use a model with the Neumann condition"
    )]
    NoBoundary,
    /// Some component has a boundary in one and none in the other.
    #[error(
        "the model was trained on a surface with {trained} eigenfunctions of λ = 0 and the mesh has {mesh}, one for \
         every component without a boundary to hold to zero; train on this mesh"
    )]
    Nullspace { trained: usize, mesh: usize },
    /// The pipeline poses another problem than the model answers.
    #[error(
        "the model was trained with {} conditions; set operators.boundary = \"{}\" in place of \"{}\"",
        trained.name(), trained.name(), asked.name()
    )]
    Condition { trained: Boundary, asked: Boundary },
    /// A Laplacian that says nothing of other samplings.
    #[error(
        "the model was trained for the {} Laplacian, whose spectrum belongs to one sampling; train it again with \
         \"cotangent\" or \"fem\"",
        .0.name()
    )]
    Laplacian(Laplacian),
}

/// How a mesh differs from the shape that a model was trained for.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Unlike {
    /// It is another surface.
    #[error(
        "the mesh has Euler characteristic {mesh_euler} and {mesh_loops} boundary loops, the trained shape {euler} and \
         {loops}: it is another surface, and its eigenfunctions are others"
    )]
    Topology { mesh_euler: i64, mesh_loops: usize, euler: i64, loops: usize },
    /// It lies elsewhere, or has another form.
    #[error(
        "the surface does not lie where the trained one did (moments of its coordinates differ by {:.0} %): the network \
         reads coordinates, so a mesh that is turned, mirrored or bent is another shape to it",
        100.0 * .difference
    )]
    Placement { difference: f64 },
}

/// Beyond this difference of moments a mesh is not taken for the trained shape. Samplings of one shape differ by a
/// hundredth.
const ALIKE: f64 = 0.1;

impl Model {
    /// Whether `k` eigenpairs can be predicted on `mesh`, and what speaks against the predictions.
    ///
    /// # Errors
    /// [`Unfit`].
    pub fn check(
        &self,
        mesh: &TriMesh,
        topology: &Topology,
        k: usize,
    ) -> Result<Vec<Unlike>, Unfit> {
        self.check_count(k)?;
        self.check_kind(mesh, topology)?;
        let trained = &self.description.mesh;
        let mut unlike = Vec::new();
        let [mesh_euler, mesh_loops] =
            [topology.euler_characteristic, topology.boundary_loops as i64];
        if (mesh_euler, mesh_loops) != (trained.euler, trained.boundary_loops as i64) {
            unlike.push(Unlike::Topology {
                mesh_euler,
                mesh_loops: topology.boundary_loops,
                euler: trained.euler,
                loops: trained.boundary_loops,
            });
        }
        // Edge lengths and distances from landmarks are the same wherever a mesh lies.
        if let (Some(placed), Some(trained)) =
            (self.description.features.placed(), &trained.moments)
        {
            let difference = trained.difference(&Moments::of(mesh, placed));
            // Also when it is not a number.
            if !difference.le(&ALIKE) {
                unlike.push(Unlike::Placement { difference });
            }
        }
        Ok(unlike)
    }

    /// Whether it has `k` eigenpairs.
    ///
    /// # Errors
    /// [`Unfit::TooMany`].
    pub fn check_count(&self, k: usize) -> Result<(), Unfit> {
        let has = self.k();
        if k > has { Err(Unfit::TooMany { asked: k, has }) } else { Ok(()) }
    }

    /// Whether it answers the problem with this boundary condition.
    ///
    /// # Errors
    /// [`Unfit::Condition`].
    pub fn check_boundary(&self, asked: Boundary) -> Result<(), Unfit> {
        let trained = self.description.operators.boundary;
        if trained == asked { Ok(()) } else { Err(Unfit::Condition { trained, asked }) }
    }

    fn check_kind(&self, mesh: &TriMesh, topology: &Topology) -> Result<(), Unfit> {
        let operators = self.description.operators;
        if operators.boundary == Boundary::Dirichlet && topology.is_closed() {
            return Err(Unfit::NoBoundary);
        }
        if operators.laplacian == Laplacian::Graph {
            return Err(Unfit::Laplacian(operators.laplacian));
        }
        let trained = self.description.mesh.components;
        if topology.components != trained {
            return Err(Unfit::Components { trained, mesh: topology.components });
        }
        let fixed = operators.boundary.fixed(&topology.boundary_vertices);
        let (trained, mesh) =
            (self.description.known, multiplicity(&component_labels(mesh), fixed));
        if mesh != trained {
            return Err(Unfit::Nullspace { trained, mesh });
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::samples::{sphere_model, sphere_model_reading};
    use super::*;
    use crate::ggnn::features::{FeatureOptions, Features, Input};
    use crate::mesh::sample::icosphere;

    fn check(model: &Model, mesh: &TriMesh, k: usize) -> Result<Vec<Unlike>, Unfit> {
        model.check(mesh, &Topology::of(mesh), k)
    }

    #[test]
    fn a_finer_sphere_fits_and_a_torus_is_unlike_it() {
        let model = sphere_model();
        assert_eq!(check(&model, &icosphere(3), 3), Ok(vec![]));
        let torus = crate::mesh::load("tests/data/meshes/lapy_torus.off".as_ref()).unwrap().mesh;
        let unlike = check(&model, &torus, 3).unwrap();
        assert!(matches!(unlike[..], [Unlike::Topology { .. }, Unlike::Placement { .. }]));
        let stretched: Vec<_> =
            icosphere(2).vertices().iter().map(|&[x, y, z]| [x, y, 1.3 * z]).collect();
        let stretched = TriMesh::new(stretched, icosphere(2).faces().to_vec()).unwrap();
        assert!(matches!(check(&model, &stretched, 3).unwrap()[..], [Unlike::Placement { .. }]));
    }

    #[test]
    fn a_model_that_reads_landmarks_does_not_mind_where_a_mesh_lies() {
        let options = FeatureOptions { input: Input::Landmarks, ..FeatureOptions::default() };
        let mesh = icosphere(1);
        let model = sphere_model_reading(Features::of(&mesh, options));
        let turned = mesh.vertices().iter().map(|&[x, y, z]| [y, -x, 3.0 * z + 5.0]).collect();
        let turned = TriMesh::new(turned, mesh.faces().to_vec()).unwrap();
        assert_eq!(check(&model, &turned, 3), Ok(vec![]));
        assert!(check(&sphere_model(), &turned, 3).unwrap().len() == 1);
    }

    #[test]
    fn what_cannot_be_predicted_says_why() {
        let mut model = sphere_model();
        let (sphere, pair) = (icosphere(1), spheres());
        assert_eq!(check(&model, &sphere, 4), Err(Unfit::TooMany { asked: 4, has: 3 }));
        assert_eq!(check(&model, &pair, 3), Err(Unfit::Components { trained: 1, mesh: 2 }));
        model.description.operators.boundary = Boundary::Dirichlet;
        assert_eq!(check(&model, &sphere, 3), Err(Unfit::NoBoundary));
        let cut = TriMesh::new(sphere.vertices().to_vec(), sphere.faces()[1..].to_vec()).unwrap();
        assert_eq!(check(&model, &cut, 3), Err(Unfit::Nullspace { trained: 1, mesh: 0 }));
        model.description.known = 0;
        assert!(check(&model, &cut, 2).is_ok());
        let refused = model.check_boundary(Boundary::Neumann).unwrap_err().to_string();
        assert!(refused.contains("set operators.boundary = \"dirichlet\""), "{refused}");
    }

    fn spheres() -> TriMesh {
        let sphere = icosphere(1);
        let n = sphere.n() as u32;
        let aside = sphere.vertices().iter().map(|&[x, y, z]| [x + 9.0, y, z]);
        let vertices = sphere.vertices().iter().copied().chain(aside).collect();
        let second = sphere.faces().iter().map(|face| face.map(|i| i + n));
        TriMesh::new(vertices, sphere.faces().iter().copied().chain(second).collect()).unwrap()
    }
}
