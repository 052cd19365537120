//! The objects of a file as meshes of their own: `scene.glb` becomes `scene.glb/body` and `scene.glb/wheel`.

use super::Job;
use crate::mesh::Opened;
use crate::mesh::policy::Objects;

/// The jobs, each in place of the file's where their objects are to be meshes of their own.
pub fn into_objects(jobs: Vec<Job>, objects: Objects) -> Vec<Job> {
    match objects {
        Objects::Merge => jobs,
        Objects::Split => jobs.into_iter().flat_map(apart).collect(),
    }
}

/// A job for each object of a file. One that has a single object stays what it is; so does one that cannot be read, which fails when
/// it is to be, with its reason.
pub fn apart(job: Job) -> Vec<Job> {
    let objects = Opened::read(&job.source).map(|opened| opened.objects()).unwrap_or_default();
    if objects.len() < 2 {
        return vec![job];
    }
    let of_object = |object| Job::object(job.source.clone(), &job.name, object);
    objects.into_iter().map(of_object).collect()
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
        assert_eq!(into_objects(jobs.clone(), Objects::Merge), jobs);
        let jobs = into_objects(jobs, Objects::Split);
        let names: Vec<&str> = jobs.iter().map(|job| job.name.as_str()).collect();
        assert_eq!(names, ["both.obj/ear", "both.obj/nose", "one.obj", "none.obj"]);
        assert_eq!((jobs[1].file_name(), jobs[2].file_name()), ("both.obj", "one.obj"));
        assert_eq!((jobs[1].object.as_deref(), &jobs[2].object), (Some("nose"), &None));
    }
}
