//! `chladni watch`: a real process on a real folder in which files are saved, renamed and deleted.

#[path = "../common/mod.rs"]
mod common;

mod chaos;
mod order;
mod saves;
mod service;

use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use chladni::flow::events::How;
use chladni::mesh::{TriMesh, sample::icosphere};
use chladni::publish::result::{Spectrum, Verdict};
use chladni::publish::watched::Happened;
use common::{Workspace, events, obj};

/// When a thing is taken not to come any more: late enough for a machine that has other work.
const PATIENCE: Duration = Duration::from_secs(300);

/// Solved in a few milliseconds.
const FEM: &str = "[train]\nmethod = \"fem\"\nk = 4\n";

/// An ellipsoid of this height: another mesh for every number.
fn ellipsoid(height: f64) -> TriMesh {
    let sphere = icosphere(2);
    let taller = sphere.vertices().iter().map(|&[x, y, z]| [x, 0.9 * y, height * z]);
    TriMesh::new(taller.collect(), sphere.faces().to_vec()).unwrap()
}

/// Ellipsoids of these heights as objects of one file.
fn scene(heights: &[(&str, f64)]) -> String {
    let objects: Vec<_> = heights.iter().map(|&(name, height)| (name, ellipsoid(height))).collect();
    common::scene(&objects)
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
        let deadline = Instant::now() + PATIENCE;
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
        save(&self.workspace, name, mesh);
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

fn save(workspace: &Workspace, name: &str, mesh: &TriMesh) {
    workspace.write(&format!("meshes/{name}"), &obj(mesh));
}

fn names_of_done(said: &[Happened]) -> Vec<&str> {
    let done = said.iter().filter_map(|happened| match happened {
        Happened::Done { path, .. } => Some(path.as_str()),
        _ => None,
    });
    done.collect()
}
