//! Inputs that are lists: text files, `.txt` or `.lst`, with one mesh, folder or pattern a line.
//!
//! Paths are relative to the folder of the list, and so are the names of what lies below it, so that two subjects'
//! `mesh.obj` stay apart. Blank lines say nothing, nor do those that begin with `#`.

use std::path::{Component, Path};

use super::{IntakeError, Job, name_of, of_input};

/// Whether an input is a list, by its name.
pub fn is_list(input: &Path) -> bool {
    let extension = input.extension().and_then(|e| e.to_str());
    extension.is_some_and(|e| ["txt", "lst"].iter().any(|list| e.eq_ignore_ascii_case(list)))
}

/// The meshes of a list, in its order.
///
/// # Errors
/// [`IntakeError::List`] for a list that cannot be read, and what is wrong with one of its lines.
pub fn jobs(list: &Path) -> Result<Vec<Job>, IntakeError> {
    let error = |reason: String| IntakeError::List { list: list.to_owned(), line: None, reason };
    let text = std::fs::read_to_string(list).map_err(|e| error(format!("cannot be read: {e}")))?;
    let folder = list.parent().unwrap_or(Path::new(""));
    let mut jobs = Vec::new();
    let lines = text.trim_start_matches('\u{feff}').lines().map(str::trim);
    for (line, entry) in (1..).zip(lines) {
        if entry.is_empty() || entry.starts_with('#') {
            continue;
        }
        let path = folder.join(entry);
        let error = |reason: String| {
            let list = list.to_owned();
            IntakeError::List { list, line: Some(line), reason }
        };
        if is_list(&path) {
            return Err(error(format!(
                "{entry} is a list; name its meshes here, or both as inputs"
            )));
        }
        let found = of_input(&path).map_err(|e| error(e.to_string()))?;
        jobs.extend(found.into_iter().map(|Job { source, name, .. }| {
            let name = name_below(folder, &source).unwrap_or(name);
            Job::whole(source, name)
        }));
    }
    if jobs.is_empty() {
        return Err(error("no line names a mesh".to_owned()));
    }
    Ok(jobs)
}

/// The name of a file below a folder; none where it is elsewhere, whichever way it is written.
fn name_below(folder: &Path, path: &Path) -> Option<String> {
    let below = path.strip_prefix(folder).ok()?;
    let plain = below.components().all(|part| matches!(part, Component::Normal(_)));
    plain.then(|| name_of(folder, path))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_names_meshes_folders_and_patterns_from_where_it_lies() {
        let dir = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| {
            let path = dir.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        };
        for name in ["in/1/m.obj", "in/2/m.obj", "in/f/a.off", "in/f/b.off", "x.obj", "in/g h.obj"]
        {
            write(name, "");
        }
        write("in/all.lst", "# subjects\n1/m.obj\r\n\n  2/m.obj\nf\n*h.obj\n../x.obj\nnone.obj\n");
        let found = jobs(&dir.path().join("in/all.lst")).unwrap();
        let names: Vec<&str> = found.iter().map(|job| job.name.as_str()).collect();
        let expected = ["1/m.obj", "2/m.obj", "f/a.off", "f/b.off", "g h.obj", "x.obj", "none.obj"];
        assert_eq!(names, expected);
        assert_eq!(found[0].source, dir.path().join("in/1/m.obj"));
    }

    #[test]
    fn errors_name_the_list_and_the_line() {
        let dir = tempfile::tempdir().unwrap();
        let list = dir.path().join("l.txt");
        let message = |text: &str| {
            std::fs::write(&list, text).unwrap();
            jobs(&list).unwrap_err().to_string()
        };
        assert!(message("# none\n").ends_with("l.txt: no line names a mesh"));
        assert!(message("a.obj\n*.ply\n").contains("l.txt, line 2: "));
        assert!(message("l.txt\n").contains("line 1: l.txt is a list"));
        std::fs::remove_file(&list).unwrap();
        assert!(jobs(&list).unwrap_err().to_string().contains("cannot be read"));
    }
}
