//! After anything that writers do, the results are those of a fresh run.

use std::collections::BTreeMap;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use chladni::publish::result::Spectrum;
use rand::{Rng, SeedableRng};

use crate::common::{Workspace, obj};
use crate::{FEM, Watched, ellipsoid};

/// So many operations of a writer who does everything that writers do, drawn from a seed.
fn chaos(folder: &Path, operations: u64, seed: u64) {
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
fn results(out: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut folders = vec![out.to_owned()];
    while let Some(folder) = folders.pop() {
        // What goes away while it is read is not there.
        for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else if ["spectrum.json", "eigen.npz", "eigen.ply"].iter().any(|n| path.ends_with(n))
            {
                let Ok(bytes) = fs::read(&path) else { continue };
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
        let is_it = |ours: &BTreeMap<PathBuf, Vec<u8>>| match lineage {
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
