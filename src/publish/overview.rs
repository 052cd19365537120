//! What stands beside the folders of all meshes: the page of the run, and the tables of ShapeDNA.

use std::path::Path;

use super::atomic::{PublishError, remove, write};
use super::export::shape_dna;
use super::page;
use super::report::RunReport;
use crate::descriptors::Descriptor;
use crate::pipeline::{Pages, Publish};

/// Which of them are wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Overview {
    page: bool,
    shape_dna: bool,
}

impl Overview {
    /// Those of a pipeline. Pages that are not settled yet are not written.
    pub fn of(asked: &Publish) -> Self {
        let page = asked.report == Pages::Written;
        Self { page, shape_dna: asked.descriptors.contains(&Descriptor::ShapeDna) }
    }

    /// Whether there is nothing to say of the meshes.
    pub fn is_empty(self) -> bool {
        self == Self::default()
    }

    /// Writes them into the output folder `out`, and removes what an earlier pipeline has left there.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn write(self, out: &Path, report: &RunReport) -> Result<(), PublishError> {
        match self.shape_dna {
            true => shape_dna::write(out, report)?,
            false => shape_dna::remove_files(out)?,
        }
        let file = out.join(page::FILE);
        match self.page {
            true => write(&file, page::run_page(report).as_bytes()),
            false if page::is_ours(&file) => remove(&file),
            false => Ok(()),
        }
    }
}
