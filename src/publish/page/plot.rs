//! Plots of a page, as SVG whose ink is that of the page.

use maud::{Markup, PreEscaped, html};
use plotters::coord::Shift;
use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::prelude::*;

/// A line or a row of points.
pub struct Series {
    /// What it is called.
    pub name: String,
    /// Ascending in the first.
    pub points: Vec<(f64, f64)>,
    /// How it is drawn.
    pub mark: Mark,
}

/// How a series is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    Line,
    Dashed,
    Points,
}

/// Whether a step upwards adds or multiplies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    Linear,
    Logarithmic,
}

/// What stands at the axes.
pub struct Axes<'a> {
    pub x: &'a str,
    pub y: &'a str,
    pub scale: Scale,
}

const SIZE: (u32, u32) = (560, 340);

/// Distinct to the colour-blind (Okabe and Ito), and on light and dark ground.
const COLOURS: [RGBColor; 6] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
];

/// Ink, as the library writes it, and as the page has it.
const INK: (&str, &str) = ("#000000", "currentColor");

/// The plot with its title and what its lines are; `None` where there is nothing to show.
pub fn figure(title: &str, axes: &Axes<'_>, series: &[Series]) -> Option<Markup> {
    let svg = plot(axes, series)?;
    Some(html! {
        figure {
            (PreEscaped(svg))
            figcaption {
                b { (title) } ": "
                @for (i, Series { name, .. }) in series.iter().enumerate() {
                    @let RGBColor(r, g, b) = COLOURS[i % COLOURS.len()];
                    span.key { span style={ "background: rgb(" (r) " " (g) " " (b) ")" } {} (name) }
                }
            }
        }
    })
}

fn plot(axes: &Axes<'_>, series: &[Series]) -> Option<String> {
    let shown = |p: &(f64, f64)| {
        p.0.is_finite() && p.1.is_finite() && (axes.scale == Scale::Linear || p.1 > 0.0)
    };
    let points = || series.iter().flat_map(|s| &s.points).filter(|p| shown(p));
    let ends = |of: fn(&(f64, f64)) -> f64| {
        points().map(of).fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)))
    };
    let ((left, right), (low, high)) = (ends(|p| p.0), ends(|p| p.1));
    if !(left.is_finite() && low.is_finite()) {
        return None;
    }
    let mut svg = String::new();
    let root = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
    let across = if left < right { left..right } else { left - 0.5..right + 0.5 };
    let drawn = match axes.scale {
        Scale::Linear => {
            let reach = if high > low { high - low } else { high.abs().max(1.0) };
            draw(&root, axes, series, &shown, across, low.min(0.0)..high + 0.05 * reach)
        }
        Scale::Logarithmic => {
            draw(&root, axes, series, &shown, across, (low / 1.5..high * 1.5).log_scale())
        }
    };
    drop(root);
    drawn.ok()?;
    // Its own size is the page's business, and what it has to say is beside it.
    let (width, height) = SIZE;
    let svg = svg.replace(&format!("width=\"{width}\" height=\"{height}\" "), "");
    Some(svg.replace(INK.0, INK.1).replace("<svg ", "<svg role=\"img\" "))
}

fn draw<Y>(
    root: &DrawingArea<SVGBackend<'_>, Shift>,
    axes: &Axes<'_>,
    series: &[Series],
    shown: &impl Fn(&(f64, f64)) -> bool,
    across: std::ops::Range<f64>,
    up: Y,
) -> Result<(), Box<dyn std::error::Error>>
where
    Y: AsRangedCoord<Value = f64>,
    Y::CoordDescType: ValueFormatter<f64> + Ranged<ValueType = f64>,
{
    let text = ("sans-serif", 15).into_font().color(&BLACK);
    // What is counted has no halves.
    let steps = (across.end - across.start) as usize + 1;
    let mut chart = ChartBuilder::on(root)
        .margin(8)
        .x_label_area_size(42)
        .y_label_area_size(70)
        .build_cartesian_2d(across, up)?;
    let number = |x: &f64| match x.abs() {
        0.0 => "0".to_owned(),
        0.01..10_000.0 => format!("{x:.2}").trim_end_matches('0').trim_end_matches('.').to_owned(),
        _ => format!("{x:.0e}"),
    };
    chart
        .configure_mesh()
        .x_desc(axes.x)
        .y_desc(axes.y)
        .x_labels(steps.min(8))
        .y_labels(6)
        .x_label_formatter(&number)
        .y_label_formatter(&number)
        .label_style(text.clone())
        .axis_desc_style(text)
        .bold_line_style(BLACK.mix(0.12))
        .light_line_style(BLACK.mix(0.0))
        .axis_style(BLACK.mix(0.5))
        .draw()?;
    for (i, Series { points, mark, .. }) in series.iter().enumerate() {
        let colour = COLOURS[i % COLOURS.len()];
        let points = || points.iter().copied().filter(|p| shown(p));
        match mark {
            Mark::Line => chart.draw_series(LineSeries::new(points(), colour.stroke_width(2)))?,
            Mark::Dashed => {
                let style = colour.stroke_width(2);
                chart.draw_series(DashedLineSeries::new(points(), 6, 4, style))?
            }
            Mark::Points => {
                // Those that lie under others reach out from under them.
                let above = series[i + 1..].iter().filter(|other| other.mark == Mark::Points);
                let radius = 3 + 2 * above.count() as i32;
                chart.draw_series(points().map(|p| Circle::new(p, radius, colour.filled())))?
            }
        };
    }
    root.present()?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(points: &[(f64, f64)]) -> Vec<Series> {
        vec![Series { name: "a".into(), points: points.to_vec(), mark: Mark::Line }]
    }

    #[test]
    fn a_plot_has_the_ink_of_the_page_and_nothing_makes_none() {
        let axes = |scale| Axes { x: "k", y: "error", scale };
        let svg = plot(&axes(Scale::Logarithmic), &line(&[(1.0, 1e-3), (2.0, 0.0), (3.0, 1e-5)]));
        let svg = svg.unwrap();
        assert!(svg.starts_with("<svg role=\"img\" ") && svg.contains("currentColor"), "{svg}");
        assert!(!svg.contains("#000000") && svg.contains("viewBox"), "{svg}");
        assert!(plot(&axes(Scale::Linear), &line(&[(1.0, 0.0)])).is_some(), "one point");
        assert!(plot(&axes(Scale::Linear), &line(&[])).is_none());
        assert!(plot(&axes(Scale::Logarithmic), &line(&[(1.0, f64::NAN), (2.0, -1.0)])).is_none());
    }
}
