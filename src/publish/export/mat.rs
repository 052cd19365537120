//! `eigen.mat`: eigenpairs and mesh for MATLAB and Octave, as a MAT-file of level 5, uncompressed.
//!
//! The MathWorks, MAT-File Format (R2015): a header of 128 bytes, then an element miMATRIX for each variable. All are
//! double, columns first: `evals` K×1, `evecs` n×K, `mass` n×1, `vertices` n×3, `faces` m×3, counted from 1 as MATLAB does.
//! The header has no time.

use super::TooLarge;
use crate::publish::npz::EigenArrays;
use crate::spectrum::pencil::column;

/// Types of elements: miINT8 and so on.
const INT8: u32 = 1;
const INT32: u32 = 5;
const UINT32: u32 = 6;
const DOUBLE: u32 = 9;
const MATRIX: u32 = 14;

/// mxDOUBLE_CLASS.
const DOUBLE_CLASS: u32 = 6;

/// The bytes of `eigen.mat`.
///
/// # Errors
/// When a variable has 2 GiB or more, which MATLAB does not read.
pub fn to_mat(arrays: &EigenArrays<'_>) -> Result<Vec<u8>, TooLarge> {
    let (mesh, pairs) = (arrays.mesh, arrays.pairs);
    let (n, m, k) = (mesh.n(), mesh.faces().len(), pairs.len());
    let mut bytes = header();
    let axes = [0, 1, 2];
    let vectors = (0..k).flat_map(|j| column(&pairs.vectors, j).iter().copied());
    let positions = axes.into_iter().flat_map(|axis| mesh.vertices().iter().map(move |p| p[axis]));
    let corner = |axis: usize| mesh.faces().iter().map(move |face| f64::from(face[axis]) + 1.0);
    variable(&mut bytes, "evals", [k, 1], pairs.values.iter().copied())?;
    variable(&mut bytes, "evecs", [n, k], vectors)?;
    variable(&mut bytes, "mass", [n, 1], arrays.mass.iter().copied())?;
    variable(&mut bytes, "vertices", [n, 3], positions)?;
    variable(&mut bytes, "faces", [m, 3], axes.into_iter().flat_map(corner))?;
    Ok(bytes)
}

/// 116 bytes of text, 8 of nothing, the version, and the byte order: "IM" for those who read "MI" backwards.
fn header() -> Vec<u8> {
    let text = concat!("MATLAB 5.0 MAT-file, written by chladni ", env!("CARGO_PKG_VERSION"));
    let mut header = text.as_bytes().to_vec();
    header.resize(116, b' ');
    header.extend([0; 8]);
    header.extend(0x0100_u16.to_le_bytes());
    header.extend(b"IM");
    header
}

/// Adds a real matrix of double, whose values come column by column.
fn variable(
    bytes: &mut Vec<u8>,
    name: &str,
    [rows, columns]: [usize; 2],
    values: impl Iterator<Item = f64>,
) -> Result<(), TooLarge> {
    let words = |words: [u32; 2]| words.into_iter().flat_map(u32::to_le_bytes);
    // Up to four bytes stand in the tag itself.
    let mut named: Vec<u8> = match name.len() as u32 {
        length @ ..=4 => (length << 16 | INT8).to_le_bytes().to_vec(),
        length => words([INT8, length]).collect(),
    };
    named.extend(name.as_bytes());
    named.resize(named.len().next_multiple_of(8), 0);
    let length = 8 * rows as u64 * columns as u64;
    // Flags, dimensions, name, values; each with its tag of 8.
    let whole = 16 + 16 + named.len() as u64 + 8 + length;
    if i32::try_from(whole).is_err() {
        return Err(TooLarge { bytes: whole });
    }
    bytes.extend(words([MATRIX, whole as u32]));
    bytes.extend(words([UINT32, 8]));
    bytes.extend(words([DOUBLE_CLASS, 0]));
    bytes.extend(words([INT32, 8]));
    bytes.extend(words([rows as u32, columns as u32]));
    bytes.extend(named);
    bytes.extend(words([DOUBLE, length as u32]));
    bytes.extend(values.flat_map(f64::to_le_bytes));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::fixture::Fixture;
    use super::*;

    type Variable = (String, [u32; 2], Vec<f64>);

    /// Reads what the specification says, tag by tag.
    fn read(bytes: &[u8]) -> Vec<Variable> {
        assert!(bytes.starts_with(b"MATLAB 5.0 MAT-file"));
        assert_eq!(bytes[124..128], [0, 1, b'I', b'M']);
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        let (mut at, mut variables) = (128, Vec::new());
        while at < bytes.len() {
            assert_eq!((word(at), at % 8), (14, 0));
            let end = at + 8 + word(at + 4) as usize;
            let mut parts = Vec::new();
            let mut inside = at + 8;
            while inside < end {
                let (kind, small) = (word(inside) & 0xffff, (word(inside) >> 16) as usize);
                let (length, from) = match small {
                    0 => (word(inside + 4) as usize, inside + 8),
                    _ => (small, inside + 4),
                };
                parts.push((kind, &bytes[from..from + length]));
                inside = (from + length).next_multiple_of(8);
            }
            assert_eq!(inside, end);
            let [(6, flags), (5, sizes), (1, name), (9, values)] = parts[..] else {
                panic!("{parts:?}")
            };
            assert_eq!(flags, [6, 0, 0, 0, 0, 0, 0, 0]);
            let sizes = [0, 4].map(|i| u32::from_le_bytes(sizes[i..i + 4].try_into().unwrap()));
            let values = values.chunks_exact(8).map(|c| f64::from_le_bytes(c.try_into().unwrap()));
            variables.push((String::from_utf8(name.to_vec()).unwrap(), sizes, values.collect()));
            at = end;
        }
        variables
    }

    #[test]
    fn a_variable_that_matlab_would_not_read_is_refused() {
        let mut bytes = Vec::new();
        let written = variable(&mut bytes, "evecs", [1 << 20, 256], std::iter::empty());
        assert_eq!((written, bytes.len()), (Err(TooLarge { bytes: (1 << 31) + 56 }), 0));
    }

    #[test]
    fn every_variable_reads_back_with_its_size() {
        let fixture = Fixture::new();
        let variables = read(&to_mat(&fixture.arrays()).unwrap());
        let names: Vec<&str> = variables.iter().map(|variable| variable.0.as_str()).collect();
        assert_eq!(names, ["evals", "evecs", "mass", "vertices", "faces"]);
        let sizes: Vec<[u32; 2]> = variables.iter().map(|variable| variable.1).collect();
        assert_eq!(sizes, [[2, 1], [42, 2], [42, 1], [42, 3], [80, 3]]);
        assert_eq!(variables[0].2, fixture.pairs.values);
        assert_eq!(variables[1].2[42..], *column(&fixture.pairs.vectors, 1));
        assert_eq!(variables[2].2, fixture.arrays().mass);
        let [x, y, z] = [0, 42, 84].map(|at| variables[3].2[at + 7]);
        assert_eq!([x, y, z], fixture.mesh.vertices()[7]);
        let corners = [0, 80, 160].map(|at| variables[4].2[at + 11]);
        assert_eq!(corners, fixture.mesh.faces()[11].map(|i| f64::from(i) + 1.0));
    }
}
