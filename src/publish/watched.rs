//! What happens in a watched folder: one line of JSON for other programs, one line of text for people.

use serde::{Deserialize, Serialize};

use super::report::{MeshReport, Status};
use super::result::Inheritance;
use super::table::duration;

/// Something that whoever watches the watcher wants to know.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "event", rename_all = "kebab-case")]
pub enum Happened {
    /// The folder is watched.
    Watching {
        /// Which one.
        folder: String,
        /// How many meshes it has.
        meshes: usize,
        /// Why it is looked at every second; null where the system says when something happens.
        polled: Option<String>,
    },
    /// A mesh is new or is being changed.
    Saved {
        /// Which one, relative to the folder.
        path: String,
    },
    /// Its file stays as it is: it waits for its turn.
    Ready {
        /// Which one.
        path: String,
    },
    /// A mesh was changed while it was worked on: that work ends.
    Superseded {
        /// Which one.
        path: String,
    },
    /// The results of a mesh are current.
    Done {
        /// Which one.
        path: String,
        /// How it ended.
        status: Status,
        /// Why it is not verified.
        reason: Option<String>,
        /// What its pairs were made from; null where they were computed from nothing, or were there.
        grown_from: Option<Inheritance>,
        /// The largest angle to the reference, in radians; null where none was measured.
        worst_angle: Option<f64>,
        /// Blocks that were trained, and that came from the store.
        trained: usize,
        /// See `trained`.
        reused: usize,
        /// Whether all of it was there already.
        #[serde(default)]
        cached: bool,
        /// From the save to the results; the work alone, where nobody knows when that was.
        seconds: f64,
        /// The folder of its results.
        out: Option<String>,
    },
    /// A mesh could not be processed.
    Failed {
        /// Which one.
        path: String,
        /// Why.
        reason: String,
        /// It is tried again, since its file may still be half of something.
        again: bool,
    },
    /// A mesh was renamed: its results went along, and nothing was computed.
    Moved {
        /// What it was called.
        from: String,
        /// What it is called.
        path: String,
    },
    /// A mesh was deleted.
    Deleted {
        /// Which one.
        path: String,
        /// Whether its results stay.
        results_kept: bool,
    },
    /// The pipeline file has changed.
    Pipeline {
        /// Why it is not used, and the old one stays in force; null where it is.
        error: Option<String>,
    },
    /// Everything is current.
    Idle {
        /// How many meshes there are.
        meshes: usize,
        /// Of these, those whose pairs all passed.
        verified: usize,
        /// Those of which some pair did not.
        unverified: usize,
        /// Those that could not be processed.
        failed: usize,
    },
}

impl Happened {
    /// What became of a mesh, `seconds` after it was saved.
    pub fn done(report: &MeshReport, seconds: f64) -> Self {
        let mut work = report.stages.iter().filter(|stage| stage.computes());
        let angles = report.eigenpairs.iter().map(|pair| pair.pair.angle_fem);
        Self::Done {
            path: report.path.clone(),
            status: report.status,
            reason: report.reason.clone(),
            grown_from: report.grown_from.map(|ancestor| ancestor.how),
            worst_angle: angles.filter(|angle| angle.is_finite()).reduce(f64::max),
            trained: report.trained,
            reused: report.reused,
            cached: !report.stages.is_empty() && work.all(|stage| stage.cached),
            seconds,
            out: report.out.clone(),
        }
    }

    /// One line for people.
    pub fn line(&self) -> String {
        match self {
            Self::Watching { folder, meshes, polled: None } => {
                format!("watching {folder}, {}", counted(*meshes))
            }
            Self::Watching { folder, meshes, polled: Some(why) } => {
                format!("watching {folder}, {}, by looking every second: {why}", counted(*meshes))
            }
            Self::Saved { path } => format!("{path}  saved"),
            Self::Ready { path } => format!("{path}  ready"),
            Self::Superseded { path } => {
                format!("{path}  saved again: the older version is dropped")
            }
            Self::Done {
                path,
                status,
                reason,
                grown_from,
                worst_angle,
                trained,
                reused,
                cached,
                seconds,
                ..
            } => {
                let how = match (grown_from, trained, reused) {
                    (Some(how), _, _) => how.in_words().to_string(),
                    _ if *cached => "from the cache".into(),
                    (None, 0, 0) => "solved".into(),
                    (None, 0, _) => "nothing to train".into(),
                    (None, trained, _) => format!("{trained} trained"),
                };
                let angle = worst_angle
                    .map(|angle| format!(", worst angle {angle:.1e}"))
                    .unwrap_or_default();
                let verdict = match (status, reason) {
                    (Status::Verified, _) => "verified".to_string(),
                    (_, reason) => format!(
                        "unverified ({})",
                        reason.as_deref().unwrap_or("no reason is known")
                    ),
                };
                format!("{path}  {verdict}{angle}; {how}; {}", duration(*seconds))
            }
            Self::Failed { path, reason, again: true } => {
                format!("{path}  not readable yet: {reason}")
            }
            Self::Failed { path, reason, again: false } => format!("{path}  failed: {reason}"),
            Self::Moved { from, path } => format!("{path}  was {from}: its results went along"),
            Self::Deleted { path, results_kept: true } => {
                format!("{path}  deleted, its results stay")
            }
            Self::Deleted { path, results_kept: false } => {
                format!("{path}  deleted with its results")
            }
            Self::Pipeline { error: None } => {
                "the pipeline has changed: every mesh is looked at again".into()
            }
            Self::Pipeline { error: Some(error) } => {
                format!(
                    "the pipeline has changed and cannot be used; the old one stays in force: {error}"
                )
            }
            Self::Idle { meshes, verified, unverified, failed } => format!(
                "{} current: {verified} verified, {unverified} unverified, {failed} failed",
                counted(*meshes)
            ),
        }
    }
}

fn counted(meshes: usize) -> String {
    format!("{meshes} {}", if meshes == 1 { "mesh" } else { "meshes" })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_and_documents_say_what_happened() {
        let deleted = Happened::Deleted { path: "a.obj".into(), results_kept: false };
        assert_eq!(deleted.line(), "a.obj  deleted with its results");
        let text = serde_json::to_string(&deleted).unwrap();
        assert_eq!(text, r#"{"event":"deleted","path":"a.obj","results_kept":false}"#);
        assert_eq!(serde_json::from_str::<Happened>(&text).unwrap(), deleted);
        let failed = MeshReport::failed("b.obj".into(), None, "it is empty".into(), 0.0);
        assert!(Happened::done(&failed, 0.5).line().starts_with("b.obj  unverified (it is empty)"));
    }
}
