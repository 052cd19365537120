//! The eigenfunctions of λ = 0 without Dirichlet boundary: one normalised indicator a component.

use super::Dense;
use super::eigenpairs::normalise_columns;
use super::pencil::InnerProduct;

/// The B-normalised indicators of the components, n×c, from every vertex's component label 0 … c−1. Components
/// are numbered by their lowest vertex index, so that k = 1 … c are in that order.
pub fn nullspace(labels: &[u32], mass: &impl InnerProduct) -> Dense {
    let components = labels.iter().max().map_or(0, |&last| last as usize + 1);
    let mut indicators = Dense::zeros(labels.len(), components);
    for (i, &label) in labels.iter().enumerate() {
        indicators[(i, label as usize)] = 1.0;
    }
    normalise_columns(mass, &mut indicators);
    indicators
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::sample::icosphere;
    use crate::operators::{MassKind, Operators};

    #[test]
    fn the_constant_of_one_component_is_one_over_the_root_of_the_area() {
        let mesh = icosphere(1);
        let operators = Operators::assemble(&mesh, MassKind::Lumped).unwrap();
        let phi = nullspace(&vec![0; mesh.n()], &operators.mass);
        let expected = 1.0 / mesh.area().0.sqrt();
        assert!((0..mesh.n()).all(|i| (phi[(i, 0)] - expected).abs() < 1e-15));
    }
}
