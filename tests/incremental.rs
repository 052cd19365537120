//! What a run computes and what it takes from the cache, judged by the event log.

mod common;

use std::collections::BTreeSet;

use chladni::flow::events::{Event, How};
use chladni::mesh::sample::Shape;
use chladni::publish::report::RunRecord;
use common::{FEM, QUICK, Workspace, chladni, ellipsoid, obj, text};

fn computed(events: &[Event]) -> Vec<(&str, Option<usize>)> {
    let computed = events.iter().filter(|event| event.how == How::Computed);
    computed.map(|event| (event.stage.as_str(), event.part)).collect()
}

/// The events of the run that `report` makes.
fn during(workspace: &Workspace, arguments: &[&str]) -> (Vec<Event>, [usize; 2]) {
    let before = workspace.events().len();
    let (code, report) = workspace.report(arguments);
    assert_eq!(code, 0, "{report:?}");
    (workspace.events().split_off(before), [report.meshes[0].trained, report.meshes[0].reused])
}

#[test]
fn a_second_run_computes_nothing_and_writes_the_same_bytes() {
    let workspace = Workspace::new(QUICK);
    let (first, counts) = during(&workspace, &[]);
    assert_eq!(counts, [3, 0]);
    let train: Vec<_> =
        computed(&first).into_iter().filter(|(stage, _)| *stage == "train").collect();
    assert_eq!(train, [("train", Some(2)), ("train", Some(3)), ("train", Some(4))]);
    let read = |name: &str| std::fs::read(workspace.path("out/sphere.obj").join(name)).unwrap();
    let before = ["spectrum.json", "eigen.npz", "eigen.ply"].map(read);
    let (second, counts) = during(&workspace, &[]);
    assert_eq!(counts, [0, 3]);
    assert_eq!(computed(&second), []);
    assert_eq!(second.len(), first.len());
    assert!(["spectrum.json", "eigen.npz", "eigen.ply"].map(read) == before);
}

#[test]
fn more_eigenpairs_train_only_the_new_ones_and_fewer_none() {
    let workspace = Workspace::new(QUICK);
    during(&workspace, &["--set", "train.k=2"]);
    let (events, counts) = during(&workspace, &[]);
    assert_eq!(counts, [2, 1]);
    let train: Vec<_> =
        computed(&events).into_iter().filter(|(stage, _)| *stage == "train").collect();
    assert_eq!(train, [("train", Some(3)), ("train", Some(4))]);
    let (events, counts) = during(&workspace, &["--set", "train.k=3"]);
    assert_eq!(counts, [0, 2]);
    assert!(computed(&events).iter().all(|(stage, _)| *stage != "train"));
}

#[test]
fn heads_on_finer_samplings_are_a_chain_as_well() {
    let finer = QUICK.replace("[train]", "[train]\nhead_subdivisions = 1");
    let workspace = Workspace::new(&finer);
    during(&workspace, &["--set", "train.k=2"]);
    assert_eq!(during(&workspace, &[]).1, [2, 1]);
    let results =
        |workspace: &Workspace| std::fs::read(workspace.path("out/sphere.obj/eigen.npz")).unwrap();
    let (grown, at_once, coarse) =
        (results(&workspace), Workspace::new(&finer), Workspace::new(QUICK));
    for workspace in [&at_once, &coarse] {
        during(workspace, &[]);
    }
    assert!(grown == results(&at_once));
    assert!(grown != results(&coarse));
}

#[test]
fn a_changed_recipe_retrains_all_and_a_changed_tolerance_nothing() {
    let workspace = Workspace::new(QUICK);
    during(&workspace, &[]);
    for change in ["train.learning_rate=1e-3", "train.seed=9", "family.seed=9"] {
        let (_, counts) = during(&workspace, &["--set", change]);
        assert_eq!(counts, [3, 0], "{change}");
    }
    let (events, counts) = during(&workspace, &["--set", "verify.lambda_tolerance=0.3"]);
    assert_eq!(counts, [0, 3]);
    assert_eq!(computed(&events), []);
}

#[test]
fn a_shared_trunk_is_trained_once_for_all_its_heads_and_anew_for_another_k() {
    let workspace = Workspace::new(&QUICK.replace("[train]", "[train]\ntrunk = \"shared\""));
    let trainings = |events: &[Event]| {
        let trained = computed(events).into_iter().filter(|(stage, _)| *stage == "train");
        trained.map(|(_, part)| part).collect::<Vec<_>>()
    };
    let (events, counts) = during(&workspace, &[]);
    assert_eq!((trainings(&events), counts), (vec![None], [3, 0]));
    let (events, counts) = during(&workspace, &[]);
    assert_eq!((computed(&events), counts), (vec![], [0, 3]));
    let record = std::fs::read_to_string(workspace.path("out/sphere.obj/run.json")).unwrap();
    assert_eq!(record.matches("\"train φ2…φ4\"").count(), 1, "{record}");
    let (events, counts) = during(&workspace, &["--set", "train.k=3"]);
    assert_eq!((trainings(&events), counts), (vec![None], [2, 0]));
    let own = ["--set", "train.trunk=per-eigenfunction"];
    let (events, counts) = during(&workspace, &own);
    assert_eq!((trainings(&events), counts), (vec![Some(2), Some(3), Some(4)], [3, 0]));
}

#[test]
fn a_recipe_is_searched_for_once_and_a_larger_k_keeps_it() {
    let workspace = Workspace::new(&QUICK.replace("[train]", "[train]\ntune = 3"));
    let stages = |events: &[Event]| -> Vec<(String, Option<usize>)> {
        let found =
            computed(events).into_iter().filter(|(stage, _)| ["tune", "train"].contains(stage));
        found.map(|(stage, part)| (stage.to_string(), part)).collect()
    };
    let train = |k| ("train".to_string(), Some(k));
    let tune = ("tune".to_string(), None);
    let (events, counts) = during(&workspace, &["--set", "train.k=3"]);
    assert_eq!((stages(&events), counts), (vec![tune.clone(), train(2), train(3)], [2, 0]));
    let (events, counts) = during(&workspace, &["--set", "train.k=3"]);
    assert_eq!((computed(&events), counts), (vec![], [0, 2]));
    let (events, counts) = during(&workspace, &[]);
    assert_eq!((stages(&events), counts), (vec![train(4)], [1, 2]));
    // What is chosen may be the same.
    let (events, _) = during(&workspace, &["--set", "train.tune=4"]);
    assert_eq!(stages(&events).first(), Some(&tune));
    let record = std::fs::read(workspace.path("out/sphere.obj/run.json")).unwrap();
    let record: RunRecord = serde_json::from_slice(&record).unwrap();
    assert_eq!(record.stages.iter().filter(|s| s.stage == "tune").count(), 1, "{record:?}");
    let (events, _) = during(&workspace, &["--set", "train.tune=0"]);
    assert!(events.iter().all(|event| event.stage != "tune"));
}

#[test]
fn a_shared_trunk_is_tuned_for_its_k() {
    let workspace =
        Workspace::new(&QUICK.replace("[train]", "[train]\ntrunk = \"shared\"\ntune = 2"));
    let tuned = |events: &[Event]| computed(events).contains(&("tune", None));
    assert!(tuned(&during(&workspace, &[]).0));
    assert!(!tuned(&during(&workspace, &[]).0));
    assert!(tuned(&during(&workspace, &["--set", "train.k=3"]).0));
}

#[test]
fn a_recipe_that_was_found_is_a_file_that_trains_the_same() {
    // What the pipeline file sets itself would win over the recipe.
    let pipeline = QUICK.replace("batch = 2\n", "").replace("[train]", "[train]\ntune = 4");
    let workspace = Workspace::new(&pipeline);
    let read = |name: &str| std::fs::read_to_string(workspace.path(name)).unwrap();
    let (_, counts) = during(&workspace, &[]);
    assert_eq!(counts, [3, 0]);
    let recipe = read("out/sphere.obj/recipe.toml");
    let table: toml::Table = recipe.parse().unwrap();
    let spectrum = read("out/sphere.obj/spectrum.json");
    let document: serde_json::Value = serde_json::from_str(&spectrum).unwrap();
    let used = &document["provenance"]["parameters"]["train"];
    for (key, value) in table["train"].as_table().unwrap() {
        let value = value.as_float().unwrap_or_else(|| value.as_integer().unwrap() as f64);
        assert_eq!(used[key].as_f64(), Some(value), "{key}");
    }
    let as_file = ["--set", "train.tune=0", "--set", "train.recipe=out/sphere.obj/recipe.toml"];
    let (events, counts) = during(&workspace, &as_file);
    assert_eq!((computed(&events), counts), (vec![], [0, 3]));
    assert_eq!(read("out/sphere.obj/recipe.toml"), recipe);
    // The same, but for what is said of the search.
    assert_eq!(
        read("out/sphere.obj/spectrum.json"),
        spectrum.replace("\"tune\": 4", "\"tune\": 0")
    );
}

#[test]
fn a_mesh_without_variants_keeps_its_recipe() {
    let workspace = Workspace::new(&QUICK.replace("[train]", "[train]\ntune = 4\nheld_out = 1"));
    let alone = ["--set", "family.vertices=2000"];
    let output = workspace.run(&alone).output().unwrap();
    let said = common::text(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(
        said.contains("no recipe is searched for") && said.contains("train.held_out = 1"),
        "{said}"
    );
    assert!(workspace.events().iter().all(|event| event.stage != "tune"));
    assert!(!workspace.path("out/sphere.obj/recipe.toml").exists());
}

#[test]
fn what_is_held_out_is_part_of_the_training() {
    let workspace = Workspace::new(&QUICK.replace("members = 2", "members = 3"));
    during(&workspace, &[]);
    let held = ["--set", "train.held_out=1"];
    let (_, counts) = during(&workspace, &held);
    assert_eq!(counts, [3, 0]);
    let (events, counts) = during(&workspace, &held);
    assert_eq!((computed(&events), counts), (vec![], [0, 3]));
}

#[test]
fn a_trunk_that_is_too_narrow_for_its_heads_says_so() {
    let workspace = Workspace::new(QUICK);
    let narrow = ["--set", "train.trunk=shared", "--set", "train.width=2"];
    let (code, report) = workspace.report(&narrow);
    let reason = report.meshes[0].reason.as_deref().unwrap();
    assert_eq!(code, 3);
    assert!(reason.contains("the heads of 3 eigenfunctions; raise train.width"), "{reason}");
}

/// The events of a run that may judge its few steps of training too bad.
fn events_with(workspace: &Workspace, change: &str) -> (Vec<Event>, [usize; 2]) {
    let before = workspace.events().len();
    let (code, report) = workspace.report(&["--set", change]);
    assert!([0, 4].contains(&code), "{change}: {report:?}");
    (workspace.events().split_off(before), [report.meshes[0].trained, report.meshes[0].reused])
}

#[test]
fn another_network_or_another_input_trains_anew_on_the_same_family() {
    let workspace = Workspace::new(QUICK);
    during(&workspace, &[]);
    for change in [
        "train.layer=gcn",
        "train.layer=gat",
        "train.activation=tanh",
        "train.activation=relu",
        "train.initial_weights=positive",
        "features.input=landmarks",
    ] {
        let (events, counts) = events_with(&workspace, change);
        assert_eq!(counts, [3, 0], "{change}");
        let family = events.iter().filter(|event| event.stage == "remesh");
        assert!(family.into_iter().all(|event| event.how == How::Reused), "{change}");
        let (events, counts) = events_with(&workspace, change);
        assert_eq!((computed(&events), counts), (vec![], [0, 3]), "{change}");
    }
}

#[test]
fn another_family_is_made_and_trained_on() {
    let workspace = Workspace::new(QUICK);
    during(&workspace, &[]);
    for change in [
        "family.operations=[\"subdivide\", \"simplify\", \"perturb\", \"flip\"]",
        "family.vertices=[80, 100]",
    ] {
        let (events, counts) = events_with(&workspace, change);
        assert_eq!(counts, [3, 0], "{change}");
        assert!(computed(&events).contains(&("remesh", None)), "{change}");
    }
}

#[test]
fn one_training_on_samplings_of_a_formula_serves_every_mesh() {
    let of_the_sphere = QUICK.replace("[family]", "[family]\nof = \"sphere\"");
    let workspace = Workspace::new(&of_the_sphere);
    workspace.write("meshes/other.obj", &obj(&Shape::Sphere.sample(300, 1, 0).unwrap()));
    let (code, report) = workspace.report(&["--jobs", "1"]);
    assert_eq!(code, 0, "{report:?}");
    let counts: Vec<_> = report.meshes.iter().map(|mesh| (mesh.trained, mesh.reused)).collect();
    assert_eq!(counts, [(3, 0), (0, 3)]);
    // An edit costs no training either, and models are called after the surface.
    workspace.write("meshes/other.obj", &obj(&Shape::Sphere.sample(400, 1, 0).unwrap()));
    let (code, report) = workspace.report(&[]);
    assert_eq!(code, 0, "{report:?}");
    assert!(report.meshes.iter().all(|mesh| mesh.trained == 0 && mesh.grown_from.is_none()));
    let cache = workspace.path("cache");
    let listed = chladni(&["model", "list", "--cache", cache.to_str().unwrap()]);
    assert_eq!(text(&listed).matches("sphere-").count(), 1, "{}", text(&listed));
    // Another surface is refused.
    workspace.write("meshes/other.obj", &obj(&Shape::Torus.sample(200, 1, 0).unwrap()));
    let (code, report) = workspace.report(&[]);
    assert_eq!(code, 3);
    let reason = report.meshes[0].reason.clone().unwrap();
    assert!(reason.starts_with("the mesh is no sampling of a sphere"), "{reason}");
}

#[test]
fn another_file_with_the_same_numbers_shares_everything() {
    let workspace = Workspace::new(QUICK);
    during(&workspace, &[]);
    let sphere = std::fs::read_to_string(workspace.path("meshes/sphere.obj")).unwrap();
    std::fs::rename(workspace.path("meshes/sphere.obj"), workspace.path("meshes/ball.obj"))
        .unwrap();
    workspace.write("meshes/ball.obj", &format!("# a comment\nmtllib none.mtl\no ball\n{sphere}"));
    let (events, counts) = during(&workspace, &[]);
    assert_eq!(counts, [0, 3]);
    assert_eq!(computed(&events), []);
}

#[test]
fn another_format_other_materials_and_what_ingest_repairs_share_everything() {
    let workspace = Workspace::new(QUICK);
    during(&workspace, &[]);
    let sphere = std::fs::read_to_string(workspace.path("meshes/sphere.obj")).unwrap();
    let lines = |prefix| sphere.lines().filter_map(move |line| line.strip_prefix(prefix));
    let faces = lines("f ").map(|face| {
        let corners = face.split(' ').map(|corner| corner.parse::<usize>().unwrap() - 1);
        format!("3 {}\n", corners.map(|corner| corner.to_string()).collect::<Vec<_>>().join(" "))
    });
    let vertices = lines("v ").map(|vertex| format!("{vertex}\n"));
    let count = (lines("v ").count(), lines("f ").count());
    let off: String = vertices.chain(faces).collect();
    let with_materials = sphere.replacen("f ", "usemtl red\ns 1\nf ", 1);
    for (name, text) in [
        ("ball.off", format!("OFF\n{} {} 0\n{off}", count.0, count.1)),
        ("ball.obj", with_materials),
        // A vertex that no triangle has: the repaired mesh is what it was, and that is where the wave stops.
        ("ball.obj", format!("v 9 9 9\n{}", shifted(&sphere))),
    ] {
        std::fs::remove_dir_all(workspace.path("meshes")).unwrap();
        std::fs::create_dir(workspace.path("meshes")).unwrap();
        workspace.write(&format!("meshes/{name}"), &text);
        let (events, counts) = during(&workspace, &[]);
        assert_eq!((computed(&events), counts), (vec![], [0, 3]), "{name}");
    }
}

/// An OBJ file whose triangles count their vertices from one further.
fn shifted(obj: &str) -> String {
    let lines = obj.lines().map(|line| match line.strip_prefix("f ") {
        None => format!("{line}\n"),
        Some(face) => {
            let corners = face.split(' ').map(|corner| corner.parse::<usize>().unwrap() + 1);
            let corners: Vec<_> = corners.map(|corner| corner.to_string()).collect();
            format!("f {}\n", corners.join(" "))
        }
    });
    lines.collect()
}

#[test]
fn an_edit_to_one_mesh_of_many_computes_that_one_and_writes_no_other() {
    let workspace = Workspace::new(FEM);
    let name = |i: usize| format!("meshes/{i:02}.obj");
    for i in 0..12 {
        workspace.write(&name(i), &ellipsoid(1.1 + 0.1 * i as f64));
    }
    assert_eq!(workspace.report(&[]).0, 0);
    let files = |i: usize| {
        let folder = workspace.path("out").join(format!("{i:02}.obj"));
        ["spectrum.json", "eigen.npz"]
            .map(|file| std::fs::metadata(folder.join(file)).unwrap().modified().unwrap())
    };
    let (before, events) = ((0..12).map(files).collect::<Vec<_>>(), workspace.events().len());
    workspace.write(&name(7), &ellipsoid(3.0));
    assert_eq!(workspace.report(&[]).0, 0);
    let events = workspace.events().split_off(events);
    assert!(events.iter().all(|event| (event.item == 7) == (event.how == How::Computed)));
    for (i, before) in before.into_iter().enumerate() {
        assert_eq!(files(i) != before, i == 7, "mesh {i}");
    }
}

#[test]
fn two_files_with_the_same_mesh_are_computed_once() {
    let workspace = Workspace::new(QUICK);
    std::fs::copy(workspace.path("meshes/sphere.obj"), workspace.path("meshes/twin.obj")).unwrap();
    let (code, report) = workspace.report(&["--jobs", "2"]);
    assert_eq!(code, 0);
    assert_eq!(report.meshes.iter().map(|mesh| mesh.trained).sum::<usize>(), 3);
    let events = workspace.events();
    let keys: BTreeSet<_> = events.iter().map(|event| &event.key).collect();
    assert_eq!(computed(&events).len(), keys.len());
}

#[test]
fn an_edit_to_one_mesh_touches_that_mesh_only() {
    let workspace = Workspace::new(QUICK);
    workspace.write("meshes/other.obj", &ellipsoid(1.01));
    let (code, report) = workspace.report(&[]);
    assert_eq!((code, report.meshes.len()), (0, 2));
    let before = workspace.events().len();
    workspace.write("meshes/other.obj", &ellipsoid(1.02));
    // Otherwise the blocks of its previous version would do, see tests/lineage.rs.
    let (code, report) = workspace.report(&["--lineage", "off"]);
    assert_eq!(code, 0);
    let by_mesh: Vec<_> = report.meshes.iter().map(|m| (m.path.as_str(), m.trained)).collect();
    assert_eq!(by_mesh, [("other.obj", 3), ("sphere.obj", 0)]);
    let events = workspace.events().split_off(before);
    assert!(events.iter().all(|event| event.item == 0 || event.how == How::Reused));
}

#[test]
fn training_sees_the_family_and_earlier_blocks_and_nothing_of_a_reference() {
    let workspace = Workspace::new(&QUICK.replace("[train]", "[train]\ntune = 2"));
    let (events, _) = during(&workspace, &[]);
    let outputs = |stages: &[&str]| -> BTreeSet<String> {
        let made = events.iter().filter(|event| stages.contains(&event.stage.as_str()));
        made.map(|event| event.output.clone()).collect()
    };
    let references = outputs(&["reference", "certify", "predict"]);
    assert_eq!(references.len(), 3);
    let blocks = outputs(&["train"]);
    let family = outputs(&["remesh"]);
    let operators = outputs(&["assemble"]);
    let remeshed = events.iter().filter(|event| event.stage == "remesh");
    let meshes: BTreeSet<String> =
        remeshed.flat_map(|event| event.inputs.iter().map(|(_, digest)| digest.clone())).collect();
    let trains = |event: &&Event| ["tune", "train"].contains(&event.stage.as_str());
    assert_eq!(events.iter().filter(trains).count(), 4);
    for event in events.iter().filter(trains) {
        for (role, digest) in &event.inputs {
            assert!(!references.contains(digest), "{role}");
            match role.as_str() {
                "family" => assert!(family.contains(digest)),
                "operators" => assert!(operators.contains(digest)),
                // For the frame of its coordinates.
                "mesh" => assert!(meshes.contains(digest)),
                block => {
                    assert!(block.starts_with("block "), "{block}");
                    assert!(blocks.contains(digest));
                }
            }
        }
    }
    // And the first reference is computed after the last block.
    let stages: Vec<&str> = events.iter().map(|event| event.stage.as_str()).collect();
    let last_block = stages.iter().rposition(|stage| *stage == "train");
    assert!(last_block < stages.iter().position(|stage| *stage == "reference"));
}

#[test]
fn a_share_of_the_vertices_gives_every_mesh_its_own_number_and_the_same_blocks() {
    let workspace = Workspace::new(QUICK);
    let coarse = chladni::mesh::sample::icosphere(1);
    workspace.write("meshes/coarse.obj", &common::obj(&coarse));
    let (_, number) = workspace.report(&["--set", "train.k=4"]);
    assert_eq!(number.meshes[1].path, "sphere.obj");
    let (_, share) = workspace.report(&["--set", "train.k=2.4%"]);
    let counts: Vec<_> = share.meshes.iter().map(|mesh| mesh.eigenpairs.len()).collect();
    assert_eq!(counts, [1, 4], "of 42 vertices, and of 162");
    assert_eq!((share.meshes[1].trained, share.meshes[1].reused), (0, 3));
    let results = |report: &chladni::publish::report::RunReport| -> Vec<f64> {
        report.meshes[1].eigenpairs.iter().map(|report| report.pair.lambda).collect()
    };
    assert_eq!(results(&share), results(&number));
}
