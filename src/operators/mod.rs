//! Discrete Laplacians of a mesh: adjacency and graph Laplacian (5), cotangent stiffness (4, 6), lumped (6)
//! and consistent (11) mass.
//!
//! - [`adjacency`]: W and I − W
//! - [`stiffness`]: the cotangent stiffness L
//! - [`mass`]: the mass matrices B
//! - [`assembly`]: all of them for one mesh, as the pipeline caches them

pub mod adjacency;
pub mod assembly;
pub mod mass;
pub mod stiffness;

pub use assembly::Operators;
pub use mass::MassKind;

/// A square sparse matrix in compressed rows, columns sorted within a row.
pub type Sparse = sprs::CsMat<f64>;

/// Builds an n×n sparse matrix from the entries that the triangles contribute, adding up duplicates in the
/// order of contribution.
fn assemble(n: usize, entries: impl Iterator<Item = (u32, u32, f64)>) -> Sparse {
    let mut triplets: Vec<(u32, u32, f64)> = entries.collect();
    triplets.sort_by_key(|&(row, column, _)| (row, column));
    let mut indptr = Vec::with_capacity(n + 1);
    let mut indices = Vec::with_capacity(triplets.len() / 2);
    let mut data: Vec<f64> = Vec::with_capacity(triplets.len() / 2);
    let mut last = None;
    indptr.push(0);
    for (row, column, value) in triplets {
        while indptr.len() <= row as usize {
            indptr.push(indices.len());
        }
        if last == Some((row, column)) {
            if let Some(sum) = data.last_mut() {
                *sum += value;
            }
        } else {
            indices.push(column as usize);
            data.push(value);
            last = Some((row, column));
        }
    }
    indptr.resize(n + 1, indices.len());
    Sparse::new((n, n), indptr, indices, data)
}
