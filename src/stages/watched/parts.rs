//! Which meshes the files of a folder are: one each, or each of their objects.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use tokio_util::sync::CancellationToken;

use super::scan::Seen;
use crate::mesh::policy::Objects;
use crate::stages::intake::{self, Job, apart};

/// The meshes of the files of a folder, by name.
pub struct Parts {
    folder: PathBuf,
    objects: Objects,
    names: BTreeMap<PathBuf, Vec<String>>,
}

impl Parts {
    /// Of a folder of which nothing is known yet.
    pub fn new(folder: &Path) -> Self {
        Self { folder: folder.into(), objects: Objects::default(), names: BTreeMap::new() }
    }

    /// From now on files are cut so. Whether they were not before.
    pub fn cut(&mut self, objects: Objects) -> bool {
        std::mem::replace(&mut self.objects, objects) != objects
    }

    /// The name of a file.
    pub fn name_of(&self, file: &Path) -> String {
        intake::name_of(&self.folder, file)
    }

    /// How many meshes these files are, as far as is known.
    pub fn count(&self, seen: &Seen) -> usize {
        seen.keys().map(|file| self.names.get(file).map_or(1, Vec::len)).sum()
    }

    /// The other meshes of a file, and itself.
    pub fn of(&self, file: &Path) -> impl Iterator<Item = &String> {
        self.names.get(file).into_iter().flatten()
    }

    /// There was a mesh of this name. The file that it is of: that, or one above it that it was an object of.
    pub fn remember(&mut self, name: String) -> PathBuf {
        let path = self.folder.join(&name);
        let mut files = path.ancestors().take_while(|above| *above != self.folder);
        let file = files.find(|file| file.is_file()).unwrap_or(&path).to_owned();
        self.names.entry(file.clone()).or_default().push(name);
        file
    }

    /// A file is these meshes now. Those that it was and is no more.
    pub fn replace(&mut self, file: &Path, jobs: &[Job]) -> Vec<String> {
        let names: Vec<String> = jobs.iter().map(|job| job.name.clone()).collect();
        let mut gone = self.names.insert(file.into(), names).unwrap_or_default();
        gone.retain(|name| jobs.iter().all(|job| job.name != *name));
        gone
    }

    /// A file is gone. The meshes that it was.
    pub fn remove(&mut self, file: &Path) -> Vec<String> {
        self.names.remove(file).unwrap_or_else(|| vec![self.name_of(file)])
    }

    /// The meshes that files are now, by file. Of one that cannot be read they are what they were: each fails with the reason.
    pub async fn jobs(
        &self,
        files: Vec<PathBuf>,
        cancel: CancellationToken,
    ) -> HashMap<PathBuf, Vec<Job>> {
        let whole = files.into_iter().map(|file| Job::whole(file.clone(), self.name_of(&file)));
        if self.objects == Objects::Merge {
            return whole.map(|job| (job.source.clone(), vec![job])).collect();
        }
        let files: Vec<(Job, Vec<Job>)> = whole
            .map(|job| {
                let known = self.objects_so_far(&job);
                if known.is_empty() { (job.clone(), vec![job]) } else { (job, known) }
            })
            .collect();
        let read = tokio::task::spawn_blocking(move || {
            let of_file = |(job, known): (Job, Vec<Job>)| {
                let objects = if cancel.is_cancelled() { None } else { apart(&job).ok() };
                (job.source, objects.unwrap_or(known))
            };
            files.into_par_iter().map(of_file).collect()
        });
        read.await.unwrap_or_default()
    }

    fn objects_so_far(&self, whole: &Job) -> Vec<Job> {
        let object = |name: &String| {
            let object = name.strip_prefix(&whole.name)?.strip_prefix('/')?;
            Some(Job::object(whole.source.clone(), &whole.name, object.into()))
        };
        self.of(&whole.source).filter_map(object).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_file_that_cannot_be_read_is_what_it_was() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("scene.obj");
        let write = |text: &str| std::fs::write(&file, text).unwrap();
        let mut parts = Parts::new(dir.path());
        assert!(parts.cut(Objects::Split) && !parts.cut(Objects::Split));
        let corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
        write(&format!("{corners}o a\nf 1 2 3\no b\nf 2 1 3\n"));
        let jobs = async |parts: &Parts| {
            let mut jobs = parts.jobs(vec![file.clone()], CancellationToken::new()).await;
            jobs.remove(&file).unwrap()
        };
        let both = jobs(&parts).await;
        assert!(parts.replace(&file, &both).is_empty());
        assert_eq!(parts.of(&file).collect::<Vec<_>>(), ["scene.obj/a", "scene.obj/b"]);
        write("v 0 0");
        assert_eq!(jobs(&parts).await, both);
        write(&format!("{corners}o a\nf 1 2 3\n"));
        let one = jobs(&parts).await;
        assert_eq!((one.len(), &one[0].object), (1, &None));
        assert_eq!(parts.replace(&file, &one), ["scene.obj/a", "scene.obj/b"]);
        assert_eq!(parts.remove(&file), ["scene.obj"]);
    }

    #[test]
    fn objects_of_a_last_time_are_remembered_with_their_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = |name: &str| dir.path().join(name);
        std::fs::write(path("scene.obj"), "").unwrap();
        let mut parts = Parts::new(dir.path());
        assert_eq!(parts.remember("scene.obj/a".into()), path("scene.obj"));
        assert_eq!(parts.remember("gone.obj/b".into()), path("gone.obj/b"));
        assert_eq!(parts.remember("gone.obj".into()), path("gone.obj"));
        assert_eq!(parts.remove(&path("scene.obj")), ["scene.obj/a"]);
        assert_eq!(parts.remove(&path("gone.obj/b")), ["gone.obj/b"]);
    }
}
