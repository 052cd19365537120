//! Learned eigenfunctions that vanish on the boundary: the square [0, π]², whose first eigenvalues are 2, 5 and 5.

mod common;

use std::f64::consts::PI;

use chladni::mesh::TriMesh;
use chladni::publish::report::Status;
use chladni::publish::result::Source;
use common::{Workspace, chladni, obj, text};
use serde_json::Value;

const PIPELINE: &str = "
[input]
paths = [\"meshes\"]
[family]
members = 4
operations = [\"perturb\", \"flip\"]
[operators]
boundary = \"dirichlet\"
[train]
k = 3
width = 48
layers = 2
steps = 40
[verify]
lambda_tolerance = 0.05
angle_tolerance = 0.2
";

/// The square in `cells`² squares, each cut along one diagonal or, where `other`, along both kinds in turn.
fn square(cells: u32, other: bool) -> TriMesh {
    let place = |i: u32| PI * f64::from(i) / f64::from(cells);
    let side = cells + 1;
    let vertices = (0..side * side).map(|at| [place(at % side), place(at / side), 0.0]);
    let faces = (0..cells * cells).flat_map(|cell| {
        let a = cell / cells * side + cell % cells;
        let (b, c, d) = (a + 1, a + side + 1, a + side);
        let turned = other && (cell / cells + cell % cells) % 2 == 1;
        if turned { [[a, b, d], [b, c, d]] } else { [[a, b, c], [a, c, d]] }
    });
    TriMesh::new(vertices.collect(), faces.collect()).unwrap()
}

fn near(found: &[f64], tolerance: f64) -> bool {
    let pairs = found.iter().zip([2.0, 5.0, 5.0]);
    found.len() == 3 && pairs.clone().all(|(found, exact)| (found / exact - 1.0).abs() < tolerance)
}

fn eigenvalues(document: &Value) -> Vec<f64> {
    let values = document["eigenvalues"].as_array().unwrap();
    values.iter().map(|value| value.as_f64().unwrap()).collect()
}

#[test]
fn the_held_square_is_learned_predicted_elsewhere_and_survives_export() {
    let workspace = Workspace::new(PIPELINE);
    workspace.write("meshes/square.obj", &obj(&square(16, false)));
    for trunk in ["shared", "per-eigenfunction"] {
        let (code, report) = workspace.report(&["--set", &format!("train.trunk={trunk}")]);
        // The sphere has nothing to hold to zero.
        let [sphere, square] = &report.meshes[..] else { panic!("{report:?}") };
        assert_eq!((code, sphere.status), (3, Status::Failed));
        assert!(sphere.reason.as_deref().unwrap().contains("the mesh has no boundary"));
        assert_eq!((square.status, square.trained), (Status::Verified, 3), "{square:?}");
        let pairs = square.eigenpairs.iter().map(|report| &report.pair);
        assert!(pairs.clone().all(|pair| pair.source == Source::Trained));
        let found: Vec<f64> = pairs.map(|pair| pair.lambda).collect();
        assert!(near(&found, 0.03), "{trunk}: {found:?}");
    }

    workspace.write("finer.obj", &obj(&square(25, true)));
    let on = |cache: &str, command: &[&str]| {
        chladni(&[command, &["--cache", workspace.path(cache).to_str().unwrap()]].concat())
    };
    let file = workspace.path("held.safetensors");
    let file = file.to_str().unwrap();
    let list = on("cache", &["model", "list", "--format", "json"]);
    let list: Value = serde_json::from_slice(&list.stdout).unwrap();
    let first = list["models"][0]["name"].as_str().unwrap();
    assert_eq!(list["models"][0]["boundary"], "dirichlet");
    assert!(on("cache", &["model", "export", first, file]).status.success());
    assert!(on("elsewhere", &["model", "import", file]).status.success());
    let [finer, sphere] = ["finer.obj", "meshes/sphere.obj"].map(|name| workspace.path(name));
    let [finer, sphere] = [&finer, &sphere].map(|path| path.to_str().unwrap());
    let predicted = |cache: &str, model: &str, more: &[&str]| -> Vec<f64> {
        let command = ["predict", finer, "--model", model, "--format", "json"];
        let output = on(cache, &[&command, more].concat());
        let document = serde_json::from_slice(&output.stdout);
        let document: Value = document.unwrap_or_else(|_| panic!("{}", text(&output)));
        assert!(document["certificate"]["orthonormality"].as_f64().unwrap() < 1e-12);
        eigenvalues(&document)
    };
    let found = predicted("elsewhere", "held", &[]);
    assert!(near(&found, 0.05), "{found:?}");
    assert_eq!(predicted("cache", first, &[]), found);
    let refined = predicted("elsewhere", "held", &["--refine", "rayleigh-ritz"]);
    assert!(refined.iter().sum::<f64>() <= found.iter().sum::<f64>() * (1.0 + 1e-12));
    assert!(near(&predicted("elsewhere", "held", &["--refine", "full", "--verify"]), 0.01));

    let refused = on("elsewhere", &["predict", sphere, "--model", "held"]);
    assert_eq!(refused.status.code(), Some(2), "{}", text(&refused));
    assert!(text(&refused).contains("no boundary to hold to zero"), "{}", text(&refused));
    let model = format!("train.model={file}");
    let neumann = ["--set", "train.method=predict", "--set", &model];
    let other = workspace.run(&neumann).args(["--set", "operators.boundary=neumann"]).output();
    let other = other.unwrap();
    assert_eq!(other.status.code(), Some(2), "{}", text(&other));
    assert!(text(&other).contains("set operators.boundary = \"dirichlet\""), "{}", text(&other));
}

#[test]
fn the_penalty_on_the_boundary_is_searched_for_too() {
    let workspace = Workspace::new(PIPELINE);
    std::fs::remove_file(workspace.path("meshes/sphere.obj")).unwrap();
    workspace.write("meshes/square.obj", &obj(&square(16, false)));
    let tuned = ["train.tune=2", "train.held_out=1"].map(|set| ["--set", set]);
    let (code, report) = workspace.report(&tuned.concat());
    assert_eq!((code, report.meshes[0].trained), (0, 3), "{report:?}");
    let recipe = std::fs::read_to_string(workspace.path("out/square.obj/recipe.toml")).unwrap();
    assert!(recipe.contains("\nboundary_penalty = "), "{recipe}");
}

#[test]
fn a_formula_says_how_far_what_is_learned_and_both_references_are_from_it() {
    let workspace = Workspace::new(PIPELINE);
    workspace.write("meshes/square.obj", &obj(&square(16, false)));
    let (code, report) = workspace.report(&["--set", "verify.closed_form=square"]);
    assert_eq!(code, 3, "the sphere has no boundary");
    for (pair, exact) in report.meshes[1].eigenpairs.iter().zip([2.0, 5.0, 5.0]) {
        let formula = pair.pair.closed_form.clone().unwrap();
        assert_eq!(formula.lambda, exact);
        let (fem, mpgd) = (formula.fem.unwrap(), formula.mpgd.unwrap());
        // On a uniform grid FEM's eigenvectors are the sines themselves, but for the cut of the diagonals.
        assert!(fem.angle < 0.01 && (fem.mse - mpgd.mse).abs() < 1e-7, "{formula:?}");
        assert!(formula.own.angle < 0.2 && formula.own.mse < 0.2_f64.powi(2), "{formula:?}");
        assert!(formula.own.mse_euclidean < formula.own.mse, "{formula:?}");
    }
    let (_, report) = workspace.report(&["--set", "verify.closed_form=sphere"]);
    let reason = report.meshes[1].reason.as_deref().unwrap();
    assert!(reason.starts_with("vertex 0 does not lie on the unit sphere"), "{reason}");
}
