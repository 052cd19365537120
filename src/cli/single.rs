//! What `solve` and `predict` are given: one mesh, and what is written of it.

use std::path::PathBuf;

use serde::de::DeserializeOwned;
use serde::de::value::{Error, StrDeserializer};

use super::Refusal;
use super::task::refuse_among_meshes;
use crate::descriptors::Descriptor;
use crate::mesh::{Ingested, MeshError, Opened};
use crate::pipeline::{ExportFormat, Publish};
use crate::stages::intake::Job;

/// A mesh: a file, or one of its objects.
#[derive(Debug, clap::Args)]
pub struct OneMesh {
    /// An OBJ, OFF, PLY, STL, VTK, VTP, glTF or GLB file
    #[arg(value_name = "MESH")]
    pub file: PathBuf,
    /// One object of the file, as the file or `chladni info` calls it [default: all of the file is one mesh]
    #[arg(long, value_name = "NAME")]
    pub object: Option<String>,
}

impl OneMesh {
    /// As a job, which is called by the names of the file and the object.
    pub fn job(&self) -> Job {
        let file = self.file.file_name().unwrap_or(self.file.as_os_str()).to_string_lossy();
        match &self.object {
            None => Job::whole(self.file.clone(), file.into_owned()),
            Some(object) => {
                // What cannot be read fails when it is, with its reason.
                let opened = Opened::read(&self.file).ok();
                let called = opened.as_ref().and_then(|opened| opened.called(object));
                let object = called.unwrap_or(object).to_owned();
                Job::object(self.file.clone(), &file, object)
            }
        }
    }

    /// Reads it; with the names of the objects that it is made of, where it is all of a file.
    ///
    /// # Errors
    /// Why it is no mesh.
    pub fn read(&self) -> Result<(Ingested, Vec<String>), MeshError> {
        let opened = Opened::read(&self.file)?;
        Ok(match &self.object {
            None => (opened.whole()?, opened.objects()),
            Some(object) => {
                let object = opened.called(object).unwrap_or(object);
                (opened.object(object)?, Vec::new())
            }
        })
    }

    /// What it is called in what is shown.
    pub fn title(&self) -> String {
        let path = self.object.as_ref().map(|object| self.file.join(object));
        path.as_ref().unwrap_or(&self.file).display().to_string()
    }
}

/// What is written of a mesh, and where.
#[derive(Debug, clap::Args)]
pub struct Written {
    /// Write the eigenpairs too, to DIR/<name of the file>, of an object to DIR/<name of the file>/<name of the object>
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// In which formats beside npz, with commas between: json, ply, vtk, vtu, glb, csv, mat, operators, mtx [default: ply]
    #[arg(long, value_name = "FORMATS", value_delimiter = ',', requires = "out", value_parser = named::<ExportFormat>)]
    formats: Option<Vec<ExportFormat>>,
    /// With which descriptors: hks, wks, gps, shape-dna, spectral-coordinates
    #[arg(long, value_name = "NAMES", value_delimiter = ',', requires = "out", value_parser = named::<Descriptor>)]
    descriptors: Vec<Descriptor>,
}

impl Written {
    /// Whether anything is.
    pub fn is_asked_for(&self) -> bool {
        self.out.is_some()
    }

    /// Whether the results of the mesh can be there.
    ///
    /// # Errors
    /// When the mesh itself is.
    pub fn check(&self, job: &Job) -> Result<(), Refusal> {
        self.out.iter().try_for_each(|out| refuse_among_meshes(out, [job]))
    }

    /// Where.
    pub fn folder(&self) -> PathBuf {
        self.out.clone().unwrap_or_default()
    }

    /// As the options of a pipeline.
    pub fn options(&self) -> Publish {
        let plain = Publish::default();
        let formats = self.formats.clone().unwrap_or(plain.formats);
        Publish { formats, descriptors: self.descriptors.clone(), ..plain }
    }
}

/// What a pipeline calls so.
fn named<T: DeserializeOwned>(name: &str) -> Result<T, String> {
    T::deserialize(StrDeserializer::<Error>::new(name)).map_err(|error| error.to_string())
}
