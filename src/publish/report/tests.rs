//! `run.json` and the run document as text that other programs rely on, and back.

use serde_json::{Value, json};

use super::super::result::tests::spectrum;
use super::*;

pub fn record() -> RunRecord {
    RunRecord {
        schema: RunRecordSchema::V1,
        stages: vec![StageRecord { stage: "assemble".to_owned(), cached: true, seconds: 0.5 }],
        pairs: vec![PairRecord { k: 2, cached: true, seconds: 0.25 }],
        trained: 0,
        reused: 1,
        seconds: 1.5,
        work: vec![WorkRecord {
            stage: "train".to_owned(),
            part: Some(2),
            cached: true,
            fields: [("seed".to_owned(), json!(0))].into(),
        }],
    }
}

fn report() -> RunReport {
    let reason = Some(
        "outside the tolerances: k = 2; the set of eigenvalues is not known to be complete"
            .to_string(),
    );
    let finished =
        MeshReport::finished("a.obj".into(), "out/a.obj".into(), &spectrum(), reason, &record());
    let failed = MeshReport::failed("b.obj".into(), None, "the file is empty".into(), 0.0);
    RunReport::new(vec![finished, failed], 2.0)
}

#[test]
fn the_record_of_one_mesh() {
    let document: Value = serde_json::from_slice(&record().to_json()).unwrap();
    assert_eq!(
        document,
        json!({
            "schema": "chladni-mesh-run-1",
            "stages": [{ "stage": "assemble", "cached": true, "seconds": 0.5 }],
            "pairs": [{ "k": 2, "cached": true, "seconds": 0.25 }],
            "trained": 0, "reused": 1, "seconds": 1.5,
            "work": [{ "stage": "train", "part": 2, "cached": true, "fields": { "seed": 0 } }]
        })
    );
    assert_eq!(serde_json::from_slice::<RunRecord>(&record().to_json()).unwrap(), record());
}

#[test]
fn the_document_of_a_run_is_the_contract() {
    let document: Value = serde_json::from_slice(&report().to_json()).unwrap();
    assert_eq!(document["schema"], "chladni-run-1");
    assert_eq!(document["seconds"], 2.0);
    let [finished, failed] = [0, 1].map(|i| &document["meshes"][i]);
    assert_eq!(finished["path"], "a.obj");
    assert_eq!(finished["hash"], spectrum().mesh.hash.to_string());
    assert_eq!(finished["status"], "unverified");
    assert_eq!(
        finished["reason"],
        "outside the tolerances: k = 2; the set of eigenvalues is not known to be complete"
    );
    assert_eq!(finished["out"], "out/a.obj");
    assert_eq!(
        finished["eigenpairs"][1],
        json!({
            "k": 2, "lambda": 1.5, "lambda_area": 3.0, "source": "trained", "cluster": 1,
            "residual": 0.25, "rho": 0.001, "lambda_mpgd": null, "lambda_fem": 1.5,
            "angle_mpgd": null, "angle_fem": 0.5,
            "mpgd": { "iterations": 7, "stopped_by": "count" }, "verdict": "unverified",
            "cached": true, "seconds": 0.25
        })
    );
    assert_eq!(finished["eigenpairs"][0]["cached"], false, "a constant has no block");
    assert_eq!(finished["eigenpairs"][0]["seconds"], Value::Null);
    assert_eq!(
        finished["completeness"],
        json!({ "sigma": 3.0, "count": null, "found": 2, "complete": false, "cut_cluster": true })
    );
    assert_eq!(finished["repairs"]["welded_vertices"], 4);
    assert_eq!(finished["stages"][0]["stage"], "assemble");
    assert_eq!(
        *failed,
        json!({
            "path": "b.obj", "hash": null, "vertices": null, "area": null, "status": "failed",
            "reason": "the file is empty", "out": null, "eigenpairs": [], "completeness": null,
            "repairs": null, "stages": [], "trained": 0, "reused": 0, "seconds": 0.0
        })
    );
}

#[test]
fn the_document_of_a_run_reads_back() {
    let read: RunReport = serde_json::from_slice(&report().to_json()).unwrap();
    assert!(read.meshes[0].eigenpairs[1].pair.lambda_mpgd.is_nan());
    assert_eq!(read.meshes[0].hash, report().meshes[0].hash);
    assert_eq!(read.to_json(), report().to_json());
}
