//! Everything about a mesh that is not as it should be: what it is, where, what ingest does about it, and the option
//! that changes that.

use serde::Serialize;

use crate::mesh::repair::Tally;
use crate::mesh::topology::{Defects, Piece};
use crate::mesh::{Ingested, TriMesh};
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
    /// What ingest does about it.
    pub treatment: &'static str,
    /// The option that changes that.
    pub option: Option<&'static str>,
}

const REFUSE_FACES: Option<&str> = Some("ingest.degenerate_faces = \"refuse\" fails the mesh");
const REFUSE_BRANCHES: Option<&str> = Some("ingest.non_manifold = \"refuse\" fails the mesh");
const ROBUST: Option<&str> =
    Some("operators.robust = true (solve --robust) computes on better triangles of the same surface");

/// What there is to say of a mesh: first what was mended, then what stays.
pub fn findings(
    ingested: &Ingested,
    pieces: &[Piece],
    quality: Option<&TriangleQuality>,
) -> Vec<Finding> {
    let mut found = mended(ingested);
    found.extend(branches(ingested));
    found.extend(winding(ingested, pieces));
    found.extend(thin(quality));
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
            "the vertex stands where an earlier one does; glTF and STL have to repeat them",
            "makes them one vertex",
            None,
        ),
        of(
            &repairs.collapsed_faces,
            "collapsed face",
            "it names one vertex twice",
            "drops it",
            REFUSE_FACES,
        ),
        of(
            &repairs.zero_area_faces,
            "face without area",
            "its corners lie in a line",
            "drops it, which may leave a slit: a boundary loop of no width",
            REFUSE_FACES,
        ),
        of(
            &repairs.duplicate_faces,
            "duplicate face",
            "it has the corners of an earlier one",
            "drops it",
            REFUSE_FACES,
        ),
        of(
            &repairs.unreferenced_vertices,
            "unreferenced vertex",
            "no face uses it",
            "drops it; `vertex_map` has −1 for it",
            None,
        ),
        of(
            &repairs.polygons,
            "polygon",
            "it has more than three corners",
            "makes a fan of triangles of it; other diagonals give slightly other eigenvalues",
            None,
        ),
        of(
            &repairs.left_out,
            "point, line or two-corner face",
            "it is no surface",
            "leaves it out",
            None,
        ),
    ]
}

fn branches(Ingested { mesh, topology, .. }: &Ingested) -> [Finding; 2] {
    let defects = Defects::of(mesh, Tally::SHOWN);
    let edges = Finding {
        what: "non-manifold edge",
        count: topology.non_manifold_edges,
        first: defects.non_manifold_edges.iter().map(|&[a, b]| format!("{a}–{b}")).collect(),
        meaning: "more than two faces meet there".into(),
        treatment: "keeps it; the Laplacian couples all the faces",
        option: REFUSE_BRANCHES,
    };
    let vertices = Finding {
        what: "non-manifold vertex",
        count: topology.non_manifold_vertices,
        first: defects.non_manifold_vertices.iter().map(|&v| located(mesh, v)).collect(),
        meaning: "pieces touch there in one point".into(),
        treatment: "keeps it; they count as one component",
        option: REFUSE_BRANCHES,
    };
    [edges, vertices]
}

fn located(mesh: &TriMesh, vertex: u32) -> String {
    let [x, y, z] = mesh.vertices()[vertex as usize];
    format!("{vertex} at ({x:.4}, {y:.4}, {z:.4})")
}

fn winding(Ingested { mesh, topology, .. }: &Ingested, pieces: &[Piece]) -> Option<Finding> {
    let defects = Defects::of(mesh, Tally::SHOWN);
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
        treatment: "keeps it; the spectrum does not depend on winding",
        option: None,
    })
}

fn thin(quality: Option<&TriangleQuality>) -> Finding {
    let (what, count, meaning, treatment) = match quality {
        Some(quality) => (
            "negative cotangent weight",
            quality.negative_weights,
            format!(
                "obtuse angles face the edge, the smallest angle being {:.2}°; functions may overshoot there",
                quality.min_angle_degrees
            ),
            "keeps it; eigenvalues stay those of finite elements",
        ),
        None => (
            "mesh without operators",
            1,
            "some triangles are too thin for double precision".into(),
            "keeps them, and the mesh fails where its operators are assembled",
        ),
    };
    Finding { what, count, first: Vec::new(), meaning, treatment, option: ROBUST }
}
