//! The mesh with its eigenfunctions as binary PLY, for viewers and mesh libraries.
//!
//! Little-endian. Each vertex carries x, y, z and one value `phi_k` for each eigenfunction, all as double: nothing
//! is lost, and readers that keep single precision (Blender, ParaView) convert by themselves. Blender and meshio
//! show the functions as vertex attributes; ParaView's reader opens the surface and passes over properties that it
//! does not know. The eigenvalues stand in comments of the header.

use std::fmt::Write;

use crate::mesh::TriMesh;
use crate::spectrum::Eigenpairs;
use crate::spectrum::pencil::column;

/// The bytes of the PLY file of `mesh` and its K eigenfunctions, n×K.
///
/// # Panics
/// When the eigenfunctions are not functions on the vertices of `mesh`.
pub fn to_ply(mesh: &TriMesh, pairs: &Eigenpairs) -> Vec<u8> {
    let (n, k) = (mesh.n(), pairs.len());
    assert_eq!(pairs.vectors.nrows(), n, "one row of the eigenfunctions a vertex");
    assert_eq!(pairs.vectors.ncols(), k, "one eigenfunction an eigenvalue");
    let header = header(mesh, pairs);
    let mut bytes = Vec::with_capacity(header.len() + 8 * n * (3 + k) + 13 * mesh.faces().len());
    bytes.extend(header.as_bytes());
    let functions: Vec<&[f64]> = (0..k).map(|j| column(&pairs.vectors, j)).collect();
    for (i, position) in mesh.vertices().iter().enumerate() {
        let values = position.iter().chain(functions.iter().map(|function| &function[i]));
        bytes.extend(values.flat_map(|value| value.to_le_bytes()));
    }
    for face in mesh.faces() {
        bytes.push(3);
        bytes.extend(face.iter().flat_map(|index| index.to_le_bytes()));
    }
    bytes
}

fn header(mesh: &TriMesh, pairs: &Eigenpairs) -> String {
    let mut header = String::from("ply\nformat binary_little_endian 1.0\n");
    if !pairs.is_empty() {
        header += "comment chladni: Laplace-Beltrami eigenfunctions phi_k, lambda_k in 1/unit^2\n";
    }
    let mut line = |text: std::fmt::Arguments<'_>| {
        writeln!(header, "{text}").expect("a string takes any text");
    };
    for (j, value) in pairs.values.iter().enumerate() {
        line(format_args!("comment lambda_{} {value:e}", j + 1));
    }
    line(format_args!("element vertex {}", mesh.n()));
    for axis in ["x", "y", "z"] {
        line(format_args!("property double {axis}"));
    }
    for k in 1..=pairs.len() {
        line(format_args!("property double phi_{k}"));
    }
    line(format_args!("element face {}", mesh.faces().len()));
    line(format_args!("property list uchar uint vertex_indices"));
    line(format_args!("end_header"));
    header
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::sample::icosphere;
    use crate::spectrum::Dense;

    /// Reads what a header of doubles, then one list of uchar and uint, describes.
    fn read(bytes: &[u8]) -> (Vec<String>, Vec<Vec<f64>>, Vec<Vec<u32>>) {
        let end = b"end_header\n";
        let body = bytes.windows(end.len()).position(|w| w == end).unwrap() + end.len();
        let header = std::str::from_utf8(&bytes[..body]).unwrap();
        assert!(header.starts_with("ply\nformat binary_little_endian 1.0\n"));
        let count = |element: &str| -> usize {
            let line = header.lines().find_map(|l| l.strip_prefix(element)).unwrap();
            line.trim().parse().unwrap()
        };
        let names: Vec<String> = header
            .lines()
            .filter_map(|l| l.strip_prefix("property double ").map(str::to_owned))
            .collect();
        let mut rest = &bytes[body..];
        let mut take = |length: usize| {
            let (head, tail) = rest.split_at(length);
            rest = tail;
            head
        };
        let vertices = (0..count("element vertex"))
            .map(|_| {
                names.iter().map(|_| f64::from_le_bytes(take(8).try_into().unwrap())).collect()
            })
            .collect();
        let faces = (0..count("element face"))
            .map(|_| {
                let corners = take(1)[0];
                (0..corners).map(|_| u32::from_le_bytes(take(4).try_into().unwrap())).collect()
            })
            .collect();
        assert!(rest.is_empty(), "{} bytes too many", rest.len());
        (names, vertices, faces)
    }

    #[test]
    fn positions_functions_and_triangles_read_back_exactly() {
        let mesh = icosphere(1);
        let pairs = Eigenpairs {
            values: vec![0.0, 2.5e-7],
            vectors: Dense::from_fn(mesh.n(), 2, |i, j| (i as f64 + 0.1).sin() * (j as f64 - 0.3)),
        };
        let bytes = to_ply(&mesh, &pairs);
        let (names, vertices, faces) = read(&bytes);
        assert_eq!(names, ["x", "y", "z", "phi_1", "phi_2"]);
        for (i, vertex) in vertices.iter().enumerate() {
            assert_eq!(vertex[..3], mesh.vertices()[i]);
            assert_eq!(vertex[3..], [pairs.vectors[(i, 0)], pairs.vectors[(i, 1)]]);
        }
        assert_eq!(faces, mesh.faces().iter().map(|f| f.to_vec()).collect::<Vec<_>>());
        let text = String::from_utf8_lossy(&bytes);
        assert!(text.contains("\ncomment lambda_2 2.5e-7\nelement vertex 42\n"));
    }
}
