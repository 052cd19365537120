//! The page of a run: every mesh with its verdict, and where its own page is.

use maud::{Markup, html};

use super::frame::{badge, command, flow_of_all, page};
use crate::publish::report::{MeshReport, RunReport, Status};
use crate::publish::table::{duration, six_digits, summary, zero_or_digits};

/// The file of a page, in the folder of a mesh and in that of a run.
pub const FILE: &str = "report.html";

/// Eigenvalues that the table shows.
const SHOWN: usize = 8;

/// The page. Those of the meshes lie in folders of their names.
pub fn run_page(report: &RunReport) -> String {
    let failed: Vec<&MeshReport> =
        report.meshes.iter().filter(|mesh| mesh.status == Status::Failed).collect();
    let done: Vec<&MeshReport> =
        report.meshes.iter().filter(|mesh| mesh.status != Status::Failed).collect();
    let most = done.iter().map(|mesh| mesh.eigenpairs.len()).max().unwrap_or(0).min(SHOWN);
    page(
        "chladni: a run",
        html! {
            h1 { "Spectra of " (report.meshes.len()) @if report.meshes.len() == 1 { " mesh" } @else { " meshes" } }
            p { (summary(report)) }
            @if !failed.is_empty() {
                h2.bad { "Failed" }
                div.scroll {
                    table {
                        thead { tr { th.text { "mesh" } th.text { "why, and what to do" } } }
                        tbody {
                            @for mesh in failed {
                                tr {
                                    td.text { (mesh.path) }
                                    td.text.wide { (mesh.reason.as_deref().unwrap_or("no reason is known")) }
                                }
                            }
                        }
                    }
                }
            }
            @if !done.is_empty() {
                h2 { "Spectra" }
                div.scroll {
                    table {
                        thead {
                            tr {
                                th.text { "mesh" } th.text { "verdict" } th { "vertices" } th { "area" }
                                @for k in 1..=most { th { "λ" (k) " · area" } }
                                th { "seconds" }
                            }
                        }
                        tbody { @for mesh in &done { (row(mesh, most)) } }
                    }
                }
                @if most == SHOWN { p.soft { "The first " (SHOWN) " eigenvalues; all are in spectrum.json and eigen.npz of each mesh." } }
                h2 { "How it came about" }
                (flow_of_all(done.iter().map(|mesh| &*mesh.stages)))
                p.soft { "Times are those of all meshes added up, which are worked on beside one another; dashed: from the cache." }
            }
            h2 { "Where it comes from" }
            p { "chladni " (env!("CARGO_PKG_VERSION")) ". The page of a mesh has its hash and all parameters." }
            (command())
        },
    )
}

fn row(mesh: &MeshReport, most: usize) -> Markup {
    let largest = mesh.eigenpairs.iter().fold(0.0_f64, |m, r| m.max(r.pair.lambda_area.abs()));
    let shown = |x: f64| zero_or_digits(x, largest);
    html! {
        tr {
            td.text { a href={ (link(&mesh.path)) "/" (FILE) } { (mesh.path) } }
            td.text title=[mesh.reason.as_deref()] { (badge(mesh.status)) }
            td { (mesh.vertices.map_or("–".into(), |n| n.to_string())) }
            td { (mesh.area.map_or("–".into(), six_digits)) }
            @for k in 0..most {
                td { (mesh.eigenpairs.get(k).map_or("–".into(), |report| shown(report.pair.lambda_area))) }
            }
            td { (duration(mesh.seconds)) }
        }
    }
}

/// A path as part of an address.
fn link(path: &str) -> String {
    let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-_.~/".contains(&byte);
    path.bytes()
        .map(|b| if plain(b) { char::from(b).to_string() } else { format!("%{b:02X}") })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_text_and_links_are_addresses() {
        let failed = MeshReport::failed("<b>.obj".into(), None, "a & b".into(), 0.0);
        let page = run_page(&RunReport::new(vec![failed], 1.0));
        assert!(page.contains("&lt;b&gt;.obj") && page.contains("a &amp; b"), "{page}");
        assert!(page.starts_with("<!DOCTYPE html>"));
        assert_eq!(link("scans/a b#1ü.obj"), "scans/a%20b%231%C3%BC.obj");
    }
}
