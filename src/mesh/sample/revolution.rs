//! Surfaces of revolution: the torus and the vase.
//!
//! In the angle u and the conformal height t = ∫ ds/ρ, where s is the arc length of the profile and ρ the radius there, the
//! surface is ρ times the plane: circles are circles, and triangles that are Delaunay in the plane are nearly so on the
//! surface. Vertices are spread by area, as a Fibonacci lattice, and moved a little; what lies across the seam is found by
//! triangulating copies beside it.

use std::f64::consts::TAU;

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use spade::{DelaunayTriangulation, Point2, Triangulation};

use crate::mesh::TriMesh;

/// The golden ratio less one: multiples of it, less their whole parts, are as even as can be.
pub(super) const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// How far a vertex moves at most in each direction, in mean distances.
const JITTER: f64 = 0.25;

/// Pieces by which profiles are measured.
const PIECES: usize = 4096;

/// A surface of revolution about the z axis.
pub struct Profile {
    /// Radius and height at a parameter in 0..1.
    pub at: fn(f64) -> (f64, f64),
    /// Its end is its beginning.
    pub is_closed: bool,
}

/// Radii 1 and 0.4.
pub const TORUS: Profile = Profile {
    at: |p| {
        let (sin, cos) = (TAU * p).sin_cos();
        (1.0 + 0.4 * cos, 0.4 * sin)
    },
    is_closed: true,
};

/// A foot, a belly, a neck and a lip: height 2, radii between 0.26 and 0.74.
pub const VASE: Profile = Profile {
    at: |p| (0.5 + 0.2 * (TAU * p - 0.9).sin() + 0.08 * (2.0 * TAU * p + 1.1).sin(), 2.0 * p),
    is_closed: false,
};

/// A profile measured: what is below the end of every piece.
struct Measured(Vec<[f64; 3]>);

/// Of what is measured: the parameter, the conformal height, the area.
const PARAMETER: usize = 0;
const CONFORMAL: usize = 1;
const AREA: usize = 2;

impl Profile {
    /// The area of the surface.
    pub fn area(&self) -> f64 {
        self.measured().total()[2]
    }

    fn measured(&self) -> Measured {
        let mut ends = vec![[0.0; 3]];
        let (mut radius, mut height) = (self.at)(0.0);
        let [mut conformal, mut area] = [0.0; 2];
        for piece in 1..=PIECES {
            let parameter = piece as f64 / PIECES as f64;
            let (next_radius, next_height) = (self.at)(parameter);
            let arc = (next_radius - radius).hypot(next_height - height);
            let mean = 0.5 * (radius + next_radius);
            conformal += arc / mean;
            area += TAU * mean * arc;
            ends.push([parameter, conformal, area]);
            (radius, height) = (next_radius, next_height);
        }
        Measured(ends)
    }
}

impl Measured {
    fn total(&self) -> [f64; 3] {
        self.0[PIECES]
    }

    /// Column `wanted` where column `given` has `value`.
    fn find(&self, given: usize, value: f64, wanted: usize) -> f64 {
        let after = self.0.partition_point(|end| end[given] < value).clamp(1, PIECES);
        let (low, high) = (self.0[after - 1], self.0[after]);
        let share = (value - low[given]) / (high[given] - low[given]);
        low[wanted] + share * (high[wanted] - low[wanted])
    }
}

/// A sampling with `n` ≥ 60 vertices; `None` where the triangles are not those of the surface.
pub(super) fn sample(profile: &Profile, n: usize, rng: &mut ChaCha8Rng) -> Option<TriMesh> {
    let measured = profile.measured();
    let [_, top, area] = measured.total();
    let far = JITTER * (area / n as f64).sqrt();
    let mut places: Vec<[f64; 2]> = Vec::with_capacity(n);
    if !profile.is_closed {
        for (parameter, t) in [(0.0, 0.0), (1.0, top)] {
            let rim = (TAU * (profile.at)(parameter).0 / (area / n as f64).sqrt()).round();
            let begin = rng.random_range(0.0..1.0);
            places.extend((0..rim as usize).map(|i| [TAU / rim * (i as f64 + begin), t]));
        }
    }
    let on_rims = places.len();
    let begin = rng.random_range(0.0..1.0);
    let inner = n.checked_sub(on_rims)?;
    // On an open surface the rims have the first and the last half of a row.
    let margin = 0.5 * on_rims as f64 / (inner + on_rims) as f64;
    for i in 0..inner {
        let share = margin + (1.0 - 2.0 * margin) * (i as f64 + 0.5) / inner as f64;
        let t = measured.find(AREA, share * area, CONFORMAL);
        let radius = (profile.at)(measured.find(CONFORMAL, t, PARAMETER)).0;
        let [across, along] = [(); 2].map(|()| far / radius * rng.random_range(-1.0..1.0));
        let u = (TAU * GOLDEN.mul_add(i as f64, begin) + across).rem_euclid(TAU);
        let t = if profile.is_closed { (t + along).rem_euclid(top) } else { t + along };
        places.push([u, t]);
    }
    let faces = periodic(&places, top, profile.is_closed)?;
    let point = |&[u, t]: &[f64; 2]| {
        let (radius, z) = (profile.at)(measured.find(CONFORMAL, t, PARAMETER));
        [radius * u.cos(), radius * u.sin(), z]
    };
    let is_inside = |&[_, t]: &[f64; 2]| (0.0..=top).contains(&t);
    let vertices = places.iter().map(point).collect();
    places.iter().all(is_inside).then(|| TriMesh::new(vertices, faces).ok())?
}

/// The Delaunay triangles of places on a cylinder around which u goes once in 2π, or on a torus where t comes back at `top`;
/// `None` where they are too few for that.
fn periodic(places: &[[f64; 2]], top: f64, both: bool) -> Option<Vec<[u32; 3]>> {
    let n = places.len();
    let rows = if both { -1..=1 } else { 0..=0 };
    let copies = rows.flat_map(|row| (-1..=1).map(move |column| (column, row)));
    let mut plane = DelaunayTriangulation::<Point2<f64>>::new();
    // The one that is not moved comes first: its vertices are the first n.
    let mut copies: Vec<(i32, i32)> = copies.collect();
    copies.sort_by_key(|&copy| copy != (0, 0));
    for (column, row) in copies {
        for [u, t] in places {
            let point = Point2::new(u + TAU * f64::from(column), t + top * f64::from(row));
            plane.insert(point).ok()?;
        }
    }
    if plane.num_vertices() % n != 0 {
        return None;
    }
    let mut faces = Vec::with_capacity(2 * n);
    for face in plane.inner_faces() {
        let corners = face.vertices().map(|v| v.index());
        let places = corners.map(|corner| (corner % n) as u32);
        // Of all its copies the one whose least vertex was not moved.
        let least = (0..3).min_by_key(|&c| places[c])?;
        if corners[least] < n {
            faces.push(places);
        }
    }
    Some(faces)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    #[test]
    fn areas_are_those_of_the_formula() {
        assert!((TORUS.area() / (4.0 * PI * PI * 0.4) - 1.0).abs() < 1e-6);
        let radii = (0..=1000).map(|i| (VASE.at)(f64::from(i) / 1000.0).0);
        let (least, most) = radii.fold((1.0_f64, 0.0_f64), |(a, b), r| (a.min(r), b.max(r)));
        assert!((0.2..0.3).contains(&least) && (0.7..0.8).contains(&most), "{least} {most}");
    }
}
