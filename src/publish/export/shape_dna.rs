//! `shape_dna.csv` and `shape_dna_distances.csv`: the ShapeDNA of all meshes of a run, and how far they are from one another.
//!
//! A line a mesh, in the order of the run. Those without results are there too, with their reason and no numbers; they have
//! no distances.

use std::path::Path;

use super::csv::{Table, number};
use crate::descriptors::shape_dna::{Normalisation, distances, shape_dna};
use crate::publish::atomic::{PublishError, remove, write_if_changed};
use crate::publish::report::{MeshReport, RunReport, Status};

const FINGERPRINTS: &str = "shape_dna.csv";
const DISTANCES: &str = "shape_dna_distances.csv";

/// Writes both files into the output folder of a run.
///
/// # Errors
/// When the system refuses.
pub fn write(out: &Path, report: &RunReport) -> Result<(), PublishError> {
    write_if_changed(&out.join(FINGERPRINTS), fingerprints(report).as_bytes())?;
    write_if_changed(&out.join(DISTANCES), distance_table(report).as_bytes())?;
    Ok(())
}

/// Removes both files of an earlier run that was asked for them.
///
/// # Errors
/// When the system refuses.
pub fn remove_files(out: &Path) -> Result<(), PublishError> {
    [FINGERPRINTS, DISTANCES].iter().try_for_each(|name| remove(&out.join(name)))
}

/// λ times area of what is published of a mesh: of refined pairs, where there are any.
fn of(mesh: &MeshReport) -> Option<Vec<f64>> {
    let pairs = mesh.eigenpairs.iter().map(|report| &report.pair);
    let values: Vec<f64> = pairs.map(|pair| pair.lambda_refined.unwrap_or(pair.lambda)).collect();
    Some(shape_dna(&values, Normalisation::Area(mesh.area?)))
}

fn fingerprints(report: &RunReport) -> String {
    let k = report.meshes.iter().map(|mesh| mesh.eigenpairs.len()).max().unwrap_or(0);
    let mut table = Table::default();
    let first = ["mesh", "status", "reason", "vertices", "area"].map(String::from);
    table.line(first.into_iter().chain((1..=k).map(|k| format!("lambda_area_{k}"))));
    for mesh in &report.meshes {
        let status = match mesh.status {
            Status::Verified => "verified",
            Status::Unverified => "unverified",
            Status::Failed => "failed",
        };
        let first = [
            mesh.path.clone(),
            status.into(),
            mesh.reason.clone().unwrap_or_default(),
            mesh.vertices.map(|n| n.to_string()).unwrap_or_default(),
            number(mesh.area.unwrap_or(f64::NAN)),
        ];
        let mut values = of(mesh).unwrap_or_default();
        values.resize(k, f64::NAN);
        table.line(first.into_iter().chain(values.into_iter().map(number)));
    }
    table.into_text()
}

fn distance_table(report: &RunReport) -> String {
    let (names, shapes): (Vec<String>, Vec<Vec<f64>>) =
        report.meshes.iter().filter_map(|mesh| Some((mesh.path.clone(), of(mesh)?))).unzip();
    let mut table = Table::default();
    table.line(["mesh".to_owned()].into_iter().chain(names.iter().cloned()));
    for (name, row) in names.iter().zip(distances(&shapes)) {
        table.line([name.clone()].into_iter().chain(row.into_iter().map(number)));
    }
    table.into_text()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::publish::report::tests::record;
    use crate::publish::result::tests::spectrum;

    #[test]
    fn every_mesh_has_a_line_and_those_with_results_have_distances() {
        let finished = |name: &str, lambda: f64| {
            let mut spectrum = spectrum();
            spectrum.mesh.area = 2.0;
            spectrum.eigenpairs.truncate(2);
            spectrum.eigenpairs[0].lambda = 0.0;
            spectrum.eigenpairs[1].lambda = 9.0;
            spectrum.eigenpairs[1].lambda_refined = Some(lambda);
            MeshReport::finished(name.into(), "out".into(), &spectrum, None, &record())
        };
        let failed = MeshReport::failed("b.obj".into(), None, "line 3, face 1".into(), 0.0);
        let meshes = vec![finished("a.obj", 1.5), failed, finished("c.obj", 4.0)];
        let report = RunReport::new(meshes, 1.0);
        let text = fingerprints(&report);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], "mesh,status,reason,vertices,area,lambda_area_1,lambda_area_2");
        assert!(lines[1].starts_with("a.obj,") && lines[1].ends_with(",2.0,0.0,3.0"), "{text}");
        assert_eq!(lines[2], "b.obj,failed,\"line 3, face 1\",,,,");
        let expected = "mesh,a.obj,c.obj\na.obj,0.0,5.0\nc.obj,5.0,0.0\n";
        assert_eq!(distance_table(&report), expected);
    }
}
