//! Which eigenvalues are so close that only their common subspace is meaningful.

use std::ops::Range;

/// The relative gap below which neighbouring reference eigenvalues belong to one cluster.
pub const CLUSTER_GAP: f64 = 0.01;

/// Eigenvalues times area below this are zero to working precision: the first positive one is far above
/// (Weyl: λ_k·area ≈ 4πk), rounding far below.
const ZERO: f64 = 1e-6;

/// The bound below which an eigenvalue on a surface of this area counts as zero.
pub fn zero_below(area: f64) -> f64 {
    ZERO / area
}

/// Splits ascending eigenvalues into maximal runs with relative gaps below `gap`.
///
/// Eigenvalues below `zero` (see [`zero_below`]) form one run, whatever rounding made of them.
pub fn clusters(values: &[f64], gap: f64, zero: f64) -> Vec<Range<usize>> {
    let mut runs: Vec<Range<usize>> = Vec::new();
    for (i, &value) in values.iter().enumerate() {
        let joined = i > 0 && {
            let previous = values[i - 1];
            value.abs() <= zero || (previous.abs() > zero && value - previous <= gap * value.abs())
        };
        match runs.last_mut() {
            Some(run) if joined => run.end = i + 1,
            _ => runs.push(i..i + 1),
        }
    }
    runs
}

/// Where the cluster of pair K ends, in ascending eigenvalues that reach past it.
pub fn cluster_end(values: &[f64], k: usize, area: f64) -> usize {
    let runs = clusters(values, CLUSTER_GAP, zero_below(area));
    runs.into_iter().find(|run| run.contains(&(k - 1))).map_or(k, |run| run.end)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sphere_has_clusters_of_2l_plus_1() {
        let noisy = [0.0, 1.99, 2.0, 2.001, 5.99, 5.99, 6.0, 6.0, 6.01];
        assert_eq!(clusters(&noisy, CLUSTER_GAP, 1e-7), vec![0..1, 1..4, 4..9]);
    }

    #[test]
    fn several_components_share_the_zero_cluster() {
        assert_eq!(clusters(&[-1e-15, 1e-14, 3.0, 7.0], CLUSTER_GAP, 1e-7), vec![0..2, 2..3, 3..4]);
        assert_eq!(clusters(&[-1e-15, 1e-14, 1e-13], CLUSTER_GAP, 1e-7), vec![0..3]);
        assert!(clusters(&[], CLUSTER_GAP, 1e-7).is_empty());
    }
}
