//! What every target does with its bytes.

use std::path::Path;

use chladni::mesh::Opened;

/// As many objects are taken apart: a file may name thousands, and each costs a pass over all of it.
const OBJECTS: usize = 4;

/// Reads them as a file of that name: all of it as one mesh, and the first objects alone.
pub fn read(name: &str, bytes: &[u8]) {
    let Ok(opened) = Opened::of_bytes(Path::new(name), bytes) else { return };
    let _ = opened.whole();
    for object in opened.objects().iter().take(OBJECTS) {
        let _ = opened.object(object);
    }
}
