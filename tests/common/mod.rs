//! What the tests of the program share: a small mesh, a quick pipeline, and a way to run the real binary.

// Every test file compiles this module for itself and uses what it needs.
#![allow(dead_code)]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use chladni::flow::Event;
use chladni::mesh::{TriMesh, sample::icosphere};
pub use chladni::publish::mesh_file::to_obj as obj;
use chladni::publish::report::RunReport;
use tempfile::TempDir;

/// A pipeline that trains in a fraction of a second, judged leniently: it is the machinery that is tested.
pub const QUICK: &str = "
[input]
paths = [\"meshes\"]
[family]
members = 2
vertices = 90
[train]
k = 4
width = 24
layers = 2
steps = 4
batch = 2
[verify]
lambda_tolerance = 0.2
angle_tolerance = 0.5
";

/// A pipeline without training: the reference solver alone.
pub const FEM: &str = "
[input]
paths = [\"meshes\"]
[train]
method = \"fem\"
k = 4
";

/// A folder of its own with a pipeline, meshes, a cache and results.
pub struct Workspace {
    dir: TempDir,
}

impl Workspace {
    /// With one unit sphere of 162 vertices, `meshes/sphere.obj`.
    pub fn new(pipeline: &str) -> Self {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir(dir.path().join("meshes")).unwrap();
        let workspace = Self { dir };
        workspace.write("pipeline.toml", pipeline);
        workspace.write("meshes/sphere.obj", &obj(&icosphere(2)));
        workspace
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    pub fn write(&self, name: &str, text: &str) {
        std::fs::write(self.path(name), text).unwrap();
    }

    /// `chladni run` on this workspace, with further arguments.
    pub fn run(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_chladni"));
        command.arg("run").arg(self.path("pipeline.toml"));
        command.arg("--out").arg(self.path("out")).arg("--cache").arg(self.path("cache"));
        command.args(arguments).env_remove("RUST_LOG");
        command
    }

    /// Runs to the end with `--format json`; the exit code and the document.
    pub fn report(&self, arguments: &[&str]) -> (i32, RunReport) {
        let output = self.run(arguments).args(["--format", "json"]).output().unwrap();
        let report = serde_json::from_slice(&output.stdout)
            .unwrap_or_else(|error| panic!("{error}: {}", text(&output)));
        (output.status.code().unwrap(), report)
    }

    /// The events of all runs so far.
    pub fn events(&self) -> Vec<Event> {
        events(&self.path("out/events.jsonl"))
    }
}

/// The events in a log; a line that is still being written is left out.
pub fn events(log: &Path) -> Vec<Event> {
    let text = std::fs::read_to_string(log).unwrap_or_default();
    text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect()
}

/// The sphere of a workspace, drawn out along x, as the text of an OBJ file.
pub fn ellipsoid(factor: f64) -> String {
    let mesh = icosphere(2);
    let vertices = mesh.vertices().iter().map(|&[x, y, z]| [factor * x, y, z]).collect();
    obj(&TriMesh::new(vertices, mesh.faces().to_vec()).unwrap())
}

/// Meshes as objects of one OBJ file.
pub fn scene(objects: &[(&str, TriMesh)]) -> String {
    let (mut text, mut first) = (String::new(), 1);
    for (name, mesh) in objects {
        text += &format!("o {name}\n");
        for [x, y, z] in mesh.vertices() {
            text += &format!("v {x:?} {y:?} {z:?}\n");
        }
        for face in mesh.faces() {
            let [a, b, c] = face.map(|v| v as usize + first);
            text += &format!("f {a} {b} {c}\n");
        }
        first += mesh.n();
    }
    text
}

/// What a process printed.
pub fn text(output: &Output) -> String {
    format!(
        "{}\n{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    )
}

/// The real binary with these arguments.
pub fn chladni(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_chladni"))
        .args(arguments)
        .env_remove("RUST_LOG")
        .output()
        .unwrap()
}
