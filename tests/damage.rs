//! A cache directory that a disk has damaged anywhere: runs on it end with the same bytes as on a sound one, without a failure,
//! and say so where results were lost.
//!
//! All 200 cases: `cargo test --test damage -- --include-ignored`.

mod common;

use std::fs;
use std::path::{Path, PathBuf};

use chladni::flow::events::How;
use common::{FEM, Workspace, text};
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};

/// What befalls one file.
#[derive(Debug, Clone, Copy)]
enum Damage {
    Flip { byte: usize, bit: u8 },
    Cut { to: usize },
    Delete,
}

impl Damage {
    fn of_a_file(rng: &mut StdRng, length: usize) -> Self {
        match rng.random_range(0..3) {
            0 if length > 0 => {
                Self::Flip { byte: rng.random_range(0..length), bit: rng.random_range(0..8) }
            }
            1 if length > 0 => Self::Cut { to: rng.random_range(0..length) },
            _ => Self::Delete,
        }
    }

    fn befall(self, file: &Path) {
        let mut bytes = fs::read(file).unwrap();
        match self {
            Self::Flip { byte, bit } => bytes[byte] ^= 1 << bit,
            Self::Cut { to } => bytes.truncate(to),
            Self::Delete => return fs::remove_file(file).unwrap(),
        }
        fs::write(file, bytes).unwrap();
    }
}

/// Files below a folder, in order.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for item in fs::read_dir(folder).unwrap() {
            let path = item.unwrap().path();
            if path.is_dir() { folders.push(path) } else { found.push(path) }
        }
    }
    found.sort();
    found
}

fn copy(from: &Path, to: &Path) {
    for file in files(from) {
        let target = to.join(file.strip_prefix(from).unwrap());
        fs::create_dir_all(target.parent().unwrap()).unwrap();
        fs::copy(file, target).unwrap();
    }
}

/// Runs after each of these cases of damage; how often results were lost.
fn withstands(cases: std::ops::Range<u64>) {
    let workspace = Workspace::new(FEM);
    assert_eq!(workspace.report(&[]).0, 0);
    // A second opening leaves a snapshot beside the log.
    assert_eq!(workspace.report(&["--set", "train.k=5"]).0, 0);
    assert_eq!(workspace.report(&[]).0, 0);
    let sound = workspace.path("sound");
    copy(&workspace.path("cache"), &sound);
    let results = || {
        ["spectrum.json", "eigen.npz"]
            .map(|name| fs::read(workspace.path("out/sphere.obj").join(name)).unwrap())
    };
    let expected = results();
    let mut lost = 0;
    for case in cases {
        let mut rng = StdRng::seed_from_u64(case);
        fs::remove_dir_all(workspace.path("cache")).unwrap();
        fs::remove_dir_all(workspace.path("out")).unwrap();
        copy(&sound, &workspace.path("cache"));
        let files = files(&workspace.path("cache"));
        let file = &files[rng.random_range(0..files.len())];
        let damage = Damage::of_a_file(&mut rng, fs::metadata(file).unwrap().len() as usize);
        damage.befall(file);

        let output = workspace.run(&[]).output().unwrap();
        let case = format!("case {case}, {damage:?} of {}: {}", file.display(), text(&output));
        assert_eq!(output.status.code(), Some(0), "{case}");
        assert!(results() == expected, "{case}");
        if workspace.events().iter().any(|event| event.how == How::Computed) {
            assert!(text(&output).contains("WARN"), "{case}");
            lost += 1;
        }
        // And the cache is whole again.
        let output = workspace.run(&[]).output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{case}");
        let last = workspace.events().split_off(workspace.events().len() / 2);
        assert!(last.iter().all(|event| event.how == How::Reused), "{case}");
    }
    assert!(lost > 0, "no case has hit a result");
}

#[test]
fn forty_cases_of_damage_cost_no_result() {
    withstands(0..40);
}

#[test]
#[ignore = "twenty seconds more of the same"]
fn the_other_cases_of_two_hundred_cost_no_result() {
    withstands(40..200);
}
