//! What counts as a change, and what becomes of it.

use std::time::{Duration, SystemTime};

use chladni::mesh::{TriMesh, sample::icosphere};
use chladni::publish::result::Spectrum;
use chladni::publish::watched::Happened;

use crate::common::{Workspace, obj};
use crate::{FEM, Watched, ellipsoid, names_of_done, scene};

#[test]
fn saves_of_every_kind_make_current_results_and_nothing_else_is_computed() {
    let watched = Watched::start(Workspace::new(FEM), &[]);
    watched.is_current("sphere.obj", &icosphere(2));

    // In place; by renaming over it; as a new file; in folders that are made with it.
    watched.save("sphere.obj", &ellipsoid(1.1));
    assert_eq!(names_of_done(&watched.until_idle()), ["sphere.obj"]);
    watched.is_current("sphere.obj", &ellipsoid(1.1));
    std::fs::write(watched.mesh("sphere.tmp"), obj(&ellipsoid(1.2))).unwrap();
    std::fs::rename(watched.mesh("sphere.tmp"), watched.mesh("sphere.obj")).unwrap();
    assert_eq!(names_of_done(&watched.until_idle()), ["sphere.obj"]);
    watched.is_current("sphere.obj", &ellipsoid(1.2));
    std::fs::create_dir_all(watched.mesh("a/b/c")).unwrap();
    watched.save("a/b/c/deep.obj", &ellipsoid(1.3));
    assert_eq!(names_of_done(&watched.until_idle()), ["a/b/c/deep.obj"]);
    watched.is_current("a/b/c/deep.obj", &ellipsoid(1.3));

    // Saved without a change: read, and nothing computed.
    let computed = watched.computed();
    watched.save("sphere.obj", &ellipsoid(1.2));
    assert_eq!(names_of_done(&watched.until_idle()), ["sphere.obj"]);
    assert_eq!(watched.computed(), computed);
    // Our own results are no input, nor are hidden and temporary files.
    for name in [".hidden.obj", "sphere.obj.tmp", "notes.txt"] {
        watched.save(name, &ellipsoid(1.4));
    }
    watched.is_silent(700);
}

#[test]
fn a_file_that_is_written_slowly_is_waited_for_and_half_of_one_is_tried_again() {
    use std::io::Write;
    let watched = Watched::start(Workspace::new(FEM), &[]);
    let text = obj(&ellipsoid(1.5));
    let mut file = std::fs::File::create(watched.mesh("slow.obj")).unwrap();
    for part in text.as_bytes().chunks(text.len() / 8 + 1) {
        file.write_all(part).unwrap();
        file.flush().unwrap();
        std::thread::sleep(Duration::from_millis(60));
    }
    drop(file);
    let said = watched.until_idle();
    assert_eq!(names_of_done(&said), ["slow.obj"], "{said:?}");
    watched.is_current("slow.obj", &ellipsoid(1.5));

    // One that stops in the middle of a line for longer than anybody waits.
    let (half, rest) = text.split_at(text.find("\nf ").unwrap() + 2);
    std::fs::write(watched.mesh("half.obj"), half).unwrap();
    let said = watched.until(|happened| matches!(happened, Happened::Failed { .. }));
    assert!(matches!(said.last(), Some(Happened::Failed { again: true, .. })), "{said:?}");
    std::fs::write(watched.mesh("half.obj"), half.to_owned() + rest).unwrap();
    let said = watched.until(|happened| matches!(happened, Happened::Done { .. }));
    assert_eq!(names_of_done(&said), ["half.obj"]);
    watched.is_current("half.obj", &ellipsoid(1.5));
}

#[test]
fn a_rename_takes_the_results_along_and_a_deletion_keeps_or_removes_them() {
    let watched = Watched::start(Workspace::new(FEM), &[]);
    let before = std::fs::read(watched.workspace.path("out/sphere.obj/spectrum.json")).unwrap();
    let computed = watched.computed();
    // Written a day ago.
    let file = std::fs::File::options().write(true).open(watched.mesh("sphere.obj")).unwrap();
    file.set_modified(SystemTime::now() - Duration::from_secs(86_400)).unwrap();
    watched.until_idle();
    std::fs::rename(watched.mesh("sphere.obj"), watched.mesh("ball.obj")).unwrap();
    let said = watched.until_idle();
    let [saved, ready, moved, Happened::Done { path, seconds, .. }, Happened::Idle { .. }] =
        &said[..]
    else {
        panic!("{said:#?}")
    };
    assert_eq!(*saved, Happened::Saved { path: "ball.obj".into() });
    assert_eq!(*ready, Happened::Ready { path: "ball.obj".into() });
    assert_eq!(*moved, Happened::Moved { from: "sphere.obj".into(), path: "ball.obj".into() });
    assert!(path == "ball.obj" && *seconds < 60.0, "{said:#?}");
    assert_eq!(watched.computed(), computed);
    let out = watched.workspace.path("out");
    assert_eq!(std::fs::read(out.join("ball.obj/spectrum.json")).unwrap(), before);
    assert!(!out.join("sphere.obj").exists());

    std::fs::remove_file(watched.mesh("ball.obj")).unwrap();
    let said = watched.until(|happened| matches!(happened, Happened::Deleted { .. }));
    assert!(matches!(said.last(), Some(Happened::Deleted { results_kept: true, .. })));
    watched.until_idle();
    assert!(out.join("ball.obj/eigen.npz").exists());

    // A pipeline that changes is read again, and every mesh is looked at again.
    watched.save("next.obj", &ellipsoid(1.6));
    watched.until_idle();
    watched.workspace.write("pipeline.toml", "[train]\nk = \n");
    let said = watched.until(|happened| matches!(happened, Happened::Pipeline { .. }));
    assert!(matches!(said.last(), Some(Happened::Pipeline { error: Some(_) })), "{said:?}");
    let changed = FEM.replace("k = 4", "k = 6") + "[publish]\non_delete = \"remove\"\n";
    watched.workspace.write("pipeline.toml", &changed);
    let said = watched.until(|happened| matches!(happened, Happened::Done { .. }));
    assert!(said.contains(&Happened::Pipeline { error: None }), "{said:?}");
    let text = std::fs::read(out.join("next.obj/spectrum.json")).unwrap();
    assert_eq!(serde_json::from_slice::<Spectrum>(&text).unwrap().eigenpairs.len(), 6);
    watched.until_idle();
    std::fs::remove_file(watched.mesh("next.obj")).unwrap();
    let said = watched.until(|happened| matches!(happened, Happened::Deleted { .. }));
    assert!(matches!(said.last(), Some(Happened::Deleted { results_kept: false, .. })));
    assert!(!out.join("next.obj").exists());
}

#[test]
fn a_copy_that_stays_is_no_rename_and_a_recipe_goes_along_with_one() {
    let watched = Watched::start(Workspace::new(FEM), &[]);
    watched.save("copy.obj", &icosphere(2));
    watched.until_idle();
    let recipe = |name: &str| watched.workspace.path("out").join(name).join("recipe.toml");
    std::fs::write(recipe("sphere.obj"), "# found").unwrap();
    // One of two with the same content goes, while the other is saved again.
    std::fs::remove_file(watched.mesh("copy.obj")).unwrap();
    watched.save("sphere.obj", &icosphere(2));
    let said = watched.until_idle();
    let deleted = Happened::Deleted { path: "copy.obj".into(), results_kept: true };
    assert!(said.contains(&deleted), "{said:#?}");
    assert!(watched.workspace.path("out/copy.obj/spectrum.json").exists());
    std::fs::rename(watched.mesh("sphere.obj"), watched.mesh("ball.obj")).unwrap();
    watched.until(|happened| matches!(happened, Happened::Moved { .. }));
    watched.until_idle();
    assert!(recipe("ball.obj").exists() && !recipe("sphere.obj").exists());
}

#[test]
fn the_bin_of_a_gltf_belongs_to_it_and_links_and_ignored_files_are_what_they_are() {
    let workspace = Workspace::new(FEM);
    workspace.write("meshes/.chladniignore", "*_lod?.obj\n");
    let watched = Watched::start(workspace, &[]);
    // Its buffer comes later.
    let (document, bytes) = gltf(&ellipsoid(1.7));
    std::fs::write(watched.mesh("egg.gltf"), document).unwrap();
    let said = watched.until(|happened| matches!(happened, Happened::Failed { .. }));
    assert!(matches!(said.last(), Some(Happened::Failed { again: true, .. })), "{said:?}");
    std::fs::write(watched.mesh("egg.bin"), bytes).unwrap();
    let said = watched.until(|happened| matches!(happened, Happened::Done { .. }));
    assert_eq!(names_of_done(&said), ["egg.gltf"]);
    watched.until_idle();
    // It alone changes.
    std::fs::write(watched.mesh("egg.bin"), gltf(&ellipsoid(1.9)).1).unwrap();
    assert_eq!(names_of_done(&watched.until_idle()), ["egg.gltf"]);
    watched.save("cow_lod1.obj", &ellipsoid(2.0));
    watched.is_silent(600);
    #[cfg(unix)]
    {
        let elsewhere = watched.workspace.path("elsewhere.obj");
        std::fs::write(&elsewhere, obj(&ellipsoid(2.1))).unwrap();
        std::os::unix::fs::symlink(&elsewhere, watched.mesh("linked.obj")).unwrap();
        assert_eq!(names_of_done(&watched.until_idle()), ["linked.obj"]);
        watched.is_current("linked.obj", &ellipsoid(2.1));
    }
}

/// A glTF document with its positions and triangles in a file beside it.
fn gltf(mesh: &TriMesh) -> (String, Vec<u8>) {
    let mut bytes: Vec<u8> =
        mesh.vertices().iter().flatten().flat_map(|&x| (x as f32).to_le_bytes()).collect();
    let positions = bytes.len();
    bytes.extend(mesh.faces().iter().flatten().flat_map(|i| i.to_le_bytes()));
    let (n, corners) = (mesh.n(), 3 * mesh.faces().len());
    let document = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}}],
        "buffers":[{{"uri":"egg.bin","byteLength":{}}}],
        "bufferViews":[{{"buffer":0,"byteLength":{positions}}},{{"buffer":0,"byteOffset":{positions},"byteLength":{}}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":{n},"type":"VEC3"}},
        {{"bufferView":1,"componentType":5125,"count":{corners},"type":"SCALAR"}}]}}"#,
        bytes.len(),
        bytes.len() - positions
    );
    (document, bytes)
}

#[test]
fn objects_of_a_file_come_change_and_go() {
    let pipeline =
        FEM.to_owned() + "[ingest]\nobjects = \"split\"\n[publish]\non_delete = \"remove\"\n";
    let workspace = Workspace::new(&pipeline);
    workspace.write("meshes/scene.obj", &scene(&[("head", 1.3), ("body", 1.7)]));
    let watched = Watched::start(workspace, &[]);
    watched.is_current("scene.obj/head", &ellipsoid(1.3));
    watched.is_current("scene.obj/body", &ellipsoid(1.7));

    let save = |heights: &[(&str, f64)]| {
        watched.workspace.write("meshes/scene.obj", &scene(heights));
        watched.until_idle()
    };
    let said = save(&[("head", 1.3), ("tail", 2.1)]);
    let is_deleted = |said: &[Happened], name: &str| {
        said.iter().any(|it| matches!(it, Happened::Deleted { path, .. } if path == name))
    };
    assert!(is_deleted(&said, "scene.obj/body"), "{said:#?}");
    watched.is_current("scene.obj/tail", &ellipsoid(2.1));
    assert!(!watched.workspace.path("out/scene.obj/body").exists());
    // One object alone is all of its file.
    let said = save(&[("head", 1.3)]);
    assert!(is_deleted(&said, "scene.obj/tail"), "{said:#?}");
    watched.is_current("scene.obj", &ellipsoid(1.3));
    save(&[("head", 1.3), ("tail", 2.2)]);

    // As one mesh by another pipeline, and taken apart again.
    watched.workspace.write("pipeline.toml", &pipeline.replace("split", "merge"));
    watched.until(|it| matches!(it, Happened::Done { path, .. } if path == "scene.obj"));
    watched.until_idle();
    assert!(!watched.workspace.path("out/scene.obj/head").exists());
    watched.workspace.write("pipeline.toml", &pipeline);
    watched.until(|it| matches!(it, Happened::Done { path, .. } if path == "scene.obj/tail"));
    watched.until_idle();
    std::fs::remove_file(watched.mesh("scene.obj")).unwrap();
    let said = watched.until_idle();
    assert!(is_deleted(&said, "scene.obj/head") && is_deleted(&said, "scene.obj/tail"));
    assert!(!watched.workspace.path("out/scene.obj").exists());
}

#[test]
fn an_object_that_fails_is_tried_again_alone_and_a_bad_moment_deletes_nothing() {
    let pipeline =
        FEM.to_owned() + "[ingest]\nobjects = \"split\"\n[publish]\non_delete = \"remove\"\n";
    let sound = scene(&[("head", 1.3), ("body", 1.7)]);
    let thin = "o thin\nv 0 0 0\nv 1 0 0\nv 2 0 0\nf -3 -2 -1\n";
    // Whichever of them the names put first.
    for name in ["a", "thin"] {
        let text = sound.clone() + &thin.replace("thin", name);
        let workspace = Workspace::new(&pipeline);
        workspace.write("meshes/scene.obj", &text);
        let watched = Watched::start(workspace, &[]);
        std::thread::sleep(Duration::from_secs(2));
        let again: Vec<Happened> = watched.heard.try_iter().collect();
        assert!(names_of_done(&again).is_empty(), "{again:#?}");

        // Half a file, and then all of it.
        watched.workspace.write("meshes/scene.obj", "o head\nv 0 0\n");
        let said = watched
            .until(|it| matches!(it, Happened::Failed { path, .. } if path.ends_with("body")));
        let is_deleted = |it: &Happened| matches!(it, Happened::Deleted { .. });
        assert!(!said.iter().any(is_deleted), "{said:#?}");
        let results = |name: &str| watched.workspace.path("out/scene.obj").join(name);
        assert!(!results("body/spectrum.json").exists() && results("body/eigen.npz").exists());
        watched.workspace.write("meshes/scene.obj", &sound);
        watched.until(|it| matches!(it, Happened::Done { path, .. } if path.ends_with("body")));
        watched.until_idle();
        watched.is_current("scene.obj/head", &ellipsoid(1.3));
        watched.is_current("scene.obj/body", &ellipsoid(1.7));
    }
}
