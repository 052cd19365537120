//! The page of a mesh: its eigenfunctions, and what was checked of them.

use std::f64::consts::PI;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use maud::{Markup, html};

use super::frame::{badge, command, flow, page};
use super::plot::{Axes, Mark, Scale, Series, figure};
use super::viewer::{MOST_VERTICES, viewer};
use crate::mesh::TriMesh;
use crate::publish::picture::{Scene, Up, View};
use crate::publish::report::RunRecord;
use crate::publish::result::{Eigenpair, Source, Spectrum, Verdict};
use crate::publish::table::{completeness, duration, six_digits, two_digits, zero_or_digits};
use crate::spectrum::Eigenpairs;
use crate::spectrum::pencil::column;

/// What a page is made of.
#[derive(Debug, Clone, Copy)]
pub struct MeshPage<'a> {
    /// The name of the mesh.
    pub name: &'a str,
    /// The mesh.
    pub mesh: &'a TriMesh,
    /// Its eigenpairs, vectors n×K.
    pub pairs: &'a Eigenpairs,
    /// What was found and checked.
    pub spectrum: &'a Spectrum,
    /// What the work was.
    pub record: &'a RunRecord,
    /// What it falls short of.
    pub reason: Option<&'a str>,
    /// How trainings went.
    pub curves: &'a [Curve],
}

/// The Rayleigh quotients of a training.
#[derive(Debug, Clone, PartialEq)]
pub struct Curve {
    /// Of which eigenfunction.
    pub name: String,
    /// Of every step, or epoch.
    pub quotients: Vec<f64>,
}

/// Pictures of a page; more are there to be turned.
const MOST_PICTURES: usize = 24;

/// Pixels of a picture.
const PICTURE: usize = 220;

impl MeshPage<'_> {
    /// The page.
    pub fn to_html(&self) -> String {
        let Self { name, mesh, pairs, spectrum, record, reason, .. } = *self;
        // A constant has nothing to show.
        let places: Vec<usize> = (0..pairs.len())
            .filter(|&j| spectrum.eigenpairs.get(j).is_none_or(|p| p.source != Source::Constant))
            .collect();
        let view = View::of(mesh, Up::Y);
        let turning = viewer(mesh, pairs, &places, view);
        let turns = turning.is_some();
        page(
            name,
            html! {
                h1 { (name) " " (badge(spectrum.status.into())) }
                (self.facts())
                @if let Some(reason) = reason { p.warn { "Unverified: " (reason) "." } }
                @if let Some(counted) = &spectrum.completeness { p { (sentence(&completeness(counted))) } }
                @if let Some(repairs) = spectrum.repairs.in_words() { p { "Mended: " (repairs) "; " code { "chladni info" } " says where." } }
                h2 { "How it came about" }
                (flow(&record.stages))
                p.soft { (blocks(record)) "dashed: from the cache." }
                @if let Some(turning) = turning {
                    section.noprint {
                        h2 { "Eigenfunctions" }
                        (turning)
                    }
                }
                h2 { "Nodal lines" }
                @if !turns && mesh.n() > MOST_VERTICES {
                    p.soft { "With " (mesh.n()) " vertices the mesh is too large to be turned here; eigen.npz and the other files beside this page have it." }
                }
                (pictures(mesh, pairs, &places, view))
                h2 { "Eigenpairs" }
                (table(&spectrum.eigenpairs))
                p.soft {
                    "λ in 1/(input unit)². The angle, in radians, is the largest between the eigenspace and the reference's. ρ needs no reference: "
                    "some true eigenvalue λᵢ lies within ρ(λᵢ + λ) of λ."
                }
                (self.plots())
                h2 { "Where it comes from" }
                (self.provenance())
            },
        )
    }

    fn facts(&self) -> Markup {
        let mesh = &self.spectrum.mesh;
        html! {
            ul.facts {
                li { b { (mesh.vertices) } " vertices" }
                li { b { (mesh.faces) } " triangles" }
                li { b { (mesh.components) } @if mesh.components == 1 { " piece" } @else { " pieces" } }
                li { b { (mesh.boundary_loops) } @if mesh.boundary_loops == 1 { " boundary loop" } @else { " boundary loops" } }
                li { "χ = " b { (mesh.euler) } }
                li { "area " b { (six_digits(mesh.area)) } }
                li { b { (self.pairs.len()) } @if self.pairs.len() == 1 { " eigenpair" } @else { " eigenpairs" } }
                li { b { (duration(self.record.seconds)) } }
            }
        }
    }

    fn plots(&self) -> Markup {
        let pairs = &self.spectrum.eigenpairs;
        let by_k = |of: &dyn Fn(&Eigenpair) -> f64| {
            pairs.iter().map(|pair| (pair.k as f64, of(pair))).collect::<Vec<_>>()
        };
        let series = |name: &str, points, mark| Series { name: name.into(), points, mark };
        // A graph has eigenvalues without a unit: no area makes them those of a surface.
        let has_unit = pairs.iter().any(|pair| pair.lambda_area.is_finite());
        let (area, name, weyl) = match has_unit {
            true => (self.spectrum.mesh.area, "λ · area", 4.0 * PI),
            false => (1.0, "λ", f64::NAN),
        };
        // λ = 0 is measured by other means.
        let is_zero = |p: &Eigenpair| p.lambda_fem.abs() * area < 1e-6;
        let unless_zero = |p: &Eigenpair, x: f64| if is_zero(p) { f64::NAN } else { x };
        let spectrum = [
            series(name, by_k(&|p| p.lambda * area), Mark::Line),
            series("FEM", by_k(&|p| p.lambda_fem * area), Mark::Points),
            series("M-PGD", by_k(&|p| p.lambda_mpgd * area), Mark::Points),
            series("Weyl: 4πk", by_k(&|p| weyl * p.k as f64), Mark::Dashed),
        ];
        let present = |all: Vec<Series>| -> Vec<Series> {
            let has = |series: &Series| series.points.iter().any(|p| p.1.is_finite());
            all.into_iter().filter(has).collect()
        };
        let off = |p: &Eigenpair| unless_zero(p, (p.lambda / p.lambda_fem - 1.0).abs());
        let errors = [
            series("relative difference of λ from FEM", by_k(&off), Mark::Line),
            series("angle to FEM", by_k(&|p| unless_zero(p, p.angle_fem)), Mark::Line),
            series("residual / λ", by_k(&|p| unless_zero(p, p.residual / p.lambda)), Mark::Line),
        ];
        let learned = pairs.iter().any(|pair| pair.angle_fem.is_finite());
        let errors: Vec<Series> = errors
            .into_iter()
            .enumerate()
            // Of learned pairs the residual says nothing, of solved ones the difference.
            .filter(|(i, _)| (*i == 2) != learned)
            .map(|(_, series)| series)
            .collect();
        let curves = self.curves.iter().map(|Curve { name, quotients }| {
            // Relative to where it ends: quotients of different eigenfunctions differ by more than any training changes.
            let last = &quotients[quotients.len() - quotients.len().div_ceil(10)..];
            let end = last.iter().sum::<f64>() / last.len() as f64;
            let points = quotients.iter().enumerate();
            series(name, points.map(|(i, &q)| ((i + 1) as f64, q / end)).collect(), Mark::Line)
        });
        let (linear, log) = (Scale::Linear, Scale::Logarithmic);
        let axes = |x, y, scale| Axes { x, y, scale };
        let shown = [
            figure("Spectrum", &axes("k", name, linear), &present(spectrum.into())),
            figure("Errors", &axes("k", "", log), &present(errors)),
            figure(
                "Training, relative to its end",
                &axes("step", "Rayleigh quotient", log),
                &curves.collect::<Vec<_>>(),
            ),
        ];
        html! {
            h2 { "In pictures" }
            div.plots { @for figure in shown.into_iter().flatten() { (figure) } }
        }
    }

    fn provenance(&self) -> Markup {
        let provenance = &self.spectrum.provenance;
        let parameters = serde_json::to_string_pretty(&provenance.parameters).unwrap_or_default();
        html! {
            p { "Mesh " code { (self.spectrum.mesh.hash) } ", chladni " (provenance.chladni) "." }
            (command())
            details {
                summary { "All parameters that can change a number" }
                pre { code { (parameters) } }
            }
        }
    }
}

/// With a large first letter and a full stop.
fn sentence(text: &str) -> String {
    let mut letters = text.chars();
    let first = letters.next().map(|c| c.to_uppercase().to_string()).unwrap_or_default();
    format!("{first}{}.", letters.as_str())
}

fn blocks(record: &RunRecord) -> String {
    match (record.trained, record.reused) {
        (0, 0) => String::new(),
        (trained, reused) => format!("{trained} blocks trained, {reused} reused; "),
    }
}

fn pictures(mesh: &TriMesh, pairs: &Eigenpairs, places: &[usize], view: View) -> Markup {
    let scene = Scene::of(mesh, view, PICTURE);
    let picture = |j: usize| {
        let phi = column(&pairs.vectors, j);
        let limit = phi.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        scene.draw(phi, limit).to_png().ok().map(|png| STANDARD.encode(png))
    };
    html! {
        div.figures {
            @for &j in places.iter().take(MOST_PICTURES) {
                @if let Some(png) = picture(j) {
                    figure {
                        img width=(PICTURE) height=(PICTURE) src={ "data:image/png;base64," (png) }
                            alt={ "eigenfunction " (j + 1) " with its nodal lines" };
                        figcaption { "φ" (j + 1) ", λ = " (six_digits(pairs.values[j])) }
                    }
                }
            }
        }
        @if places.len() > MOST_PICTURES {
            p.soft { "The first " (MOST_PICTURES) " of " (places.len()) "." }
        }
    }
}

fn table(pairs: &[Eigenpair]) -> Markup {
    let any = |of: fn(&Eigenpair) -> f64| pairs.iter().any(|pair| of(pair).is_finite());
    let refined = pairs.iter().any(|pair| pair.lambda_refined.is_some());
    let (fem, mpgd) = (any(|p| p.lambda_fem), any(|p| p.lambda_mpgd));
    let (angle, rho) = (any(|p| p.angle_fem), any(|p| p.rho));
    // Of a learned pair high frequencies dominate it.
    let residual = any(|p| p.residual) && (!angle || refined);
    let largest = pairs.iter().fold(0.0_f64, |m, pair| m.max(pair.lambda.abs()));
    let value = |x: f64| zero_or_digits(x, largest);
    html! {
        div.scroll {
            table {
                thead {
                    tr {
                        th { "k" } th { "λ" }
                        @if refined { th { "λ refined" } }
                        @if mpgd { th { "λ M-PGD" } }
                        @if fem { th { "λ FEM" } }
                        th { "λ · area" }
                        @if angle { th { "angle" } }
                        @if rho { th { "ρ" } }
                        @if residual { th { "residual" } }
                        th.text { "verdict" } th.text { "source" }
                    }
                }
                tbody {
                    @for pair in pairs {
                        tr {
                            td { (pair.k) } td { @if pair.source == Source::Constant { "0" } @else { (value(pair.lambda)) } }
                            @if refined { td { (pair.lambda_refined.map_or("–".into(), value)) } }
                            @if mpgd { td { (value(pair.lambda_mpgd)) } }
                            @if fem { td { (value(pair.lambda_fem)) } }
                            td { (if value(pair.lambda) == "0" { "0".into() } else { six_digits(pair.lambda_area) }) }
                            @if angle { td { (two_digits(pair.angle_fem)) } }
                            @if rho { td { (two_digits(pair.rho)) } }
                            @if residual { td { (two_digits(pair.residual)) } }
                            @match pair.verdict {
                                Verdict::Verified => { td.text.good { "verified" } }
                                Verdict::Unverified => { td.text.warn { "unverified" } }
                            }
                            td.text { (pair.source.name()) }
                        }
                    }
                }
            }
        }
    }
}
