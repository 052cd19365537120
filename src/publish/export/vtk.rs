//! The mesh with its eigenfunctions as legacy VTK: POLYDATA, for VTK, ParaView, PyVista and what else has read it for
//! thirty years.
//!
//! Version 3.0, binary, which is big-endian. Point data have one array `phi_k` for each eigenfunction, field data the
//! eigenvalues `lambda`; all as double. Indices are 32-bit, as the format has them.

use crate::mesh::TriMesh;
use crate::spectrum::Eigenpairs;
use crate::spectrum::pencil::column;

/// The bytes of the file of `mesh` and its K eigenfunctions, n×K.
pub fn to_vtk(mesh: &TriMesh, pairs: &Eigenpairs) -> Vec<u8> {
    let (n, m, k) = (mesh.n(), mesh.faces().len(), pairs.len());
    let mut file = File(Vec::with_capacity(8 * n * (3 + k) + 16 * m + 1024 + 64 * k));
    file.line("# vtk DataFile Version 3.0");
    file.line("chladni: Laplace-Beltrami eigenfunctions phi_k, lambda_k in 1/unit^2");
    file.line("BINARY");
    file.line("DATASET POLYDATA");
    file.line("FIELD FieldData 1");
    file.line(&format!("lambda 1 {k} double"));
    file.doubles(pairs.values.iter());
    file.line(&format!("POINTS {n} double"));
    file.doubles(mesh.vertices().iter().flatten());
    file.line(&format!("POLYGONS {m} {}", 4 * m));
    for face in mesh.faces() {
        [3].iter().chain(face).for_each(|index: &u32| file.0.extend(index.to_be_bytes()));
    }
    file.line("");
    file.line(&format!("POINT_DATA {n}"));
    file.line(&format!("FIELD FieldData {k}"));
    for j in 0..k {
        file.line(&format!("phi_{} 1 {n} double", j + 1));
        file.doubles(column(&pairs.vectors, j).iter());
    }
    file.0
}

struct File(Vec<u8>);

impl File {
    fn line(&mut self, text: &str) {
        self.0.extend(text.as_bytes());
        self.0.push(b'\n');
    }

    fn doubles<'a>(&mut self, values: impl Iterator<Item = &'a f64>) {
        self.0.extend(values.flat_map(|value| value.to_be_bytes()));
        self.0.push(b'\n');
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixture::Fixture;
    use super::*;
    use crate::mesh::load;

    #[test]
    fn the_mesh_reads_back_and_the_functions_stand_behind_it() {
        let Fixture { mesh, pairs, .. } = Fixture::new();
        let bytes = to_vtk(&mesh, &pairs);
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.vtk");
        std::fs::write(&path, &bytes).unwrap();
        assert_eq!(load(&path).unwrap().mesh, mesh);
        let header = b"phi_2 1 42 double\n";
        let at = bytes.windows(header.len()).position(|w| w == header).unwrap() + header.len();
        let found: Vec<f64> = bytes[at..bytes.len() - 1]
            .chunks_exact(8)
            .map(|chunk| f64::from_be_bytes(chunk.try_into().unwrap()))
            .collect();
        assert_eq!(found, column(&pairs.vectors, 1));
    }
}
