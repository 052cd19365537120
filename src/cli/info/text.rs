//! What `chladni info` prints for people: at most 80 columns, the names of what is said in the first fourteen.

use std::fmt::Write;

use super::Info;
use super::findings::Finding;
use crate::mesh::error::listed;
use crate::mesh::topology::Piece;
use crate::publish::table::six_digits;

/// The width of names, and that of the whole page.
const NAMES: usize = 13;
const PAGE: usize = 80;

/// The longest bar of the histogram.
const BAR: usize = 40;

/// More pieces, or runs of equal ones, are summed up.
const PIECES: usize = 8;

/// The page of a mesh.
pub fn page(info: &Info<'_>) -> String {
    let mut page = Page::default();
    page.line("mesh", &format!("{} ({})", info.path, info.format.name()));
    page.line("hash", &info.hash);
    let counts = format!("{} vertices, {} edges, {} faces", info.vertices, info.edges, info.faces);
    page.line("counts", &counts);
    if info.objects.len() > 1 {
        page.line("objects", &format!("{}: {}", info.objects.len(), listed(&info.objects)));
        page.line("", "  ingest: made one mesh");
        page.line(
            "",
            "  option: ingest.objects = \"split\" (solve --object NAME) makes each a mesh",
        );
    }
    page.line("topology", &topology(info));
    if info.pieces.len() > 1 {
        let alike: Vec<&[Piece]> = info.pieces.chunk_by(|a, b| a == b).collect();
        for run in alike.iter().take(PIECES) {
            let times = if run.len() > 1 { format!("{} × ", run.len()) } else { String::new() };
            run.first()
                .into_iter()
                .for_each(|piece| page.line("", &(times.clone() + &of_piece(piece))));
        }
        let more: usize = alike.iter().skip(PIECES).map(|run| run.len()).sum();
        if more > 0 {
            page.line("", &format!("and {}", plural(more, "further component")));
        }
    }
    page.line("area", &six_digits(info.area));
    let [low, high] = info.bounds;
    let side = |c: usize| format!("[{}, {}]", six_digits(low[c]), six_digits(high[c]));
    page.line("bounds", &format!("{} × {} × {}", side(0), side(1), side(2)));
    page.line("unit (guess)", info.units);
    shape(&mut page, info);
    if info.findings.is_empty() {
        page.line("findings", "none: the mesh is what the file says, and clean");
    }
    for (number, finding) in info.findings.iter().enumerate() {
        page.line(if number == 0 { "findings" } else { "" }, &title(finding));
        page.line("", &format!("  ingest: {}", finding.treatment));
        page.line("", &format!("  option: {}", finding.option.unwrap_or("none changes that")));
    }
    page.text
}

fn topology(info: &Info<'_>) -> String {
    let boundary = match info.boundary_loops {
        0 => "closed".to_string(),
        loops => format!(
            "{} with {}",
            plural(loops, "boundary loop"),
            plural(info.boundary_vertices, "vertex")
        ),
    };
    let components = plural(info.components, "component");
    let genus = match info.pieces[..] {
        [piece] => format!(", {}", genus(&piece)),
        _ => String::new(),
    };
    format!("{components}, {boundary}, Euler characteristic {}{genus}", info.euler)
}

fn of_piece(piece: &Piece) -> String {
    format!(
        "{}, {}, {}, χ = {}, {}",
        plural(piece.vertices, "vertex"),
        plural(piece.faces, "face"),
        plural(piece.boundary_loops, "boundary loop"),
        piece.euler_characteristic,
        genus(piece)
    )
}

fn genus(piece: &Piece) -> String {
    match piece.genus {
        Some(genus) => format!("genus {genus}"),
        None if piece.orientable => "not manifold".into(),
        None => "not orientable".into(),
    }
}

fn shape(page: &mut Page, info: &Info<'_>) {
    let shape = &info.shape;
    let [shortest, median, longest] =
        [shape.shortest_edge, shape.median_edge, shape.longest_edge].map(six_digits);
    let edges = format!(
        "{shortest} to {longest}, median {median}, ratio {}",
        six_digits(shape.longest_edge / shape.shortest_edge)
    );
    page.line("edges", &edges);
    page.line("angles", &format!("{:.2}° to {:.2}°", shape.smallest_angle, shape.largest_angle));
    let most = shape.angles.iter().copied().max().unwrap_or(0).max(1);
    let last = shape.angles.iter().rposition(|&count| count > 0).unwrap_or(0);
    let width = most.to_string().len();
    for (bin, &count) in shape.angles.iter().enumerate().take(last + 1) {
        // Whatever is there is seen.
        let bar = "#".repeat((count * BAR).div_ceil(most));
        let from = 10 * bin;
        page.line("", &format!("{from:>3}°–{:>3}° {count:>width$} {bar}", from + 10));
    }
}

fn title(finding: &Finding) -> String {
    let mut title = plural(finding.count, finding.what);
    if !finding.first.is_empty() {
        let more = if finding.count > finding.first.len() { "; …" } else { "" };
        let _ = write!(title, " ({}{more})", finding.first.join("; "));
    }
    let _ = write!(title, ": {}", finding.meaning);
    title
}

/// Lines under one another, the long ones broken between words.
#[derive(Default)]
struct Page {
    text: String,
}

impl Page {
    fn line(&mut self, name: &str, value: &str) {
        let mut start = format!("{name:<NAMES$}");
        let indent = value.len() - value.trim_start().len();
        let mut line = " ".repeat(indent);
        for word in value.trim_start().split(' ') {
            let taken = NAMES + line.chars().count();
            if !line.trim().is_empty() && taken + 1 + word.chars().count() > PAGE {
                let _ = writeln!(self.text, "{start}{line}");
                start = " ".repeat(NAMES);
                line = " ".repeat(indent + 2);
            } else if !line.trim().is_empty() {
                line.push(' ');
            }
            line.push_str(word);
        }
        let _ = writeln!(self.text, "{}", format!("{start}{line}").trim_end());
    }
}

fn plural(count: usize, what: &str) -> String {
    match (count, what.strip_suffix("vertex")) {
        (1, _) => format!("1 {what}"),
        (_, Some(before)) => format!("{count} {before}vertices"),
        _ => format!("{count} {what}s"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lines_are_broken_between_words() {
        let mut page = Page::default();
        page.line("name", &"word ".repeat(40));
        page.line("", &format!("  {}", "x".repeat(100)));
        let lines: Vec<&str> = page.text.lines().collect();
        assert!(lines[..3].iter().all(|line| line.chars().count() <= PAGE), "{lines:?}");
        assert!(lines[0].starts_with("name         word word"));
        assert!(lines[1].starts_with("               word"));
        assert_eq!(lines.last().unwrap().trim_start().len(), 100);
    }

    #[test]
    fn counts_agree_with_their_nouns() {
        assert_eq!(plural(1, "non-manifold vertex"), "1 non-manifold vertex");
        assert_eq!(plural(2, "non-manifold vertex"), "2 non-manifold vertices");
        assert_eq!(plural(0, "boundary loop"), "0 boundary loops");
    }
}
