//! What a sweep has left: its document, and the eigenfunctions of its meshes.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use chladni::mesh::TriMesh;
use chladni::pipeline::sweep::folder_name;
use chladni::publish::sweep::{CaseReport, SweepReport};
use chladni::spectrum::Dense;
use npyz::npz::NpzArchive;

use super::Outcome;

/// A sweep that was run.
pub struct Experiment {
    /// The name of its file.
    pub name: String,
    /// What was found.
    pub report: SweepReport,
    folder: PathBuf,
}

/// A mesh with its eigenfunctions.
pub struct Solved {
    pub mesh: TriMesh,
    /// λ by k.
    pub values: Vec<f64>,
    /// n×K.
    pub vectors: Dense,
}

impl Experiment {
    /// That of a name, below `out`.
    pub fn read(out: &Path, name: &str) -> Outcome<Self> {
        let folder = out.join(name);
        let bytes = std::fs::read(folder.join("sweep.json")).map_err(|_| "it was not run")?;
        Ok(Self { name: name.into(), report: serde_json::from_slice(&bytes)?, folder })
    }

    /// The run of a variant by the first of its seeds.
    pub fn case(&self, variant: &str) -> Outcome<&CaseReport> {
        let case = self.report.cases.iter().find(|case| case.variant == variant);
        Ok(case.ok_or_else(|| format!("{variant} was not run"))?)
    }

    /// What a variant has found for a mesh, by the first of its seeds.
    pub fn solved(&self, variant: &str, mesh: &str) -> Outcome<Solved> {
        let case = self.case(variant)?;
        let file =
            self.folder.join(folder_name(variant)).join(format!("seed-{}", case.seed)).join(mesh);
        let mut npz = NpzArchive::new(BufReader::new(File::open(file.join("eigen.npz"))?))?;
        let mut numbers = |name: &str| -> Outcome<Vec<f64>> {
            Ok(npz.by_name(name)?.ok_or("an array is missing")?.into_vec()?)
        };
        let (values, vectors) = (numbers("evals")?, numbers("evecs")?);
        let vertices = numbers("vertices")?.as_chunks::<3>().0.to_vec();
        let faces: Vec<i64> = npz.by_name("faces")?.ok_or("there are no faces")?.into_vec()?;
        let faces = faces.as_chunks::<3>().0.iter().map(|face| face.map(|v| v as u32)).collect();
        let (n, k) = (vertices.len(), values.len());
        let vectors = Dense::from_fn(n, k, |i, j| vectors[i * k + j]);
        Ok(Solved { mesh: TriMesh::new(vertices, faces)?, values, vectors })
    }
}
