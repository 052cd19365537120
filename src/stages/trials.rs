//! The trials of a search that is not finished: one that was stopped and begins again has what it found already.

use std::cell::RefCell;
use std::time::Instant;

use rkyv::{Archive, Deserialize, Serialize};

use crate::ggnn::tune::{Choice, Effort};
use crate::store::{Artifact, CacheKey, Store};

/// The loss of one trial.
#[derive(Debug, Clone, Copy, PartialEq, Archive, Serialize, Deserialize)]
pub struct TrialArtifact {
    loss: f64,
}

impl Artifact for TrialArtifact {
    const STAGE: &'static str = "trial";
    const VERSION: u32 = 1;
    const SCHEMA: u32 = 1;
}

/// The trials of one search, in the store while it lasts.
pub struct Trials<'s> {
    store: Option<&'s Store>,
    search: CacheKey,
    kept: RefCell<Vec<CacheKey>>,
}

impl<'s> Trials<'s> {
    /// Of the search whose result is stored under `search`; without a store nothing is kept.
    pub fn of(search: &CacheKey, store: Option<&'s Store>) -> Self {
        Self { store, search: *search, kept: RefCell::default() }
    }

    /// The loss of a trial, by `training` where it is not known.
    ///
    /// # Errors
    /// Those of `training`.
    pub fn loss<E>(
        &self,
        choice: &Choice,
        effort: Effort,
        training: impl FnOnce() -> Result<f64, E>,
    ) -> Result<f64, E> {
        let Some(store) = self.store else { return training() };
        let key = TrialArtifact::key()
            .param("of", self.search.as_bytes())
            .param("trial", format!("{choice:?} {effort:?}"))
            .finish(0, "f64");
        let loss = match store.get::<TrialArtifact>(&key) {
            Some(known) => known.artifact.loss,
            None => {
                let started = Instant::now();
                let loss = training()?;
                if let Err(error) = store.keep(&key, &TrialArtifact { loss }, started.elapsed()) {
                    store.complain(TrialArtifact::STAGE, &error);
                }
                loss
            }
        };
        self.kept.borrow_mut().push(key);
        Ok(loss)
    }

    /// The search is done, and its result is what counts.
    pub fn are_over(self) {
        let Some(store) = self.store else { return };
        for key in self.kept.into_inner() {
            if let Err(error) = store.remove(&key) {
                tracing::debug!("a trial that has served stays in the cache: {error}");
                return;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ggnn::recipe::Ritz;

    #[test]
    fn a_search_that_begins_again_trains_only_what_is_missing() {
        let dir = tempfile::tempdir().unwrap();
        let store = Store::open(dir.path()).unwrap();
        let search = TrialArtifact::key().param("a", "search").finish(0, "");
        let own = Choice::of(&Ritz::default(), 1.0);
        let wider = Choice { encoder_range: 2.0 * own.encoder_range, ..own };
        let all = [(own, Effort::Quarter), (wider, Effort::Quarter), (own, Effort::Whole)];
        let run = |known: usize, stops_at: usize| {
            let trials = Trials::of(&search, Some(&store));
            let mut losses = Vec::new();
            for (i, (choice, effort)) in all.iter().enumerate() {
                let training = || {
                    assert!(i >= known, "trial {i} was known");
                    if i == stops_at { Err(()) } else { Ok(i as f64) }
                };
                losses.push(trials.loss(choice, *effort, training)?);
            }
            trials.are_over();
            Ok(losses)
        };
        assert_eq!(run(0, 2), Err(()));
        assert_eq!(run(2, 3), Ok(vec![0.0, 1.0, 2.0]));
        // Then nothing is left of it.
        assert_eq!(run(0, 0), Err(()));
    }
}
