//! What a mesh that has changed takes from its previous version: the real binary on a folder whose meshes are edited.

mod common;

use chladni::flow::events::How;
use chladni::mesh::{TriMesh, sample::icosphere};
use chladni::publish::report::MeshReport;
use chladni::publish::result::{Inheritance, Source, Spectrum};
use common::{QUICK, Workspace, obj};

/// A pipeline under which trained functions pass, with room for small edits.
fn pipeline() -> String {
    QUICK.replace("angle_tolerance = 0.5", "angle_tolerance = 0.1")
}

/// A sphere whose north is drawn out by `height`.
fn drawn_out(height: f64) -> TriMesh {
    let sphere = icosphere(2);
    let moved = |&[x, y, z]: &[f64; 3]| {
        let near = (2.0 * z - 1.0).max(0.0);
        [x, y, z + height * near * near]
    };
    let vertices = sphere.vertices().iter().map(moved).collect();
    TriMesh::new(vertices, sphere.faces().to_vec()).unwrap()
}

fn save(workspace: &Workspace, mesh: &TriMesh) {
    workspace.write("meshes/sphere.obj", &obj(mesh));
}

fn run(workspace: &Workspace, arguments: &[&str]) -> MeshReport {
    let (code, mut report) = workspace.report(arguments);
    assert_eq!(code, 0, "{report:?}");
    report.meshes.remove(0)
}

fn bytes(workspace: &Workspace) -> [Vec<u8>; 2] {
    ["spectrum.json", "eigen.npz"]
        .map(|name| std::fs::read(workspace.path("out/sphere.obj").join(name)).unwrap())
}

fn spectrum(workspace: &Workspace) -> Spectrum {
    serde_json::from_slice(&bytes(workspace)[0]).unwrap()
}

fn how(workspace: &Workspace) -> Option<Inheritance> {
    spectrum(workspace).provenance.grown_from.map(|ancestor| ancestor.how)
}

/// The results of a run on this mesh that never saw another.
fn fresh(mesh: &TriMesh) -> [Vec<u8>; 2] {
    let workspace = Workspace::new(&pipeline());
    save(&workspace, mesh);
    run(&workspace, &[]);
    bytes(&workspace)
}

#[test]
fn a_small_edit_is_predicted_with_the_blocks_of_the_version_before() {
    let workspace = Workspace::new(&pipeline());
    run(&workspace, &[]);
    let first = spectrum(&workspace);
    assert_eq!(first.provenance.grown_from, None);

    save(&workspace, &drawn_out(0.02));
    let report = run(&workspace, &[]);
    assert_eq!((report.trained, report.reused), (0, 3));
    let sources =
        |source: Source| report.eigenpairs.iter().filter(|p| p.pair.source == source).count();
    assert_eq!((sources(Source::Constant), sources(Source::Predicted)), (1, 3), "{report:?}");
    let ancestor = spectrum(&workspace).provenance.grown_from.unwrap();
    assert_eq!((ancestor.mesh, ancestor.how), (first.mesh.hash, Inheritance::AsTheyAre));

    // Once more: nothing is computed, and the bytes stay.
    let (before, events) = (bytes(&workspace), workspace.events().len());
    run(&workspace, &[]);
    assert!(workspace.events()[events..].iter().all(|event| event.how == How::Reused));
    assert!(bytes(&workspace) == before);
}

#[test]
fn without_lineage_the_bytes_are_those_of_a_fresh_run_whatever_the_cache_holds() {
    let workspace = Workspace::new(&pipeline());
    run(&workspace, &[]);
    let edited = drawn_out(0.02);
    save(&workspace, &edited);
    run(&workspace, &[]);
    assert_eq!(how(&workspace), Some(Inheritance::AsTheyAre));
    let report = run(&workspace, &["--lineage", "off"]);
    assert_eq!(report.trained, 3);
    let fresh = fresh(&edited);
    assert!(bytes(&workspace) == fresh);
    // What was trained from nothing stays so.
    let report = run(&workspace, &[]);
    assert_eq!((report.trained, report.reused), (0, 3));
    assert!(bytes(&workspace) == fresh);
}

#[test]
fn an_edit_that_is_undone_has_its_results_back() {
    let workspace = Workspace::new(&pipeline());
    run(&workspace, &[]);
    let first = bytes(&workspace);
    save(&workspace, &drawn_out(0.02));
    run(&workspace, &[]);
    save(&workspace, &icosphere(2));
    let events = workspace.events().len();
    let report = run(&workspace, &[]);
    assert_eq!((report.trained, report.reused), (0, 3));
    assert!(workspace.events()[events..].iter().all(|event| event.how == How::Reused));
    assert!(bytes(&workspace) == first);
}

#[test]
fn a_renamed_mesh_takes_its_results_along() {
    let workspace = Workspace::new(&pipeline());
    run(&workspace, &[]);
    save(&workspace, &drawn_out(0.02));
    run(&workspace, &[]);
    let before = bytes(&workspace);
    std::fs::rename(workspace.path("meshes/sphere.obj"), workspace.path("meshes/egg.obj")).unwrap();
    let events = workspace.events().len();
    run(&workspace, &[]);
    assert!(workspace.events()[events..].iter().all(|event| event.how == How::Reused));
    let moved = std::fs::read(workspace.path("out/egg.obj/spectrum.json")).unwrap();
    assert!(moved == before[0]);
}

#[test]
fn a_larger_edit_takes_more_work_and_each_is_recorded() {
    let workspace = Workspace::new(&pipeline());
    run(&workspace, &[]);
    let mut seen = Vec::new();
    for height in [0.1, 0.3, 0.6] {
        save(&workspace, &drawn_out(height));
        let report = run(&workspace, &[]);
        let learned = report.eigenpairs.iter().filter(|pair| pair.pair.source != Source::Constant);
        let expected = match how(&workspace) {
            None => Source::Trained,
            Some(Inheritance::AsTheyAre) => Source::Predicted,
            Some(_) => Source::Finetuned,
        };
        assert!(learned.clone().all(|pair| pair.pair.source == expected), "{report:?}");
        assert_eq!(report.trained + report.reused, learned.count());
        seen.push(how(&workspace));
    }
    assert!(seen.contains(&Some(Inheritance::Heads)), "{seen:?}");
    // Without the heads' solution: the weights are trained on, on a family of the new mesh.
    let strict = ["--set", "verify.angle_tolerance=0.02"];
    let workspace = Workspace::new(&pipeline().replace("steps = 4", "steps = 40"));
    run(&workspace, &[]);
    save(&workspace, &drawn_out(0.4));
    let (_, report) = workspace.report(&strict);
    seen.push(how(&workspace));
    assert!(seen.contains(&Some(Inheritance::FineTuned)), "{seen:?} {report:?}");
}

#[test]
fn what_no_certificate_passes_is_trained_from_nothing_and_so_is_another_surface() {
    let workspace = Workspace::new(&pipeline());
    run(&workspace, &[]);
    let edited = drawn_out(0.3);
    save(&workspace, &edited);
    let strict = ["--set", "verify.angle_tolerance=1e-6"];
    let (code, report) = workspace.report(&strict);
    assert_eq!((code, report.meshes[0].trained), (4, 3));
    assert_eq!(how(&workspace), None);
    // Judged as a fresh run's, they are a fresh run's bytes.
    run(&workspace, &[]);
    assert!(bytes(&workspace) == fresh(&edited));

    let far: Vec<_> = icosphere(1).vertices().iter().map(|&[x, y, z]| [x + 5.0, y, z]).collect();
    let n = edited.n() as u32;
    let faces = icosphere(1).faces().iter().map(|face| face.map(|i| i + n)).collect::<Vec<_>>();
    let vertices = [edited.vertices(), &far].concat();
    save(&workspace, &TriMesh::new(vertices, [edited.faces(), &faces].concat()).unwrap());
    let (_, report) = workspace.report(&[]);
    // Two constants leave two functions to learn.
    assert_eq!(report.meshes[0].trained, 2, "{report:?}");
    assert_eq!(how(&workspace), None);
}

#[test]
fn the_solver_begins_with_the_eigenfunctions_of_the_version_before() {
    let fem = |k| format!("[input]\npaths = [\"meshes\"]\n[train]\nmethod = \"fem\"\nk = {k}\n");
    let workspace = Workspace::new(&fem(12));
    let sphere = |height: f64, levels: u32| {
        let sphere = icosphere(levels);
        let taller = sphere.vertices().iter().map(|&[x, y, z]| [x, 0.9 * y, z * (1.2 + height)]);
        TriMesh::new(taller.collect(), sphere.faces().to_vec()).unwrap()
    };
    save(&workspace, &sphere(0.0, 3));
    run(&workspace, &[]);
    let first = spectrum(&workspace).mesh.hash;
    // Other places, and then another sampling.
    for (edited, before) in [(sphere(0.02, 3), Some(first)), (sphere(0.02, 4), None)] {
        let before = before.unwrap_or_else(|| spectrum(&workspace).mesh.hash);
        save(&workspace, &edited);
        run(&workspace, &[]);
        let ancestor = spectrum(&workspace).provenance.grown_from.unwrap();
        assert_eq!((ancestor.mesh, ancestor.how), (before, Inheritance::WarmStart));
        let (warm, events) = (bytes(&workspace), workspace.events().len());
        run(&workspace, &[]);
        assert!(workspace.events()[events..].iter().all(|event| event.how == How::Reused));
        assert!(bytes(&workspace) == warm);
        let from_nothing = Workspace::new(&fem(12));
        save(&from_nothing, &edited);
        run(&from_nothing, &[]);
        let lambdas = |w: &Workspace| -> Vec<f64> {
            spectrum(w).eigenpairs.iter().map(|pair| pair.lambda).collect()
        };
        for (warm, cold) in lambdas(&workspace).into_iter().zip(lambdas(&from_nothing)).skip(1) {
            assert!((warm / cold - 1.0).abs() < 1e-10, "{warm} {cold}");
        }
    }
    // The bytes of a fresh run, which stay in force.
    run(&workspace, &["--lineage", "off"]);
    let from_nothing = Workspace::new(&fem(12));
    save(&from_nothing, &sphere(0.02, 4));
    run(&from_nothing, &[]);
    assert!(bytes(&workspace) == bytes(&from_nothing));
    run(&workspace, &[]);
    assert!(bytes(&workspace) == bytes(&from_nothing));
}
