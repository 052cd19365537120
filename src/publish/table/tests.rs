//! The text of small runs, letter by letter.

use super::super::result::{
    Ancestor, Eigenpair, Inheritance, MpgdRun, RepairCounts, Source, Verdict,
};
use super::*;
use crate::mesh::sample::icosphere;

fn pair(k: usize, lambda: f64, stopped_by: Option<StoppedBy>) -> PairReport {
    let (source, seconds) = match stopped_by {
        Some(_) => (Source::Trained, 3.256),
        None => (Source::Constant, f64::NAN),
    };
    PairReport {
        pair: Eigenpair {
            k,
            lambda,
            lambda_refined: None,
            lambda_area: 12.0 * lambda,
            source,
            cluster: k - 1,
            residual: 0.1,
            rho: 0.00123,
            lambda_mpgd: lambda * 1.01,
            lambda_fem: lambda * 0.999,
            angle_mpgd: 0.5,
            angle_fem: 0.0119,
            mpgd: stopped_by.map(|stopped_by| MpgdRun { iterations: 100, stopped_by }),
            closed_form: None,
            verdict: Verdict::Verified,
        },
        cached: false,
        seconds,
    }
}

fn sphere() -> MeshReport {
    MeshReport {
        path: "meshes/sphere.obj".to_owned(),
        hash: Some(icosphere(1).hash()),
        vertices: Some(42),
        area: Some(11.914),
        status: Status::Verified,
        reason: None,
        out: Some("out/sphere.obj".to_owned()),
        repairs: Some(RepairCounts::default()),
        eigenpairs: vec![
            pair(1, -3e-15, None),
            pair(2, 2.0123456, Some(StoppedBy::Tolerance)),
            pair(3, 12.3456789, Some(StoppedBy::Tolerance)),
        ],
        completeness: Some(Completeness {
            sigma: 13.5,
            count: Some(3),
            found: 3,
            complete: true,
            cut_cluster: false,
        }),
        grown_from: None,
        trained: 2,
        reused: 0,
        stages: Vec::new(),
        seconds: 7.5,
    }
}

#[test]
fn what_comes_from_a_previous_version_says_so() {
    let mesh = icosphere(2).hash();
    let mut grown = sphere();
    grown.grown_from = Some(Ancestor { mesh, how: Inheritance::Heads });
    for pair in &mut grown.eigenpairs {
        (pair.pair.source, pair.cached) = (Source::Finetuned, true);
    }
    let text = mesh_table(&grown);
    let line = "trunks of a previous version, with heads solved on this mesh, ";
    assert!(text.contains(&format!("{line}{:.12}\n", mesh.to_string())), "{text}");
    assert!(text.contains("finetuned") && !text.contains("verified  reused"), "{text}");
}

#[test]
fn a_run_with_a_good_a_doubtful_and_a_failed_mesh() {
    let mut doubtful = sphere();
    doubtful.path = "meshes/odd\u{1b}.obj".to_owned();
    doubtful.status = Status::Unverified;
    doubtful.reason = Some("pair 2: angle to the reference".to_owned());
    doubtful.eigenpairs = vec![pair(1, 0.0, None), pair(2, 123456.7, Some(StoppedBy::Count))];
    doubtful.eigenpairs[1].cached = true;
    let repairs = RepairCounts { duplicate_faces: 8, polygons: 2, ..RepairCounts::default() };
    doubtful.repairs = Some(repairs);
    doubtful.eigenpairs[1].pair.verdict = Verdict::Unverified;
    doubtful.eigenpairs[1].pair.angle_fem = f64::NAN;
    let counted = doubtful.completeness.as_mut().unwrap();
    (counted.found, counted.complete) = (2, false);
    (doubtful.trained, doubtful.reused) = (0, 1);
    let failed = MeshReport::failed(
        "meshes/empty.obj".to_owned(),
        None,
        "meshes/empty.obj: the file is empty; export or copy it again".to_owned(),
        0.001,
    );
    let report = RunReport::new(vec![sphere(), doubtful, failed], 15.25);
    let expected = "\
meshes/sphere.obj  169fe89fc651  n = 42  area 11.9140
k        λ  λ M-PGD    λ FEM   angle       ρ  verdict   source       s
───────────────────────────────────────────────────────────────────────
1        0        0        0  1.2e-2  1.2e-3  verified  constant     –
2  2.01235  2.03247  2.01033  1.2e-2  1.2e-3  verified  trained   3.26
3  12.3457  12.4691  12.3333  1.2e-2  1.2e-3  verified  trained   3.26
complete: 3 eigenvalues below σ = 13.5000, 3 found
2 trained, 0 reused; 7.50 s

meshes/odd\\u{1b}.obj  169fe89fc651  n = 42  area 11.9140
k       λ  λ M-PGD   λ FEM   angle       ρ  verdict     source       s
───────────────────────────────────────────────────────────────────────
1       0       0        0  1.2e-2  1.2e-3  verified    constant     –
2  123457  124691*  123333       –  1.2e-3  unverified  reused    3.26
mended: 8 duplicate faces dropped, 2 polygons triangulated
* M-PGD has not converged there, or not for a pair before; its opinion does not count
not complete: 3 eigenvalues below σ = 13.5000, 2 found
unverified: pair 2: angle to the reference
0 trained, 1 reused; 7.50 s

meshes/empty.obj
failed: meshes/empty.obj: the file is empty; export or copy it again

3 meshes: 1 verified, 1 unverified, 1 failed; 2 trained, 1 reused; 15.25 s
";
    assert_eq!(run_table(&report), expected);
}

#[test]
fn completeness_in_words() {
    let counted = |count, found, complete, cut_cluster| {
        completeness(&Completeness { sigma: 1.5e-7, count, found, complete, cut_cluster })
    };
    assert_eq!(
        counted(Some(1), 1, true, false),
        "complete: 1 eigenvalue below σ = 1.50000e-7, 1 found"
    );
    assert_eq!(
        counted(Some(9), 8, true, true),
        "complete: 9 eigenvalues below σ = 1.50000e-7, 8 found; k = 8 cuts a cluster and leaves 1 of it out"
    );
    assert_eq!(
        counted(None, 8, false, false),
        "not known to be complete: the eigenvalues below σ = 1.50000e-7 cannot be counted in double \
         precision, 8 found"
    );
}

#[test]
fn an_interrupted_mpgd_is_marked_and_a_value_it_never_reached_is_not() {
    let mut mesh = sphere();
    mesh.eigenpairs[1].pair.mpgd =
        Some(MpgdRun { iterations: 3, stopped_by: StoppedBy::Cancelled });
    mesh.eigenpairs[2].pair.mpgd = None;
    mesh.eigenpairs[2].pair.lambda_mpgd = f64::NAN;
    let text = mesh_table(&mesh);
    assert!(text.contains(" 2.03247* "), "{text}");
    assert!(text.contains(" – ") && !text.contains("–*"), "{text}");
}

#[test]
fn six_digits_whatever_the_size() {
    let cases = [
        (0.0, "0"),
        (1.0, "1.00000"),
        (-12.5, "-12.5000"),
        (999_999.0, "999999"),
        (1e6, "1.00000e6"),
        (0.001, "0.00100000"),
        (0.00099, "9.90000e-4"),
        (f64::INFINITY, "–"),
    ];
    for (value, text) in cases {
        assert_eq!(six_digits(value), text);
    }
}

#[test]
fn predictions_that_were_held_against_nothing_show_no_measures() {
    let mut mesh = sphere();
    mesh.completeness = None;
    for report in &mut mesh.eigenpairs[1..] {
        report.pair.source = Source::Predicted;
    }
    for report in &mut mesh.eigenpairs {
        report.pair.lambda_fem = f64::NAN;
        report.pair.mpgd = None;
    }
    let heads = |mesh: &MeshReport| {
        let table = mesh_table(mesh);
        let head = table.lines().nth(1).unwrap().split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(table.contains("predicted") && !table.contains("complete"), "{table}");
        head
    };
    assert_eq!(heads(&mesh), "k λ λ · area source");
    mesh.eigenpairs[1].pair.lambda_refined = Some(2.0);
    assert_eq!(heads(&mesh), "k λ λ refined λ · area source");
}
