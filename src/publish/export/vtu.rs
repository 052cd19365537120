//! The mesh with its eigenfunctions as VTK's XML: an UnstructuredGrid of triangles, for ParaView, PyVista and meshio.
//!
//! Arrays are inline, base64 of little-endian numbers after their length in bytes, uncompressed. Point data have one array
//! `phi_k` for each eigenfunction, field data the eigenvalues `lambda`; all as double.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;

use crate::mesh::TriMesh;
use crate::spectrum::Eigenpairs;
use crate::spectrum::pencil::column;

/// VTK's number for a triangle.
const TRIANGLE: u8 = 5;

/// The bytes of the file of `mesh` and its K eigenfunctions, n×K.
pub fn to_vtu(mesh: &TriMesh, pairs: &Eigenpairs) -> Vec<u8> {
    let (n, m, k) = (mesh.n(), mesh.faces().len(), pairs.len());
    let mut text = String::from(
        "<?xml version=\"1.0\"?>\n\
         <VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n\
         <UnstructuredGrid>\n<FieldData>\n",
    );
    let tuples = format!(" Name=\"lambda\" NumberOfTuples=\"{k}\"");
    array(&mut text, "Float64", &tuples, doubles(&pairs.values));
    text += &format!(
        "</FieldData>\n<Piece NumberOfPoints=\"{n}\" NumberOfCells=\"{m}\">\n<PointData>\n"
    );
    for j in 0..k {
        let name = format!(" Name=\"phi_{}\"", j + 1);
        array(&mut text, "Float64", &name, doubles(column(&pairs.vectors, j)));
    }
    text += "</PointData>\n<Points>\n";
    let points = " Name=\"Points\" NumberOfComponents=\"3\"";
    array(&mut text, "Float64", points, doubles(mesh.vertices().as_flattened()));
    text += "</Points>\n<Cells>\n";
    let corners = mesh.faces().iter().flatten().map(|&i| i64::from(i));
    array(&mut text, "Int64", " Name=\"connectivity\"", integers(corners));
    array(&mut text, "Int64", " Name=\"offsets\"", integers((1..=m as i64).map(|i| 3 * i)));
    array(&mut text, "UInt8", " Name=\"types\"", vec![TRIANGLE; m]);
    text += "</Cells>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>\n";
    text.into_bytes()
}

fn array(text: &mut String, kind: &str, attributes: &str, bytes: Vec<u8>) {
    *text += &format!("<DataArray type=\"{kind}\"{attributes} format=\"binary\">\n");
    let length = (bytes.len() as u64).to_le_bytes();
    STANDARD.encode_string([&length[..], &bytes].concat(), text);
    *text += "\n</DataArray>\n";
}

fn doubles(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

fn integers(values: impl Iterator<Item = i64>) -> Vec<u8> {
    values.flat_map(i64::to_le_bytes).collect()
}

#[cfg(test)]
mod tests {
    use super::super::fixture::Fixture;
    use super::*;

    /// The bytes of the array of this name.
    fn read(text: &str, name: &str) -> Vec<u8> {
        let at = text.find(&format!("Name=\"{name}\"")).unwrap();
        let encoded = text[at..].split('\n').nth(1).unwrap();
        let bytes = STANDARD.decode(encoded).unwrap();
        let length = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        assert_eq!(bytes.len(), 8 + length, "{name}");
        bytes[8..].to_vec()
    }

    #[test]
    fn every_array_reads_back_exactly() {
        let Fixture { mesh, pairs, .. } = Fixture::new();
        let text = String::from_utf8(to_vtu(&mesh, &pairs)).unwrap();
        let floats = |name: &str| -> Vec<f64> {
            let bytes = read(&text, name);
            bytes.chunks_exact(8).map(|c| f64::from_le_bytes(c.try_into().unwrap())).collect()
        };
        assert_eq!(floats("lambda"), pairs.values);
        assert_eq!(floats("phi_1"), column(&pairs.vectors, 0));
        assert_eq!(floats("phi_2"), column(&pairs.vectors, 1));
        assert_eq!(floats("Points"), mesh.vertices().as_flattened());
        let corners: Vec<u32> = read(&text, "connectivity")
            .chunks_exact(8)
            .map(|c| i64::from_le_bytes(c.try_into().unwrap()) as u32)
            .collect();
        assert_eq!(corners, mesh.faces().as_flattened());
        assert_eq!(read(&text, "types"), [5; 80]);
        assert_eq!(read(&text, "offsets")[..16], [3, 0, 0, 0, 0, 0, 0, 0, 6, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(text.matches("<DataArray").count(), text.matches("</DataArray>").count());
    }
}
