//! Plots of a page, as SVG whose ink is that of the page.

use std::ops::Range;

use colorous::VIRIDIS;
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
    /// From zero, as a size has it.
    Linear,
    /// Of what is positive; linear where all of it is within one power of ten.
    Logarithmic,
}

/// What stands at the axes.
pub struct Axes<'a> {
    pub x: &'a str,
    pub y: &'a str,
    pub scale: Scale,
}

const SIZE: (u32, u32) = (560, 340);

/// Places on an axis that have a label, at most.
const LABELS: usize = 8;

/// Distinct to the colour-blind (Okabe and Ito), and on light and dark ground.
const COLOURS: [RGBColor; 6] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
];

/// Of one series among `count`. Of more than there are distinct ones, their order is what one can see.
fn colour(i: usize, count: usize) -> RGBColor {
    if count <= COLOURS.len() {
        return COLOURS[i % COLOURS.len()];
    }
    // Neither the darkest nor the brightest, which dark and light ground swallow.
    let place = 0.2 + 0.65 * i as f64 / (count - 1) as f64;
    let colour = VIRIDIS.eval_continuous(place);
    RGBColor(colour.r, colour.g, colour.b)
}

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
                    @let RGBColor(r, g, b) = colour(i, series.len());
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
    let (up, scale) = upwards(axes.scale, low, high);
    let between = (up.end - up.start) / LABELS as f64;
    let drawn = match scale {
        Scale::Linear => draw(&root, axes, series, &shown, across, up, &|y| label(*y, between)),
        Scale::Logarithmic => {
            draw(&root, axes, series, &shown, across, up.log_scale(), &|y| label(*y, *y))
        }
    };
    drop(root);
    drawn.ok()?;
    // Its own size is the page's business, and what it has to say is beside it.
    let (width, height) = SIZE;
    let svg = svg.replace(&format!("width=\"{width}\" height=\"{height}\" "), "");
    Some(svg.replace(INK.0, INK.1).replace("<svg ", "<svg role=\"img\" "))
}

/// What the axis upwards spans, with values from `low` to `high`, and its scale.
fn upwards(scale: Scale, low: f64, high: f64) -> (Range<f64>, Scale) {
    let reach = if high > low { high - low } else { high.abs().max(1.0) };
    match scale {
        Scale::Linear => (low.min(0.0)..high + 0.05 * reach, Scale::Linear),
        // Labels are at powers of ten: two of them at least, and the lines a little inside.
        Scale::Logarithmic if high > 10.0 * low => {
            let [below, above] = [low.log10().floor(), high.log10().ceil()];
            (10_f64.powf(below) / 1.01..10_f64.powf(above) * 1.01, Scale::Logarithmic)
        }
        Scale::Logarithmic => (low - 0.05 * reach..high + 0.05 * reach, Scale::Linear),
    }
}

/// A number at an axis on which the next label is so far away.
fn label(x: f64, step: f64) -> String {
    if x.abs() < 1e-6 * step {
        return "0".to_owned();
    }
    // Labels lie at round numbers: those have no more than one digit below the first one of a step.
    let finest = step.log10().floor() as i32 - 1;
    let exponent = x.abs().log10().floor() as i32;
    let digits = |place: i32| (place - finest).max(0) as usize;
    let without_zeros = |text: &str| match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text.to_owned(),
    };
    match exponent {
        -3..4 => without_zeros(&format!("{x:.*}", digits(0))),
        _ => {
            let text = format!("{x:.*e}", digits(exponent));
            let (mantissa, power) = text.split_once('e').unwrap_or((&text, "0"));
            format!("{}e{power}", without_zeros(mantissa))
        }
    }
}

fn draw<Y>(
    root: &DrawingArea<SVGBackend<'_>, Shift>,
    axes: &Axes<'_>,
    series: &[Series],
    shown: &impl Fn(&(f64, f64)) -> bool,
    across: Range<f64>,
    up: Y,
    upper: &dyn Fn(&f64) -> String,
) -> Result<(), Box<dyn std::error::Error>>
where
    Y: AsRangedCoord<Value = f64>,
    Y::CoordDescType: ValueFormatter<f64> + Ranged<ValueType = f64>,
{
    let text = ("sans-serif", 15).into_font().color(&BLACK);
    // What is counted has no halves.
    let wide = across.end - across.start;
    let columns = (wide as usize + 1).min(LABELS);
    let mut chart = ChartBuilder::on(root)
        .margin(8)
        // Half of the last label.
        .margin_right(24)
        .x_label_area_size(42)
        .y_label_area_size(70)
        .build_cartesian_2d(across, up)?;
    let right = |x: &f64| label(*x, wide / columns as f64);
    chart
        .configure_mesh()
        .x_desc(axes.x)
        .y_desc(axes.y)
        .x_labels(columns)
        .y_labels(LABELS)
        .x_label_formatter(&right)
        .y_label_formatter(&upper)
        .label_style(text.clone())
        .axis_desc_style(text)
        .bold_line_style(BLACK.mix(0.12))
        .light_line_style(BLACK.mix(0.0))
        .axis_style(BLACK.mix(0.5))
        .draw()?;
    for (i, Series { points, mark, .. }) in series.iter().enumerate() {
        let colour = colour(i, series.len());
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
    use std::collections::BTreeSet;

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

    /// The labels of a plot, as they stand in it.
    fn labels(scale: Scale, points: &[(f64, f64)]) -> Vec<String> {
        let svg = plot(&Axes { x: "k", y: "error", scale }, &line(points)).unwrap();
        let texts = svg.split("<text").skip(1);
        let text = texts.map(|t| t.split_once('>').unwrap().1.split_once('<').unwrap().0.trim());
        text.filter(|text| !["k", "error"].contains(text)).map(str::to_owned).collect()
    }

    #[test]
    fn every_axis_has_labels_that_differ() {
        let ranges = [
            (2.3e-3, 2.8e-2),
            (1e-12, 3e-3),
            (0.98, 1.03),
            (1.0, 1.0),
            (0.9999998, 1.0000003),
            (1.0, 9.99),
            (1.0, 10.01),
            (1e5, 1.5e5),
            (3e-7, 4e-7),
            (2.0, 5e9),
        ];
        for scale in [Scale::Linear, Scale::Logarithmic] {
            for (low, high) in ranges {
                let found = labels(scale, &[(1.0, low), (2.0, high), (3.0, low)]);
                let (up, across) = found.split_at(found.len() - 3);
                assert_eq!(across, ["1", "2", "3"]);
                let distinct: BTreeSet<_> = up.iter().collect();
                assert!(up.len() >= 2 && distinct.len() == up.len(), "{low}..{high}: {up:?}");
            }
        }
    }

    #[test]
    fn a_label_is_the_number_it_stands_at() {
        let cases = [
            (0.0, 1.0, "0"),
            (1e-17, 0.1, "0"),
            (0.25, 0.25, "0.25"),
            (0.30000000000000004, 0.1, "0.3"),
            (120.0, 20.0, "120"),
            (1500.0, 500.0, "1500"),
            (150_000.0, 50_000.0, "1.5e5"),
            (1e-3, 1e-3, "0.001"),
            (1e-4, 1e-4, "1e-4"),
            (-0.02, 0.02, "-0.02"),
        ];
        for (x, step, expected) in cases {
            assert_eq!(label(x, step), expected);
        }
    }

    #[test]
    fn many_series_have_a_colour_each() {
        for count in [1, 6, 7, 50] {
            let colours: BTreeSet<_> =
                (0..count).map(|i| colour(i, count)).map(|c| (c.0, c.1, c.2)).collect();
            assert_eq!(colours.len(), count);
        }
    }
}
