//! A sparse matrix in the Matrix Market exchange format: text, one entry a line, for MATLAB, Julia, Eigen, PETSc and what
//! else solves.
//!
//! R. F. Boisvert, R. Pozo and K. A. Remington, The Matrix Market exchange formats (NISTIR 5935, 1996). Rows and columns
//! count from 1; of a symmetric matrix the lower triangle stands there. Every number is the shortest decimals that are the
//! same double.

use std::fmt::Write;

use crate::operators::Sparse;

/// Which entries stand in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Symmetry {
    /// All of them.
    General,
    /// The lower triangle; the other has the same.
    Symmetric,
}

/// The text of the file.
pub fn to_mtx(matrix: &Sparse, symmetry: Symmetry) -> String {
    let (word, entries): (_, Vec<(usize, usize, f64)>) = match symmetry {
        Symmetry::General => ("general", entries(matrix).collect()),
        Symmetry::Symmetric => ("symmetric", entries(matrix).filter(|(i, j, _)| i >= j).collect()),
    };
    let mut text = format!("%%MatrixMarket matrix coordinate real {word}\n");
    let mut line = |line: std::fmt::Arguments<'_>| {
        writeln!(text, "{line}").expect("a string takes any text");
    };
    line(format_args!("{} {} {}", matrix.rows(), matrix.cols(), entries.len()));
    for (i, j, value) in entries {
        line(format_args!("{} {} {value:?}", i + 1, j + 1));
    }
    text
}

fn entries(matrix: &Sparse) -> impl Iterator<Item = (usize, usize, f64)> + '_ {
    let rows = matrix.outer_iterator().enumerate();
    rows.flat_map(|(i, row)| row.iter().map(|(j, &v)| (i, j, v)).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::sample::icosphere;
    use crate::operators::{MassKind, Operators};

    fn read(text: &str) -> (String, Vec<(usize, usize, f64)>) {
        let mut lines = text.lines();
        let header = lines.next().unwrap().to_owned();
        let sizes: Vec<usize> =
            lines.next().unwrap().split(' ').map(|word| word.parse().unwrap()).collect();
        let entries: Vec<_> = lines
            .map(|line| {
                let [i, j, value] = line.split(' ').collect::<Vec<_>>()[..] else {
                    panic!("{line}")
                };
                let [i, j] = [i, j].map(|word| word.parse::<usize>().unwrap() - 1);
                (i, j, value.parse().unwrap())
            })
            .collect();
        assert_eq!(sizes, [42, 42, entries.len()]);
        (header, entries)
    }

    #[test]
    fn every_entry_reads_back_exactly() {
        let operators = Operators::assemble(&icosphere(1), MassKind::Consistent).unwrap();
        for matrix in [&operators.stiffness, &operators.mass] {
            let (header, found) = read(&to_mtx(matrix, Symmetry::Symmetric));
            assert!(header.ends_with(" real symmetric"));
            let all = found.iter().flat_map(|&(i, j, v)| {
                [(i, j, v), (j, i, v)].into_iter().take(if i == j { 1 } else { 2 })
            });
            let mut all: Vec<_> = all.collect();
            all.sort_by_key(|&(i, j, _)| (i, j));
            assert_eq!(all, entries(matrix).collect::<Vec<_>>(), "symmetric to the last bit");
        }
        let laplacian = operators.graph_laplacian();
        let (header, found) = read(&to_mtx(&laplacian, Symmetry::General));
        assert!(header.ends_with(" real general"));
        assert_eq!(found, entries(&laplacian).collect::<Vec<_>>());
    }
}
