//! Errors by k, on a logarithmic scale, as Fig. 5 has them: dashed that of the eigenfunction, solid that of λ.

use std::path::Path;

use chladni::pipeline::sweep::Case;
use chladni::publish::report::PairReport;
use chladni::publish::result::Eigenpair;
use chladni::publish::sweep::CaseReport;
use plotters::prelude::*;

use super::results::Experiment;
use super::{Outcome, rows};

/// A colour for each variant, distinct to the colour-blind (Okabe and Ito).
const COLOURS: [RGBColor; 6] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(40, 40, 40),
    RGBColor(230, 159, 0),
];

/// The name, the MSE by k and the relative error of λ by k.
type Errors = (String, Vec<(f64, f64)>, Vec<(f64, f64)>);

/// The plot of an experiment, as a file in `docs/paper`, and Markdown that shows it; of all its variants or of none.
pub fn of(experiment: &Experiment, docs: &Path) -> Outcome<String> {
    let mut lines: Vec<Errors> = Vec::new();
    for Case { variant, .. } in rows::sweep(docs, &experiment.name)?.cases {
        if lines.iter().all(|(name, ..)| *name != variant) {
            lines.push(errors(&variant, experiment.case(&variant)?, own));
        }
    }
    lines.extend(experiment.report.cases.first().map(|case| errors("FEM", case, fem)));
    let name = format!("{}.svg", experiment.name);
    draw(&docs.join("paper").join(&name), &lines)?;
    Ok(format!("![errors by k: dashed MSE, solid relative error of λ](paper/{name})\n"))
}

/// What `of` says of each pair: its MSE and its λ.
fn errors(name: &str, case: &CaseReport, of: fn(&Eigenpair) -> Option<(f64, f64)>) -> Errors {
    let pairs = case.run.meshes.iter().flat_map(|mesh| &mesh.eigenpairs);
    let of = pairs.filter_map(|PairReport { pair, .. }| {
        let (k, exact) = (pair.k as f64, pair.closed_form.as_ref()?.lambda);
        let (mse, lambda) = of(pair)?;
        Some(((k, mse), (k, (lambda / exact - 1.0).abs())))
    });
    let (mse, lambda) = of.unzip();
    (name.into(), mse, lambda)
}

fn own(pair: &Eigenpair) -> Option<(f64, f64)> {
    Some((pair.closed_form.as_ref()?.own.mse, pair.lambda))
}

fn fem(pair: &Eigenpair) -> Option<(f64, f64)> {
    Some((pair.closed_form.as_ref()?.fem?.mse, pair.lambda_fem))
}

fn draw(file: &Path, lines: &[Errors]) -> Outcome<()> {
    let all = || lines.iter().flat_map(|(_, mse, lambda)| mse.iter().chain(lambda));
    let most_k = all().map(|p| p.0).fold(1.0, f64::max);
    let positive = || all().map(|p| p.1).filter(|y| *y > 0.0);
    let (least, most) =
        (positive().fold(f64::INFINITY, f64::min), positive().fold(f64::MIN_POSITIVE, f64::max));
    if !least.is_finite() {
        return Err("there is nothing to plot".into());
    }
    let root = SVGBackend::new(file, (760, 420)).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .margin(12)
        .x_label_area_size(36)
        .y_label_area_size(64)
        .build_cartesian_2d(0.5..most_k + 0.5, (least / 2.0..most * 2.0).log_scale())?;
    chart
        .configure_mesh()
        .x_desc("k")
        .y_desc("error")
        .x_labels(most_k as usize)
        .x_label_formatter(&|k| format!("{k:.0}"))
        .y_label_formatter(&|y| format!("{y:.0e}"))
        .light_line_style(WHITE.mix(0.0))
        .draw()?;
    for (i, (name, mse, lambda)) in lines.iter().enumerate() {
        let colour = COLOURS[i % COLOURS.len()];
        chart.draw_series(DashedLineSeries::new(
            mse.iter().copied(),
            6,
            4,
            colour.stroke_width(2),
        ))?;
        chart
            .draw_series(LineSeries::new(lambda.iter().copied(), colour.stroke_width(2)))?
            .label(name)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 20, y)], colour.stroke_width(2)));
        let points = mse.iter().chain(lambda).map(|&p| Circle::new(p, 3, colour.filled()));
        chart.draw_series(points)?;
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::LowerRight)
        .background_style(WHITE.mix(0.8))
        .border_style(BLACK.mix(0.3))
        .draw()?;
    root.present()?;
    Ok(())
}
