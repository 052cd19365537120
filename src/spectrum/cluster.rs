//! Which eigenvalues are so close that only their common subspace is meaningful.

use std::ops::Range;

/// The relative gap below which neighbouring reference eigenvalues belong to one cluster.
pub const CLUSTER_GAP: f64 = 0.01;

/// Splits ascending eigenvalues into maximal runs with relative gaps below `gap`.
///
/// Eigenvalues that are zero to working precision (below 1e-9 of the largest) form one run.
pub fn clusters(values: &[f64], gap: f64) -> Vec<Range<usize>> {
    let zero = 1e-9 * values.last().copied().unwrap_or(0.0).abs();
    let mut runs: Vec<Range<usize>> = Vec::new();
    for (i, &value) in values.iter().enumerate() {
        let joined = i > 0 && {
            let previous = values[i - 1];
            value - previous <= gap * value.abs() || value.abs() <= zero
        };
        match runs.last_mut() {
            Some(run) if joined => run.end = i + 1,
            _ => runs.push(i..i + 1),
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sphere_has_clusters_of_2l_plus_1() {
        let noisy = [0.0, 1.99, 2.0, 2.001, 5.99, 5.99, 6.0, 6.0, 6.01];
        assert_eq!(clusters(&noisy, CLUSTER_GAP), vec![0..1, 1..4, 4..9]);
    }

    #[test]
    fn several_components_share_the_zero_cluster() {
        assert_eq!(clusters(&[-1e-15, 1e-14, 3.0, 7.0], CLUSTER_GAP), vec![0..2, 2..3, 3..4]);
        assert!(clusters(&[], CLUSTER_GAP).is_empty());
    }
}
