//! What lineage saves: a mesh is edited again and again, and every version is computed twice.
//!
//! `cargo bench --bench lineage [-- EDITS KEY=VALUE…]`. The real program, as a process of its own: once in the session's own folder, whose
//! cache has the version before, once with `--lineage off` and an empty cache. The tolerances are the same, and all
//! verification is in both times. Options of the pipeline are laid over its defaults, as with `--set`.

use std::collections::BTreeMap;
use std::error::Error;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

use chladni::mesh::load;
use chladni::publish::report::{MeshReport, RunReport, Status};
use chladni::publish::result::{Inheritance, Spectrum};

use edits::{Edit, edit, obj};

mod edits;

const SEED: u64 = 11;

/// After so many edits the session goes back to the mesh that it began with.
const SITTING: u64 = 10;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    let (set, numbers): (Vec<_>, Vec<_>) = arguments.iter().partition(|a| a.contains('='));
    let edits = numbers.first().map_or(Ok(50), |number| number.parse())?;
    let folder = tempfile::tempdir()?;
    let session = Session { folder: folder.path(), set };
    let manifest = Path::new(env!("CARGO_MANIFEST_DIR"));
    let original = load(&manifest.join("pipelines/meshes/spot_829.obj"))?.mesh;
    let mut mesh = original.clone();
    std::fs::create_dir(folder.path().join("meshes"))?;
    std::fs::write(folder.path().join("meshes/mesh.obj"), obj(&mesh))?;
    std::fs::write(folder.path().join("pipeline.toml"), "[input]\npaths = [\"meshes\"]\n")?;
    session.run(true)?;
    println!("| edit | what | from the version before | s | from nothing, s | ratio |");
    println!("|---|---|---|---|---|---|");
    let (mut ratios, mut count) = (Vec::new(), BTreeMap::<&str, usize>::new());
    for number in 0..edits {
        // Patch upon patch would make a surface that nobody would draw.
        if number % SITTING == 0 {
            mesh.clone_from(&original);
        }
        let Edit { what, mesh: edited } = edit(&mesh, SEED, number);
        mesh = edited;
        std::fs::write(folder.path().join("meshes/mesh.obj"), obj(&mesh))?;
        let (warm, took) = session.run(true)?;
        let how = session.how()?;
        let (cold, nothing) = session.run(false)?;
        let ratio = took / nothing;
        println!(
            "| {number} | {what} | {how}, {} | {took:.2} | {}, {nothing:.2} | {ratio:.2} |",
            verdict(&warm),
            verdict(&cold)
        );
        *count.entry(how).or_default() += 1;
        // What never passes took longer than this.
        ratios.push(if warm.status == Status::Verified { ratio } else { f64::INFINITY });
    }
    ratios.sort_by(f64::total_cmp);
    let median = ratios.get(ratios.len() / 2).copied().unwrap_or(f64::NAN);
    println!("\nmedian ratio {median:.3} over {edits} edits; {count:?}");
    Ok(())
}

fn verdict(mesh: &MeshReport) -> &'static str {
    match mesh.status {
        Status::Verified => "verified",
        Status::Unverified => "unverified",
        Status::Failed => "failed",
    }
}

/// A folder in which one mesh is edited.
struct Session<'a> {
    folder: &'a Path,
    set: Vec<&'a String>,
}

impl Session<'_> {
    /// The report on the mesh as it is now, and the seconds that the process took.
    fn run(&self, lineage: bool) -> Result<(MeshReport, f64), Box<dyn Error>> {
        let (own, fresh) = (self.folder.join("cache"), tempfile::tempdir()?);
        let (switch, cache, out) = if lineage {
            ("on", own.as_path(), self.folder.join("out"))
        } else {
            ("off", fresh.path(), fresh.path().join("out"))
        };
        let mut command = Command::new(env!("CARGO_BIN_EXE_chladni"));
        command.arg("run").arg(self.folder.join("pipeline.toml")).args(["--format", "json"]);
        command.arg("--out").arg(out).arg("--cache").arg(cache).args(["--lineage", switch]);
        for assignment in &self.set {
            command.arg("--set").arg(assignment);
        }
        let began = Instant::now();
        let output = command.output()?;
        let took = began.elapsed().as_secs_f64();
        let mut report: RunReport = serde_json::from_slice(&output.stdout)
            .map_err(|error| format!("{error}: {}", String::from_utf8_lossy(&output.stderr)))?;
        Ok((report.meshes.remove(0), took))
    }

    /// What became of the version before.
    fn how(&self) -> Result<&'static str, Box<dyn Error>> {
        let Ok(text) = std::fs::read(self.folder.join("out/mesh.obj/spectrum.json")) else {
            return Ok("no results");
        };
        let spectrum: Spectrum = serde_json::from_slice(&text)?;
        Ok(match spectrum.provenance.grown_from.map(|ancestor| ancestor.how) {
            Some(Inheritance::AsTheyAre) => "as they are",
            Some(Inheritance::Heads) => "heads",
            Some(Inheritance::FineTuned) => "fine-tuned",
            Some(Inheritance::WarmStart) => "warm start",
            None => "trained anew",
        })
    }
}
