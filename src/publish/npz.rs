//! `eigen.npz`: eigenpairs and mesh for numpy. `np.load` reads every array without pickle.
//!
//! With n vertices, m triangles, K pairs and N vertices in the input file:
//!
//! | array        | type    | shape | content                                                        |
//! |--------------|---------|-------|----------------------------------------------------------------|
//! | `evals`      | float64 | (K,)  | λ by k, 1/(input unit)²; ascending inside every cluster         |
//! | `evecs`      | float64 | (n,K) | φ, one a column, φᵀBφ = 1, C order                             |
//! | `mass`       | float64 | (n,)  | the row sums of B: vertex areas, or degrees for `degree`       |
//! | `mass_kind`  | str     | ()    | which B: `lumped`, `voronoi`, `consistent` or `degree`         |
//! | `vertices`   | float64 | (n,3) | positions, input units                                         |
//! | `faces`      | int64   | (m,3) | triangles, zero-based                                          |
//! | `k`          | int64   | (K,)  | 1 … K                                                          |
//! | `schema`     | str     | ()    | `chladni-eigen-1`                                              |
//! | `vertex_map` | int64   | (N,)  | for each vertex of the input file its row above, or −1         |
//! | `file_vertices` | int64 | (N,) | of an object of the file only: its N vertices there, which `vertex_map` is then of |
//!
//! Indices are int64 because that is numpy's own index type: it goes into any indexing and into sparse matrices
//! without a conversion, and differences of indices do not wrap. Equal input gives equal bytes.

use super::arrays::Arrays;
use crate::mesh::TriMesh;
use crate::operators::MassKind;
use crate::spectrum::{Dense, Eigenpairs};

/// The value of the array `schema`.
pub const SCHEMA: &str = "chladni-eigen-1";

/// What goes into `eigen.npz`.
#[derive(Debug, Clone, Copy)]
pub struct EigenArrays<'a> {
    /// The mesh, n vertices.
    pub mesh: &'a TriMesh,
    /// K pairs, vectors n×K.
    pub pairs: &'a Eigenpairs,
    /// The row sums of the mass matrix, length n.
    pub mass: &'a [f64],
    /// Which mass matrix.
    pub mass_kind: MassKind,
    /// For each vertex of the input file its row, or −1.
    pub vertex_map: &'a [i64],
    /// Where the mesh is an object of the file: which of the vertices there `vertex_map` is of.
    pub file_vertices: Option<&'a [u32]>,
}

impl EigenArrays<'_> {
    /// The bytes of `eigen.npz`.
    ///
    /// # Panics
    /// When the sizes of the parts do not agree.
    pub fn to_npz(&self) -> Vec<u8> {
        let (n, k) = (self.mesh.n(), self.pairs.len());
        assert_eq!(self.mass.len(), n, "one mass a vertex");
        assert_eq!(self.pairs.vectors.nrows(), n, "one row of the eigenfunctions a vertex");
        assert_eq!(self.pairs.vectors.ncols(), k, "one eigenfunction an eigenvalue");
        let (m, vectors) = (self.mesh.faces().len(), &self.pairs.vectors);
        let mut npz = Arrays::new();
        npz.floats("evals", &[k], self.pairs.values.iter().copied());
        npz.floats("evecs", &[n, k], rows(vectors));
        npz.floats("mass", &[n], self.mass.iter().copied());
        npz.text("mass_kind", self.mass_kind.name());
        npz.floats("vertices", &[n, 3], self.mesh.vertices().iter().flatten().copied());
        npz.integers("faces", &[m, 3], self.mesh.faces().iter().flatten().map(|&i| i.into()));
        npz.integers("k", &[k], 1..=k as i64);
        npz.text("schema", SCHEMA);
        npz.integers("vertex_map", &[self.vertex_map.len()], self.vertex_map.iter().copied());
        if let Some(of_file) = self.file_vertices {
            npz.integers("file_vertices", &[of_file.len()], of_file.iter().map(|&v| v.into()));
        }
        npz.into_bytes()
    }
}

/// The entries of a matrix row by row.
pub(super) fn rows(x: &Dense) -> impl Iterator<Item = f64> + '_ {
    (0..x.nrows()).flat_map(move |i| (0..x.ncols()).map(move |j| x[(i, j)]))
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;
    use crate::mesh::sample::icosphere;
    use crate::operators::Operators;
    use crate::operators::mass::row_sums;

    fn bytes() -> Vec<u8> {
        let mesh = icosphere(1);
        let n = mesh.n();
        let pairs = Eigenpairs {
            values: vec![0.0, 1.9, 2.1],
            vectors: Dense::from_fn(n, 3, |i, j| i as f64 + 0.25 * j as f64),
        };
        let kind = MassKind::Consistent;
        EigenArrays {
            mesh: &mesh,
            pairs: &pairs,
            mass: &row_sums(&Operators::assemble(&mesh, kind).unwrap().mass),
            mass_kind: kind,
            vertex_map: &[1, -1, 0],
            file_vertices: None,
        }
        .to_npz()
    }

    fn read<T: npyz::Deserialize>(bytes: &[u8], name: &str) -> (String, Vec<u64>, Vec<T>) {
        let mut npz = npyz::npz::NpzArchive::new(Cursor::new(bytes)).unwrap();
        let file = npz.by_name(name).unwrap().unwrap();
        assert_eq!(file.order(), npyz::Order::C);
        (file.dtype().descr(), file.shape().to_vec(), file.into_vec().unwrap())
    }

    #[test]
    fn every_array_reads_back_with_its_type_and_shape() {
        let bytes = bytes();
        let mesh = icosphere(1);
        let (descr, shape, evecs) = read::<f64>(&bytes, "evecs");
        assert_eq!((descr.as_str(), shape), ("'<f8'", vec![42, 3]));
        assert_eq!(evecs[..4], [0.0, 0.25, 0.5, 1.0], "row by row");
        assert_eq!(read::<f64>(&bytes, "evals").2, [0.0, 1.9, 2.1]);
        let (descr, shape, vertices) = read::<f64>(&bytes, "vertices");
        assert_eq!((descr.as_str(), shape), ("'<f8'", vec![42, 3]));
        assert_eq!(vertices, mesh.vertices().as_flattened());
        let (descr, shape, faces) = read::<i64>(&bytes, "faces");
        assert_eq!((descr.as_str(), shape), ("'<i8'", vec![80, 3]));
        assert_eq!(faces[..3], mesh.faces()[0].map(i64::from));
        let area: f64 = read::<f64>(&bytes, "mass").2.iter().sum();
        assert!((area - mesh.area().0).abs() < 1e-12);
        assert_eq!(read::<i64>(&bytes, "k").2, [1, 2, 3]);
        assert_eq!(read::<i64>(&bytes, "vertex_map").2, [1, -1, 0]);
        let (descr, shape, kind) = read::<String>(&bytes, "mass_kind");
        assert_eq!((descr.as_str(), shape), ("'<U10'", vec![]));
        assert_eq!(kind, ["consistent"]);
        assert_eq!(read::<String>(&bytes, "schema").2, [SCHEMA]);
    }

    #[test]
    fn equal_input_gives_equal_bytes_and_no_entry_carries_a_time() {
        let bytes = bytes();
        assert_eq!(bytes, self::bytes());
        let mut npz = npyz::npz::NpzArchive::new(Cursor::new(bytes)).unwrap();
        let zip = npz.zip_archive();
        assert_eq!(zip.len(), 9);
        for i in 0..zip.len() {
            let time = zip.by_index(i).unwrap().last_modified();
            assert_eq!((time.year(), time.month(), time.day(), time.hour()), (1980, 1, 1, 0));
        }
    }
}
