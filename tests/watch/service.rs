//! A watch among other programs: signals, systemd, cron, and a system that loses events.

use std::process::Command;
use std::time::Duration;

use chladni::publish::report::Status;
use chladni::publish::status::{RunState, RunStatus};
use chladni::publish::watched::Happened;

use crate::common::{Workspace, chladni, text};
use crate::{FEM, Watched, ellipsoid, names_of_done, scene};

#[cfg(unix)]
fn signal(watched: &Watched, name: &str) {
    let id = watched.child.id().to_string();
    assert!(Command::new("kill").args([name, &id]).status().unwrap().success());
}

#[cfg(unix)]
#[test]
fn a_stop_is_clean_and_a_status_can_be_read() {
    let mut watched = Watched::start(Workspace::new(FEM), &["--poll", "0.2"]);
    let status = || -> RunStatus {
        let text = std::fs::read(watched.workspace.path("out/status.json")).unwrap();
        serde_json::from_slice(&text).unwrap()
    };
    watched.save("more.obj", &ellipsoid(2.2));
    watched.until_idle();
    std::thread::sleep(Duration::from_millis(1200));
    assert_eq!((status().state, status().meshes, status().verified), (RunState::Running, 2, 2));
    signal(&watched, "-TERM");
    assert_eq!(watched.child.wait().unwrap().code(), Some(130));
    let text = std::fs::read(watched.workspace.path("out/status.json")).unwrap();
    let status: RunStatus = serde_json::from_slice(&text).unwrap();
    assert_eq!(status.state, RunState::Interrupted);
}

/// What `--once` says, and its exit code.
fn once(workspace: &Workspace) -> (Option<i32>, Vec<Happened>) {
    let output = Watched::command(workspace, &["--once"]).output().unwrap();
    let lines = String::from_utf8(output.stdout).unwrap();
    let said = lines.lines().map(|line| serde_json::from_str::<Happened>(line).unwrap());
    (output.status.code(), said.collect())
}

#[test]
fn once_does_what_there_is_to_do_and_ends() {
    let workspace = Workspace::new(FEM);
    workspace.write("meshes/broken.obj", "v 0 0\n");
    let (code, said) = once(&workspace);
    assert_eq!(code, Some(3), "{said:?}");
    assert_eq!(names_of_done(&said), ["sphere.obj"]);
    std::fs::remove_file(workspace.path("meshes/broken.obj")).unwrap();
    let (code, said) = once(&workspace);
    assert_eq!(code, Some(0), "{said:?}");
    let idle = Happened::Idle { meshes: 1, verified: 1, unverified: 0, failed: 0 };
    assert_eq!(said.last(), Some(&idle));
    let verified =
        |happened: &&Happened| matches!(happened, Happened::Done { status: Status::Verified, .. });
    assert_eq!(said.iter().filter(verified).count(), 1);
    assert!(said.iter().any(|happened| happened.line().contains("; from the cache; ")), "{said:?}");
    let out = workspace.path("out");
    let status = chladni(&["status", "--out", out.to_str().unwrap()]);
    let status = text(&status);
    assert!(status.starts_with("finished after "), "{status}");
}

#[test]
fn what_was_deleted_while_nobody_watched_is_found_missing() {
    let workspace = Workspace::new(&(FEM.to_owned() + "[publish]\non_delete = \"remove\"\n"));
    // Results of somebody else, who ran into the same folder.
    assert_eq!(workspace.report(&["--input", workspace.path("meshes").to_str().unwrap()]).0, 0);
    let sphere = workspace.path("meshes/sphere.obj");
    let elsewhere = workspace.path("sphere.obj");
    std::fs::rename(&sphere, &elsewhere).unwrap();
    // However often this folder is watched, they are not its own.
    for _ in 0..2 {
        let (_, said) = once(&workspace);
        assert!(matches!(said[..], [Happened::Watching { meshes: 0, .. }, Happened::Idle { .. }]));
        assert!(workspace.path("out/sphere.obj/spectrum.json").exists());
    }

    std::fs::rename(&elsewhere, &sphere).unwrap();
    assert_eq!(names_of_done(&once(&workspace).1), ["sphere.obj"]);
    std::fs::remove_file(&sphere).unwrap();
    let (code, said) = once(&workspace);
    let deleted = Happened::Deleted { path: "sphere.obj".into(), results_kept: false };
    assert!(code == Some(0) && said.contains(&deleted), "{said:?}");
    assert!(!workspace.path("out/sphere.obj").exists());
}

#[test]
fn so_are_objects_of_a_file_that_is_still_there() {
    let split = "[ingest]\nobjects = \"split\"\n[publish]\non_delete = \"remove\"\n";
    let workspace = Workspace::new(&(FEM.to_owned() + split));
    workspace.write("meshes/scene.obj", &scene(&[("head", 1.3), ("body", 1.7)]));
    let (_, said) = once(&workspace);
    assert_eq!(
        said.last(),
        Some(&Happened::Idle { meshes: 3, verified: 3, unverified: 0, failed: 0 })
    );
    workspace.write("meshes/scene.obj", &scene(&[("body", 1.7), ("tail", 1.9)]));
    let (_, said) = once(&workspace);
    let head = Happened::Deleted { path: "scene.obj/head".into(), results_kept: false };
    assert!(said.contains(&head), "{said:?}");
    let is_there = |name: &str| workspace.path("out/scene.obj").join(name).exists();
    assert_eq!(["head", "body", "tail"].map(is_there), [false, true, true]);
    std::fs::remove_file(workspace.path("meshes/scene.obj")).unwrap();
    once(&workspace);
    assert!(!workspace.path("out/scene.obj").exists());
}

#[cfg(unix)]
#[test]
fn systemd_is_told_when_the_folder_is_watched_and_when_that_ends() {
    use std::os::unix::net::UnixDatagram;
    let workspace = Workspace::new(FEM);
    let socket = UnixDatagram::bind(workspace.path("notify")).unwrap();
    socket.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
    let mut command = Watched::command(&workspace, &["--once"]);
    assert!(command.env("NOTIFY_SOCKET", workspace.path("notify")).output().is_ok());
    let told = || {
        let mut message = [0; 64];
        let length = socket.recv(&mut message).unwrap();
        String::from_utf8_lossy(&message[..length]).trim().to_owned()
    };
    assert_eq!([told(), told()], ["READY=1", "STOPPING=1"]);
}

/// The kernel's queue holds 16,384 events by default, and says only that it has lost some.
#[cfg(target_os = "linux")]
#[test]
fn events_that_were_lost_cost_nothing() {
    let watched = Watched::start(Workspace::new(FEM), &[]);
    signal(&watched, "-STOP");
    let queue = std::fs::read_to_string("/proc/sys/fs/inotify/max_queued_events").unwrap();
    let events: usize = queue.trim().parse().unwrap();
    for event in 0..events.min(200_000) / 2 {
        // Two files in turn: events of one file that follow each other are one.
        watched.workspace.write(&format!("meshes/{}.txt", event % 2), "x");
    }
    watched.save("late.obj", &ellipsoid(1.8));
    signal(&watched, "-CONT");
    assert_eq!(names_of_done(&watched.until_idle()), ["late.obj"]);
    watched.is_current("late.obj", &ellipsoid(1.8));
}

#[test]
fn what_is_said_of_all_meshes_is_kept_current() {
    let publish = "[publish]\ndescriptors = [\"shape-dna\"]\nreport = true\n";
    let workspace = Workspace::new(&(FEM.to_owned() + publish));
    let page = || std::fs::read_to_string(workspace.path("out/report.html"));
    let table = || std::fs::read_to_string(workspace.path("out/shape_dna.csv"));
    let names = || -> Vec<String> {
        let text = table().unwrap();
        text.lines().skip(1).map(|line| line.split(',').next().unwrap().into()).collect()
    };
    once(&workspace);
    assert_eq!(names(), ["sphere.obj"]);
    workspace.write("meshes/broken.obj", "v 0 0\n");
    crate::save(&workspace, "egg.obj", &ellipsoid(1.4));
    once(&workspace);
    assert_eq!(names(), ["broken.obj", "egg.obj", "sphere.obj"]);
    let text = page().unwrap();
    assert!(text.contains("egg.obj/report.html") && text.contains("Failed"), "{text}");
    std::fs::remove_file(workspace.path("meshes/sphere.obj")).unwrap();
    std::fs::remove_file(workspace.path("meshes/broken.obj")).unwrap();
    once(&workspace);
    assert_eq!(names(), ["egg.obj"]);
    assert!(!page().unwrap().contains("sphere.obj"));
    workspace.write("pipeline.toml", FEM);
    once(&workspace);
    assert!(table().is_err() && page().is_err());
}
