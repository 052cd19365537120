//! Several objects of one file as several meshes: `ingest.objects = "split"`, and `--object`.

mod common;

use std::collections::BTreeSet;
use std::io::Cursor;
use std::path::Path;

use chladni::flow::Event;
use chladni::flow::events::How;
use chladni::mesh::{Opened, TriMesh, sample::icosphere};
use chladni::publish::plan::RunPlan;
use chladni::publish::report::Status;
use chladni::publish::result::Spectrum;
use common::{FEM, Workspace, chladni, text};
use npyz::npz::NpzArchive;

/// A sphere and an ellipsoid in one OBJ file.
fn scene(height: f64) -> (String, TriMesh, TriMesh) {
    let sphere = icosphere(2);
    let taller = sphere.vertices().iter().map(|&[x, y, z]| [x + 5.0, 0.9 * y, height * z]);
    let ellipsoid = TriMesh::new(taller.collect(), sphere.faces().to_vec()).unwrap();
    let scene = common::scene(&[("ball", sphere.clone()), ("long ball", ellipsoid.clone())]);
    (scene, sphere, ellipsoid)
}

fn spectrum(folder: &Path) -> Spectrum {
    serde_json::from_slice(&std::fs::read(folder.join("spectrum.json")).unwrap()).unwrap()
}

#[test]
fn each_object_has_results_of_its_own_and_only_the_edited_one_is_computed_again() {
    let split = FEM.to_owned() + "[ingest]\nobjects = \"split\"\n";
    let workspace = Workspace::new(FEM);
    let (scene, sphere, ellipsoid) = scene(2.0);
    workspace.write("meshes/scene.obj", &scene);
    let (code, report) = workspace.report(&[]);
    assert_eq!(code, 0, "{report:?}");
    assert_eq!(report.meshes.len(), 2);
    assert_eq!(spectrum(&workspace.path("out/scene.obj")).mesh.components, 2);

    workspace.write("pipeline.toml", &split);
    let (code, report) = workspace.report(&[]);
    assert_eq!(code, 0, "{report:?}");
    let names: Vec<&str> = report.meshes.iter().map(|mesh| mesh.path.as_str()).collect();
    assert_eq!(names, ["scene.obj/ball", "scene.obj/long_ball", "sphere.obj"]);
    let of = |name: &str| spectrum(&workspace.path("out").join(name)).mesh.hash;
    assert_eq!(of("scene.obj/ball"), sphere.hash());
    assert_eq!(of("scene.obj/long_ball"), ellipsoid.hash());
    // As one mesh it has no current results any more.
    assert!(!workspace.path("out/scene.obj/spectrum.json").exists());

    let before = workspace.events().len();
    workspace.write("meshes/scene.obj", &self::scene(2.1).0);
    let (_, report) = workspace.report(&[]);
    assert!(report.meshes.iter().all(|mesh| mesh.status == Status::Verified));
    let computed = |event: &&Event| event.how == How::Computed;
    let items: BTreeSet<usize> =
        workspace.events()[before..].iter().filter(computed).map(|event| event.item).collect();
    assert_eq!(items, BTreeSet::from([1]), "scene.obj/long_ball alone");

    let mut explain = workspace.run(&["--dry-run", "--format", "json"]);
    let plan: RunPlan = serde_json::from_slice(&explain.output().unwrap().stdout).unwrap();
    assert_eq!(plan.meshes[1].path, "scene.obj/long_ball");
}

/// Each object has a history of its own: nothing that was found depends on which came first.
#[test]
fn objects_of_a_file_do_not_grow_from_one_another() {
    let split = FEM.to_owned() + "[ingest]\nobjects = \"split\"\n";
    let names = ["scene.obj/ball", "scene.obj/long_ball"];
    let results = |jobs: &str| -> Vec<Vec<u8>> {
        let workspace = Workspace::new(&split);
        workspace.write("meshes/scene.obj", &scene(2.0).0);
        assert_eq!(workspace.report(&["--jobs", jobs]).0, 0);
        let bytes =
            |name: &str| std::fs::read(workspace.path("out").join(name).join("spectrum.json"));
        names.iter().map(|name| bytes(name).unwrap()).collect()
    };
    let alone = results("1");
    assert!(alone == results("4"));
    for bytes in alone {
        let spectrum: Spectrum = serde_json::from_slice(&bytes).unwrap();
        assert!(spectrum.provenance.grown_from.is_none());
    }
}

/// What no longer holds does not stay as verified, whichever way the file was cut before.
#[test]
fn results_of_another_cut_are_withdrawn() {
    let workspace = Workspace::new(FEM);
    let split: &[&str] = &["--set", "ingest.objects=split"];
    let is_there = |name: &str| workspace.path("out").join(name).join("spectrum.json").exists();
    let whole = || is_there("scene.obj");
    let objects = || [is_there("scene.obj/ball"), is_there("scene.obj/long_ball")];
    let write = |text: &str| workspace.write("meshes/scene.obj", text);
    write(&scene(2.0).0);
    workspace.report(split);
    write(&scene(2.1).0);
    workspace.report(&[]);
    assert_eq!((whole(), objects()), (true, [false, false]));
    // No object is large enough.
    assert_eq!(workspace.report(&[split, &["--set", "train.k=170"]].concat()).0, 3);
    assert_eq!((whole(), objects()), (false, [false, false]));
    workspace.report(split);
    assert_eq!((whole(), objects()), (false, [true, true]));
    write("v 0 0\n");
    assert_eq!(workspace.report(split).0, 3);
    assert_eq!((whole(), objects()), (false, [false, false]));
}

#[test]
fn one_object_is_solved_for_and_others_are_named() {
    let workspace = Workspace::new(FEM);
    let (scene, sphere, _) = scene(2.0);
    workspace.write("scene.obj", &scene);
    let (file, out) = (workspace.path("scene.obj"), workspace.path("spectra"));
    let (file, out) = (file.to_str().unwrap(), out.to_str().unwrap());
    let solve = |arguments: &[&str]| chladni(&[&["solve", file, "-k", "4"], arguments].concat());
    let solved = solve(&[
        "--object",
        "ball",
        "--out",
        out,
        "--formats",
        "csv,vtu",
        "--descriptors",
        "shape-dna",
    ]);
    assert_eq!(solved.status.code(), Some(0), "{}", text(&solved));
    let folder = workspace.path("spectra/scene.obj/ball");
    assert_eq!(spectrum(&folder).mesh.hash, sphere.hash());
    for name in ["eigen.npz", "spectrum.csv", "eigen.vtu", "descriptors.npz"] {
        assert!(folder.join(name).exists(), "{name}");
    }
    assert!(!folder.join("eigen.ply").exists());
    let arrays = std::fs::read(folder.join("eigen.npz")).unwrap();
    let mut arrays = NpzArchive::new(Cursor::new(arrays)).unwrap();
    let mut array =
        |name: &str| -> Vec<i64> { arrays.by_name(name).unwrap().unwrap().into_vec().unwrap() };
    assert_eq!(array("file_vertices"), (0..162).collect::<Vec<_>>());
    assert_eq!(array("vertex_map"), (0..162).collect::<Vec<_>>());
    // It says nothing of what is there of all of the file.
    assert_eq!(solve(&["--out", out]).status.code(), Some(0));
    assert_eq!(solve(&["--out", out, "--object", "long_ball"]).status.code(), Some(0));
    for name in ["", "ball", "long_ball"] {
        spectrum(&workspace.path("spectra/scene.obj").join(name));
    }
    let as_in_the_file = solve(&["--object", "long ball"]);
    assert_eq!(as_in_the_file.status.code(), Some(0), "{}", text(&as_in_the_file));
    let unknown = solve(&["--object", "lid"]);
    assert_eq!(unknown.status.code(), Some(2));
    assert!(text(&unknown).contains("it has ball, long_ball"), "{}", text(&unknown));
    let wrong = solve(&["--out", out, "--formats", "stl"]);
    assert_eq!(wrong.status.code(), Some(2));
    assert!(text(&wrong).contains("expected one of"), "{}", text(&wrong));
    let info = text(&chladni(&["info", file]));
    assert!(info.contains("2: ball, long_ball") && info.contains("ingest.objects"), "{info}");
    let info = text(&chladni(&["info", file, "--object", "ball"]));
    assert!(info.contains("scene.obj/ball") && info.contains("162 vertices"), "{info}");
}

/// A scene that somebody else made: a .glb of trimesh's with nodes in nodes.
#[test]
fn the_nodes_of_a_scene_are_its_objects() {
    let path = Path::new("../shared/data/trimesh_nested.glb");
    if !path.exists() {
        eprintln!("skipped: {} is not there", path.display());
        return;
    }
    let opened = Opened::read(path).unwrap();
    let whole = opened.whole().unwrap();
    let objects = opened.objects();
    assert!(objects.len() > 1, "{objects:?}");
    let faces: usize =
        objects.iter().map(|object| opened.object(object).unwrap().mesh.faces().len()).sum();
    assert_eq!(faces, whole.mesh.faces().len());
}
