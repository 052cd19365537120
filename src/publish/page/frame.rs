//! What all pages have in common: head, style, the words for a verdict.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use maud::{DOCTYPE, Markup, PreEscaped, html};

use crate::publish::report::{StageRecord, Status};
use crate::publish::table::duration;

const STYLE: &str = include_str!("assets/style.css");

/// Who has made a page, as it stands in its head.
const GENERATOR: &str = "chladni ";

/// Whether a file is one of these pages; people have such files of their own.
pub fn is_ours(file: &Path) -> bool {
    let mut head = Vec::new();
    let read = File::open(file).and_then(|file| file.take(1024).read_to_end(&mut head));
    let mark = format!("name=\"generator\" content=\"{GENERATOR}");
    read.is_ok() && String::from_utf8_lossy(&head).contains(&mark)
}

/// A whole page.
pub fn page(title: &str, body: Markup) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="generator" content={ (GENERATOR) (env!("CARGO_PKG_VERSION")) };
                link rel="icon" href="data:,";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body { main { (body) } }
        }
    };
    page.into_string()
}

/// How a mesh ended, as a badge.
pub fn badge(status: Status) -> Markup {
    let (class, word) = match status {
        Status::Verified => ("good", "verified"),
        Status::Unverified => ("warn", "unverified"),
        Status::Failed => ("bad", "failed"),
    };
    html! { span class={ "badge " (class) } { (word) } }
}

/// A step of the pipeline as it is drawn.
#[derive(Debug, Clone, PartialEq)]
struct Step {
    name: String,
    seconds: f64,
    /// Pieces of work, and how many of them came from the cache.
    parts: usize,
    cached: usize,
}

impl Step {
    fn of(name: String, stages: &[StageRecord]) -> Self {
        let mut step = Self { name, seconds: 0.0, parts: 0, cached: 0 };
        stages.iter().for_each(|stage| step.add(stage));
        step
    }

    fn add(&mut self, stage: &StageRecord) {
        self.seconds += stage.seconds;
        self.parts += 1;
        self.cached += usize::from(stage.cached);
    }
}

/// The stages of a mesh with their times, those of one kind after one another as one.
pub fn flow(stages: &[StageRecord]) -> Markup {
    let groups = stages.chunk_by(|a, b| kind(a) == kind(b) && is_of_one(a));
    let step = |group: &[StageRecord]| match group {
        [first, .., last] => Step::of(format!("{} … {}", first.stage, ending(&last.stage)), group),
        [only] => Step::of(only.stage.clone(), group),
        [] => Step::of(String::new(), group),
    };
    drawn(&groups.map(step).collect::<Vec<_>>())
}

/// The stages of several meshes, all of a kind as one.
pub fn flow_of_all<'a>(meshes: impl Iterator<Item = &'a [StageRecord]>) -> Markup {
    drawn(&steps_of_all(meshes))
}

/// In the order of the pipeline, whichever of them a mesh has.
fn steps_of_all<'a>(meshes: impl Iterator<Item = &'a [StageRecord]>) -> Vec<Step> {
    let mut steps: Vec<Step> = Vec::new();
    for stages in meshes {
        let mut next = 0;
        for stage in stages {
            let name = if is_of_one(stage) { kind(stage) } else { &stage.stage };
            let at = steps.iter().position(|step| step.name == name).unwrap_or_else(|| {
                steps.insert(next, Step::of(name.to_owned(), &[]));
                next
            });
            steps[at].add(stage);
            next = at + 1;
        }
    }
    steps
}

fn drawn(steps: &[Step]) -> Markup {
    html! {
        ol.flow {
            @for Step { name, seconds, parts, cached } in steps {
                li.cached[cached == parts] {
                    (name)
                    small {
                        (duration(*seconds))
                        @if cached == parts { ", from the cache" }
                        @else if *cached > 0 { ", " (cached) " of " (parts) " from the cache" }
                    }
                }
            }
        }
    }
}

/// Whether it is the work on one eigenfunction.
fn is_of_one(stage: &StageRecord) -> bool {
    stage.stage.contains('φ')
}

/// What a stage does, without what for.
fn kind(stage: &StageRecord) -> &str {
    stage.stage.split(' ').next().unwrap_or_default()
}

fn ending(stage: &str) -> &str {
    stage.rsplit_once(' ').map_or(stage, |(_, last)| last)
}

/// The command that this process was started with, to be copied.
pub fn command() -> Markup {
    let arguments = std::env::args_os();
    let arguments: Vec<String> = arguments.map(|given| quoted(&given.to_string_lossy())).collect();
    html! {
        p { "The command:" }
        pre { code { (arguments.join(" ")) } }
    }
}

/// An argument as a shell reads it.
fn quoted(argument: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "-_./=:,+@%".contains(c);
    if !argument.is_empty() && argument.chars().all(plain) {
        argument.to_owned()
    } else {
        format!("'{}'", argument.replace('\'', "'\\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stages(names: &[(&str, bool)]) -> Vec<StageRecord> {
        let record = |&(stage, cached): &(&str, bool)| StageRecord {
            stage: stage.to_owned(),
            cached,
            seconds: 0.5,
        };
        names.iter().map(record).collect()
    }

    #[test]
    fn the_steps_of_all_meshes_are_in_the_order_of_the_pipeline() {
        let short = stages(&[("ingest", false), ("train φ2", true), ("publish", false)]);
        let long = stages(&[
            ("ingest", true),
            ("assemble", false),
            ("remesh", false),
            ("assemble family", true),
            ("train φ2", false),
            ("verify", true),
        ]);
        let steps = steps_of_all([&*short, &*long].into_iter());
        let names: Vec<&str> = steps.iter().map(|step| step.name.as_str()).collect();
        let in_order =
            ["ingest", "assemble", "remesh", "assemble family", "train", "verify", "publish"];
        assert_eq!(names, in_order);
        assert_eq!(steps[4], Step { name: "train".into(), seconds: 1.0, parts: 2, cached: 1 });
        let text = drawn(&steps).into_string();
        assert!(text.contains("train<small>1.00 s, 1 of 2 from the cache"), "{text}");
        assert!(
            text.contains("<li class=\"cached\">verify<small>0.50 s, from the cache"),
            "{text}"
        );
    }

    #[test]
    fn trainings_of_a_mesh_are_one_step() {
        let text = flow(&stages(&[("train φ2", true), ("train φ3", false)])).into_string();
        assert!(text.contains("train φ2 … φ3<small>1.00 s, 1 of 2 from the cache"), "{text}");
    }

    #[test]
    fn a_page_is_told_from_other_files_of_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("report.html");
        assert!(!is_ours(&file));
        std::fs::write(&file, page("a", html! { p { "b" } })).unwrap();
        assert!(is_ours(&file));
        std::fs::write(&file, "<html><p>chladni is fine").unwrap();
        assert!(!is_ours(&file));
    }

    #[test]
    fn a_command_can_be_copied() {
        assert_eq!(quoted("train.k=16"), "train.k=16");
        assert_eq!(quoted("my scans/a'b"), "'my scans/a'\\''b'");
        assert_eq!(quoted(""), "''");
    }
}
