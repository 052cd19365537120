//! Flat surfaces that no mesh in space can be: a torus, a Klein bottle and a Möbius strip, as triangles of given edge
//! lengths glued to one another. The spectra of the discrete operators are known to the last eigenvalue.

use std::f64::consts::PI;

use chladni::mesh::Area;
use chladni::operators::adjacency::adjacency;
use chladni::operators::gluing::{Gluing, Run};
use chladni::operators::mass::mass;
use chladni::operators::stiffness::cotangent_stiffness;
use chladni::operators::{Boundary, MassKind, Operators, Pattern, Quality, Triangle};
use chladni::spectrum::cluster::{CLUSTER_GAP, clusters, zero_below};

use super::{AREAS, Surface, distance};

/// A sheet of `columns` × `rows` cells of `width` × `height`, and how it is glued.
#[derive(Clone, Copy)]
struct Sheet {
    columns: usize,
    rows: usize,
    width: f64,
    height: f64,
    glued: Glued,
}

#[derive(Clone, Copy, PartialEq)]
enum Glued {
    /// Left to right and bottom to top.
    Torus,
    /// Bottom to top, and left to right upside down.
    KleinBottle,
    /// Left to right upside down.
    MoebiusStrip,
}

impl Sheet {
    /// The vertex at corner (i, j) of the cells.
    fn vertex(&self, i: usize, j: usize) -> u32 {
        let around = i == self.columns;
        let (i, j) = match self.glued {
            Glued::Torus => (i % self.columns, j % self.rows),
            Glued::KleinBottle if around => (0, (self.rows - j) % self.rows),
            Glued::KleinBottle => (i, j % self.rows),
            Glued::MoebiusStrip if around => (0, self.rows - j),
            Glued::MoebiusStrip => (i, j),
        };
        (i + j * self.columns) as u32
    }

    /// Every cell is two triangles.
    fn triangles(&self) -> Vec<Triangle> {
        let (w, h) = (self.width, self.height);
        let diagonal = w.hypot(h);
        let cells = (0..self.rows).flat_map(|j| (0..self.columns).map(move |i| (i, j)));
        let halves = cells.flat_map(|(i, j)| {
            let [a, b] = [(i, j), (i + 1, j)].map(|(i, j)| self.vertex(i, j));
            let [c, d] = [(i + 1, j + 1), (i, j + 1)].map(|(i, j)| self.vertex(i, j));
            [([a, b, c], [w, h, diagonal]), ([a, c, d], [diagonal, w, h])]
        });
        halves.map(|(vertices, lengths)| Triangle::of_lengths(vertices, lengths)).collect()
    }

    fn surface(&self, mass_kind: MassKind, boundary: Boundary) -> Surface {
        let triangles = self.triangles();
        let faces: Vec<_> = triangles.iter().map(|triangle| triangle.vertices).collect();
        let rows = if self.glued == Glued::MoebiusStrip { self.rows + 1 } else { self.rows };
        let n = self.columns * rows;
        let pattern = Pattern::of(n, faces.iter().copied());
        let (gluing, on_boundary) = Gluing::of(&pattern, &faces);
        let along = gluing.edges().any(|(a, _)| gluing.mate(a).unwrap().run == Run::Along);
        assert_eq!(along, self.glued != Glued::Torus, "only the torus can be oriented");
        assert_eq!(on_boundary.is_empty(), self.glued != Glued::MoebiusStrip);
        let stiffness = cotangent_stiffness(&pattern, &triangles);
        let operators = Operators {
            adjacency: adjacency(&pattern),
            mass: mass(mass_kind, &pattern, &triangles),
            mass_kind,
            boundary: on_boundary,
            area: Area(triangles.iter().map(|triangle| triangle.area).sum()),
            quality: Quality::of(&triangles, &gluing, &stiffness, None),
            stiffness,
        };
        Surface { operators, labels: vec![0; n], boundary }
    }
}

/// −d²/dx² in steps of h, of a wave that turns by `phase` in a step.
fn wave(phase: f64, step: f64) -> f64 {
    (2.0 * (0.5 * phase).sin() / step).powi(2)
}

fn sorted(mut values: Vec<f64>) -> Vec<f64> {
    values.sort_by(f64::total_cmp);
    values
}

/// The distance of all eigenvalues from `expected`.
fn from_all(surface: &Surface, expected: Vec<f64>) -> f64 {
    let found = surface.lowest(expected.len()).values;
    distance(&found, &sorted(expected), 1e-10)
}

/// The unit torus of `cells` × `cells` squares.
fn unit_torus(cells: usize) -> Sheet {
    let step = 1.0 / cells as f64;
    Sheet { columns: cells, rows: cells, width: step, height: step, glued: Glued::Torus }
}

#[test]
fn the_flat_torus_has_4_pi_squared_n_squared_plus_m_squared_to_order_two() {
    let exact: Vec<f64> = [(0, 1), (1, 4), (2, 4), (4, 4), (5, 8)]
        .into_iter()
        .flat_map(|(sum, multiplicity)| vec![4.0 * PI * PI * f64::from(sum); multiplicity])
        .collect();
    for mass in AREAS {
        let values = |cells| unit_torus(cells).surface(mass, Boundary::Neumann).lowest(21).values;
        let [coarse, fine] = [values(24), values(48)];
        let runs = clusters(&fine, 2.0 * CLUSTER_GAP, zero_below(1.0));
        let multiplicities: Vec<_> = runs.iter().map(ExactSizeIterator::len).collect();
        assert_eq!(multiplicities, [1, 4, 4, 4, 8], "{mass:?}");
        let [coarse, fine] = [coarse, fine].map(|found| distance(&found, &exact, 1e-10));
        let order = (coarse / fine).log2();
        assert!((1.9..2.1).contains(&order), "{mass:?}: {coarse:e} {fine:e}");
    }
}

#[test]
fn all_eigenvalues_of_the_discrete_torus_under_every_mass() {
    let (columns, rows, width, height) = (16, 20, 0.3, 0.2);
    let sheet = Sheet { columns, rows, width, height, glued: Glued::Torus };
    for mass in AREAS {
        let phase = |n: usize, of: usize| 2.0 * PI * n as f64 / of as f64;
        let waves =
            (0..columns).flat_map(|n| (0..rows).map(move |m| (phase(n, columns), phase(m, rows))));
        let expected = waves.map(|(a, b)| {
            // The consistent mass is ½ of a vertex's area on the diagonal and 1/12 on each of its six edges.
            let share = match mass {
                MassKind::Consistent => 0.5 + (a.cos() + b.cos() + (a + b).cos()) / 6.0,
                _ => 1.0,
            };
            (wave(a, width) + wave(b, height)) / share
        });
        let worst = from_all(&sheet.surface(mass, Boundary::Neumann), expected.collect());
        assert!(worst < 1e-11, "{mass:?}: {worst:e}");
    }
}

#[test]
fn all_eigenvalues_of_the_discrete_klein_bottle() {
    // Once around, a wave with an even number of half-turns meets itself upside down if it is even in y, one with an
    // odd number if it is odd.
    let (columns, rows, width, height) = (14, 18, 0.2, 0.3);
    let sheet = Sheet { columns, rows, width, height, glued: Glued::KleinBottle };
    let waves = (0..2 * columns).flat_map(|n| {
        let across = if n % 2 == 0 { 0..rows / 2 + 1 } else { 1..rows / 2 };
        across.map(move |m| {
            let (half, turn) = (PI * n as f64 / columns as f64, 2.0 * PI * m as f64 / rows as f64);
            wave(half, width) + wave(turn, height)
        })
    });
    for mass in [MassKind::Lumped, MassKind::Voronoi] {
        let worst = from_all(&sheet.surface(mass, Boundary::Neumann), waves.clone().collect());
        assert!(worst < 1e-11, "{mass:?}: {worst:e}");
    }
}

#[test]
fn all_eigenvalues_of_the_discrete_moebius_strip_free_and_held() {
    let (columns, rows, width, height) = (18, 11, 0.2, 0.3);
    let sheet = Sheet { columns, rows, width, height, glued: Glued::MoebiusStrip };
    // Cosines of an even number of half-waves across are even about the middle, sines of an odd number.
    let waves = |across: std::ops::Range<usize>, parity: usize| {
        let pairs = (0..2 * columns).flat_map(|n| across.clone().map(move |m| (n, m)));
        let pairs = pairs.filter(|(n, m)| (n + m) % 2 == parity);
        let value = |(n, m): (usize, usize)| {
            let (along, across) = (PI * n as f64 / columns as f64, PI * m as f64 / rows as f64);
            wave(along, width) + wave(across, height)
        };
        pairs.map(value).collect()
    };
    for (mass, boundary, expected) in [
        (MassKind::Voronoi, Boundary::Neumann, waves(0..rows + 1, 0)),
        (MassKind::Voronoi, Boundary::Dirichlet, waves(1..rows, 1)),
        (MassKind::Lumped, Boundary::Dirichlet, waves(1..rows, 1)),
    ] {
        let worst = from_all(&sheet.surface(mass, boundary), expected);
        assert!(worst < 1e-11, "{mass:?} {boundary:?}: {worst:e}");
    }
}
