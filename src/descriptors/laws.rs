//! What holds of all descriptors: size, signs and bases do not count, pieces do, and computed pairs come near the formulas.

use std::f64::consts::PI;

use super::shape_dna::{Normalisation, shape_dna};
use super::wave_kernel::Energies;
use super::{Basis, Counted, Descriptor, TooFew};
use super::{coordinates, diffusion, global_point, heat_kernel, wave_kernel};
use crate::mesh::topology::component_labels;
use crate::mesh::{TriMesh, sample::icosphere};
use crate::operators::{Boundary, MassKind, Operators};
use crate::spectrum::factor::Analysis;
use crate::spectrum::{Dense, Eigenpairs, Problem, fem};

/// The operators of a mesh with a consistent mass, and its lowest `k` pairs.
pub fn solved(mesh: &TriMesh, k: usize) -> (Operators, Eigenpairs) {
    let operators = Operators::assemble(mesh, MassKind::Consistent).unwrap();
    let pairs = {
        let problem = Problem::new(&operators, Boundary::Neumann, &component_labels(mesh)).unwrap();
        let analysis = Analysis::new(problem.pencil()).unwrap();
        fem::lowest(&problem, &analysis, k).unwrap().pairs.truncated(k)
    };
    (operators, pairs)
}

/// A mesh without symmetry.
fn egg(scale: f64) -> TriMesh {
    let sphere = icosphere(2);
    let place = |&[x, y, z]: &[f64; 3]| [1.7 * x + 0.2 * y * z, y, 0.8 * z + 0.3 * x * x];
    let vertices = sphere.vertices().iter().map(|p| place(p).map(|c| scale * c)).collect();
    TriMesh::new(vertices, sphere.faces().to_vec()).unwrap()
}

/// Two spheres that do not touch, the second of radius 2.
fn two_spheres() -> TriMesh {
    let sphere = icosphere(1);
    let n = sphere.n() as u32;
    let second = sphere.vertices().iter().map(|p| [10.0 + 2.0 * p[0], 2.0 * p[1], 2.0 * p[2]]);
    let vertices = sphere.vertices().iter().copied().chain(second).collect();
    let moved = sphere.faces().iter().map(|face| face.map(|i| i + n));
    TriMesh::new(vertices, sphere.faces().iter().copied().chain(moved).collect()).unwrap()
}

fn apart(a: &Dense, b: &Dense) -> f64 {
    (a - b).norm_max() / b.norm_max()
}

#[test]
fn size_does_not_count() {
    let scale = 37.0;
    let (small, large) = (egg(1.0), egg(scale));
    let [(_, a), (_, b)] = [&small, &large].map(|mesh| solved(mesh, 12));
    let (x, y) = (Basis::new(&a, small.area().0), Basis::new(&b, large.area().0));
    let dna = |pairs: &Eigenpairs, mesh: &TriMesh| {
        shape_dna(&pairs.values, Normalisation::Area(mesh.area().0))
    };
    for (a, b) in dna(&a, &small).iter().zip(dna(&b, &large)) {
        assert!((a - b).abs() < 1e-9 * b.max(1.0));
    }
    // The times follow the size; what is per area takes it along.
    let times = |basis| heat_kernel::times(basis, 20).unwrap();
    let per_area = |basis, mesh: &TriMesh, f: fn(&Basis<'_>, &[f64]) -> Dense| {
        faer::Scale(mesh.area().0) * f(basis, &times(basis))
    };
    for f in [heat_kernel::hks, heat_kernel::scaled_hks] {
        assert!(apart(&per_area(&x, &small, f), &per_area(&y, &large, f)) < 1e-9);
    }
    let wks = |basis, mesh: &TriMesh| {
        faer::Scale(mesh.area().0) * wave_kernel::wks(basis, &Energies::of(basis, 40).unwrap())
    };
    assert!(apart(&wks(&x, &small), &wks(&y, &large)) < 1e-9);
    let gps = |basis| global_point::gps(basis).unwrap();
    assert!(apart(&gps(&x), &gps(&y)) < 1e-8);
    let distances = [(&x, 1.0), (&y, scale)].map(|(basis, scale)| {
        let all = diffusion::from_vertex(basis, 5, 0.1 * scale * scale);
        Dense::from_fn(all.len(), 1, |i, _| scale * all[i])
    });
    assert!(apart(&distances[0], &distances[1]) < 1e-9);
}

#[test]
fn signs_and_the_basis_of_an_eigenspace_do_not_count() {
    let mesh = icosphere(2);
    let (_, pairs) = solved(&mesh, 9);
    let mut values = pairs.values.clone();
    values[1..4].fill(2.0);
    let one = Eigenpairs { values: values.clone(), vectors: pairs.vectors.clone() };
    // φ₂ and φ₃ turned in their eigenspace, every other of the rest with its other sign.
    let (s, c) = 0.9_f64.sin_cos();
    let other = Dense::from_fn(mesh.n(), 9, |i, j| {
        let phi = |j| pairs.vectors[(i, j)];
        match j {
            1 => c * phi(1) + s * phi(2),
            2 => c * phi(2) - s * phi(1),
            j if j % 2 == 0 => -phi(j),
            j => phi(j),
        }
    });
    let other = Eigenpairs { values, vectors: other };
    let [a, b] = [&one, &other].map(|pairs| Basis::new(pairs, mesh.area().0));
    let times = heat_kernel::times(&a, 10).unwrap();
    assert!(apart(&heat_kernel::hks(&a, &times), &heat_kernel::hks(&b, &times)) < 1e-13);
    let energies = Energies::of(&a, 50).unwrap();
    assert!(apart(&wave_kernel::wks(&a, &energies), &wave_kernel::wks(&b, &energies)) < 1e-13);
    let distances = [&a, &b].map(|basis| diffusion::from_vertex(basis, 0, 0.3));
    assert!(distances[0].iter().zip(&distances[1]).all(|(a, b)| (a - b).abs() < 1e-13));
    let [p, q] = [&a, &b].map(|basis| global_point::gps(basis).unwrap());
    let length = |x: &Dense, i: usize| (0..8).map(|j| x[(i, j)].powi(2)).sum::<f64>();
    assert!((0..mesh.n()).all(|i| (length(&p, i) - length(&q, i)).abs() < 1e-13));
}

#[test]
fn every_piece_has_its_own_zero() {
    let mesh = two_spheres();
    let (_, pairs) = solved(&mesh, 8);
    let basis = Basis::new(&pairs, mesh.area().0);
    // λ = 0 twice, ½ three times of the large sphere, 2 of the small one.
    assert_eq!(basis.positive().collect::<Vec<_>>(), [2, 3, 4, 5, 6, 7]);
    let times = heat_kernel::times(&basis, 2).unwrap();
    let [low, high] = [pairs.values[2], pairs.values[7]].map(|value| 4.0 * 10_f64.ln() / value);
    assert!((times[0] / high - 1.0).abs() < 1e-12 && (times[1] / low - 1.0).abs() < 1e-12);
    // Long after, heat is even on its piece.
    let (first, second) = (0, 42);
    let hks = heat_kernel::hks(&basis, &[1e4]);
    let area = |faces: std::ops::Range<usize>| {
        mesh.face_areas().skip(faces.start).take(faces.len()).sum::<f64>()
    };
    assert!((hks[(first, 0)] * area(0..80) - 1.0).abs() < 1e-10);
    assert!((hks[(second, 0)] * area(80..160) - 1.0).abs() < 1e-10);
    let apart = diffusion::between(&basis, &[[0, 1], [0, 42]], 1e4);
    let expected = (area(0..80).recip() + area(80..160).recip()).sqrt();
    assert!(apart[0] < 1e-8 && (apart[1] - expected).abs() < 1e-10, "{apart:?}");
    let finite = |x: Dense| x.col_iter().all(|column| column.iter().all(|v| v.is_finite()));
    let gps = global_point::gps(&basis).unwrap();
    assert_eq!(gps.ncols(), 6);
    assert!(finite(gps));
    assert!(finite(wave_kernel::wks(&basis, &Energies::of(&basis, 40).unwrap())));
    let coordinates = coordinates::spectral_coordinates(&basis).unwrap();
    assert!((0..42).all(|i| coordinates[(i, 0)].abs() < 1e-8), "the large sphere's vibrate first");
}

#[test]
fn computed_pairs_of_a_sphere_come_near_the_formulas() {
    let mesh = icosphere(4);
    let (_, pairs) = solved(&mesh, 49);
    let basis = Basis::new(&pairs, mesh.area().0);
    let times = heat_kernel::times(&basis, 30).unwrap();
    let found = heat_kernel::hks(&basis, &times);
    for (i, t) in times.iter().enumerate() {
        let of_degree = |l: i32| f64::from(2 * l + 1) * (-f64::from(l * (l + 1)) * t).exp();
        let expected = (0..7).map(of_degree).sum::<f64>() / (4.0 * PI);
        let worst = found.col(i).iter().map(|v| (v / expected - 1.0).abs()).fold(0.0, f64::max);
        assert!(worst < 0.005, "t = {t}: {worst}");
    }
    let wks = wave_kernel::wks(&basis, &Energies::of(&basis, 100).unwrap());
    let worst = |v: f64| (v * 4.0 * PI - 1.0).abs();
    let worst = wks.col_iter().flat_map(|c| c.iter().copied()).map(worst).fold(0.0, f64::max);
    assert!(worst < 0.03, "{worst}");
    for (found, l) in
        [(1, 1), (4, 2), (9, 3), (16, 4)].map(|(j, l)| (pairs.values[j], f64::from(l)))
    {
        let dna = shape_dna(&[found], Normalisation::Area(mesh.area().0))[0];
        assert!((dna / (4.0 * PI * l * (l + 1.0)) - 1.0).abs() < 0.01);
    }
}

#[test]
fn too_few_pairs_are_said_with_the_remedy() {
    let pairs = |values: &[f64]| Eigenpairs {
        values: values.to_vec(),
        vectors: Dense::zeros(4, values.len()),
    };
    let (none, one) = (pairs(&[0.0, 1e-15]), pairs(&[0.0, 2.0, 2.0]));
    let [none, one] = [&none, &one].map(|pairs| Basis::new(pairs, 1.0));
    let refused =
        |descriptor, needed, what, found, k| Some(TooFew { descriptor, needed, what, found, k });
    let (hks, wks) = (Descriptor::Hks, Descriptor::Wks);
    assert_eq!(heat_kernel::times(&none, 3).err(), refused(hks, 1, Counted::Different, 0, 2));
    assert_eq!(Energies::of(&one, 30).err(), refused(wks, 2, Counted::Different, 1, 3));
    assert_eq!(
        global_point::gps(&none).err(),
        refused(Descriptor::Gps, 1, Counted::Functions, 0, 2)
    );
    let error = coordinates::spectral_coordinates(&one).unwrap_err().to_string();
    assert!(
        error.starts_with(
            "\"spectral-coordinates\" takes 3 eigenfunctions of λ > 0, and there are 2"
        ),
        "{error}"
    );
    assert!(error.contains("train.k"), "{error}");
}
