//! Stopping a real process at any moment and going on from what is finished.

mod common;

use std::collections::BTreeMap;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use chladni::flow::events::How;
use chladni::publish::status::{RunState, RunStatus};
use common::{QUICK, Workspace};
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};

/// Long enough a training that a signal falls into its middle; gently, for so small a network.
fn slow() -> String {
    QUICK.replace("k = 4", "k = 6").replace("steps = 4", "steps = 600\nlearning_rate = 1e-4")
}

/// Starts a run and waits until `blocks` of its blocks are trained.
fn start_until(workspace: &Workspace, blocks: usize) -> Child {
    let mut child = workspace.run(&[]).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let deadline = Instant::now() + Duration::from_secs(120);
    while trained(workspace) < blocks {
        assert!(child.try_wait().unwrap().is_none(), "the run ended before it could be stopped");
        assert!(Instant::now() < deadline, "no block was trained in two minutes");
        std::thread::sleep(Duration::from_millis(5));
    }
    child
}

fn trained(workspace: &Workspace) -> usize {
    let events = workspace.events();
    events.iter().filter(|e| e.stage == "train" && e.how == How::Computed).count()
}

fn results(workspace: &Workspace) -> [Vec<u8>; 2] {
    ["spectrum.json", "eigen.npz"]
        .map(|name| std::fs::read(workspace.path("out/sphere.obj").join(name)).unwrap())
}

fn nothing_was_computed_twice(workspace: &Workspace) {
    let mut times = BTreeMap::new();
    for event in workspace.events().iter().filter(|event| event.how == How::Computed) {
        *times.entry(event.key.clone()).or_insert(0) += 1;
    }
    assert!(times.values().all(|&count| count == 1), "{times:?}");
}

#[test]
fn a_killed_run_resumes_at_the_first_missing_eigenfunction() {
    let undisturbed = Workspace::new(&slow());
    let (code, report) = undisturbed.report(&[]);
    assert_eq!((code, report.meshes[0].trained), (0, 5));

    let workspace = Workspace::new(&slow());
    let mut child = start_until(&workspace, 2);
    child.kill().unwrap();
    child.wait().unwrap();
    let finished = trained(&workspace);
    assert!((2..5).contains(&finished), "{finished} blocks were trained before the kill");
    let (code, report) = workspace.report(&[]);
    assert_eq!(code, 0);
    // A block whose event was lost in the kill may still be in the store.
    assert!(report.meshes[0].reused >= finished);
    assert_eq!(report.meshes[0].reused + report.meshes[0].trained, 5);
    nothing_was_computed_twice(&workspace);
    assert!(results(&workspace) == results(&undisturbed));
}

/// One long training, of `steps` steps.
fn one_long(steps: usize) -> String {
    let steps = format!("steps = {steps}\nlearning_rate = 1e-4");
    QUICK.replace("k = 4", "k = 2").replace("steps = 4", &steps)
}

#[test]
fn a_training_that_was_killed_goes_on_from_its_checkpoint() {
    // More than the kills below take together, on any machine.
    let pipeline = one_long(12_000);
    let undisturbed = Workspace::new(&pipeline);
    assert_eq!(undisturbed.report(&[]).0, 0);

    let workspace = Workspace::new(&pipeline);
    let often = ["--checkpoint", "0.1"];
    let mut kills = 0;
    for wait in [700, 500, 900] {
        let mut child =
            workspace.run(&often).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        std::thread::sleep(Duration::from_millis(wait));
        kills += usize::from(child.try_wait().unwrap().is_none());
        child.kill().unwrap();
        child.wait().unwrap();
    }
    assert!(kills > 0, "the training was over before it could be killed");
    let output = workspace.run(&often).env("RUST_LOG", "info,sled=off").output().unwrap();
    let said = common::text(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(said.contains("training φ2 goes on after step"), "{said}");
    nothing_was_computed_twice(&workspace);
    assert!(results(&workspace) == results(&undisturbed));
    let stat = chladni::store::Store::open(workspace.path("cache")).unwrap().stat().unwrap();
    assert!(!stat.stages.contains_key("checkpoint"), "it has served: {stat:?}");
}

/// Kills runs at random moments, going on from what each has left, until `kills` of them were killed; whenever one ends by
/// itself, another begins anew.
fn withstands(kills: usize, seed: u64) {
    let pipeline = QUICK.replace("steps = 4", "steps = 200\nlearning_rate = 1e-4");
    let undisturbed = Workspace::new(&pipeline);
    let started = Instant::now();
    assert_eq!(undisturbed.report(&[]).0, 0);
    let whole = started.elapsed();

    let mut rng = StdRng::seed_from_u64(seed);
    let mut killed = 0;
    while killed < kills {
        let workspace = Workspace::new(&pipeline);
        loop {
            let mut run = workspace.run(&["--checkpoint", "0.02"]);
            let mut child = run.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
            if killed < kills {
                std::thread::sleep(whole.mul_f64(rng.random_range(0.0..0.9)));
                if child.try_wait().unwrap().is_none() {
                    child.kill().unwrap();
                    child.wait().unwrap();
                    killed += 1;
                    continue;
                }
            }
            let output = child.wait_with_output().unwrap();
            assert_eq!(output.status.code(), Some(0), "{}", common::text(&output));
            break;
        }
        nothing_was_computed_twice(&workspace);
        assert!(results(&workspace) == results(&undisturbed), "after {killed} kills");
    }
}

#[test]
fn eight_kills_at_any_moment_change_nothing_and_cost_no_finished_work() {
    withstands(8, 1);
}

/// `cargo test --test resume -- --ignored`
#[test]
#[ignore = "a minute or two more of the same"]
fn a_hundred_kills_at_any_moment_change_nothing_and_cost_no_finished_work() {
    withstands(100, 2);
}

#[test]
fn a_mesh_that_takes_too_long_fails_and_goes_on_when_it_has_more_time() {
    let workspace = Workspace::new(&one_long(4000));
    let (code, report) = workspace.report(&["--time-limit", "0.6"]);
    let reason = report.meshes[0].reason.as_deref().unwrap();
    assert_eq!(code, 3);
    assert!(reason.contains("not done within --time-limit = 0.6 s"), "{reason}");
    let output = workspace.run(&[]).env("RUST_LOG", "info,sled=off").output().unwrap();
    let said = common::text(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(said.contains("training φ2 goes on after step"), "{said}");
}

#[cfg(unix)]
#[test]
fn an_interrupted_run_keeps_what_is_finished_and_says_so() {
    let workspace = Workspace::new(&slow());
    let mut child = start_until(&workspace, 1);
    let status = std::process::Command::new("kill")
        .args(["-TERM", &child.id().to_string()])
        .status()
        .unwrap();
    assert!(status.success());
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let finished = trained(&workspace);
    assert!((1..5).contains(&finished), "{finished}");
    assert!(!workspace.path("out/sphere.obj/spectrum.json").exists());
    let (code, report) = workspace.report(&[]);
    assert_eq!((code, report.meshes[0].reused), (0, finished));
    nothing_was_computed_twice(&workspace);
}

#[test]
fn the_bits_do_not_depend_on_the_number_of_workers() {
    let [one, three] = ["1", "3"].map(|jobs| {
        let workspace = Workspace::new(QUICK);
        assert_eq!(workspace.report(&["--jobs", jobs]).0, 0);
        results(&workspace)
    });
    assert!(one == three);
}

#[test]
fn another_process_sees_how_far_a_run_is_and_that_it_was_killed() {
    let workspace = Workspace::new(&slow().replace("steps = 600", "steps = 2500"));
    workspace.write("meshes/broken.obj", "v 0 0\n");
    let out = workspace.path("out");
    let status = || {
        let output =
            common::chladni(&["status", "--format", "json", "--out", out.to_str().unwrap()]);
        assert_eq!(output.status.code(), Some(0), "{}", common::text(&output));
        serde_json::from_slice::<RunStatus>(&output.stdout).unwrap()
    };
    assert_eq!(common::chladni(&["status", "--out", out.to_str().unwrap()]).status.code(), Some(2));

    let mut child = start_until(&workspace, 1);
    let deadline = Instant::now() + Duration::from_secs(60);
    let running = loop {
        let status = status();
        if status.under_way.iter().any(|mesh| mesh.stage.starts_with("train φ")) {
            break status;
        }
        assert!(Instant::now() < deadline, "{status:?}");
        std::thread::sleep(Duration::from_millis(50));
    };
    assert_eq!((running.state, running.process), (RunState::Running, child.id()));
    assert_eq!((running.meshes, running.failed, running.waiting), (2, 1, 0));
    assert_eq!(running.under_way[0].path, "sphere.obj");
    assert!(running.seconds_left.is_some());
    child.kill().unwrap();
    child.wait().unwrap();
    assert_eq!(status().state, RunState::Killed);

    workspace.report(&[]);
    let finished = status();
    assert_eq!(finished.state, RunState::Finished);
    assert_eq!((finished.verified + finished.unverified, finished.failed), (1, 1));
    assert!(finished.under_way.is_empty());
    let output = common::chladni(&["status", "--out", out.to_str().unwrap()]);
    assert!(common::text(&output).contains("2 of 2 meshes done"), "{}", common::text(&output));
}
