//! Everything about a mesh that is not as it should be: what it is, where, what ingest does about it, and the option
//! that changes that.

use serde::Serialize;

use crate::mesh::repair::Tally;
use crate::mesh::topology::{Defects, Piece};
use crate::mesh::{Area, Ingested, TriMesh};
use crate::publish::result::TriangleQuality;

/// Something that is not as it should be.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// What it is called, in the singular.
    pub what: &'static str,
    pub count: usize,
    /// The first few of them; places of the file, or vertices by their rows in `eigen.npz`.
    pub first: Vec<String>,
    pub meaning: String,
    /// What ingest does about it, as a participle: "dropped".
    pub treatment: &'static str,
    /// The option that changes that, if any does.
    pub option: Option<&'static str>,
}

const REFUSE_FACES: Option<&str> = Some("ingest.degenerate_faces = \"refuse\" fails the mesh");
const ROBUST: Option<&str> = Some(
    "operators.robust = true (solve --robust) computes on better triangles of the same surface",
);
const TUFTED: Option<&str> = Some(
    "ingest.non_manifold = \"refuse\" fails the mesh; operators.robust = \"tufted\" (solve --robust=tufted) \
     computes on two sheets of it that are manifold",
);

/// What there is to say of a mesh: first what was mended, then what stays.
pub fn findings(
    ingested: &Ingested,
    pieces: &[Piece],
    quality: Option<&TriangleQuality>,
) -> Vec<Finding> {
    let defects = Defects::of(&ingested.mesh, Tally::SHOWN);
    let mut found = mended(ingested);
    found.extend(branches(ingested, &defects));
    found.extend(winding(ingested, &defects, pieces));
    found.push(match ingested.mesh.area() {
        Area(area) if !area.is_normal() => beyond(area),
        _ => thin(quality),
    });
    found.retain(|finding| finding.count > 0);
    found
}

fn mended(Ingested { repairs, .. }: &Ingested) -> Vec<Finding> {
    let of = |tally: &Tally, what, meaning: &str, treatment, option| Finding {
        what,
        count: tally.count,
        first: tally.first.iter().map(ToString::to_string).collect(),
        meaning: meaning.into(),
        treatment,
        option,
    };
    vec![
        of(
            &repairs.welded_vertices,
            "repeated position",
            "where an earlier vertex stands; glTF and STL have to repeat them",
            "made one vertex",
            None,
        ),
        of(
            &repairs.collapsed_faces,
            "collapsed face",
            "one vertex named twice",
            "dropped",
            REFUSE_FACES,
        ),
        of(
            &repairs.zero_area_faces,
            "face without area",
            "corners in a line",
            "dropped, which may leave a slit: a boundary loop of no width",
            REFUSE_FACES,
        ),
        of(
            &repairs.duplicate_faces,
            "duplicate face",
            "the corners of an earlier one",
            "dropped",
            REFUSE_FACES,
        ),
        of(
            &repairs.unreferenced_vertices,
            "unreferenced vertex",
            "used by no face",
            "dropped; `vertex_map` has −1 there",
            None,
        ),
        of(
            &repairs.polygons,
            "polygon",
            "more than three corners",
            "split into a fan of triangles; other diagonals give slightly other eigenvalues",
            None,
        ),
        of(&repairs.left_out, "point, line or two-corner face", "no surface", "left out", None),
    ]
}

fn branches(Ingested { mesh, topology, .. }: &Ingested, defects: &Defects) -> [Finding; 2] {
    let edges = Finding {
        what: "non-manifold edge",
        count: topology.non_manifold_edges,
        first: defects.non_manifold_edges.iter().map(|&[a, b]| format!("{a}–{b}")).collect(),
        meaning: "more than two faces meet there".into(),
        treatment: "kept; the Laplacian couples all the faces",
        option: TUFTED,
    };
    let vertices = Finding {
        what: "non-manifold vertex",
        count: topology.non_manifold_vertices,
        first: defects.non_manifold_vertices.iter().map(|&v| located(mesh, v)).collect(),
        meaning: "pieces touch there in one point".into(),
        treatment: "kept; they count as one component",
        option: TUFTED,
    };
    [edges, vertices]
}

fn located(mesh: &TriMesh, vertex: u32) -> String {
    let [x, y, z] = mesh.vertices()[vertex as usize];
    format!("{vertex} at ({x:.4}, {y:.4}, {z:.4})")
}

fn winding(
    Ingested { topology, .. }: &Ingested,
    defects: &Defects,
    pieces: &[Piece],
) -> Option<Finding> {
    let one_sided = pieces.iter().filter(|piece| !piece.orientable).count();
    let flipped: usize = pieces.iter().map(|piece| piece.flipped_faces).sum();
    let meaning = match (one_sided, flipped) {
        (0, 1) => "1 face is inside out".to_owned(),
        (0, _) => format!("{flipped} faces are inside out"),
        _ => "the surface has one side, as a Möbius strip has, and cannot be wound one way".into(),
    };
    (topology.misoriented_edges > 0).then(|| Finding {
        what: "misoriented edge",
        count: topology.misoriented_edges,
        first: defects.misoriented_edges.iter().map(|&[a, b]| format!("{a}–{b}")).collect(),
        meaning,
        treatment: "kept; the spectrum does not depend on winding",
        option: None,
    })
}

fn beyond(area: f64) -> Finding {
    Finding {
        what: "mesh beyond double precision",
        count: 1,
        first: Vec::new(),
        meaning: format!("its area is {area:e}; scale its coordinates"),
        treatment: "kept, and the mesh fails where it is read for a run",
        option: None,
    }
}

fn thin(quality: Option<&TriangleQuality>) -> Finding {
    let (what, count, meaning, treatment) = match quality {
        Some(quality) => (
            "negative cotangent weight",
            quality.negative_weights,
            format!(
                "obtuse angles face an edge, the smallest angle being {:.2}°; functions may overshoot there",
                quality.min_angle_degrees
            ),
            "kept; eigenvalues stay those of finite elements",
        ),
        None => (
            "mesh without operators",
            1,
            "some triangles are too thin for double precision".into(),
            "kept, and the mesh fails where its operators are assembled",
        ),
    };
    Finding { what, count, first: Vec::new(), meaning, treatment, option: ROBUST }
}
