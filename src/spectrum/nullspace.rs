//! The eigenfunctions of λ = 0: one normalised indicator for every component without Dirichlet boundary.

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

/// As [`nullspace`], where functions are 0 at the vertices `fixed`: a component that has one of them has no part in it.
pub fn free_nullspace(labels: &[u32], fixed: &[u32], mass: &impl InnerProduct) -> Dense {
    let all = nullspace(labels, mass);
    let free = free_components(labels, fixed);
    Dense::from_fn(all.nrows(), free.len(), |i, j| all[(i, free[j])])
}

/// The multiplicity of λ = 0 where functions are 0 at the vertices `fixed`.
pub fn multiplicity(labels: &[u32], fixed: &[u32]) -> usize {
    free_components(labels, fixed).len()
}

/// The components with none of the vertices `fixed`, ascending.
fn free_components(labels: &[u32], fixed: &[u32]) -> Vec<usize> {
    let mut free = vec![true; labels.iter().max().map_or(0, |&last| last as usize + 1)];
    fixed.iter().for_each(|&i| free[labels[i as usize] as usize] = false);
    (0..free.len()).filter(|&component| free[component]).collect()
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

    #[test]
    fn a_component_that_is_held_somewhere_has_no_constant() {
        let mesh = icosphere(0);
        let mass = Operators::assemble(&mesh, MassKind::Lumped).unwrap().mass;
        let labels: Vec<u32> = (0..12).map(|i| i % 3).collect();
        let all = nullspace(&labels, &mass);
        let free = free_nullspace(&labels, &[4, 7], &mass);
        assert_eq!(multiplicity(&labels, &[4, 7]), 2);
        assert_eq!(free, Dense::from_fn(12, 2, |i, j| all[(i, 2 * j)]));
        assert_eq!(free_nullspace(&labels, &[], &mass), all);
    }
}
