//! Why a file did not become a mesh: which file, where in it, what is wrong and what helps.

use std::fmt;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::read::format::Format;

/// A place in a mesh file, precise enough to find it in an editor or a viewer. Lines are counted from 1, all else
/// from 0, as the files' own indices are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Place {
    /// A line of a text file.
    Line(u32),
    /// A vertex of a binary file; of an STL file, vertex 3i + j is corner j of facet i.
    Vertex(u32),
    /// A face of a binary file.
    Face(u32),
    /// A triangle strip of a binary PLY file.
    Strip(u32),
    /// A cell of a binary VTK file, counted through all its lists of cells.
    Cell(u32),
    /// An entry of a list that is not geometry.
    Entry(u32),
    /// A glTF primitive.
    Primitive { mesh: u32, primitive: u32 },
    /// A triangle of a glTF primitive.
    Triangle { mesh: u32, primitive: u32, triangle: u32 },
    /// An element of a glTF accessor: a position in the buffer.
    Element { accessor: u32, element: u32 },
}

impl Place {
    /// The place `by` entries further on in the same list, where it has that many.
    pub(super) fn further(self, by: usize) -> Option<Self> {
        let add = |n: u32| n.checked_add(u32::try_from(by).ok()?);
        Some(match self {
            Self::Line(n) => Self::Line(add(n)?),
            Self::Vertex(n) => Self::Vertex(add(n)?),
            Self::Face(n) => Self::Face(add(n)?),
            Self::Strip(n) => Self::Strip(add(n)?),
            Self::Cell(n) => Self::Cell(add(n)?),
            Self::Entry(n) => Self::Entry(add(n)?),
            Self::Primitive { mesh, primitive } => {
                Self::Primitive { mesh, primitive: add(primitive)? }
            }
            Self::Triangle { mesh, primitive, triangle } => {
                Self::Triangle { mesh, primitive, triangle: add(triangle)? }
            }
            Self::Element { accessor, element } => {
                Self::Element { accessor, element: add(element)? }
            }
        })
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line(line) => write!(f, "line {line}"),
            Self::Vertex(vertex) => write!(f, "vertex {vertex}"),
            Self::Face(face) => write!(f, "face {face}"),
            Self::Strip(strip) => write!(f, "strip {strip}"),
            Self::Cell(cell) => write!(f, "cell {cell}"),
            Self::Entry(entry) => write!(f, "entry {entry}"),
            Self::Primitive { mesh, primitive } => write!(f, "mesh {mesh}, primitive {primitive}"),
            Self::Triangle { mesh, primitive, triangle } => {
                write!(f, "mesh {mesh}, primitive {primitive}, triangle {triangle}")
            }
            Self::Element { accessor, element } => {
                write!(f, "accessor {accessor}, element {element}")
            }
        }
    }
}

/// A file that cannot become a mesh.
#[derive(Debug, thiserror::Error)]
#[error("{}{}: {fault}", .path.display(), Located(.place))]
pub struct MeshError {
    /// The file, as it was named by the caller.
    pub path: PathBuf,
    /// Where in the file, when one place can be named.
    pub place: Option<Place>,
    /// What is wrong.
    pub fault: Fault,
}

impl MeshError {
    /// Whether the system refused to read the file, which says nothing of what is in it.
    pub fn is_unreadable(&self) -> bool {
        matches!(self.fault, Fault::Unreadable(_))
    }

    /// Whether the file has no object of the name that was asked for.
    pub fn is_no_object(&self) -> bool {
        matches!(self.fault, Fault::NoObject { .. })
    }
}

struct Located<'a>(&'a Option<Place>);

impl fmt::Display for Located<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.map_or(Ok(()), |place| write!(f, ", {place}"))
    }
}

/// What can be wrong with a mesh file. Each message says what happened and what helps.
#[derive(Debug, thiserror::Error)]
pub enum Fault {
    /// The operating system refused to read the file: it is missing, a folder, or not readable.
    #[error("cannot be read: {0}")]
    Unreadable(std::io::Error),
    /// The file has no bytes, usually because an export or a copy was interrupted.
    #[error("the file is empty; export or copy it again")]
    EmptyFile,
    /// The content is none of the formats we read; the extension cannot help then.
    #[error(
        "{}; convert the mesh to {}",
        .recognised.map_or_else(
            || "the content is no mesh format that is read".to_owned(),
            |name| format!("this is {name}, which is not read")
        ),
        Format::listed(Format::name)
    )]
    UnknownFormat { recognised: Option<&'static str> },
    /// More vertices or triangles than `u32` can number.
    #[error("more than 4294967295 vertices or lines; split or decimate the mesh")]
    TooLarge,

    /// The file ends in the middle of a list: an interrupted download or copy, or counts that are not true.
    #[error("the file ends here{}; export or copy it again", unfinished(.entries, *.promised))]
    EndsEarly { entries: String, promised: Option<usize> },
    /// A line has fewer numbers than what it describes. Usual causes are a line broken in two and a file
    /// written under another header.
    #[error(
        "the line ends in the middle of its {entries}; give each {entries} one whole line, or export the mesh again"
    )]
    ShortLine { entries: String },
    /// A word is no number. Usual causes are decimal commas and counts that are not true.
    #[error(
        "cannot read `{text}` as {expected}; numbers are written as 12 or -1.5e-3, with decimal points"
    )]
    NotANumber { text: String, expected: &'static str },
    /// The file breaks a rule of its format.
    #[error("not a valid {format} file: {problem}; export the mesh again")]
    Malformed { format: &'static str, problem: String },
    /// The file is sound and holds something that is not read.
    #[error("{what} is not read; {remedy}")]
    NotRead { what: String, remedy: &'static str },
    /// A `v` or `f` line of an OBJ file is not what the OBJ format allows: a word that is no number, too few coordinates.
    /// Usual causes are decimal commas and files cut in the middle of a line.
    #[error(
        "cannot read `{text}` ({reason}); numbers need decimal points, `v` three coordinates, `f` vertex indices such as 1, 1/2, 1//3 or 1/2/3"
    )]
    Unparsable { text: String, reason: tobj::LoadError },
    /// A coordinate is NaN or infinite, usually from a division by zero in the program that wrote the file,
    /// or is too large for the transforms above it.
    #[error(
        "the position ({}, {}, {}) is not finite; repair the vertex in the program that wrote it",
        .position[0], .position[1], .position[2]
    )]
    NotFinite { position: [f64; 3] },
    /// A face names a vertex that does not exist. Usual causes are a file cut short, zero-based indices in
    /// an OBJ file, and vertices deleted by hand.
    #[error(
        "vertex index {index} is out of range: there are {vertices} vertices to choose from{}; export the mesh again",
        if *.index == 0 && *.vertices > 0 { ", counted from 1" } else { "" }
    )]
    IndexOutOfRange { index: i64, vertices: usize },
    /// No triangle with an area is left to integrate over. Point clouds, curves and files whose faces are
    /// all degenerate end here.
    #[error(
        "no surface: the file has {vertices} vertices and {triangles} triangles, and none of the triangles has an area; export faces, not points or curves"
    )]
    NoSurface { vertices: usize, triangles: usize },

    /// The file has no object of that name.
    #[error("there is no object \"{name}\" with triangles in the file; {}", known(.objects))]
    NoObject { name: String, objects: Vec<String> },
    /// The mesh has edges of three and more triangles or pinched vertices, and is to have none.
    #[error(
        "{edges} non-manifold edge{} and {vertices} non-manifold {}, which ingest.non_manifold = \"refuse\" turns away; \
         `chladni info` shows where, and \"accept\" takes the mesh as it is",
        if *.edges == 1 { "" } else { "s" },
        if *.vertices == 1 { "vertex" } else { "vertices" }
    )]
    NonManifold { edges: usize, vertices: usize },
    /// The file has faces that are dropped, and is to have none.
    #[error(
        "{faces} faces have no area or repeat others, which ingest.degenerate_faces = \"refuse\" turns away; \
         `chladni info` shows where, and \"drop\" goes on without them"
    )]
    DegenerateFaces { faces: usize },
    /// The mended mesh breaks a rule of the canonical one. This is a defect of this program, not of the file.
    #[error("repair left an invalid mesh ({0}); please report the file")]
    Unsound(super::trimesh::InvalidMesh),

    /// A GLB container is shorter than its header says: an interrupted download or copy.
    #[error("the GLB container is cut short ({0}); download or export it again")]
    TruncatedGlb(String),
    /// The document breaks a rule of glTF 2.0.
    #[error("not a valid glTF 2.0 document: {0}; the Khronos glTF validator shows the details")]
    InvalidDocument(String),
    /// The document cannot be read without an extension that we do not read: its positions or triangles are
    /// compressed or quantised.
    #[error("needs the glTF extension {name}, which is not read; {}", remedy(name))]
    RequiredExtension { name: String },
    /// A buffer is missing or shorter than the document says. A `.gltf` has to lie beside its `.bin` files.
    #[error("buffer {buffer}: {problem}")]
    Buffer { buffer: usize, problem: String },
    /// An accessor does not describe usable data inside its buffer.
    #[error("accessor {accessor}: {problem}")]
    Accessor { accessor: usize, problem: String },
    /// A node is its own ancestor or has two parents: transforms would be ambiguous or endless.
    #[error("node {node} is reached twice, so the nodes are no tree; export the scene again")]
    NotATree { node: usize },
    /// The scene repeats its meshes so often that it would fill the memory.
    #[error(
        "the scene repeats its meshes or their parts too often: more than {limit} positions and indices from {bytes} bytes; export the one mesh that is meant"
    )]
    TooManyInstances { limit: usize, bytes: usize },
}

/// More objects are not named.
const NAMED: usize = 12;

fn known(objects: &[String]) -> String {
    match objects {
        [] => "it is one object without a name".into(),
        some if some.len() > NAMED => format!("it has {} ({} in all)", listed(some), some.len()),
        some => format!("it has {}", listed(some)),
    }
}

/// The first few names of objects.
pub fn listed(names: &[String]) -> String {
    let more = if names.len() > NAMED { ", …" } else { "" };
    names[..names.len().min(NAMED)].join(", ") + more
}

fn unfinished(entries: &str, promised: Option<usize>) -> String {
    match promised {
        Some(promised) => format!(", but promises {promised} {entries} entries"),
        None => format!(", before its {entries} entries do"),
    }
}

fn remedy(extension: &str) -> &'static str {
    match extension {
        "KHR_draco_mesh_compression" => "export without Draco compression",
        "EXT_meshopt_compression" | "KHR_meshopt_compression" => {
            "export without meshopt compression"
        }
        "KHR_mesh_quantization" => "export with floating-point positions",
        _ => "export without it",
    }
}

/// A [`Fault`] and its place, before the file's name is known.
#[derive(Debug)]
pub(super) struct Failure {
    pub place: Option<Place>,
    pub fault: Fault,
}

impl Failure {
    pub fn at(place: Place, fault: Fault) -> Self {
        Self { place: Some(place), fault }
    }

    pub fn in_file(self, path: &Path) -> MeshError {
        MeshError { path: path.to_owned(), place: self.place, fault: self.fault }
    }
}

impl From<Fault> for Failure {
    fn from(fault: Fault) -> Self {
        Self { place: None, fault }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_name_the_file_the_place_and_the_remedy() {
        let fault = Fault::IndexOutOfRange { index: 9, vertices: 8 };
        let error = Failure::at(Place::Line(12), fault).in_file(Path::new("a/b.obj"));
        assert_eq!(
            error.to_string(),
            "a/b.obj, line 12: vertex index 9 is out of range: there are 8 vertices to choose from; export the mesh again"
        );
        let name = "KHR_draco_mesh_compression".to_owned();
        let error = Failure::from(Fault::RequiredExtension { name }).in_file(Path::new("c.glb"));
        assert_eq!(
            error.to_string(),
            "c.glb: needs the glTF extension KHR_draco_mesh_compression, which is not read; export without Draco compression"
        );
    }
}
