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
        match (self.page, page::is_ours(&file)) {
            (true, false) if file.exists() => {
                tracing::warn!(
                    "{} is somebody else's and stays; to have the page of all meshes there, move it away",
                    file.display()
                );
                Ok(())
            }
            (true, _) => write(&file, page::run_page(report).as_bytes()),
            (false, true) => remove(&file),
            (false, false) => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_comes_and_goes_and_that_of_somebody_else_stays() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join(page::FILE);
        let report = RunReport::new(Vec::new(), 0.0);
        let [with, without] = [true, false].map(|page| Overview { page, shape_dna: false });
        with.write(folder.path(), &report).unwrap();
        assert!(page::is_ours(&file));
        without.write(folder.path(), &report).unwrap();
        assert!(!file.exists());
        std::fs::write(&file, "mine").unwrap();
        for overview in [with, without] {
            overview.write(folder.path(), &report).unwrap();
            assert_eq!(std::fs::read(&file).unwrap(), b"mine");
        }
    }
}
