//! `chladni explain` and `chladni run --dry-run`: what they list is what the run then does.

mod common;

use chladni::flow::events::How;
use chladni::mesh::{TriMesh, sample::icosphere};
use chladni::publish::plan::{Because, RunPlan};
use common::{QUICK, Workspace, chladni, obj, text};

type Listed = Vec<(String, Option<usize>, bool)>;

fn planned(workspace: &Workspace, arguments: &[&str]) -> RunPlan {
    let arguments = [arguments, &["--dry-run", "--format", "json"]].concat();
    let output = workspace.run(&arguments).output().unwrap();
    serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", text(&output)))
}

fn listed(plan: &RunPlan) -> Listed {
    let work = plan.meshes.iter().flat_map(|mesh| &mesh.work);
    work.map(|work| (work.stage.clone(), work.part, work.cached)).collect()
}

/// What a run does, mesh by mesh.
fn done(workspace: &Workspace, arguments: &[&str]) -> Listed {
    let before = workspace.events().len();
    workspace.report(&[arguments, &["--jobs", "1"]].concat());
    let mut events = workspace.events().split_off(before);
    events.sort_by_key(|event| event.item);
    events.into_iter().map(|e| (e.stage, e.part, e.how == How::Reused)).collect()
}

/// The whole text of `explain`.
fn explained(workspace: &Workspace, arguments: &[&str]) -> String {
    let [pipeline, out, cache] = ["pipeline.toml", "out", "cache"].map(|name| workspace.path(name));
    let [pipeline, out, cache] = [&pipeline, &out, &cache].map(|path| path.to_str().unwrap());
    let fixed = ["explain", pipeline, "--out", out, "--cache", cache];
    let output = chladni(&[&fixed, arguments].concat());
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn the_list_of_a_dry_run_is_that_of_the_run() {
    let workspace = Workspace::new(QUICK);
    std::fs::copy(workspace.path("meshes/sphere.obj"), workspace.path("meshes/twin.obj")).unwrap();
    let off = "--lineage=off";
    let runs: [&[&str]; 11] = [
        &[],
        &[],
        &["--set", "train.k=3"],
        &["--set", "train.k=6"],
        &["--set", "train.learning_rate=1e-3"],
        &["--set", "verify.lambda_tolerance=0.3"],
        &["--set", "train.refine=full"],
        &["--set", "train.trunk=shared", off],
        &["--set", "train.tune=2"],
        &["--set", "train.method=fem"],
        &["--set", "train.method=mpgd", "--set", "operators.mass=consistent"],
    ];
    for arguments in runs {
        let plan = listed(&planned(&workspace, arguments));
        assert_eq!(plan, done(&workspace, arguments), "{arguments:?}");
        let again = listed(&planned(&workspace, arguments));
        assert!(again.iter().all(|(_, _, cached)| *cached), "{arguments:?}: {again:?}");
    }
}

#[test]
fn a_dry_run_leaves_everything_as_it_is() {
    let workspace = Workspace::new(QUICK);
    planned(&workspace, &[]);
    assert!(!workspace.path("cache").exists() && !workspace.path("out").exists());
    workspace.report(&[]);
    let stat = || {
        let store = chladni::store::Store::open(workspace.path("cache")).unwrap();
        (store.stat().unwrap().stages, std::fs::read(workspace.path("out/events.jsonl")).unwrap())
    };
    let before = stat();
    planned(&workspace, &["--set", "train.k=6"]);
    assert_eq!(stat(), before);
}

#[test]
fn the_changed_option_is_named() {
    let workspace = Workspace::new(QUICK);
    let plan = planned(&workspace, &[]);
    assert!(plan.meshes[0].work.iter().all(|work| work.because == Some(Because::New)));
    workspace.report(&[]);
    assert!(explained(&workspace, &[]).contains("reused    train φ2…φ4\n"));
    let text = explained(&workspace, &["--set", "train.learning_rate=5e-4"]);
    assert!(text.contains("train φ2             learning_rate 0.006 → 0.0005\n"), "{text}");
    assert!(text.contains("train φ3…φ4          earlier blocks, learning_rate"), "{text}");
    assert!(text.contains("reused    reference\n"), "{text}");
    let text = explained(&workspace, &["sphere.obj", "--set", "train.k=5"]);
    assert!(text.contains("reused    train φ2…φ4\n"), "{text}");
    assert!(text.contains("computed  train φ5             new\n"), "{text}");
    // The tolerances are in no key.
    let text = explained(&workspace, &["--set", "verify.angle_tolerance=0.4"]);
    assert!(text.contains("1 up to date"), "{text}");
    std::fs::remove_dir_all(workspace.path("cache")).unwrap();
    let text = explained(&workspace, &[]);
    assert!(text.contains("train φ2             not in this cache"), "{text}");
}

#[test]
fn an_edited_mesh_says_that_its_certificate_decides() {
    let workspace = Workspace::new(QUICK);
    workspace.report(&[]);
    let sphere = icosphere(2);
    let flattened = sphere.vertices().iter().map(|&[x, y, z]| [x, y, 0.99 * z]).collect();
    let edited = TriMesh::new(flattened, sphere.faces().to_vec()).unwrap();
    workspace.write("meshes/sphere.obj", &obj(&edited));
    let plan = planned(&workspace, &[]);
    assert!(plan.meshes[0].undecided);
    let list = listed(&plan);
    assert_eq!(done(&workspace, &[])[..list.len()], list);
    assert!(!planned(&workspace, &[]).meshes[0].undecided);
    let anew = planned(&workspace, &["--lineage", "off"]);
    assert_eq!(listed(&anew).iter().filter(|(stage, ..)| stage == "train").count(), 3);
    assert_eq!(listed(&anew), done(&workspace, &["--lineage", "off"]));
}

#[test]
fn a_mesh_that_cannot_be_read_fails_in_the_plan_too() {
    let workspace = Workspace::new(QUICK);
    workspace.write("meshes/broken.obj", "v 0 0\n");
    let output = workspace.run(&["--dry-run"]).output().unwrap();
    let said = text(&output);
    assert_eq!(output.status.code(), Some(3), "{said}");
    assert!(said.contains("2 meshes: 0 up to date, 1 to compute (3 trainings), 1 fails"), "{said}");
    assert!(said.contains("fails: "), "{said}");
}
