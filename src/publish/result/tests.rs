//! `spectrum.json` as text that other programs rely on, and back.

use serde_json::json;

use super::*;

fn measured(lambda: f64, mpgd: Option<mpgd::Run>) -> PairCertificate {
    PairCertificate {
        lambda,
        cluster: 1,
        residual: 0.25,
        rho: 0.001,
        lambda_fem: lambda,
        lambda_mpgd: f64::NAN,
        angle_fem: 0.5,
        angle_mpgd: f64::INFINITY,
        mpgd,
    }
}

pub fn spectrum() -> Spectrum {
    let hash = crate::mesh::sample::icosphere(0).hash();
    let run = mpgd::Run {
        iterations: 7,
        change: 1e-9,
        residual: 0.1,
        stopped_by: mpgd::StoppedBy::Count,
    };
    Spectrum {
        schema: SpectrumSchema::V1,
        status: Verdict::Unverified,
        mesh: MeshSummary {
            hash,
            vertices: 12,
            faces: 20,
            components: 1,
            boundary_loops: 0,
            euler: 2,
            area: 2.0,
        },
        eigenpairs: vec![
            Eigenpair::new(1, Source::Constant, Verdict::Verified, &measured(0.0, None), Area(2.0)),
            Eigenpair::new(
                2,
                Source::Trained,
                Verdict::Unverified,
                &measured(1.5, Some(run)),
                Area(2.0),
            ),
        ],
        orthonormality: 1e-15,
        completeness: Some(Completeness {
            sigma: 3.0,
            count: None,
            found: 2,
            complete: false,
            cut_cluster: true,
        }),
        quality: Some(TriangleQuality {
            min_angle_degrees: 31.5,
            negative_weights: 2,
            non_delaunay_edges: 1,
            mollification: None,
            flips: None,
        }),
        repairs: RepairCounts { welded_vertices: 4, ..RepairCounts::default() },
        provenance: Provenance {
            chladni: "0.1.0".to_owned(),
            parameters: json!({ "train": { "k": 2 } }),
            grown_from: None,
        },
    }
}

#[test]
fn the_document_is_the_contract() {
    let spectrum = spectrum();
    let document: serde_json::Value = serde_json::from_slice(&spectrum.to_json()).unwrap();
    assert_eq!(
        document,
        json!({
            "schema": "chladni-spectrum-1",
            "status": "unverified",
            "mesh": {
                "hash": spectrum.mesh.hash.to_string(), "vertices": 12, "faces": 20,
                "components": 1, "boundary_loops": 0, "euler": 2, "area": 2.0
            },
            "eigenpairs": [
                {
                    "k": 1, "lambda": 0.0, "lambda_area": 0.0, "source": "constant", "cluster": 1,
                    "residual": 0.25, "rho": 0.001, "lambda_mpgd": null, "lambda_fem": 0.0,
                    "angle_mpgd": null, "angle_fem": 0.5, "mpgd": null, "verdict": "verified"
                },
                {
                    "k": 2, "lambda": 1.5, "lambda_area": 3.0, "source": "trained", "cluster": 1,
                    "residual": 0.25, "rho": 0.001, "lambda_mpgd": null, "lambda_fem": 1.5,
                    "angle_mpgd": null, "angle_fem": 0.5,
                    "mpgd": { "iterations": 7, "stopped_by": "count" }, "verdict": "unverified"
                }
            ],
            "orthonormality": 1e-15,
            "completeness": {
                "sigma": 3.0, "count": null, "found": 2, "complete": false, "cut_cluster": true
            },
            "quality": {
                "min_angle_degrees": 31.5, "negative_weights": 2, "non_delaunay_edges": 1,
                "mollification": null, "flips": null
            },
            "repairs": {
                "welded_vertices": 4, "collapsed_faces": 0, "zero_area_faces": 0,
                "duplicate_faces": 0, "unreferenced_vertices": 0, "polygons": 0, "left_out": 0
            },
            "provenance": { "chladni": "0.1.0", "parameters": { "train": { "k": 2 } } }
        })
    );
}

#[test]
fn null_reads_back_as_not_a_number_and_the_rest_as_it_was() {
    let written = spectrum();
    let read: Spectrum = serde_json::from_slice(&written.to_json()).unwrap();
    assert!(read.eigenpairs[1].lambda_mpgd.is_nan() && read.eigenpairs[1].angle_mpgd.is_nan());
    assert_eq!(read.mesh, written.mesh);
    assert_eq!(read.to_json(), written.to_json());
}

#[test]
fn a_missing_number_and_another_format_are_refused() {
    let text = String::from_utf8(spectrum().to_json()).unwrap();
    let refused = |text: &str| serde_json::from_str::<Spectrum>(text).unwrap_err().to_string();
    let missing = text.replacen("\"rho\": 0.001,", "", 1);
    assert!(refused(&missing).contains("missing field `rho`"));
    let newer = text.replace("chladni-spectrum-1", "chladni-spectrum-2");
    assert!(refused(&newer).contains("`chladni-spectrum-2`, expected `chladni-spectrum-1`"));
    let damaged = text.replace("\"hash\": \"", "\"hash\": \"x");
    assert!(serde_json::from_str::<Spectrum>(&damaged).is_err());
}

#[test]
fn a_summary_counts_what_ingest_saw() {
    let obj = b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 9 9 9\nf 1 2 3 4\n";
    let ingested = crate::mesh::load_bytes("square.obj".as_ref(), obj).unwrap();
    let summary = MeshSummary::from(&ingested);
    assert_eq!((summary.vertices, summary.faces, summary.components), (4, 2, 1));
    assert_eq!((summary.boundary_loops, summary.euler, summary.area), (1, 1, 1.0));
    assert_eq!(
        ingested.repairs.counts(),
        RepairCounts { unreferenced_vertices: 1, polygons: 1, ..RepairCounts::default() }
    );
}
