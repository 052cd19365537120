//! What becomes of a file's objects, and of meshes that are read but are not clean: the options of `[ingest]`.
//!
//! Repairs are always the same and always recorded. The options say which meshes are turned away in place of being
//! taken with their repairs or defects.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::error::Fault;
use super::{Ingested, MeshError, Place};

/// What is mended is the same for every mesh, and in its spectrum.json: equal positions of STL and glTF become one vertex, polygons
/// become triangles; faces without area or that repeat another, and vertices without a face, are dropped. These options turn meshes
/// away; `chladni info` shows what one has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct IngestOptions {
    /// A file with several objects: the `o` lines of an OBJ file, or else its groups; the solids of an STL file; the nodes of a
    /// glTF scene.
    pub objects: Objects,
    /// Edges where more than two triangles meet, and vertices where a surface is pinched.
    pub non_manifold: NonManifold,
    /// Faces that name a vertex twice, have no area, or have the corners of an earlier one.
    pub degenerate_faces: DegenerateFaces,
}

/// `ingest.objects`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Objects {
    /// They are one mesh.
    #[default]
    Merge,
    /// Each is a mesh, with results in scene.glb/body/, scene.glb/wheel/ and so on. Names are made fit for folders: only
    /// letters, digits, hyphens and underscores stay; another of the same name has a number behind it, one without a name is
    /// object-N. A file with one object keeps its results in scene.glb/ itself.
    Split,
}

/// `ingest.non_manifold`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum NonManifold {
    /// The mesh is taken as it is, and the Laplacian couples all triangles that meet there.
    #[default]
    Accept,
    /// It is a failed mesh.
    Refuse,
}

/// `ingest.degenerate_faces`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum DegenerateFaces {
    /// They are left out, and the result says how many.
    #[default]
    Drop,
    /// It is a failed mesh.
    Refuse,
}

impl IngestOptions {
    /// Whether these options let a mesh in.
    ///
    /// # Errors
    /// [`Fault::NonManifold`] or [`Fault::DegenerateFaces`], at the first place.
    pub fn check(self, ingested: &Ingested, path: &std::path::Path) -> Result<(), MeshError> {
        let refused =
            |place: Option<Place>, fault| MeshError { path: path.to_owned(), place, fault };
        let (topology, repairs) = (&ingested.topology, &ingested.repairs);
        if self.non_manifold == NonManifold::Refuse && !topology.is_manifold() {
            let (edges, vertices) = (topology.non_manifold_edges, topology.non_manifold_vertices);
            return Err(refused(None, Fault::NonManifold { edges, vertices }));
        }
        let dropped =
            [&repairs.collapsed_faces, &repairs.zero_area_faces, &repairs.duplicate_faces];
        let faces = dropped.iter().map(|tally| tally.count).sum();
        if self.degenerate_faces == DegenerateFaces::Refuse && faces > 0 {
            let place = dropped.iter().find_map(|tally| tally.first.first().copied());
            return Err(refused(place, Fault::DegenerateFaces { faces }));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::mesh::load_bytes;

    fn refusal(text: &str, options: IngestOptions) -> Option<String> {
        let ingested = load_bytes(Path::new("a.obj"), text.as_bytes()).unwrap();
        options.check(&ingested, Path::new("a.obj")).err().map(|error| error.to_string())
    }

    const FIN: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 0 -1 0\nf 1 2 3\nf 1 2 4\nf 1 2 5\n";

    #[test]
    fn by_default_every_mesh_is_let_in() {
        let twice = format!("{FIN}f 3 2 1\n");
        assert_eq!(refusal(&twice, IngestOptions::default()), None);
    }

    #[test]
    fn what_is_refused_says_how_often_and_which_option() {
        let strict = IngestOptions {
            non_manifold: NonManifold::Refuse,
            degenerate_faces: DegenerateFaces::Refuse,
            ..IngestOptions::default()
        };
        let message = refusal(FIN, strict).unwrap();
        assert!(
            message.starts_with("a.obj: 1 non-manifold edge and 0 non-manifold vertices"),
            "{message}"
        );
        assert!(message.contains("ingest.non_manifold"), "{message}");
        let clean = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
        assert_eq!(refusal(clean, strict), None);
        let message = refusal(&format!("{clean}f 3 2 1\nf 1 1 2\n"), strict).unwrap();
        assert!(message.starts_with("a.obj, line 6: 2 faces"), "{message}");
        assert!(message.contains("ingest.degenerate_faces"), "{message}");
    }
}
