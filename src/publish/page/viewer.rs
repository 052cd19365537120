//! The mesh that turns: its data, and the program that shows it.
//!
//! Positions are sent as single precision in a ball around the origin, functions as 16-bit integers, each scaled by its largest
//! entry. A page is kept below some ten megabytes: of large meshes with many pairs only the first are there to be turned, of
//! very large ones none.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use colorous::VIRIDIS;
use maud::{Markup, PreEscaped, html};
use serde_json::json;

use crate::mesh::TriMesh;
use crate::publish::picture::View;
use crate::publish::table::six_digits;
use crate::spectrum::Eigenpairs;
use crate::spectrum::pencil::column;

const TWGL: &str = include_str!("assets/twgl-7.0.0.min.js");
const VIEWER: &str = include_str!("assets/viewer.js");

/// What the functions of a page may take, in bytes.
const MOST_BYTES: usize = 6 << 20;

/// A mesh of more vertices is not shown: its positions and triangles alone would make a page of many megabytes.
pub const MOST_VERTICES: usize = 150_000;

/// The mesh with the functions of `places`, from 0; `None` where there is too much of it, or nothing to show.
pub fn viewer(mesh: &TriMesh, pairs: &Eigenpairs, places: &[usize], view: View) -> Option<Markup> {
    let fit = MOST_BYTES / (2 * mesh.n()).max(1);
    let places = &places[..places.len().min(fit)];
    if mesh.n() > MOST_VERTICES || places.is_empty() {
        return None;
    }
    let (centre, radius) = view.ball(mesh);
    let place = |p: &[f64; 3]| [0, 1, 2].map(|i| ((p[i] - centre[i]) / radius) as f32);
    let positions = mesh.vertices().iter().flat_map(place).flat_map(f32::to_le_bytes);
    let faces = mesh.faces().iter().flatten().flat_map(|i| i.to_le_bytes());
    let functions = places.iter().flat_map(|&j| {
        let phi = column(&pairs.vectors, j);
        let largest = phi.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        let scale = if largest > 0.0 { f64::from(i16::MAX) / largest } else { 0.0 };
        phi.iter().flat_map(move |x| ((scale * x).round() as i16).to_le_bytes())
    });
    let colours = (0..256).flat_map(|i| {
        let colour = VIRIDIS.eval_rational(i, 256);
        [colour.r, colour.g, colour.b, 255]
    });
    let about = json!({
        "view": view.axes().as_flattened(),
        "lit": view.lit(),
        "places": places.iter().map(|j| j + 1).collect::<Vec<_>>(),
        "lambdas": places.iter().map(|&j| six_digits(pairs.values[j])).collect::<Vec<_>>(),
    });
    // Nothing in a page may end its script early.
    let about = about.to_string().replace('<', "\\u003c");
    Some(html! {
        div.viewer {
            canvas #mesh tabindex="0" role="img" aria-label="the mesh" {}
            div {
                p { b #shown {} }
                div.choose role="group" aria-label="which eigenfunction" {
                    @for &j in places {
                        button type="button" data-function=(j) aria-pressed="false" { "φ" (j + 1) }
                    }
                }
                p.soft #note {
                    "Drag to turn, pinch or scroll to zoom. With the mesh in focus: "
                    kbd { "←" } kbd { "→" } kbd { "↑" } kbd { "↓" } " turn, "
                    kbd { "+" } kbd { "−" } " zoom, " kbd { "n" } kbd { "p" } " next and previous, " kbd { "0" } " as it was."
                }
            }
        }
        (data("positions", positions))
        (data("faces", faces))
        (data("functions", functions))
        (data("colours", colours))
        script #about type="application/json" { (PreEscaped(about)) }
        script { (PreEscaped(TWGL)) }
        script { (PreEscaped(VIEWER)) }
    })
}

fn data(name: &str, bytes: impl Iterator<Item = u8>) -> Markup {
    let text = STANDARD.encode(bytes.collect::<Vec<u8>>());
    html! { script id=(name) type="application/octet-stream;base64" { (PreEscaped(text)) } }
}
