//! What the work on a mesh takes of memory, told before the mesh is read: from the size of its file and from the pipeline.
//!
//! It is there to keep large meshes from being under way together, not to be exact. `docs/design-notes.md` has what was measured.

use std::fs;
use std::path::Path;

use crate::pipeline::{Count, Method, Pipeline};

/// Bytes of a file for each vertex, at least: a binary PLY has 38, text 60 to 150. So a mesh from text counts double.
const FILE_BYTES: u64 = 38;

/// Bytes a vertex that ingest, the operators, their factors and the Krylov space of a solve take, whatever K, and for each eigenpair.
const SOLVE: (u64, u64) = (3000, 24);

/// Buffers of one feature that a forward pass has at once, and a step of training for each layer.
const BUFFERS: u64 = 3;

/// What is there whatever the mesh.
const BESIDE: u64 = 8 << 20;

/// What meshes take under one pipeline.
#[derive(Debug, Clone, Copy)]
pub struct Weights {
    /// For every vertex.
    vertex: u64,
    /// For every eigenpair at every vertex.
    pair: u64,
    /// How many eigenpairs.
    count: Count,
    /// For every mesh.
    mesh: u64,
}

impl Weights {
    /// Under this pipeline.
    pub fn of(pipeline: &Pipeline) -> Self {
        let train = &pipeline.train;
        let (count, width) = (train.k, train.width as u64);
        let (solve, pair) = SOLVE;
        let feature = BUFFERS * size_of::<f32>() as u64;
        match train.method {
            Method::Fem | Method::Mpgd => Self { vertex: solve, pair, count, mesh: BESIDE },
            Method::Predict => Self { vertex: solve + width * feature, pair, count, mesh: BESIDE },
            Method::LepDpinn => {
                let members = train.batch as u64 * pipeline.family.vertices.most as u64;
                let step = members * width * (2 + train.layers as u64) * feature;
                Self { vertex: solve + width * feature, pair, count, mesh: BESIDE + step }
            }
        }
    }

    /// Of the mesh in this file. One that cannot be looked at weighs little: it fails when it is read.
    pub fn of_mesh(&self, file: &Path) -> u64 {
        let bytes = |path: &Path| fs::metadata(path).map_or(0, |found| found.len());
        // A .gltf usually has its numbers beside it.
        let beside = file.extension().is_some_and(|extension| extension == "gltf");
        let bytes = bytes(file) + if beside { bytes(&file.with_extension("bin")) } else { 0 };
        let n = bytes / FILE_BYTES;
        let k = self.count.of(n as usize) as u64;
        let vertex = self.vertex.saturating_add(k.saturating_mul(self.pair));
        self.mesh.saturating_add(n.saturating_mul(vertex))
    }
}

/// What a run may take where it is not told: half of the memory that is available now, or 4 GiB where that is not known.
pub fn half_of_the_memory() -> u64 {
    const UNKNOWN: u64 = 4 << 30;
    let told = fs::read_to_string("/proc/meminfo").ok();
    told.as_deref().and_then(available).map_or(UNKNOWN, |bytes| bytes / 2)
}

/// What Linux says is available, in bytes.
fn available(meminfo: &str) -> Option<u64> {
    let line = meminfo.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    Some(line.trim().strip_suffix("kB")?.trim_end().parse::<u64>().ok()? << 10)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mesh_weighs_by_its_file_and_more_pairs_weigh_more() {
        let dir = tempfile::tempdir().unwrap();
        let file = |name: &str, bytes: usize| {
            let path = dir.path().join(name);
            fs::write(&path, vec![b' '; bytes]).unwrap();
            path
        };
        let mut pipeline = Pipeline::default();
        pipeline.train.method = Method::Fem;
        let few = Weights::of(&pipeline);
        let (small, large) =
            (few.of_mesh(&file("a.obj", 1000)), few.of_mesh(&file("b.ply", 3_800_000)));
        assert!((BESIDE..BESIDE + 1_000_000).contains(&small), "{small}");
        assert!((300_000_000..400_000_000).contains(&large), "{large}");
        pipeline.train.k = 100.into();
        assert!(Weights::of(&pipeline).of_mesh(&dir.path().join("b.ply")) > large);
        let text = file("c.gltf", 500);
        file("c.bin", 3_800_000);
        assert!(few.of_mesh(&text) >= large);
        assert_eq!(few.of_mesh(&dir.path().join("none.obj")), BESIDE);
    }

    #[test]
    fn what_is_available_is_read_where_the_system_says_it() {
        assert_eq!(available("MemTotal: 9 kB\nMemAvailable:    2048 kB\n"), Some(2 << 20));
        assert_eq!(available("MemAvailable: many\n"), None);
        assert!(half_of_the_memory() > 0);
    }
}
