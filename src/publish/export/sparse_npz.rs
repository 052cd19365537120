//! A sparse matrix for `scipy.sparse.load_npz`: compressed rows, with the arrays that `save_npz` writes.
//!
//! `format` is "csr"; `shape` int64 (2,), `data` float64 (nnz,), `indices` (nnz,) and `indptr` (rows + 1,), both int32, as
//! SciPy has them, or int64 where there are too many entries for that.

use crate::operators::Sparse;
use crate::publish::arrays::Arrays;

/// The bytes of the archive.
pub fn to_npz(matrix: &Sparse) -> Vec<u8> {
    let mut npz = Arrays::new();
    let indptr = matrix.indptr();
    let indptr = indptr.raw_storage();
    match i32::try_from(matrix.nnz()) {
        Ok(_) => {
            npz.short_integers("indices", matrix.indices().iter().map(|&j| j as i32));
            npz.short_integers("indptr", indptr.iter().map(|&p| p as i32));
        }
        Err(_) => {
            npz.integers("indices", &[matrix.nnz()], matrix.indices().iter().map(|&j| j as i64));
            npz.integers("indptr", &[indptr.len()], indptr.iter().map(|&p| p as i64));
        }
    }
    npz.text("format", "csr");
    npz.integers("shape", &[2], [matrix.rows(), matrix.cols()].map(|length| length as i64));
    npz.floats("data", &[matrix.nnz()], matrix.data().iter().copied());
    npz.into_bytes()
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use npyz::npz::NpzArchive;

    use super::*;
    use crate::mesh::sample::icosphere;
    use crate::operators::{MassKind, Operators};

    #[test]
    fn the_arrays_make_the_matrix_again() {
        let stiffness = Operators::assemble(&icosphere(1), MassKind::Lumped).unwrap().stiffness;
        let bytes = to_npz(&stiffness);
        let mut npz = NpzArchive::new(Cursor::new(&bytes)).unwrap();
        let integers = |npz: &mut NpzArchive<Cursor<&Vec<u8>>>, name: &str| -> Vec<usize> {
            let array = npz.by_name(name).unwrap().unwrap().into_vec::<i32>().unwrap();
            array.into_iter().map(|i| i as usize).collect()
        };
        let (indptr, indices) = (integers(&mut npz, "indptr"), integers(&mut npz, "indices"));
        let data = npz.by_name("data").unwrap().unwrap().into_vec::<f64>().unwrap();
        let shape = npz.by_name("shape").unwrap().unwrap().into_vec::<i64>().unwrap();
        let format = npz.by_name("format").unwrap().unwrap().into_vec::<String>().unwrap();
        assert_eq!((shape, format), (vec![42, 42], vec!["csr".to_owned()]));
        assert_eq!(Sparse::new((42, 42), indptr, indices, data), stiffness);
    }
}
