//! The objects of a file as meshes of their own: `scene.glb` becomes `scene.glb/body` and `scene.glb/wheel`.

use rayon::prelude::*;

use super::{IntakeError, Job, check_names};
use crate::mesh::policy::Objects;
use crate::mesh::{MeshError, Opened};

/// The jobs, each in place of the file's where their objects are to be meshes of their own; then every file is read. One that
/// cannot be stays one job, which fails with the reason.
///
/// # Errors
/// [`IntakeError::Clash`].
pub fn into_objects(jobs: Vec<Job>, objects: Objects) -> Result<Vec<Job>, IntakeError> {
    if objects == Objects::Merge {
        return Ok(jobs);
    }
    let of_file = |job: &Job| apart(job).unwrap_or_else(|_| vec![job.clone()]);
    let jobs = jobs.par_iter().flat_map_iter(of_file).collect::<Vec<_>>();
    check_names(&jobs)?;
    Ok(jobs)
}

/// A job for each object of a file; one that has a single object stays what it is.
///
/// # Errors
/// When the file cannot be read or is no mesh file.
pub fn apart(job: &Job) -> Result<Vec<Job>, MeshError> {
    let objects = Opened::read(&job.source)?.objects();
    if objects.len() < 2 {
        return Ok(vec![job.clone()]);
    }
    let of_object = |object| Job::object(job.source.clone(), &job.name, object);
    Ok(objects.into_iter().map(of_object).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn several_objects_are_several_meshes() {
        let dir = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| {
            let path = dir.path().join(name);
            std::fs::write(&path, text).unwrap();
            Job::whole(path, name.into())
        };
        let corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\no ear\nf 1 2 3\n";
        let both = write("both.obj", &format!("{corners}o nose\nf 3 2 1\n"));
        let jobs = vec![both, write("one.obj", corners), write("none.obj", "")];
        assert_eq!(into_objects(jobs.clone(), Objects::Merge).unwrap(), jobs);
        let jobs = into_objects(jobs, Objects::Split).unwrap();
        let names: Vec<&str> = jobs.iter().map(|job| job.name.as_str()).collect();
        assert_eq!(names, ["both.obj/ear", "both.obj/nose", "one.obj", "none.obj"]);
        assert_eq!((jobs[1].file_name(), jobs[2].file_name()), ("both.obj", "one.obj"));
        let mut clashing = vec![Job::whole(jobs[0].source.clone(), "both.obj".into())];
        clashing.push(Job::whole(jobs[2].source.clone(), "both.obj/ear".into()));
        assert!(into_objects(clashing, Objects::Split).is_err());
        assert_eq!((jobs[1].object.as_deref(), &jobs[2].object), (Some("nose"), &None));
    }
}
