//! A file with variants of a pipeline: one command runs them all, goes on where it was stopped, and compares them.

mod common;

use std::path::Path;

use chladni::flow::events::How;
use chladni::pipeline::sweep::{Asked, Effort, Sweep};
use chladni::publish::plan::SweepPlan;
use chladni::publish::sweep::{Row, SweepReport};
use common::{QUICK, Workspace, chladni, events, text};

fn two() -> String {
    let sweep = "
[sweep]
title = \"Two widths\"
seeds = [3, 4]
columns = [{ name = \"angle\", what = \"angle\", k = [2, 4] }, { name = \"λ2\", what = \"lambda\", k = 2, exact = 2.0 }]
[[variant]]
name = \"narrow\"
printed = { \"λ2\" = 0.0 }
[[variant]]
name = \"by the paper\"
train = { recipe = \"paper\", epochs = 2 }
seeds = [3]
";
    QUICK.replace("steps = 4\n", "") + sweep + "[quick]\ntrain = { steps = 2, epochs = 1, k = 2 }"
}

fn sweep(workspace: &Workspace, arguments: &[&str]) -> (i32, SweepReport) {
    let output = workspace.run(arguments).args(["--format", "json"]).output().unwrap();
    let report = serde_json::from_slice(&output.stdout)
        .unwrap_or_else(|error| panic!("{error}: {}", text(&output)));
    (output.status.code().unwrap(), report)
}

#[test]
fn one_command_runs_all_variants_and_a_second_one_only_what_is_missing() {
    let workspace = Workspace::new(&two());
    let (_, part) = sweep(&workspace, &["--variant", "narrow", "--set", "train.steps=4"]);
    assert_eq!((part.cases.len(), part.table.len()), (2, 2));

    let (_, all) = sweep(&workspace, &["--variant", "by the paper", "--variant", "narrow"]);
    let ran: Vec<_> = all.cases.iter().map(|case| (case.variant.as_str(), case.seed)).collect();
    assert_eq!(ran, [("narrow", 3), ("narrow", 4), ("by the paper", 3)]);
    let trained = |report: &SweepReport| -> Vec<usize> {
        report.cases.iter().map(|case| case.run.meshes[0].trained).collect()
    };
    assert_eq!(trained(&all), [3, 3, 3]);
    let (_, again) = sweep(&workspace, &[]);
    assert_eq!(trained(&again), [0, 0, 0]);
    assert_eq!(again.table, all.table);

    let rows = &all.table;
    assert_eq!(rows.len(), 4);
    assert!(rows.iter().all(|row| row.median.is_some()), "{rows:?}");
    assert_eq!(rows[1].printed, Some(0.0));
    assert!(rows[1].verdict.is_some() && (rows[1].fem.unwrap() - 2.0).abs() < 0.1, "{rows:?}");
    let out = |name: &str| workspace.path("out").join(name);
    for folder in ["narrow/seed-3", "narrow/seed-4", "by-the-paper/seed-3"] {
        assert!(out(folder).join("sphere.obj/spectrum.json").is_file(), "{folder}");
        let log = events(&out(folder).join("events.jsonl"));
        assert!(log.iter().any(|event| event.how == How::Computed), "{folder}");
    }
    let kept: SweepReport =
        serde_json::from_slice(&std::fs::read(out("sweep.json")).unwrap()).unwrap();
    assert_eq!(kept.table, all.table);
    let table = std::fs::read_to_string(out("table.md")).unwrap();
    assert!(table.starts_with("# Two widths\n") && table.contains("| by the paper | λ2 |"));
}

#[test]
fn what_a_sweep_would_do_is_said_variant_by_variant() {
    let workspace = Workspace::new(&two());
    sweep(&workspace, &["--quick", "--variant", "narrow"]);
    let output = workspace.run(&["--quick", "--dry-run", "--format", "json"]).output().unwrap();
    let plan: SweepPlan = serde_json::from_slice(&output.stdout).unwrap();
    let open: Vec<_> = plan
        .cases
        .iter()
        .map(|case| {
            let work = &case.plan.meshes[0].work;
            let trains = work.iter().filter(|work| work.stage == "train" && !work.cached).count();
            (case.variant.as_str(), case.seed, trains)
        })
        .collect();
    assert_eq!(open, [("narrow", 3, 0), ("by the paper", 3, 1)]);
    // The status of a sweep is that of its last run.
    let folder = workspace.path("out");
    let status = text(&chladni(&["status", "--out", folder.to_str().unwrap()]));
    assert!(status.starts_with("narrow/seed-3: finished"), "{status}");
    let human = text(&workspace.run(&["--quick", "--dry-run"]).output().unwrap());
    assert!(human.contains("by the paper, seed 3"), "{human}");
}

#[test]
fn the_terminal_shows_every_run_and_then_the_table() {
    let workspace = Workspace::new(&two());
    let output = workspace.run(&["--quick"]).output().unwrap();
    let shown = text(&output);
    for part in ["[1/2] narrow, seed 3: 1 mesh: ", "[2/2] by the paper, seed 3", "Two widths\n"] {
        assert!(shown.contains(part), "{shown}");
    }
    let unknown = workspace.run(&["--variant", "wide"]).output().unwrap();
    assert_eq!(unknown.status.code(), Some(2));
    let said = text(&unknown);
    assert!(said.contains("--variant \"wide\"") && said.contains("\"narrow\""), "{said}");
    let pipeline = workspace.path("pipeline.toml");
    let watched = workspace.path("meshes");
    let arguments = ["watch", watched.to_str().unwrap(), "--pipeline", pipeline.to_str().unwrap()];
    let refused = chladni(&[&arguments[..], &["--once"]].concat());
    assert_eq!(refused.status.code(), Some(2));
    assert!(text(&refused).contains("belongs to a sweep"), "{}", text(&refused));
}

/// The sweeps of the paper's experiments, by the names of their files.
fn papers() -> Vec<std::path::PathBuf> {
    let mut files: Vec<_> = std::fs::read_dir("pipelines/paper")
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "toml"))
        .collect();
    files.sort();
    files
}

#[test]
fn the_papers_experiments_load_and_every_column_can_have_a_value() {
    let names: Vec<String> =
        papers().iter().map(|path| path.file_stem().unwrap().display().to_string()).collect();
    let figures = ["fig3", "fig4", "fig5", "fig6", "fig7", "fig8-horse", "fig8", "fig9"];
    assert_eq!(names, [&figures[..], &["table1", "table2", "table3"]].concat());
    for path in papers() {
        for effort in [Effort::Full, Effort::Quick] {
            let Sweep { comparison, cases } =
                Sweep::load(&path, Asked { effort, ..Asked::default() }).unwrap();
            let comparison = comparison.unwrap();
            for case in &cases {
                for column in &comparison.columns {
                    // Of 162 vertices, where it is a share.
                    let k = case.pipeline.train.k.of(162);
                    assert!(column.k.ends().1 <= k, "{}: {}", path.display(), column.name);
                }
            }
        }
    }
}

/// A quick rehearsal of every experiment of the paper, so that none rots. The horse is not here.
#[test]
fn the_papers_experiments_run() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name).display().to_string();
    for file in papers() {
        let name = file.file_stem().unwrap().display().to_string();
        if name == "fig8-horse" {
            continue;
        }
        let (out, cache) = (path(&name), path("cache"));
        let file = file.display().to_string();
        let arguments = ["run", &file, "--quick", "--out", &out, "--cache", &cache];
        let output = chladni(&arguments);
        // Hardly trained, hardly anything is verified.
        assert_eq!(output.status.code(), Some(4), "{name}: {}", text(&output));
        let report = std::fs::read(Path::new(&out).join("sweep.json")).unwrap();
        let report: SweepReport = serde_json::from_slice(&report).unwrap();
        for row in report.table {
            let expected = !row.variant.starts_with("Ben-Shaul");
            // M-PGD does not get everywhere in fifty steps.
            let has_value = row.median.is_some() || row.column.contains("M-PGD");
            assert_eq!(has_value, expected, "{name}: {row:?}");
        }
    }
}

/// Why lumped masses are the default (docs/concepts/operators.md): their λ are closer, although consistent ones have the closer
/// eigenfunctions on irregular triangles.
#[test]
fn each_kind_of_masses_is_better_at_something() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name).display().to_string();
    for (surface, farther) in [("square", 2.0), ("sphere", 1.0)] {
        let file = format!("pipelines/masses/{surface}.toml");
        let (out, cache) = (path(surface), path("cache"));
        let output = chladni(&["run", &file, "--out", &out, "--cache", &cache]);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output));
        let report = std::fs::read(dir.path().join(surface).join("sweep.json")).unwrap();
        let report: SweepReport = serde_json::from_slice(&report).unwrap();
        let of = |variant: &str, what: &str| -> Vec<f64> {
            let wanted = |row: &&Row| row.variant == variant && row.column.ends_with(what);
            report.table.iter().filter(wanted).map(|row| row.median.unwrap()).collect()
        };
        let errors = of("lumped", "error of λ").into_iter().zip(of("consistent", "error of λ"));
        assert!(errors.clone().count() == 3 && errors.clone().all(|(l, c)| 1.2 * l < c));
        let mut voronoi = of("voronoi", "error of λ").into_iter().zip(of("lumped", "error of λ"));
        assert!(voronoi.all(|(v, l)| 0.9 * l < v && v < l), "a few per cent better");
        let coarse = |variant| of(variant, "MSE")[0];
        assert!(coarse("lumped") > farther * coarse("consistent"), "{surface}");
    }
}
