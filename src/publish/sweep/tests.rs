//! What a table of a sweep holds.

use super::super::report::MeshReport;
use super::super::report::tests::record;
use super::super::result::tests::spectrum;
use super::*;
use crate::pipeline::sweep::{Described, Places};

/// A run over two meshes, whose learned second eigenfunction has these errors; FEM's has half of them.
fn run(errors: [f64; 2]) -> RunReport {
    let mesh = |name: &str, error: f64| {
        let mut spectrum = spectrum();
        let off = |mse: f64| FromFormula { angle: mse.sqrt(), mse, mse_euclidean: mse / 9.0 };
        spectrum.eigenpairs[1].closed_form = Some(AgainstFormula {
            lambda: 1.25,
            own: off(error),
            fem: Some(off(error / 2.0)),
            mpgd: None,
        });
        MeshReport::finished(name.into(), "out".into(), &spectrum, None, &record())
    };
    RunReport::new(vec![mesh("square-9.ply", errors[0]), mesh("square-10.ply", errors[1])], 1.0)
}

fn case(seed: u64, errors: [f64; 2]) -> CaseReport {
    CaseReport { variant: "a".into(), seed, out: "out".into(), run: run(errors) }
}

fn column(what: Quantity, mesh: &str) -> Column {
    let (name, k) = ("error".to_string(), Places::One(2));
    Column { name, what, of: Whose::Own, k, mesh: mesh.into(), exact: None }
}

fn one(column: Column, printed: f64, cases: Vec<CaseReport>) -> Row {
    let printed = [(column.name.clone(), printed)].into();
    let variants = vec![Described { name: "a".into(), printed }];
    let comparison = Comparison { title: "A".into(), columns: vec![column], variants };
    let mut rows = SweepReport::new(&comparison, cases, 0.0).table;
    assert_eq!(rows.len(), 1);
    rows.remove(0)
}

#[test]
fn a_cell_is_the_median_over_seeds_of_the_mean_over_meshes_beside_fem_and_the_printed_value() {
    let cases = || vec![case(0, [4.0, 2.0]), case(1, [1.0, 1.0]), case(2, [9.0, 9.0])];
    let row = one(column(Quantity::Mse, ""), 1.0, cases());
    assert_eq!((row.seeds, row.median, row.range), (3, Some(3.0), Some([1.0, 9.0])));
    assert_eq!((row.fem, row.verdict), (Some(1.5), Some(Outcome::Reproduced)));
    assert_eq!(one(column(Quantity::Mse, ""), 3.0, cases()).verdict, Some(Outcome::Surpassed));
    assert_eq!(one(column(Quantity::Mse, ""), 0.9, cases()).verdict, Some(Outcome::NotReproduced));
    assert_eq!(one(column(Quantity::Mse, "-10."), 3.0, cases()).median, Some(2.0));
    assert_eq!(one(column(Quantity::Mse, "sphere"), 3.0, cases()).median, None);
    let rmse = one(column(Quantity::Rmse, ""), 3.0, cases());
    assert_eq!(rmse.range, Some([1.0, 3.0]), "means of roots");
    let euclidean = one(column(Quantity::MseEuclidean, "-9."), 3.0, cases());
    assert_eq!(euclidean.range, Some([1.0 / 9.0, 1.0]));
}

#[test]
fn an_eigenvalue_is_judged_by_its_distance_from_the_exact_one() {
    let lambda = column(Quantity::Lambda, "");
    // 1.5 here.
    let exact = |exact| Column { exact, ..lambda.clone() };
    let verdict = |column, printed| one(column, printed, vec![case(0, [1.0, 1.0])]).verdict;
    assert_eq!(verdict(exact(None), 2.0), None, "nobody knows which is better");
    assert_eq!(verdict(exact(Some(1.4)), 2.0), Some(Outcome::Surpassed));
    assert_eq!(verdict(exact(Some(1.4)), 1.45), Some(Outcome::Reproduced));
    let off = one(column(Quantity::LambdaError, ""), 0.1, vec![case(0, [1.0, 1.0])]);
    assert!((off.median.unwrap() - 0.2).abs() < 1e-12 && off.fem.is_some(), "{off:?}");
}

#[test]
fn what_failed_or_was_not_run_has_no_value() {
    let mut failed = case(0, [1.0, 1.0]);
    failed.run.meshes.push(MeshReport::failed("c".into(), None, "no".into(), 0.0));
    let row = one(column(Quantity::Mse, ""), 1.0, vec![failed]);
    assert_eq!((row.seeds, row.median, row.verdict), (0, None, None));
    assert_eq!(row.cells(), ["a", "error", "–", "–", "–", "1.000", "–"]);
    let several = Column { k: Places::Range([2, 3]), ..column(Quantity::Mse, "") };
    assert_eq!(one(several, 1.0, vec![case(0, [1.0, 1.0])]).median, None, "there is no third pair");
}

#[test]
fn the_document_is_read_back_and_the_table_is_markdown() {
    let variants = vec![Described { name: "a".into(), printed: [("error".into(), 5e-6)].into() }];
    let columns = vec![column(Quantity::Mse, "")];
    let comparison = Comparison { title: "Widths".into(), columns, variants };
    let cases = vec![case(0, [4e-5, 2e-5]), case(1, [1e-6, 1e-6])];
    let report = SweepReport::new(&comparison, cases, 2.0);
    let read: SweepReport = serde_json::from_slice(&report.to_json()).unwrap();
    assert_eq!((read.table, read.cases.len()), (report.table.clone(), 2));
    let markdown = report.to_markdown();
    assert!(markdown.starts_with("# Widths\n\n| variant | measure | here |"), "{markdown}");
    let last = "| a | error | 1.55e-5 | 1.00e-6 – 3.00e-5 | 7.75e-6 | 5.00e-6 | not reproduced |\n";
    assert!(markdown.ends_with(last), "{markdown}");
}
