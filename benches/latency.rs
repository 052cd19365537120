//! How long it takes from a save to a verified result on disk, while a folder is watched.
//!
//! `cargo bench --bench latency [-- EDITS KEY=VALUE…]`. The real program watches a folder; spot, 829 vertices, is edited again and again, each
//! version renamed over the last one as editors do it. K = 16 on a shared trunk, unless the options say otherwise. Measured is from
//! the rename to the line that says that the results are there, its version before being known.

use std::error::Error;
use std::io::{BufRead, BufReader, Lines};
use std::path::Path;
use std::process::{Child, ChildStdout, Command, Stdio};
use std::time::Instant;

use chladni::mesh::load;
use chladni::publish::report::Status;
use chladni::publish::watched::Happened;

use edits::{Edit, edit, obj};

mod edits;

const SEED: u64 = 23;

/// After so many edits the session goes back to the mesh that it began with.
const SITTING: u64 = 10;

struct Watcher {
    child: Child,
    lines: Lines<BufReader<ChildStdout>>,
}

impl Watcher {
    fn start(folder: &Path, set: &[&String]) -> Result<Self, Box<dyn Error>> {
        let mut command = Command::new(env!("CARGO_BIN_EXE_chladni"));
        command.arg("watch").arg(folder.join("meshes")).args(["--format", "json"]);
        command.arg("--out").arg(folder.join("out")).arg("--cache").arg(folder.join("cache"));
        for assignment in ["train.k=16", "train.trunk=shared"] {
            command.args(["--set", assignment]);
        }
        for assignment in set {
            command.arg("--set").arg(assignment);
        }
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn()?;
        let out = child.stdout.take().ok_or("no output")?;
        Ok(Self { child, lines: BufReader::new(out).lines() })
    }

    /// The next event of this kind.
    fn until<T>(&mut self, wanted: impl Fn(Happened) -> Option<T>) -> Result<T, Box<dyn Error>> {
        for line in self.lines.by_ref() {
            if let Some(found) = wanted(serde_json::from_str(&line?)?) {
                return Ok(found);
            }
        }
        Err("the watch has ended".into())
    }
}

impl Drop for Watcher {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let (set, numbers): (Vec<_>, Vec<_>) = arguments.iter().partition(|a| a.contains('='));
    let count = numbers.first().map_or(Ok(50), |number| number.parse())?;
    let folder = tempfile::tempdir()?;
    let file = folder.path().join("meshes/mesh.obj");
    std::fs::create_dir(folder.path().join("meshes"))?;
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
    let original = load(&manifest.join("pipelines/meshes/spot_829.obj"))?.mesh;
    std::fs::write(&file, obj(&original))?;
    let mut watcher = Watcher::start(folder.path(), &set)?;
    let idle = |happened| matches!(happened, Happened::Idle { .. }).then_some(());
    watcher.until(idle)?;
    println!("| edit | what | how | verdict | worst angle | s |\n|---|---|---|---|---|---|");
    let (mut mesh, mut times) = (original.clone(), Vec::new());
    for number in 0..count {
        if number % SITTING == 0 {
            mesh.clone_from(&original);
        }
        let Edit { what, mesh: edited } = edit(&mesh, SEED, number);
        mesh = edited;
        let temporary = folder.path().join("meshes/mesh.obj.tmp");
        std::fs::write(&temporary, obj(&mesh))?;
        let saved = Instant::now();
        std::fs::rename(&temporary, &file)?;
        let (status, how, angle) = watcher.until(|happened| match happened {
            Happened::Done { status, grown_from, worst_angle, .. } => {
                Some((status, grown_from, worst_angle))
            }
            Happened::Failed { .. } => Some((Status::Failed, None, None)),
            _ => None,
        })?;
        let took = saved.elapsed().as_secs_f64();
        watcher.until(idle)?;
        let how = how.map_or("from nothing", |how| how.in_words());
        let angle = angle.unwrap_or(f64::NAN);
        println!("| {number} | {what} | {how} | {status:?} | {angle:.3} | {took:.2} |");
        // What does not pass is never done.
        times.push(if status == Status::Verified { took } else { f64::INFINITY });
    }
    times.sort_by(f64::total_cmp);
    let at = |share: f64| times.get((share * times.len() as f64) as usize).copied();
    println!(
        "\nmedian {:.2} s, nine tenths below {:.2} s",
        at(0.5).unwrap_or(f64::NAN),
        at(0.9).unwrap_or(f64::NAN)
    );
    Ok(())
}
