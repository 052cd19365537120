//! The eigenproblem (8) of a mesh with its boundary condition: which rows are free, and what λ = 0 belongs to.

use std::borrow::Cow;

use super::nullspace::{free_nullspace, nullspace};
use super::pencil::{column, column_mut};
use super::{Dense, Pencil, SpectrumError};
use crate::operators::{Boundary, Operators, Sparse};

/// The pencil of the free vertices of a mesh, and the eigenfunctions of λ = 0.
#[derive(Debug, Clone)]
pub struct Problem<'a> {
    stiffness: Cow<'a, Sparse>,
    mass: Cow<'a, Sparse>,
    /// The free vertices, ascending; `None` when all are.
    free: Option<Vec<u32>>,
    vertices: usize,
    nullspace: Dense,
}

impl<'a> Problem<'a> {
    /// Poses the problem for the operators of a mesh whose vertices have these component labels, 0 … c−1.
    ///
    /// # Errors
    /// Under [`Boundary::Dirichlet`], [`SpectrumError::NoBoundary`] and [`SpectrumError::NoInterior`].
    pub fn new(
        operators: &'a Operators,
        boundary: Boundary,
        labels: &[u32],
    ) -> Result<Self, SpectrumError> {
        let (stiffness, mass) = (&operators.stiffness, &operators.mass);
        let vertices = stiffness.rows();
        match boundary {
            Boundary::Neumann => Ok(Self {
                stiffness: Cow::Borrowed(stiffness),
                mass: Cow::Borrowed(mass),
                free: None,
                vertices,
                nullspace: nullspace(labels, mass),
            }),
            Boundary::Dirichlet => Self::dirichlet(operators, labels),
        }
    }

    /// A component without boundary keeps its constant: only its indicator is left of the nullspace.
    fn dirichlet(operators: &Operators, labels: &[u32]) -> Result<Self, SpectrumError> {
        let vertices = operators.stiffness.rows();
        let mut position = vec![Some(0_usize); vertices];
        for &i in &operators.boundary {
            position[i as usize] = None;
        }
        let free: Vec<u32> =
            (0..vertices as u32).filter(|&i| position[i as usize].is_some()).collect();
        if free.len() == vertices {
            return Err(SpectrumError::NoBoundary);
        }
        if free.is_empty() {
            return Err(SpectrumError::NoInterior { vertices });
        }
        for (row, &i) in free.iter().enumerate() {
            position[i as usize] = Some(row);
        }
        let [stiffness, mass] =
            [&operators.stiffness, &operators.mass].map(|a| submatrix(a, &free, &position));
        let zeros = free_nullspace(labels, &operators.boundary, &operators.mass);
        let nullspace =
            Dense::from_fn(free.len(), zeros.ncols(), |i, j| zeros[(free[i] as usize, j)]);
        Ok(Self {
            stiffness: Cow::Owned(stiffness),
            mass: Cow::Owned(mass),
            free: Some(free),
            vertices,
            nullspace,
        })
    }

    /// L and B on the free vertices.
    pub fn pencil(&self) -> Pencil<'_> {
        Pencil { stiffness: &self.stiffness, mass: &self.mass }
    }

    /// The B-orthonormal eigenfunctions of λ = 0 on the free vertices: the indicators of the components without
    /// Dirichlet boundary, by lowest vertex index.
    pub fn nullspace(&self) -> &Dense {
        &self.nullspace
    }

    /// The values at the free vertices of functions on the mesh.
    pub fn restrict(&self, x: &Dense) -> Dense {
        match &self.free {
            None => x.clone(),
            Some(free) => Dense::from_fn(free.len(), x.ncols(), |i, j| x[(free[i] as usize, j)]),
        }
    }

    /// The functions on the mesh that have these values at the free vertices, and vanish elsewhere.
    pub fn extend(&self, x: Dense) -> Dense {
        let Some(free) = &self.free else { return x };
        let mut all = Dense::zeros(self.vertices, x.ncols());
        for j in 0..x.ncols() {
            let to = column_mut(&mut all, j);
            free.iter().zip(column(&x, j)).for_each(|(&i, &value)| to[i as usize] = value);
        }
        all
    }
}

/// The rows and columns `free` of a matrix; `position` has the new index of each.
fn submatrix(a: &Sparse, free: &[u32], position: &[Option<usize>]) -> Sparse {
    let (mut pointers, mut indices, mut data) = (vec![0], Vec::new(), Vec::new());
    for &i in free {
        let row = a.outer_view(i as usize);
        for (j, &value) in row.iter().flat_map(|row| row.iter()) {
            if let Some(j) = position[j] {
                indices.push(j);
                data.push(value);
            }
        }
        pointers.push(indices.len());
    }
    Sparse::new((free.len(), free.len()), pointers, indices, data)
}
