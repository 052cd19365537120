//! The main job on a real mesh: the pipeline that is shipped, as the README runs it.

use std::path::Path;
use std::process::Command;

use chladni::publish::report::RunReport;
use chladni::publish::result::Source;

fn run(folder: &Path, arguments: &[&str]) -> (i32, RunReport) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_chladni"));
    command.args(["run", "pipelines/spot.toml", "--format", "json"]).args(arguments);
    command.arg("--out").arg(folder.join("out")).arg("--cache").arg(folder.join("cache"));
    let output = command.output().unwrap();
    (output.status.code().unwrap(), serde_json::from_slice(&output.stdout).unwrap())
}

#[test]
fn spot_is_predicted_within_one_per_cent_and_a_twentieth_of_a_radian() {
    let folder = tempfile::tempdir().unwrap();
    let (code, report) = run(folder.path(), &[]);
    let mesh = &report.meshes[0];
    assert_eq!((code, mesh.trained, mesh.reused), (0, 7, 0), "{:?}", mesh.reason);
    assert!(mesh.completeness.as_ref().unwrap().complete);
    for pair in mesh.eigenpairs.iter().map(|report| &report.pair).skip(1) {
        assert_eq!(pair.source, Source::Trained);
        for reference in [pair.lambda_fem, pair.lambda_mpgd] {
            assert!((pair.lambda / reference - 1.0).abs() < 0.01, "{pair:?}");
        }
        assert!(pair.angle_fem < 0.05 && pair.angle_mpgd < 0.05, "{pair:?}");
        // ρ is a bound: it can only be larger than what it bounds.
        let distance = (pair.lambda - pair.lambda_fem).abs();
        assert!(distance <= pair.rho * (pair.lambda + pair.lambda_fem), "{pair:?}");
    }
    let (code, again) = run(folder.path(), &[]);
    assert_eq!((code, again.meshes[0].trained, again.meshes[0].reused), (0, 0, 7));
    let (_, more) = run(folder.path(), &["--set", "train.k=10"]);
    assert_eq!((more.meshes[0].trained, more.meshes[0].reused), (2, 7));
}
