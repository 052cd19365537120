//! `chladni predict`, `chladni model`, and `train.method = "predict"`: the real binary, its documents and its exit codes.

mod common;

use std::path::Path;
use std::process::Output;

use chladni::mesh::{TriMesh, sample::icosphere};
use common::{QUICK, Workspace, chladni, obj, text};
use serde_json::Value;

/// A workspace whose sphere is trained: its model is the only one of the cache.
fn trained() -> Workspace {
    let workspace = Workspace::new(QUICK);
    let (code, report) = workspace.report(&[]);
    assert_eq!(code, 0, "{report:?}");
    workspace
}

fn on(workspace: &Workspace, command: &[&str], arguments: &[&str]) -> Output {
    let cache = workspace.path("cache");
    chladni(&[command, arguments, &["--cache", cache.to_str().unwrap()]].concat())
}

fn predict(workspace: &Workspace, mesh: &str, arguments: &[&str]) -> Output {
    on(workspace, &["predict", workspace.path(mesh).to_str().unwrap()], arguments)
}

fn document(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", text(output)))
}

fn predicted(workspace: &Workspace, mesh: &str, arguments: &[&str]) -> Value {
    let output = predict(workspace, mesh, &[arguments, &["--format", "json"]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    document(&output)
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

fn numbers(values: &Value) -> Vec<f64> {
    values.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

fn moved(mesh: &TriMesh, by: impl Fn([f64; 3]) -> [f64; 3]) -> TriMesh {
    let vertices = mesh.vertices().iter().map(|&p| by(p)).collect();
    TriMesh::new(vertices, mesh.faces().to_vec()).unwrap()
}

/// Two spheres of different size, side by side.
fn spheres() -> TriMesh {
    let (large, small) = (icosphere(2), icosphere(1));
    let n = large.n() as u32;
    let aside = small.vertices().iter().map(|&[x, y, z]| [0.5 * x + 3.0, 0.5 * y, 0.5 * z]);
    let vertices = large.vertices().iter().copied().chain(aside).collect();
    let faces = small.faces().iter().map(|face| face.map(|i| i + n));
    TriMesh::new(vertices, large.faces().iter().copied().chain(faces).collect()).unwrap()
}

#[test]
fn a_model_predicts_what_the_run_that_trained_it_predicted() {
    let workspace = trained();
    let out = workspace.path("predicted");
    let written = ["--model", "sphere", "--out", out.to_str().unwrap()];
    let verified = [&written[..], &["--verify"]].concat();
    let code = predict(&workspace, "meshes/sphere.obj", &verified).status.code();
    assert!(matches!(code, Some(0 | 4)), "{code:?}");
    // The same functions, sorted and measured by the same certificate.
    let arrays = |folder: &str| std::fs::read(workspace.path(folder).join("eigen.npz")).unwrap();
    assert!(arrays("predicted/sphere.obj") == arrays("out/sphere.obj"));

    let found = predicted(&workspace, "meshes/sphere.obj", &written);
    let mut lambdas = numbers(&found["eigenvalues"]);
    lambdas.sort_by(f64::total_cmp);
    let run = json(&workspace.path("out/sphere.obj/spectrum.json"));
    for (found, pair) in lambdas.iter().zip(run["eigenpairs"].as_array().unwrap()) {
        let expected = pair["lambda"].as_f64().unwrap();
        assert!((found - expected).abs() < 1e-11, "{found} {expected}");
    }
    assert!(found["certificate"]["orthonormality"].as_f64().unwrap() < 1e-12);
    let record = json(&out.join("sphere.obj/run.json"));
    let stages: Vec<&str> =
        record["stages"].as_array().unwrap().iter().map(|s| s["stage"].as_str().unwrap()).collect();
    assert_eq!(stages, ["ingest", "predict", "publish"], "nothing is assembled");
}

#[test]
fn the_document_has_what_the_contract_promises_and_says_that_nothing_was_checked() {
    let workspace = trained();
    workspace.write("finer.obj", &obj(&icosphere(3)));
    let found = predicted(&workspace, "finer.obj", &["--model", "sphere", "-k", "3"]);
    assert_eq!(
        (&found["schema"], &found["status"]),
        (&"chladni-predict-1".into(), &"unverified".into())
    );
    assert_eq!(found["mesh"]["vertices"], 642);
    assert_eq!(found["model"]["k"], 4);
    assert!(found["certificate"]["completeness"].is_null() && found["quality"].is_null());
    let pairs = found["certificate"]["eigenpairs"].as_array().unwrap();
    let sources: Vec<&str> = pairs.iter().map(|pair| pair["source"].as_str().unwrap()).collect();
    assert_eq!(sources, ["constant", "predicted", "predicted"]);
    assert!(pairs.iter().all(|pair| pair["rho"].is_null() && pair.get("lambda_refined").is_none()));
    assert!((numbers(&found["eigenvalues"])[1] / 2.0 - 1.0).abs() < 0.2);
    assert_eq!(found["warnings"].as_array().unwrap().len(), 0);

    let table = text(&predict(&workspace, "finer.obj", &["--model", "sphere"]));
    for word in ["λ · area", "predicted", "unverified", "--verify", "trained for sphere.obj"] {
        assert!(table.contains(word), "{word} is not in\n{table}");
    }
}

#[test]
fn export_import_and_predict_give_the_same_bytes() {
    let workspace = trained();
    let file = workspace.path("ball.safetensors");
    let file = file.to_str().unwrap();
    let exported = on(&workspace, &["model", "export", "sphere", file], &[]);
    assert_eq!(exported.status.code(), Some(0), "{}", text(&exported));
    let elsewhere = workspace.path("elsewhere");
    let elsewhere = elsewhere.to_str().unwrap();
    let there = |command: &[&str]| chladni(&[command, &["--cache", elsewhere]].concat());
    assert_eq!(there(&["model", "import", file]).status.code(), Some(0));
    let again = workspace.path("again.safetensors");
    let again = again.to_str().unwrap();
    assert_eq!(there(&["model", "export", "ball", again]).status.code(), Some(0));
    assert!(std::fs::read(file).unwrap() == std::fs::read(again).unwrap());

    let list = document(&there(&["model", "list", "--format", "json"]));
    let entry = &list["models"][0];
    assert_eq!(
        (&entry["name"], &entry["k"], &entry["whole"]),
        (&"ball".into(), &4.into(), &true.into())
    );
    assert_eq!(entry["mesh"]["vertices"], 162);
    assert!(text(&there(&["model", "list"])).contains("sphere.obj"));

    let written = |to: &str, model: &str, cache: &str| {
        let out = workspace.path(to);
        let mesh = workspace.path("meshes/sphere.obj");
        let [mesh, out] = [&mesh, &out].map(|path| path.to_str().unwrap());
        let arguments = ["predict", mesh, "--model", model, "--out", out, "--cache", cache];
        assert_eq!(chladni(&arguments).status.code(), Some(0));
        ["eigen.npz", "spectrum.json"]
            .map(|name| std::fs::read(workspace.path(to).join("sphere.obj").join(name)).unwrap())
    };
    let cache = workspace.path("cache");
    let by_name = written("a", "sphere", cache.to_str().unwrap());
    assert!(written("b", "ball", elsewhere) == by_name);
    assert!(written("c", file, "there/is/no/cache") == by_name);

    let taken = there(&["model", "import", file, "--name", "a b"]);
    assert_eq!(taken.status.code(), Some(2), "{}", text(&taken));
}

#[test]
fn a_model_that_reads_landmarks_reads_them_again_wherever_a_mesh_lies() {
    let pipeline = format!("{QUICK}[features]\ninput = \"landmarks\"\n");
    let workspace = Workspace::new(&pipeline);
    let egg = moved(&icosphere(2), |[x, y, z]| [x, 1.1 * y, 1.3 * z]);
    workspace.write("meshes/sphere.obj", &obj(&egg));
    let (code, report) = workspace.report(&[]);
    assert!([0, 4].contains(&code), "{report:?}");
    let mut expected: Vec<f64> =
        report.meshes[0].eigenpairs.iter().map(|report| report.pair.lambda).collect();
    let turned = moved(&egg, |[x, y, z]| [z + 7.0, x, y]);
    workspace.write("turned.obj", &obj(&turned));
    let found = predicted(&workspace, "turned.obj", &["--model", "sphere"]);
    assert_eq!(found["warnings"].as_array().unwrap().len(), 0);
    let mut found = numbers(&found["eigenvalues"]);
    found.sort_by(f64::total_cmp);
    expected.sort_by(f64::total_cmp);
    for (found, expected) in found.iter().zip(&expected) {
        assert!((found - expected).abs() < 1e-3 * expected.max(1.0), "{found} {expected}");
    }
}

#[test]
fn a_shared_trunk_is_one_model_and_predicts_the_same_from_a_file() {
    let workspace = Workspace::new(&QUICK.replace("[train]", "[train]\ntrunk = \"shared\""));
    let (code, report) = workspace.report(&[]);
    assert_eq!((code, report.meshes[0].trained), (0, 3), "{report:?}");
    let list = document(&on(&workspace, &["model", "list"], &["--format", "json"]));
    assert_eq!((&list["models"][0]["k"], &list["models"][1]), (&4.into(), &Value::Null));
    let file = workspace.path("ball.safetensors");
    let file = file.to_str().unwrap();
    assert_eq!(on(&workspace, &["model", "export", "sphere", file], &[]).status.code(), Some(0));
    // Weights of 24·3 + 24 + 2·2·24² numbers once, not three times.
    let weights = 4 * (24 * 3 + 24 + 4 * 24 * 24);
    assert!(std::fs::metadata(file).unwrap().len() < 2 * weights);
    let out = workspace.path("predicted");
    let written = ["--model", file, "--out", out.to_str().unwrap(), "--verify"];
    let code = predict(&workspace, "meshes/sphere.obj", &written).status.code();
    assert!(matches!(code, Some(0 | 4)), "{code:?}");
    let arrays = |folder: &str| std::fs::read(workspace.path(folder).join("eigen.npz")).unwrap();
    assert!(arrays("predicted/sphere.obj") == arrays("out/sphere.obj"));
    let fewer = predicted(&workspace, "meshes/sphere.obj", &["--model", file, "-k", "2"]);
    assert_eq!(numbers(&fewer["eigenvalues"]).len(), 2);
}

#[test]
fn a_larger_k_takes_the_place_of_a_smaller_and_another_recipe_has_another_name() {
    let workspace = Workspace::new(QUICK);
    let names = || -> Vec<(String, u64)> {
        let list = document(&on(&workspace, &["model", "list"], &["--format", "json"]));
        let entries = list["models"].as_array().unwrap().clone();
        let name = |e: &Value| (e["name"].as_str().unwrap().to_string(), e["k"].as_u64().unwrap());
        entries.iter().map(name).collect()
    };
    for (k, expected) in [("3", 3), ("4", 4), ("2", 4)] {
        workspace.report(&["--set", &format!("train.k={k}")]);
        assert_eq!(names().iter().map(|(_, k)| *k).collect::<Vec<_>>(), [expected]);
    }
    assert!(names()[0].0.starts_with("sphere-"));
    workspace.report(&["--set", "train.seed=5", "--set", "train.k=2"]);
    assert_eq!(names().len(), 2);
    let ambiguous = predict(&workspace, "meshes/sphere.obj", &["--model", "sphere"]);
    assert_eq!(ambiguous.status.code(), Some(2));
    assert!(text(&ambiguous).contains("give more of the name"), "{}", text(&ambiguous));
}

#[test]
fn refined_pairs_stand_beside_the_predicted() {
    let workspace = trained();
    let egg = moved(&icosphere(3), |[x, y, z]| [x, 1.02 * y, 1.05 * z]);
    workspace.write("egg.obj", &obj(&egg));
    let path = workspace.path("egg.obj");
    let solved = chladni(&["solve", path.to_str().unwrap(), "-k", "4", "--format", "json"]);
    let solved = numbers(&document(&solved)["eigenvalues"]);
    let of = |refine: &str, more: &[&str]| {
        predicted(
            &workspace,
            "egg.obj",
            &[&["--model", "sphere", "--refine", refine], more].concat(),
        )
    };
    let plain = numbers(&of("none", &[])["eigenvalues"]);
    let ritz = of("rayleigh-ritz", &[]);
    let full = of("full", &["--verify"]);
    for (document, method) in [(&ritz, "rayleigh-ritz"), (&full, "full")] {
        assert_eq!(document["refinement"]["method"], method);
        let pairs = document["certificate"]["eigenpairs"].as_array().unwrap();
        assert_eq!(
            (&pairs[0]["source"], &pairs[1]["source"]),
            (&"constant".into(), &"refined".into())
        );
        for (j, pair) in pairs.iter().enumerate() {
            assert_eq!(pair["lambda_refined"], document["eigenvalues"][j]);
        }
    }
    // λ stays that of the prediction.
    let before: Vec<f64> = ritz["certificate"]["eigenpairs"]
        .as_array()
        .unwrap()
        .iter()
        .map(|pair| pair["lambda"].as_f64().unwrap())
        .collect();
    assert_eq!(before, plain);
    let sum = |values: &[f64]| values.iter().sum::<f64>();
    let ritz = numbers(&ritz["eigenvalues"]);
    assert!(sum(&solved) <= sum(&ritz) && sum(&ritz) <= sum(&plain) * (1.0 + 1e-12));
    for (found, expected) in numbers(&full["eigenvalues"]).iter().zip(&solved) {
        assert!((found - expected).abs() <= 1e-9 * expected.max(1.0), "{found} {expected}");
    }
    assert_eq!(
        (&full["status"], &full["certificate"]["completeness"]["complete"]),
        (&"verified".into(), &true.into())
    );
    assert!(full["certificate"]["eigenpairs"][1]["residual"].as_f64().unwrap() < 1e-6);
}

#[test]
fn a_prediction_that_fails_its_certificate_is_exit_4_and_another_shape_is_warned_of() {
    let workspace = trained();
    let cigar = moved(&icosphere(2), |[x, y, z]| [x, y, 4.0 * z]);
    workspace.write("cigar.obj", &obj(&cigar));
    let output =
        predict(&workspace, "cigar.obj", &["--model", "sphere", "--verify", "--format", "json"]);
    assert_eq!(output.status.code(), Some(4), "{}", text(&output));
    let found = document(&output);
    assert_eq!(found["status"], "unverified");
    assert!(found["reason"].as_str().unwrap().contains("reference"));
    assert!(found["warnings"][0].as_str().unwrap().contains("does not lie where"));
    let table = text(&predict(&workspace, "cigar.obj", &["--model", "sphere"]));
    assert!(table.contains("warning: the surface"), "{table}");
}

#[test]
fn what_cannot_be_predicted_is_exit_2_and_what_cannot_be_read_exit_3() {
    let workspace = trained();
    workspace.write("two.obj", &obj(&spheres()));
    let file = workspace.path("sphere.safetensors");
    let file = file.to_str().unwrap();
    on(&workspace, &["model", "export", "sphere", file], &[]);
    let bytes = std::fs::read(file).unwrap();
    let cut = workspace.path("cut.safetensors");
    std::fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    let refused = |mesh: &str, arguments: &[&str], code: i32, message: &str| {
        let output = predict(&workspace, mesh, arguments);
        assert_eq!(output.status.code(), Some(code), "{}", text(&output));
        assert!(text(&output).contains(message), "{message} is not in {}", text(&output));
        assert!(output.stdout.is_empty());
    };
    let sphere = "meshes/sphere.obj";
    refused(sphere, &["--model", "cow"], 2, "it has sphere-");
    refused(sphere, &["--model", "sphere", "-k", "9"], 2, "the model has 4 eigenpairs");
    refused("two.obj", &["--model", "sphere"], 2, "2 components");
    refused(sphere, &["--model", cut.to_str().unwrap()], 2, "cut off or damaged");
    refused(sphere, &["--model", "nowhere.safetensors"], 2, "nowhere.safetensors");
    refused(sphere, &["--model", workspace.path(sphere).to_str().unwrap()], 2, "no safetensors");
    refused("nowhere.obj", &["--model", "sphere"], 3, "nowhere.obj");
    let nothing = chladni(&["model", "list", "--cache", workspace.path("x").to_str().unwrap()]);
    assert_eq!(nothing.status.code(), Some(2));
    assert!(!workspace.path("x").exists());
}

#[test]
fn a_folder_is_predicted_through_the_same_stages_and_store() {
    let workspace = trained();
    let file = workspace.path("ball.safetensors");
    on(&workspace, &["model", "export", "sphere", file.to_str().unwrap()], &[]);
    workspace.write("meshes/finer.obj", &obj(&icosphere(3)));
    let model = format!("train.model={}", file.display());
    let method = ["--set", "train.method=predict", "--set", &model, "--set", "train.refine=full"];
    let (code, report) = workspace.report(&method);
    assert!(matches!(code, 0 | 4) && report.meshes.len() == 2, "{report:?}");
    for mesh in &report.meshes {
        assert_eq!((mesh.trained, mesh.reused), (0, 0));
        let pair = &mesh.eigenpairs[1].pair;
        assert_eq!(pair.source, chladni::publish::result::Source::Refined);
        assert!((pair.lambda_refined.unwrap() / pair.lambda_fem - 1.0).abs() < 1e-8);
    }
    let before = workspace.events().len();
    workspace.report(&method);
    let events = workspace.events().split_off(before);
    assert!(events.iter().all(|event| event.how == chladni::flow::events::How::Reused));
    assert!(events.iter().any(|event| event.stage == "refine"));

    let refused = |set: &[&str], message: &str| {
        let output = workspace.run(set).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{}", text(&output));
        assert!(text(&output).contains(message), "{}", text(&output));
    };
    refused(&["--set", "train.method=predict"], "needs a model");
    refused(&["--set", &model], "is for train.method");
    refused(&[&method[..4], &["--set", "train.k=9"]].concat(), "the model has 4 eigenpairs");
    refused(&["--set", "train.method=fem", "--set", "train.refine=full"], "learned");
}

#[test]
fn a_model_of_two_components_predicts_after_both_constants() {
    let workspace = Workspace::new(QUICK);
    std::fs::remove_file(workspace.path("meshes/sphere.obj")).unwrap();
    workspace.write("meshes/two.obj", &obj(&spheres()));
    let (_, report) = workspace.report(&["--set", "verify.angle_tolerance=3"]);
    assert_eq!(report.meshes[0].trained, 2, "{report:?}");
    let found = predicted(&workspace, "meshes/two.obj", &["--model", "two"]);
    let pairs = found["certificate"]["eigenpairs"].as_array().unwrap();
    let sources: Vec<&str> = pairs.iter().map(|pair| pair["source"].as_str().unwrap()).collect();
    assert_eq!(sources, ["constant", "constant", "predicted", "predicted"]);
    let first = predicted(&workspace, "meshes/two.obj", &["--model", "two", "-k", "1"]);
    assert_eq!(numbers(&first["eigenvalues"]), [0.0]);
}
