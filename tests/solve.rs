//! `chladni solve`, and `train.method` without training: the real binary, its documents and its exit codes.

mod common;

use std::process::Output;

use chladni::mesh::sample::icosphere;
use common::{QUICK, Workspace, chladni, obj, text};
use serde_json::Value;

/// A grid of `n` × `n` vertices on [0, π]².
fn square(n: usize) -> String {
    let step = std::f64::consts::PI / (n - 1) as f64;
    let mut file = String::from("OFF\n");
    let count = 2 * (n - 1) * (n - 1);
    file += &format!("{} {count} 0\n", n * n);
    for v in 0..n * n {
        file += &format!("{} {} 0\n", (v % n) as f64 * step, (v / n) as f64 * step);
    }
    for (i, j) in (0..n - 1).flat_map(|j| (0..n - 1).map(move |i| (i, j))) {
        let v = j * n + i;
        file += &format!("3 {v} {} {}\n3 {v} {} {}\n", v + 1, v + n + 1, v + n + 1, v + n);
    }
    file
}

fn solve(workspace: &Workspace, mesh: &str, arguments: &[&str]) -> Output {
    let path = workspace.path(mesh);
    chladni(&[&["solve", path.to_str().unwrap()], arguments].concat())
}

fn document(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", text(output)))
}

#[test]
fn the_document_has_what_the_contract_promises() {
    let workspace = Workspace::new(QUICK);
    let output = solve(&workspace, "meshes/sphere.obj", &["-k", "9", "--format", "json"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let solution = document(&output);
    assert!(solution["schema"].is_string() && solution["seconds"].is_number());
    for key in ["hash", "vertices", "faces", "components", "boundary_loops", "euler", "area"] {
        assert!(!solution["mesh"][key].is_null(), "{key}");
    }
    let completeness = &solution["certificate"]["completeness"];
    assert_eq!(completeness["count"], 9);
    assert_eq!(completeness["found"], 9);
    assert_eq!(
        (&completeness["complete"], &completeness["cut_cluster"]),
        (&true.into(), &false.into())
    );
    assert!(completeness["sigma"].as_f64().unwrap() > 6.0);
    let eigenvalues = solution["eigenvalues"].as_array().unwrap();
    assert_eq!(eigenvalues.len(), 9);
    assert!((eigenvalues[3].as_f64().unwrap() - 2.0).abs() < 0.05);
    assert!(solution["quality"]["min_angle_degrees"].as_f64().unwrap() > 30.0);
    assert_eq!(solution["quality"]["negative_weights"], 0);
}

#[test]
fn k_inside_a_cluster_is_complete_up_to_it() {
    let workspace = Workspace::new(QUICK);
    let output = solve(&workspace, "meshes/sphere.obj", &["-k", "7", "--format", "json"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let solution = document(&output);
    let completeness = &solution["certificate"]["completeness"];
    assert_eq!(
        (&completeness["cut_cluster"], &completeness["complete"]),
        (&true.into(), &true.into())
    );
    assert!(
        text(&solve(&workspace, "meshes/sphere.obj", &["-k", "7"]))
            .contains("k = 7 cuts a cluster and leaves 2 of it out")
    );
}

#[test]
fn both_solvers_and_every_laplacian_agree_with_theory_on_the_square() {
    let workspace = Workspace::new(QUICK);
    workspace.write("square.off", &square(21));
    let eigenvalues = |arguments: &[&str]| -> Vec<f64> {
        let output = solve(
            &workspace,
            "square.off",
            &[&["-k", "3", "--format", "json"], arguments].concat(),
        );
        assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", text(&output));
        let solution = document(&output);
        assert_eq!(solution["certificate"]["completeness"]["complete"], true);
        solution["eigenvalues"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
    };
    let near = |found: &[f64], expected: [f64; 3]| {
        found.iter().zip(expected).all(|(f, e)| (f - e).abs() < 0.05 * e.max(0.1))
    };
    for method in ["fem", "mpgd"] {
        for mass in ["lumped", "voronoi", "consistent"] {
            let common = ["--method", method, "--laplacian", "cotangent", "--mass", mass];
            let dirichlet = [&common[..], &["--boundary", "dirichlet"]].concat();
            assert!(near(&eigenvalues(&common), [0.0, 1.0, 1.0]), "{common:?}");
            assert!(near(&eigenvalues(&dirichlet), [2.0, 5.0, 5.0]), "{dirichlet:?}");
        }
    }
    assert!(near(&eigenvalues(&["--laplacian", "fem"]), [0.0, 1.0, 1.0]));
    assert!(near(&eigenvalues(&["--laplacian", "fem", "--robust"]), [0.0, 1.0, 1.0]));
    let graph = eigenvalues(&["--laplacian", "graph"]);
    assert!(graph[0].abs() < 1e-12 && graph[2] < 2.0);
}

#[test]
fn what_cannot_be_asked_is_exit_2_and_what_cannot_be_read_exit_3() {
    let workspace = Workspace::new(QUICK);
    let refused = |mesh: &str, arguments: &[&str], code: i32, message: &str| {
        let output = solve(&workspace, mesh, arguments);
        assert_eq!(output.status.code(), Some(code), "{}", text(&output));
        assert!(text(&output).contains(message), "{}", text(&output));
        assert!(output.stdout.is_empty());
    };
    refused("meshes/sphere.obj", &["--boundary", "dirichlet"], 2, "no boundary");
    refused("meshes/sphere.obj", &["-k", "1000"], 2, "ask for fewer");
    refused("meshes/sphere.obj", &["-k", "0"], 2, "0");
    refused("meshes/sphere.obj", &["--laplacian", "graph", "--mass", "lumped"], 2, "graph");
    refused("nowhere.obj", &[], 3, "nowhere.obj");
    workspace.write("flat.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    refused("flat.obj", &["-k", "1", "--boundary", "dirichlet"], 2, "boundary");
}

#[test]
fn out_has_the_arrays_and_the_documents() {
    let workspace = Workspace::new(QUICK);
    let out = workspace.path("results");
    let arguments = ["-k", "4", "--out", out.to_str().unwrap()];
    assert_eq!(solve(&workspace, "meshes/sphere.obj", &arguments).status.code(), Some(0));
    for name in ["eigen.npz", "eigen.ply", "spectrum.json", "run.json"] {
        assert!(out.join("sphere.obj").join(name).exists(), "{name}");
    }
    let spectrum = std::fs::read(out.join("sphere.obj/spectrum.json")).unwrap();
    let spectrum: Value = serde_json::from_slice(&spectrum).unwrap();
    assert_eq!(spectrum["eigenpairs"][0]["source"], "constant");
    assert_eq!(spectrum["eigenpairs"][1]["source"], "fem");
}

#[test]
fn a_folder_is_solved_through_the_same_stages_and_store() {
    let workspace = Workspace::new(QUICK);
    workspace.write("meshes/square.off", &square(12));
    workspace.write("meshes/finer.obj", &obj(&icosphere(3)));
    let method = ["--set", "train.method=fem", "--set", "train.k=6"];
    let (code, report) = workspace.report(&method);
    assert_eq!((code, report.meshes.len()), (0, 3), "{report:?}");
    let computed = workspace.events().len();
    let stages = |from: usize| -> Vec<String> {
        workspace.events().split_off(from).into_iter().map(|event| event.stage).collect()
    };
    assert!(stages(0).iter().all(|s| ["assemble", "reference", "certify"].contains(&s.as_str())));
    for mesh in &report.meshes {
        assert_eq!((mesh.trained, mesh.reused), (0, 0));
        assert!(mesh.completeness.as_ref().unwrap().complete);
        assert!(mesh.eigenpairs.iter().all(|pair| !pair.cached));
    }
    let bytes = || std::fs::read(workspace.path("out/square.off/eigen.npz")).unwrap();
    let before = bytes();
    let (_, again) = workspace.report(&method);
    assert!(again.meshes.iter().flat_map(|mesh| &mesh.eigenpairs).all(|pair| pair.cached));
    assert_eq!(stages(computed).len(), computed);
    assert!(
        workspace.events()[computed..].iter().all(|e| e.how == chladni::flow::events::How::Reused)
    );
    assert!(bytes() == before);
    // Dirichlet is another problem: the square has it, a closed surface cannot.
    let (code, report) =
        workspace.report(&[&method[..], &["--set", "operators.boundary=dirichlet"]].concat());
    assert_eq!(code, 3);
    let square = report.meshes.iter().find(|mesh| mesh.path == "square.off").unwrap();
    assert!((square.eigenpairs[0].pair.lambda - 2.0).abs() < 0.05);
    let closed = report.meshes.iter().find(|mesh| mesh.path == "sphere.obj").unwrap();
    assert!(closed.reason.as_ref().unwrap().contains("no boundary"));
}

#[test]
fn the_paper_s_solver_runs_as_a_method_too() {
    let workspace = Workspace::new(QUICK);
    let (code, report) = workspace.report(&["--set", "train.method=mpgd"]);
    assert_eq!(code, 0, "{report:?}");
    let pair = &report.meshes[0].eigenpairs[2].pair;
    assert!((pair.lambda / pair.lambda_fem - 1.0).abs() < 1e-4 && pair.mpgd.is_some());
}
