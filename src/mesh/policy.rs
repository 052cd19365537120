//! What becomes of a file's objects, and of meshes that are read but are not clean: the options of `[ingest]`.
//!
//! Repairs are always the same and always recorded. The options say which meshes are turned away in place of being
//! taken with their repairs or defects.

use serde::{Deserialize, Serialize};

use super::error::Fault;
use super::{Ingested, MeshError, Place};

/// `[ingest]`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct IngestOptions {
    /// The objects of a file.
    pub objects: Objects,
    /// Edges of three and more triangles, and vertices where a surface is pinched.
    pub non_manifold: NonManifold,
    /// Triangles that name a vertex twice, have no area, or repeat an earlier one.
    pub degenerate_faces: DegenerateFaces,
}

/// `ingest.objects`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Objects {
    /// All of a file is one mesh.
    #[default]
    Merge,
    /// Each of several is a mesh.
    Split,
}

/// `ingest.non_manifold`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum NonManifold {
    /// The mesh is taken as it is: the Laplacian couples all triangles that meet there.
    #[default]
    Accept,
    /// The mesh fails.
    Refuse,
}

/// `ingest.degenerate_faces`
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DegenerateFaces {
    /// They are dropped, and the result says how many.
    #[default]
    Drop,
    /// The mesh fails.
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
