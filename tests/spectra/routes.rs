//! Two ways to a spectrum, dense and by Lanczos, find the same one; neither depends on the number of threads.

use chladni::operators::MassKind;
use chladni::spectrum::certificate::principal_angle;
use chladni::spectrum::cluster::{CLUSTER_GAP, clusters, zero_below};

use super::{AREAS, Surface, distance, mesh};

/// Meshes of more than 400 vertices, and the largest K that Lanczos is asked for: up to n = 4K a dense solver is.
const SWITCH: [(&str, usize); 2] = [("lapy_square-mesh.off", 103), ("bunny2.obj", 125)];

#[test]
fn the_dense_and_the_sparse_route_agree() {
    for (name, k) in SWITCH {
        for mass in AREAS {
            let surface = Surface::of(&mesh(name), mass);
            let n = surface.operators.n();
            assert!(n > 400 && n > 4 * k && n <= 4 * (k + 1), "{name} has {n} vertices");
            let [sparse, dense] = [k, k + 1].map(|k| surface.reference(k));
            let worst = distance(&sparse.pairs.values[..k], &dense.pairs.values[..k], 1e-9);
            assert!(worst < 1e-9, "{name}, {mass:?}: {worst:e}");
            let area = surface.operators.area.0;
            let runs = clusters(&sparse.pairs.values, CLUSTER_GAP, zero_below(area));
            for run in runs.into_iter().filter(|run| run.end <= dense.pairs.len()) {
                let [a, b] = [&sparse, &dense]
                    .map(|found| found.pairs.vectors.subcols(run.start, run.len()).to_owned());
                let angle = principal_angle(&surface.operators.mass, &a, &b);
                assert!(angle < 1e-7, "{name}, {mass:?}, {run:?}: {angle:e}");
            }
        }
    }
}

#[test]
fn neither_route_depends_on_the_number_of_threads() {
    let (name, k) = SWITCH[0];
    let surface = Surface::of(&mesh(name), MassKind::Consistent);
    for k in [k, k + 1] {
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let pairs = surface.lowest(k);
                let certificate = surface.certificate(&pairs.vectors);
                (pairs.values, pairs.vectors, format!("{certificate:?}"))
            })
        };
        assert!(on(1) == on(3), "K = {k}");
    }
}
