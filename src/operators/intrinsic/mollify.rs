//! Longer edges for thin triangles: the smallest ε that, added to the length of every edge, makes all triangles
//! satisfy the triangle inequality with some room to spare.

use super::IntrinsicTriangulation;

/// The room to spare, δ, in mean edge lengths: that of geometry-central and robust-laplacians.
const ROOM: f64 = 1e-5;

impl IntrinsicTriangulation {
    /// Lengthens all edges by the smallest ε ≥ 0 with which l_i + l_j − l_k ≥ δ at every corner, δ being 1e-5 of the
    /// mean edge length, and returns ε. Triangles that are fat enough have ε = 0.
    pub(super) fn mollify(&mut self, mean: f64) -> f64 {
        let slack = |[a, b, c]: [f64; 3]| (b + c - a).min(c + a - b).min(a + b - c);
        let least = self.lengths.iter().copied().map(slack).fold(f64::INFINITY, f64::min);
        // ε is added twice and taken away once.
        let epsilon = (ROOM * mean - least).max(0.0);
        self.lengths.iter_mut().flatten().for_each(|length| *length += epsilon);
        epsilon
    }
}
