//! What a run would do and why: the document and the text of `chladni run --dry-run` and `chladni explain`.

use std::collections::BTreeMap;
use std::fmt::Write;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::report::{RunRecord, WorkRecord};

/// The format of the document.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum RunPlanSchema {
    /// The one that [`RunPlan`] describes.
    #[default]
    #[serde(rename = "chladni-plan-1")]
    V1,
}

/// What a run would do.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RunPlan {
    /// The format.
    pub schema: RunPlanSchema,
    /// One entry a mesh, in the order of the run.
    pub meshes: Vec<PlannedMesh>,
}

/// What a run over a file with variants would do.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SweepPlan {
    /// The format.
    pub schema: SweepPlanSchema,
    /// One entry a variant and seed, in the order of the run.
    pub cases: Vec<PlannedCase>,
}

/// The format of a [`SweepPlan`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum SweepPlanSchema {
    /// The one that [`SweepPlan`] describes.
    #[default]
    #[serde(rename = "chladni-sweep-plan-1")]
    V1,
}

/// What would be done for a variant with one seed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlannedCase {
    /// The name of the variant; empty for a file without variants.
    pub variant: String,
    /// `train.seed`.
    pub seed: u64,
    /// What would be done.
    pub plan: RunPlan,
}

impl SweepPlan {
    /// The plan of these cases.
    pub fn new(cases: Vec<PlannedCase>) -> Self {
        Self { schema: SweepPlanSchema::V1, cases }
    }
}

/// What a run would do for one mesh.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlannedMesh {
    /// The file, relative to the input that it was found under.
    pub path: String,
    /// The work, in its order.
    pub work: Vec<PlannedWork>,
    /// The blocks of a previous version are tried, and what follows depends on their certificate.
    pub undecided: bool,
    /// Why it could not be processed, as far as that is known without doing it.
    pub failure: Option<String>,
}

/// A piece of work.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PlannedWork {
    /// Its stage.
    pub stage: String,
    /// Which of several (the eigenfunction, for training), counted from 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part: Option<usize>,
    /// Whether its result is there.
    pub cached: bool,
    /// Why it is not; nothing where it is.
    pub because: Option<Because>,
}

/// Why work would be done.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Because {
    /// The last run had no such work, or there was none.
    New,
    /// It depends on the same as in the last run, and its result is not in this cache.
    NotCached,
    /// What it depends on has changed since the last run.
    Changed(Vec<Change>),
}

/// A field of a key that has another value than in the last run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Change {
    /// Its name, with those of the options that it is part of.
    pub field: String,
    /// What it was; null for nothing.
    pub before: Value,
    /// What it is.
    pub after: Value,
}

impl PlannedWork {
    /// The work of a plan beside that of the last run.
    pub fn beside(work: Vec<WorkRecord>, last: Option<&RunRecord>) -> Vec<Self> {
        let mut earlier: BTreeMap<(String, Option<usize>), Vec<&WorkRecord>> = BTreeMap::new();
        for record in last.iter().flat_map(|run| run.work.iter().rev()) {
            earlier.entry((record.stage.clone(), record.part)).or_default().push(record);
        }
        let one = |WorkRecord { stage, part, cached, fields }: WorkRecord| {
            let before = earlier.get_mut(&(stage.clone(), part)).and_then(Vec::pop);
            let because = (!cached).then(|| match before {
                None => Because::New,
                Some(before) => {
                    let changes = changes(&before.fields, &fields);
                    if changes.is_empty() { Because::NotCached } else { Because::Changed(changes) }
                }
            });
            Self { stage, part, cached, because }
        };
        work.into_iter().map(one).collect()
    }

    /// What happens to it, and why.
    fn why(&self) -> (&'static str, String) {
        match &self.because {
            None => ("reused", String::new()),
            Some(because) => ("computed", because.text()),
        }
    }

    fn name(&self) -> String {
        self.part.map_or_else(|| self.stage.clone(), |part| format!("{} φ{part}", self.stage))
    }
}

/// What differs, option by option.
fn changes(before: &BTreeMap<String, Value>, after: &BTreeMap<String, Value>) -> Vec<Change> {
    let [before, after] = [before, after].map(|fields| {
        let mut leaves = BTreeMap::new();
        fields.iter().for_each(|(name, value)| flatten(name, value, &mut leaves));
        leaves
    });
    let names: std::collections::BTreeSet<&String> = before.keys().chain(after.keys()).collect();
    let value = |of: &BTreeMap<String, Value>, name| of.get(name).cloned().unwrap_or_default();
    names
        .into_iter()
        .map(|name| Change {
            field: name.clone(),
            before: value(&before, name),
            after: value(&after, name),
        })
        .filter(|change| change.before != change.after)
        .collect()
}

fn flatten(name: &str, value: &Value, leaves: &mut BTreeMap<String, Value>) {
    match value {
        Value::Object(fields) => {
            for (field, value) in fields {
                flatten(&format!("{name}.{field}"), value, leaves);
            }
        }
        leaf => drop(leaves.insert(name.into(), leaf.clone())),
    }
}

impl Change {
    /// In words: an option with its values, contents without their hashes.
    fn text(&self) -> String {
        let name = self.field.rsplit('.').next().unwrap_or(&self.field);
        match (name, &self.before, &self.after) {
            ("block", _, _) => "earlier blocks".into(),
            ("parent", _, _) => "the previous version's blocks".into(),
            (_, Value::String(before), Value::String(after))
                if is_hash(before) || is_hash(after) =>
            {
                format!("{name} changed")
            }
            ("version", before, after) => format!("chladni's own code {before} → {after}"),
            (_, before, after) => format!("{name} {} → {}", plain(before), plain(after)),
        }
    }
}

fn is_hash(text: &str) -> bool {
    text.len() == 16 && text.bytes().all(|byte| byte.is_ascii_hexdigit())
}

fn plain(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Null => "none".into(),
        other => other.to_string(),
    }
}

impl Because {
    fn text(&self) -> String {
        match self {
            Self::New => "new".into(),
            Self::NotCached => "not in this cache".into(),
            Self::Changed(changes) => {
                changes.iter().map(Change::text).collect::<Vec<_>>().join(", ")
            }
        }
    }
}

impl PlannedMesh {
    /// Whether a run would have nothing to do for it.
    fn is_current(&self) -> bool {
        self.failure.is_none() && self.work.iter().all(|work| work.cached)
    }

    /// Its work in lines, those that say the same in one; with what is there already, if `everything` is to be shown.
    fn text(&self, everything: bool) -> String {
        let mut text = format!("{}\n", self.path);
        let shown = self.work.iter().filter(|work| everything || !work.cached);
        let shown: Vec<&PlannedWork> = shown.collect();
        for run in shown.chunk_by(|a, b| a.stage == b.stage && a.why() == b.why()) {
            let (first, last) = (run[0].name(), run[run.len() - 1]);
            let name = match (run.len(), last.part) {
                (1, _) => first,
                (_, Some(part)) => format!("{first}…φ{part}"),
                (times, None) => format!("{first} × {times}"),
            };
            let (verb, why) = run[0].why();
            let _ = writeln!(text, "{}", format!("  {verb:<9} {name:<20} {why}").trim_end());
        }
        if self.undecided {
            text += "  then its certificate decides: accepted, heads solved anew, fine-tuned, or trained from nothing\n";
        }
        if let Some(failure) = &self.failure {
            let _ = writeln!(text, "  fails: {failure}");
        }
        text
    }
}

impl RunPlan {
    /// What a run would do for these meshes.
    pub fn new(meshes: Vec<PlannedMesh>) -> Self {
        Self { schema: RunPlanSchema::V1, meshes }
    }

    /// For people: what would be computed and why, or `everything`.
    pub fn text(&self, everything: bool) -> String {
        let shown = self.meshes.iter().filter(|mesh| everything || !mesh.is_current());
        let mut text: String = shown.map(|mesh| mesh.text(everything) + "\n").collect();
        let current = self.meshes.iter().filter(|mesh| mesh.is_current()).count();
        let failing = self.meshes.iter().filter(|mesh| mesh.failure.is_some()).count();
        let trained = self.meshes.iter().flat_map(|mesh| &mesh.work);
        let trained = trained.filter(|work| work.stage == "train" && !work.cached).count();
        let all = self.meshes.len();
        let _ = writeln!(
            text,
            "{all} {}: {current} up to date, {} to compute ({trained} {}), {failing} {}",
            if all == 1 { "mesh" } else { "meshes" },
            all - current - failing,
            if trained == 1 { "training" } else { "trainings" },
            if failing == 1 { "fails" } else { "fail" },
        );
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn record(part: usize, fields: Value) -> WorkRecord {
        let fields = serde_json::from_value(fields).unwrap();
        WorkRecord { stage: "train".into(), part: Some(part), cached: false, fields }
    }

    fn run(work: Vec<WorkRecord>) -> RunRecord {
        let (stages, pairs) = (Vec::new(), Vec::new());
        let schema = Default::default();
        RunRecord { schema, stages, pairs, trained: 0, reused: 0, seconds: 1.0, work }
    }

    #[test]
    fn the_changed_option_is_named_and_what_follows_from_it() {
        let first =
            |rate: f64| record(2, json!({ "recipe": { "ritz": { "learning_rate": rate } } }));
        let second = |hash: &str| record(3, json!({ "recipe": "r", "block": hash }));
        let last = run(vec![first(1e-3), second("0123456789abcdef")]);
        let work = vec![first(5e-4), second("fedcba9876543210"), record(4, json!({}))];
        let planned = PlannedWork::beside(work, Some(&last));
        let texts: Vec<String> =
            planned.iter().map(|work| work.because.as_ref().unwrap().text()).collect();
        assert_eq!(texts, ["learning_rate 0.001 → 0.0005", "earlier blocks", "new"]);
        let same = PlannedWork::beside(vec![first(1e-3)], Some(&last));
        assert_eq!(same[0].because, Some(Because::NotCached));
        assert_eq!(PlannedWork::beside(vec![first(1e-3)], None)[0].because, Some(Because::New));
    }

    #[test]
    fn lines_that_say_the_same_are_one() {
        let work = |stage: &str, part, cached| PlannedWork {
            stage: stage.into(),
            part,
            cached,
            because: (!cached).then_some(Because::New),
        };
        let mesh = PlannedMesh {
            path: "a.obj".into(),
            work: vec![
                work("assemble", None, true),
                work("assemble", None, true),
                work("train", Some(2), false),
                work("train", Some(3), false),
                work("predict", None, false),
            ],
            undecided: false,
            failure: None,
        };
        let plan = RunPlan::new(vec![mesh]);
        let text = plan.text(true);
        assert_eq!(
            text.lines().collect::<Vec<_>>(),
            [
                "a.obj",
                "  reused    assemble × 2",
                "  computed  train φ2…φ3          new",
                "  computed  predict              new",
                "",
                "1 mesh: 0 up to date, 1 to compute (2 trainings), 0 fail",
            ]
        );
        assert!(!plan.text(false).contains("reused"));
    }
}
