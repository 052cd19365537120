//! `chladni watch`: a real process on a real folder in which files are saved, renamed and deleted.

mod common;

use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use chladni::flow::events::How;
use chladni::mesh::{TriMesh, sample::icosphere};
use chladni::publish::report::Status;
use chladni::publish::result::{Spectrum, Verdict};
use chladni::publish::status::{RunState, RunStatus};
use chladni::publish::watched::Happened;
use common::{QUICK, Workspace, events, obj};

/// Solved in a few milliseconds.
const FEM: &str = "[train]\nmethod = \"fem\"\nk = 4\n";

/// An ellipsoid of this height: another mesh for every number.
fn ellipsoid(height: f64) -> TriMesh {
    let sphere = icosphere(2);
    let taller = sphere.vertices().iter().map(|&[x, y, z]| [x, 0.9 * y, height * z]);
    TriMesh::new(taller.collect(), sphere.faces().to_vec()).unwrap()
}

/// A watch, and what it says.
struct Watched {
    workspace: Workspace,
    child: Child,
    heard: Receiver<Happened>,
}

impl Watched {
    /// Watches `meshes` of a workspace, and waits until all that is there is current.
    fn start(workspace: Workspace, arguments: &[&str]) -> Self {
        let mut child =
            Self::command(&workspace, arguments).stdout(Stdio::piped()).spawn().unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let (tell, heard) = channel();
        std::thread::spawn(move || {
            for line in lines.map_while(Result::ok) {
                let happened = serde_json::from_str(&line).unwrap_or_else(|_| panic!("{line}"));
                if tell.send(happened).is_err() {
                    return;
                }
            }
        });
        let watched = Self { workspace, child, heard };
        watched.until(|happened| matches!(happened, Happened::Idle { .. }));
        watched
    }

    fn command(workspace: &Workspace, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_chladni"));
        command.arg("watch").arg(workspace.path("meshes"));
        command.arg("--pipeline").arg(workspace.path("pipeline.toml"));
        command.arg("--out").arg(workspace.path("out")).arg("--cache").arg(workspace.path("cache"));
        command.args(["--format", "json"]).args(arguments).env_remove("RUST_LOG");
        command.stderr(Stdio::null());
        command
    }

    /// All that is said until something of this kind.
    fn until(&self, is_it: impl Fn(&Happened) -> bool) -> Vec<Happened> {
        let deadline = Instant::now() + Duration::from_secs(60);
        let mut said = Vec::new();
        loop {
            match self.heard.recv_timeout(deadline.saturating_duration_since(Instant::now())) {
                Ok(happened) => {
                    said.push(happened);
                    if is_it(&said[said.len() - 1]) {
                        return said;
                    }
                }
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => {
                    panic!("it never came: {said:#?}")
                }
            }
        }
    }

    /// All that is said until everything is current.
    fn until_idle(&self) -> Vec<Happened> {
        self.until(|happened| matches!(happened, Happened::Idle { .. }))
    }

    /// Whether the last that it said is that everything is current.
    fn is_idle(&self) -> bool {
        std::thread::sleep(Duration::from_millis(600));
        matches!(self.heard.try_iter().last(), None | Some(Happened::Idle { .. }))
    }

    /// Nothing is said for a while.
    fn is_silent(&self, milliseconds: u64) {
        let said = self.heard.recv_timeout(Duration::from_millis(milliseconds));
        assert!(said.is_err(), "{said:?}");
    }

    fn mesh(&self, name: &str) -> PathBuf {
        self.workspace.path("meshes").join(name)
    }

    fn save(&self, name: &str, mesh: &TriMesh) {
        self.workspace.write(&format!("meshes/{name}"), &obj(mesh));
    }

    /// The results of a mesh, held against the mesh that they are to be of.
    fn is_current(&self, name: &str, mesh: &TriMesh) {
        let text = std::fs::read(self.workspace.path("out").join(name).join("spectrum.json"));
        let spectrum: Spectrum = serde_json::from_slice(&text.unwrap()).unwrap();
        assert_eq!((spectrum.mesh.hash, spectrum.status), (mesh.hash(), Verdict::Verified));
    }

    fn computed(&self) -> usize {
        let events = events(&self.workspace.path("out/events.jsonl"));
        events.iter().filter(|event| event.how == How::Computed).count()
    }
}

impl Drop for Watched {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn names_of_done(said: &[Happened]) -> Vec<&str> {
    let done = said.iter().filter_map(|happened| match happened {
        Happened::Done { path, .. } => Some(path.as_str()),
        _ => None,
    });
    done.collect()
}

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
    std::fs::rename(watched.mesh("sphere.obj"), watched.mesh("ball.obj")).unwrap();
    let said = watched.until(|happened| matches!(happened, Happened::Moved { .. }));
    let moved = Happened::Moved { from: "sphere.obj".into(), path: "ball.obj".into() };
    assert_eq!(said.last(), Some(&moved), "{said:?}");
    watched.until_idle();
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
fn a_newer_save_ends_the_work_on_the_older_one() {
    let slow = QUICK.replace("steps = 4", "steps = 4000\nlearning_rate = 1e-4");
    let slow = slow.replace("[input]\npaths = [\"meshes\"]\n", "");
    let workspace = Workspace::new(&slow);
    std::fs::remove_file(workspace.path("meshes/sphere.obj")).unwrap();
    let watched = Watched::start(workspace, &["--jobs", "1"]);
    watched.save("egg.obj", &ellipsoid(1.2));
    watched.until(|happened| matches!(happened, Happened::Saved { .. }));
    // In the middle of its training.
    let under_way = || {
        let text = std::fs::read(watched.workspace.path("out/status.json")).unwrap_or_default();
        let status = serde_json::from_slice::<RunStatus>(&text).ok();
        status.is_some_and(|s| s.under_way.iter().any(|mesh| mesh.stage.starts_with("train")))
    };
    let deadline = Instant::now() + Duration::from_secs(60);
    while !under_way() {
        assert!(Instant::now() < deadline, "it never trained");
        std::thread::sleep(Duration::from_millis(50));
    }
    watched.workspace.write("pipeline.toml", FEM);
    watched.until(|happened| matches!(happened, Happened::Pipeline { error: None }));
    watched.until_idle();
    watched.is_current("egg.obj", &ellipsoid(1.2));

    watched.workspace.write("pipeline.toml", &slow);
    watched.until(|happened| matches!(happened, Happened::Pipeline { error: None }));
    let deadline = Instant::now() + Duration::from_secs(60);
    while !under_way() {
        assert!(Instant::now() < deadline, "it never trained again");
        std::thread::sleep(Duration::from_millis(50));
    }
    watched.save("egg.obj", &ellipsoid(1.3));
    watched.until(|happened| matches!(happened, Happened::Superseded { .. }));
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
    let id = watched.child.id().to_string();
    assert!(Command::new("kill").args(["-TERM", &id]).status().unwrap().success());
    assert_eq!(watched.child.wait().unwrap().code(), Some(130));
    let text = std::fs::read(watched.workspace.path("out/status.json")).unwrap();
    let status: RunStatus = serde_json::from_slice(&text).unwrap();
    assert_eq!(status.state, RunState::Interrupted);
}

#[test]
fn once_does_what_there_is_to_do_and_ends() {
    let workspace = Workspace::new(FEM);
    workspace.write("meshes/broken.obj", "v 0 0\n");
    let run = || {
        let output = Watched::command(&workspace, &["--once"]).output().unwrap();
        let lines = String::from_utf8(output.stdout).unwrap();
        let said = lines.lines().map(|line| serde_json::from_str::<Happened>(line).unwrap());
        (output.status.code(), said.collect::<Vec<_>>())
    };
    let (code, said) = run();
    assert_eq!(code, Some(3), "{said:?}");
    assert_eq!(names_of_done(&said), ["sphere.obj"]);
    std::fs::remove_file(workspace.path("meshes/broken.obj")).unwrap();
    let (code, said) = run();
    assert_eq!(code, Some(0), "{said:?}");
    let idle = Happened::Idle { meshes: 1, verified: 1, unverified: 0, failed: 0 };
    assert_eq!(said.last(), Some(&idle));
    let verified =
        |happened: &&Happened| matches!(happened, Happened::Done { status: Status::Verified, .. });
    assert_eq!(said.iter().filter(verified).count(), 1);
}

/// So many operations of a writer who does everything that writers do, drawn from a seed.
fn chaos(folder: &std::path::Path, operations: u64, seed: u64) {
    use rand::{Rng, SeedableRng};
    use std::fs;
    use std::io::Write;
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let folders = ["", "a", "b", "a/deep"];
    for operation in 0..operations {
        let mut name = || {
            let place = folders[rng.random_range(0..folders.len())];
            folder.join(place).join(format!("{}.obj", rng.random_range(0..4)))
        };
        let (one, other) = (name(), name());
        let text = obj(&ellipsoid(1.1 + 0.1 * rng.random_range(0..30) as f64));
        let _ = fs::create_dir_all(one.parent().unwrap());
        // Whatever is not there cannot be renamed or deleted: that is part of it.
        let _ = match rng.random_range(0..8) {
            0 | 1 => fs::write(&one, &text),
            2 => {
                let mut file = fs::File::create(&one).unwrap();
                for part in text.as_bytes().chunks(text.len() / 3 + 1) {
                    let _ = file.write_all(part);
                    std::thread::sleep(Duration::from_millis(rng.random_range(0..6)));
                }
                Ok(())
            }
            3 => {
                let temporary = one.with_extension("tmp");
                fs::write(&temporary, &text).and_then(|()| fs::rename(&temporary, &one))
            }
            4 => {
                fs::create_dir_all(other.parent().unwrap()).and_then(|()| fs::rename(&one, &other))
            }
            5 => fs::remove_file(&one),
            6 => fs::remove_file(&one).and_then(|()| fs::write(&one, &text)),
            _ => {
                let (from, to) = (folder.join("a"), folder.join("moved"));
                let away = fs::rename(&from, &to);
                std::thread::sleep(Duration::from_millis(rng.random_range(0..30)));
                away.and_then(|()| fs::rename(&to, &from))
            }
        };
        if operation % 50 == 0 {
            std::thread::sleep(Duration::from_millis(rng.random_range(0..200)));
        }
    }
}

/// The results below a folder: every file by its name, but for times and logs.
fn results(out: &std::path::Path) -> std::collections::BTreeMap<PathBuf, Vec<u8>> {
    let mut found = std::collections::BTreeMap::new();
    let mut folders = vec![out.to_owned()];
    while let Some(folder) = folders.pop() {
        // What goes away while it is read is not there.
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else if ["spectrum.json", "eigen.npz", "eigen.ply"].iter().any(|n| path.ends_with(n))
            {
                let Ok(bytes) = std::fs::read(&path) else { continue };
                found.insert(path.strip_prefix(out).unwrap().to_owned(), bytes);
            }
        }
    }
    found
}

#[test]
fn after_chaos_the_results_are_those_of_a_fresh_run() {
    let pipeline = FEM.to_owned() + "[publish]\non_delete = \"remove\"\n";
    for (lineage, seed) in [("off", 1), ("on", 2)] {
        let watched = Watched::start(Workspace::new(&pipeline), &["--lineage", lineage]);
        chaos(&watched.workspace.path("meshes"), 2000, seed);
        let fresh = Workspace::new(&pipeline);
        let meshes = watched.workspace.path("meshes");
        let arguments = ["--lineage", "off", "--input", meshes.to_str().unwrap()];
        let (code, report) = fresh.report(&arguments);
        assert_eq!(code, 0, "{report:?}");
        let theirs = results(&fresh.path("out"));
        let is_it = |ours: &std::collections::BTreeMap<PathBuf, Vec<u8>>| match lineage {
            "off" => *ours == theirs,
            _ => ours.keys().eq(theirs.keys()) && watched.is_idle(),
        };
        let ours = || results(&watched.workspace.path("out"));
        let deadline = Instant::now() + Duration::from_secs(45);
        while Instant::now() < deadline && !is_it(&ours()) {
            std::thread::sleep(Duration::from_millis(200));
        }
        let ours = ours();
        assert_eq!(ours.keys().collect::<Vec<_>>(), theirs.keys().collect::<Vec<_>>());
        if lineage == "off" {
            assert!(ours == theirs);
        }
        let status = |bytes: &[u8]| serde_json::from_slice::<Spectrum>(bytes).unwrap().status;
        for (path, bytes) in ours.iter().filter(|(path, _)| path.ends_with("spectrum.json")) {
            assert_eq!(status(bytes), status(&theirs[path]), "{}", path.display());
        }
    }
}
