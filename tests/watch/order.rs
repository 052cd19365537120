//! Which mesh comes first, and what becomes of work that is no longer wanted.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use chladni::publish::result::Inheritance;
use chladni::publish::status::RunStatus;
use chladni::publish::watched::Happened;

use crate::common::{QUICK, Workspace};
use crate::{FEM, PATIENCE, Watched, ellipsoid, save};

/// A pipeline that trains an eigenfunction for some seconds.
fn slow() -> String {
    let slow = QUICK.replace("steps = 4", "steps = 8000\nlearning_rate = 1e-4");
    slow.replace("[input]\npaths = [\"meshes\"]\n", "")
}

/// A watch of an empty folder, one mesh at a time.
fn watched(pipeline: &str) -> Watched {
    let workspace = Workspace::new(pipeline);
    std::fs::remove_file(workspace.path("meshes/sphere.obj")).unwrap();
    Watched::start(workspace, &["--jobs", "1"])
}

impl Watched {
    fn wait_for(&self, what: &str, has_come: impl Fn() -> bool) {
        let deadline = Instant::now() + PATIENCE;
        while !has_come() {
            assert!(Instant::now() < deadline, "it never came: {what}");
            thread::sleep(Duration::from_millis(20));
        }
    }

    fn is_training(&self) -> bool {
        let text = std::fs::read(self.workspace.path("out/status.json")).unwrap_or_default();
        let status = serde_json::from_slice::<RunStatus>(&text).ok();
        status.is_some_and(|s| s.under_way.iter().any(|mesh| mesh.stage.starts_with("train")))
    }
}

#[test]
fn another_pipeline_and_a_newer_save_end_the_work_on_the_older_one() {
    let watched = watched(&slow());
    watched.save("egg.obj", &ellipsoid(1.2));
    watched.until(|happened| matches!(happened, Happened::Ready { .. }));
    watched.wait_for("a training", || watched.is_training());
    watched.workspace.write("pipeline.toml", FEM);
    watched.until(|happened| matches!(happened, Happened::Pipeline { error: None }));
    watched.until_idle();
    watched.is_current("egg.obj", &ellipsoid(1.2));

    watched.workspace.write("pipeline.toml", &slow());
    watched.until(|happened| matches!(happened, Happened::Pipeline { error: None }));
    watched.wait_for("a training under the first pipeline again", || watched.is_training());
    watched.save("egg.obj", &ellipsoid(1.3));
    watched.until(|happened| matches!(happened, Happened::Superseded { .. }));
}

#[test]
fn what_was_trained_of_the_older_version_is_what_the_newer_one_begins_with() {
    let watched = watched(&slow());
    watched.save("egg.obj", &ellipsoid(1.2));
    watched.wait_for("the second block", || {
        watched.workspace.events().iter().any(|e| e.stage == "train" && e.part == Some(2))
    });
    watched.save("egg.obj", &ellipsoid(1.21));
    let said = watched.until(|happened| matches!(happened, Happened::Done { .. }));
    assert!(said.contains(&Happened::Superseded { path: "egg.obj".into() }), "{said:#?}");
    let Some(Happened::Done { grown_from, .. }) = said.last() else { unreachable!() };
    assert_eq!(*grown_from, Some(Inheritance::FineTuned), "{said:#?}");
    watched.is_current("egg.obj", &ellipsoid(1.21));
}

#[test]
fn a_mesh_that_is_saved_again_and_again_does_not_keep_the_others_waiting() {
    let watched = watched(&slow());
    let is_over = AtomicBool::new(false);
    let (workspace, goes_on) = (&watched.workspace, || !is_over.load(Ordering::Relaxed));
    thread::scope(|scope| {
        scope.spawn(move || {
            let end = Instant::now() + PATIENCE;
            for version in (0..).take_while(|_| goes_on() && Instant::now() < end) {
                save(workspace, "busy.obj", &ellipsoid(1.2 + 1e-3 * f64::from(version)));
                thread::sleep(Duration::from_millis(400));
            }
        });
        watched.wait_for("a training", || watched.is_training());
        watched.save("calm.obj", &ellipsoid(2.0));
        let said = watched.until(
            |happened| matches!(happened, Happened::Done { path, .. } if path == "calm.obj"),
        );
        let busy = Happened::Superseded { path: "busy.obj".into() };
        assert!(said.contains(&busy), "{said:#?}");
        let is_done = |happened: &Happened| matches!(happened, Happened::Done { path, .. } if path == "busy.obj");
        assert!(!said.iter().any(is_done), "{said:#?}");
        is_over.store(true, Ordering::Relaxed);
    });
    watched.until(|happened| matches!(happened, Happened::Done { path, .. } if path == "busy.obj"));
}
