//! A piece of work: everything that its result depends on, as a cache key and in words.

use std::collections::BTreeMap;
use std::marker::PhantomData;

use serde_json::Value;

use crate::publish::report::WorkRecord;
use crate::store::{Artifact, CacheKey, Digest, KeyBuilder};

/// Work that is described bit by bit; [`seeded`](Self::seeded) completes it.
pub struct Work<A> {
    key: KeyBuilder,
    params: Vec<(String, Value)>,
    inputs: Vec<(String, Digest)>,
    part: Option<usize>,
    artifact: PhantomData<A>,
}

/// Work with its key.
pub struct Keyed<A> {
    key: CacheKey,
    params: Vec<(String, Value)>,
    inputs: Vec<(String, Digest)>,
    part: Option<usize>,
    artifact: PhantomData<A>,
}

impl<A: Artifact> Work<A> {
    /// Work of the stage that makes `A`.
    pub fn of_stage() -> Self {
        let params = vec![("version".into(), A::VERSION.into())];
        Self { key: A::key(), params, inputs: Vec::new(), part: None, artifact: PhantomData }
    }

    /// Work number `part` of the stage.
    pub fn part(mut self, part: usize) -> Self {
        self.key = self.key.param("part", part.to_string());
        self.part = Some(part);
        self
    }

    /// It depends on a parameter.
    pub fn param(mut self, name: &str, value: impl AsRef<[u8]>) -> Self {
        self.key = self.key.param(name, &value);
        let text = || String::from_utf8_lossy(value.as_ref()).into_owned().into();
        let value = serde_json::from_slice(value.as_ref()).unwrap_or_else(|_| text());
        self.params.push((name.into(), value));
        self
    }

    /// It depends on some content.
    pub fn input(mut self, role: impl Into<String>, content: &Digest) -> Self {
        let role = role.into();
        self.key = self.key.input(&role, content);
        self.inputs.push((role, *content));
        self
    }

    /// It depends on a seed and on the precision it is done in; this completes the key.
    pub fn seeded(mut self, seed: u64, precision: &str) -> Keyed<A> {
        self.params.push(("seed".into(), seed.into()));
        let Self { key, params, inputs, part, artifact } = self;
        Keyed { key: key.finish(seed, precision), params, inputs, part, artifact }
    }
}

impl<A: Artifact> Keyed<A> {
    /// Where the store has its result, once there is one.
    pub fn key(&self) -> &CacheKey {
        &self.key
    }

    /// Which of several of its stage it is, counted from 1.
    pub fn part(&self) -> Option<usize> {
        self.part
    }

    /// The digests that went into the key, by role.
    pub fn inputs(&self) -> &[(String, Digest)] {
        &self.inputs
    }

    /// What it depends on, in words, and whether it was `cached`.
    pub fn record(&self, cached: bool) -> WorkRecord {
        let inputs = gathered(&self.inputs).into_iter().map(|(role, hash)| (role, hash.into()));
        let fields = self.params.iter().cloned().chain(inputs).collect();
        WorkRecord { stage: A::STAGE.into(), part: self.part, cached, fields }
    }
}

/// Digits of a hash that are enough to see whether it is another.
const SHORT: usize = 16;

/// Inputs by role; those of a role that is counted (`block 2`, `block 3`, …) or repeated as one: what they are together.
fn gathered(inputs: &[(String, Digest)]) -> BTreeMap<String, String> {
    let mut roles: BTreeMap<&str, Vec<u8>> = BTreeMap::new();
    for (role, content) in inputs {
        let role = match role.rsplit_once(' ') {
            Some((role, number)) if number.parse::<usize>().is_ok() => role,
            _ => role,
        };
        roles.entry(role).or_default().extend(content.as_bytes());
    }
    let short = |bytes: &[u8]| format!("{:.SHORT$}", Digest::of(bytes).to_string());
    roles.into_iter().map(|(role, bytes)| (role.to_string(), short(&bytes))).collect()
}

/// The role of what a network reads of a mesh, where a previous version says it: its frame, or its landmarks.
pub const PARENTS_FRAME: &str = "frame of the previous version";

/// Options as the bytes that stand for them in a key.
///
/// # Panics
/// When they are no JSON, which options made of numbers and names always are: an empty text instead would make
/// keys collide.
pub fn canonical(options: &impl serde::Serialize) -> Vec<u8> {
    serde_json::to_vec(options).expect("options are numbers and names")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stages::artifacts::TrunkArtifact;

    #[test]
    fn a_record_says_what_the_key_is_made_of() {
        let (a, b) = (Digest::of(b"a"), Digest::of(b"b"));
        let work = |last: &Digest| {
            Work::<TrunkArtifact>::of_stage()
                .part(4)
                .param("recipe", canonical(&serde_json::json!({ "steps": 100 })))
                .param("trunk", "shared")
                .input("mesh", &a)
                .input("block 2", &a)
                .input("block 3", last)
                .seeded(7, "f32")
        };
        let (one, other) = (work(&a).record(false), work(&b).record(true));
        assert_eq!((one.stage.as_str(), one.part, one.cached), ("train", Some(4), false));
        assert_eq!(one.fields["recipe"]["steps"], 100);
        assert_eq!((&one.fields["trunk"], &one.fields["seed"]), (&"shared".into(), &7.into()));
        let differing: Vec<_> =
            one.fields.keys().filter(|&name| one.fields[name] != other.fields[name]).collect();
        assert_eq!(differing, ["block"]);
    }
}
