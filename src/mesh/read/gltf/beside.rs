//! The files that a `.gltf` document has its bytes in: they belong to the mesh as the document does.

use std::path::{Path, PathBuf};

use serde_json::Value;

use super::buffers::percent_decoded;

/// The files beside `path` that a `.gltf` names as its buffers, whether they are there or not; none for a document that cannot
/// be read, and for all other files.
pub fn companions(path: &Path) -> Vec<PathBuf> {
    let is_document = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("gltf"));
    if !is_document || !path.is_file() {
        return Vec::new();
    }
    let folder = path.parent().unwrap_or(Path::new(""));
    let document = std::fs::read(path).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok());
    let document: Value = document.unwrap_or_default();
    let buffers = document["buffers"].as_array().into_iter().flatten();
    let uris = buffers.filter_map(|buffer| buffer["uri"].as_str());
    let beside = uris.filter(|uri| !uri.starts_with("data:") && !uri.contains("://"));
    beside.map(|uri| folder.join(percent_decoded(uri))).collect()
}
