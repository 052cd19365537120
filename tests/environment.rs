//! What the system refuses: a cache or a folder of results that cannot be written, a full disk, a mesh that cannot be read.
//! It costs a warning or one mesh, and never a result.
//!
//! Who may do everything (root) gives up that right for these tests; disks are small ones in a namespace of their own. Where the
//! system allows neither, a test says so and passes.
#![cfg(target_os = "linux")]

mod common;

use std::collections::BTreeMap;
use std::fs::{self, Permissions};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use chladni::flow::events::How;
use chladni::publish::report::{RunReport, Status};
use common::{FEM, QUICK, Workspace, text};

/// The same command as somebody who is bound by permissions; `None` where that cannot be had.
fn unprivileged(command: &Command) -> Option<Command> {
    let root = Command::new("id").arg("-u").output().ok()?.stdout.starts_with(b"0\n");
    let mut bound = if root {
        let mut bound = Command::new("setpriv");
        bound.args(["--reuid", "65534", "--regid", "65534", "--clear-groups"]);
        bound.arg(command.get_program());
        bound
    } else {
        Command::new(command.get_program())
    };
    bound.args(command.get_args()).env_remove("RUST_LOG");
    let mut trial = Command::new("setpriv");
    trial.args(["--reuid", "65534", "--regid", "65534", "--clear-groups"]);
    trial.arg(command.get_program()).arg("--version");
    if root && !trial.output().is_ok_and(|output| output.status.success()) {
        eprintln!("skipped: root cannot give up its rights here");
        return None;
    }
    Some(bound)
}

fn permit(path: &Path, mode: u32) {
    fs::set_permissions(path, Permissions::from_mode(mode)).unwrap();
}

/// All files below a folder, with their bytes.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for item in fs::read_dir(folder).unwrap() {
        let path = item.unwrap().path();
        if path.is_dir() {
            found.extend(contents(&path));
        } else {
            found.insert(path.clone(), fs::read(path).unwrap());
        }
    }
    found
}

/// Takes the right to write away from everybody, or gives it back to the owner.
fn make_writable(folder: &Path, writable: bool) {
    for item in fs::read_dir(folder).unwrap() {
        let path = item.unwrap().path();
        if path.is_dir() {
            make_writable(&path, writable);
        } else {
            change(&path, writable);
        }
    }
    change(folder, writable);
}

fn change(path: &Path, writable: bool) {
    let mode = fs::metadata(path).unwrap().permissions().mode();
    permit(path, if writable { mode | 0o200 } else { mode & !0o222 });
}

/// A workspace that others may look into, with a place for their results.
fn open_to_all(pipeline: &str) -> Workspace {
    let workspace = Workspace::new(pipeline);
    permit(&workspace.path("."), 0o755);
    fs::create_dir(workspace.path("out")).unwrap();
    permit(&workspace.path("out"), 0o777);
    workspace
}

fn warnings(output: &Output) -> usize {
    String::from_utf8_lossy(&output.stderr).matches("WARN").count()
}

#[test]
fn a_cache_that_may_only_be_read_is_used_and_stays_as_it_is() {
    let workspace = open_to_all(QUICK);
    assert_eq!(workspace.report(&[]).0, 0);
    let cache = workspace.path("cache");
    fs::remove_dir_all(workspace.path("out")).unwrap();
    fs::create_dir(workspace.path("out")).unwrap();
    permit(&workspace.path("out"), 0o777);
    make_writable(&cache, false);
    let before = contents(&cache);

    let Some(mut command) = unprivileged(&workspace.run(&[])) else { return };
    let output = command.output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    assert_eq!(warnings(&output), 1, "{}", text(&output));
    assert!(text(&output).contains("what is in the cache is used, and nothing new is kept"));
    let events = workspace.events();
    assert!(!events.is_empty() && events.iter().all(|event| event.how == How::Reused));

    // What is not in it is computed, and once only.
    let more = workspace.run(&["--set", "train.k=5"]);
    let output = unprivileged(&more).unwrap().output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    assert_eq!(warnings(&output), 1, "{}", text(&output));
    let events = workspace.events();
    let trained =
        |event: &&chladni::flow::Event| event.stage == "train" && event.how == How::Computed;
    assert_eq!(events.iter().filter(trained).count(), 1);

    let mut stat = Command::new(env!("CARGO_BIN_EXE_chladni"));
    stat.args(["cache", "stat", "--cache"]).arg(&cache);
    let output = unprivileged(&stat).unwrap().output().unwrap();
    assert!(text(&output).contains("train "), "{}", text(&output));
    assert!(contents(&cache) == before);
    make_writable(&cache, true);
}

#[test]
fn a_mesh_that_may_not_be_read_fails_alone() {
    let workspace = open_to_all(FEM);
    fs::copy(workspace.path("meshes/sphere.obj"), workspace.path("meshes/closed.obj")).unwrap();
    permit(&workspace.path("meshes/closed.obj"), 0o000);
    fs::create_dir(workspace.path("cache")).unwrap();
    permit(&workspace.path("cache"), 0o777);
    let Some(mut command) = unprivileged(&workspace.run(&["--format", "json"])) else { return };
    let output = command.output().unwrap();
    assert_eq!(output.status.code(), Some(3), "{}", text(&output));
    let report: RunReport = serde_json::from_slice(&output.stdout).unwrap();
    let statuses: Vec<Status> = report.meshes.iter().map(|mesh| mesh.status).collect();
    assert_eq!(statuses, [Status::Failed, Status::Verified]);
    let reason = report.meshes[0].reason.as_deref().unwrap();
    assert!(reason.contains("closed.obj") && reason.contains("ermission denied"), "{reason}");
}

#[test]
fn results_that_are_deleted_during_a_run_are_missing_and_nothing_else() {
    let workspace = Workspace::new(QUICK);
    for (name, factor) in [("b", 1.02), ("c", 1.04), ("d", 1.06)] {
        workspace.write(&format!("meshes/{name}.obj"), &common::ellipsoid(factor));
    }
    fs::rename(workspace.path("meshes/sphere.obj"), workspace.path("meshes/a.obj")).unwrap();
    let mut run = workspace.run(&["--jobs", "1", "--format", "json"]);
    let child = run.stdout(std::process::Stdio::piped()).stderr(std::process::Stdio::piped());
    let child = child.spawn().unwrap();
    let deadline = Instant::now() + Duration::from_secs(60);
    while !workspace.path("out/a.obj/spectrum.json").exists() {
        assert!(Instant::now() < deadline);
        std::thread::sleep(Duration::from_millis(2));
    }
    // What is being written meanwhile may keep the folder for a moment.
    while fs::remove_dir_all(workspace.path("out")).is_err() {}
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    assert!(workspace.path("out/d.obj/eigen.npz").exists());
    let (code, report) = workspace.report(&[]);
    assert_eq!((code, report.meshes.iter().map(|mesh| mesh.trained).sum::<usize>()), (0, 0));
    assert!(workspace.path("out/a.obj/spectrum.json").exists());
}

/// Does `script` where `$disk` is a disk of so many MiB and `run` runs the pipeline into `$log`; `None` where there can be none.
fn on_a_small_disk(workspace: &Workspace, mebibytes: usize, script: &str) -> Option<()> {
    let disk = workspace.path("disk");
    fs::create_dir(&disk).unwrap();
    let mount = format!("mount -t tmpfs -o size={mebibytes}m small \"$disk\"");
    let in_namespace = |script: String| {
        let mut command = Command::new("unshare");
        command.args(["-rm", "sh", "-c", &script]).env("disk", &disk).env_remove("RUST_LOG");
        command.env("folder", workspace.path(".")).env("bin", env!("CARGO_BIN_EXE_chladni"));
        command.output()
    };
    if !in_namespace(mount.clone()).is_ok_and(|output| output.status.success()) {
        eprintln!("skipped: no disk can be mounted here");
        return None;
    }
    // A run writes its exit code behind what it says.
    let run = "run() { log=\"$folder/$1\"; shift; \
               \"$bin\" run \"$folder/pipeline.toml\" \"$@\" >\"$log\" 2>&1 && code=0 || code=$?; \
               echo \"exit $code\" >>\"$log\"; }; \
               fill() { cat /dev/zero >\"$disk/ballast\" 2>/dev/null || true; }";
    let output = in_namespace(format!("set -e; {mount}; {run}; {script}")).unwrap();
    assert!(output.status.success(), "{}", text(&output));
    Some(())
}

fn read(workspace: &Workspace, name: &str) -> String {
    fs::read_to_string(workspace.path(name)).unwrap()
}

#[test]
fn a_full_disk_of_the_cache_costs_a_warning_and_the_cache_works_when_there_is_room() {
    let workspace = Workspace::new(QUICK);
    let done = on_a_small_disk(
        &workspace,
        24,
        "with() { run $1 --cache \"$disk/cache\" --out \"$folder/$1.out\"; }
         fill; with never
         rm \"$disk/ballast\"; head -c 21M /dev/zero >\"$disk/ballast\"; with little
         rm \"$disk/ballast\"; with room; with again
         fill; with full
         rm \"$disk/ballast\"; with after",
    );
    if done.is_none() {
        return;
    }
    let computed = |name: &str| {
        let events = common::events(&workspace.path(&format!("{name}.out/events.jsonl")));
        assert!(!events.is_empty());
        events.iter().filter(|event| event.how == How::Computed).count()
    };
    let spectrum = |name: &str| read(&workspace, &format!("{name}.out/sphere.obj/spectrum.json"));
    for (name, warnings, computes) in [
        ("never", 1, true),
        ("little", 1, true),
        ("room", 0, true),
        ("again", 0, false),
        ("full", 1, false),
        ("after", 0, false),
    ] {
        let log = read(&workspace, name);
        assert!(log.ends_with("exit 0\n"), "{name}: {log}");
        assert_eq!(log.matches("WARN").count(), warnings, "{name}: {log}");
        assert_eq!(computed(name) > 0, computes, "{name}: {log}");
        assert_eq!(spectrum(name), spectrum("never"), "{name}");
    }
    assert!(
        read(&workspace, "little").contains("has no room for"),
        "{}",
        read(&workspace, "little")
    );
    assert!(
        read(&workspace, "never").contains("nothing is cached"),
        "{}",
        read(&workspace, "never")
    );
}

#[test]
fn a_full_disk_of_the_results_fails_its_meshes_and_keeps_what_was_computed() {
    let workspace = Workspace::new(QUICK);
    let done = on_a_small_disk(
        &workspace,
        4,
        "with() { run $1 --cache \"$folder/cache\" --out \"$disk/out\"; }
         fill; with full
         rm \"$disk/ballast\"; with room
         cp \"$disk/out/events.jsonl\" \"$folder/events.jsonl\"",
    );
    if done.is_none() {
        return;
    }
    let full = read(&workspace, "full");
    assert!(full.ends_with("exit 3\n"), "{full}");
    assert!(full.contains("that the disk has space"), "{full}");
    assert_eq!(full.matches("events are missing").count(), 1, "{full}");
    let room = read(&workspace, "room");
    assert!(room.ends_with("exit 0\n"), "{room}");
    let events = common::events(&workspace.path("events.jsonl"));
    assert!(!events.is_empty() && events.iter().all(|event| event.how == How::Reused), "{room}");
}
