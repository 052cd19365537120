//! A search for a better recipe, within a budget: over the numbers that do not change what a prediction costs, judged by the
//! loss on members of the family that its trainings do not see ([`super::held_out`]).
//!
//! Candidates are drawn around the recipe that the search starts from, which is one of them. All are trained with a quarter
//! of the steps, the best quarter of them once more with all (successive halving, with one halving). The recipe that it
//! starts from is trained with all in any case, so that what is chosen is never worse than it by this measure.
//!
//! A budget is a number of candidates and not of seconds: the same inputs give the same bits.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::block::Block;
use super::held_out::loss;
use super::recipe::{Ritz, Trunks};
use super::sample::{Member, Sample, append_predictions};
use super::train::{Observer, TrainError, train_blocks, trunk_seed};
use crate::operators::Boundary;
use crate::spectrum::Dense;

/// The numbers that are searched over.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Choice {
    /// Adam's learning rate at the first step.
    pub learning_rate: f64,
    /// γ₁, the range of the encoder's initial weights.
    pub encoder_range: f64,
    /// γ₂, that of the hidden ones.
    pub hidden_range: f64,
    /// The head's ridge.
    pub ridge: f64,
    /// Family members in one step.
    pub batch: usize,
    /// Of a shared trunk: eigenfunctions beyond the wanted ones.
    pub spare: usize,
    /// Under Dirichlet conditions: what holds the network to 0 on the boundary.
    pub boundary_penalty: f64,
}

impl Choice {
    /// What a recipe has chosen.
    pub fn of(recipe: &Ritz, boundary_penalty: f64) -> Self {
        let &Ritz { ranges, batch, learning_rate, ridge, spare, .. } = recipe;
        let (encoder_range, hidden_range) = (ranges.encoder, ranges.hidden);
        Self { learning_rate, encoder_range, hidden_range, ridge, batch, spare, boundary_penalty }
    }

    /// The recipe with these numbers in place of its own. The boundary's penalty stands in the members.
    pub fn applied(&self, recipe: &Ritz) -> Ritz {
        let &Self { learning_rate, encoder_range, hidden_range, ridge, batch, spare, .. } = self;
        let mut recipe = Ritz { learning_rate, ridge, batch, spare, ..*recipe };
        recipe.ranges.encoder = encoder_range;
        recipe.ranges.hidden = hidden_range;
        recipe
    }
}

/// Which numbers there are to choose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Space {
    /// Spare eigenfunctions are for a shared trunk alone.
    pub trunks: Trunks,
    /// The penalty is for Dirichlet conditions alone.
    pub boundary: Boundary,
    /// How many members trials train on: a batch has no more.
    pub members: usize,
}

/// The largest factors that candidates are away from the recipe that the search starts from, either way.
mod reach {
    pub const LEARNING_RATE: f64 = 4.0;
    pub const ENCODER_RANGE: f64 = 2.0;
    pub const HIDDEN_RANGE: f64 = 10.0;
    pub const RIDGE: f64 = 100.0;
    pub const BATCH: f64 = 4.0;
    pub const SPARE: f64 = 3.0;
    pub const BOUNDARY_PENALTY: f64 = 10.0;
}

impl Space {
    /// A candidate, log-uniform around `own`.
    fn draw(&self, own: &Choice, rng: &mut ChaCha8Rng) -> Choice {
        // All are drawn, whether they count or not: the stream is the same for every space.
        let mut around = |value: f64, reach: f64| value * reach.powf(rng.random_range(-1.0..=1.0));
        let drawn = Choice {
            learning_rate: rounded(around(own.learning_rate, reach::LEARNING_RATE)),
            encoder_range: rounded(around(own.encoder_range, reach::ENCODER_RANGE)),
            hidden_range: rounded(around(own.hidden_range, reach::HIDDEN_RANGE)),
            ridge: rounded(around(own.ridge, reach::RIDGE)),
            batch: around(own.batch as f64, reach::BATCH).round() as usize,
            // From the next number on, so that none at all is among them.
            spare: around(own.spare as f64 + 1.0, reach::SPARE).round() as usize,
            boundary_penalty: rounded(around(own.boundary_penalty, reach::BOUNDARY_PENALTY)),
        };
        Choice {
            batch: drawn.batch.clamp(1, self.members.max(1)),
            spare: match self.trunks {
                Trunks::PerEigenfunction => own.spare,
                Trunks::Shared => drawn.spare.saturating_sub(1),
            },
            boundary_penalty: match self.boundary {
                Boundary::Neumann => own.boundary_penalty,
                Boundary::Dirichlet => drawn.boundary_penalty,
            },
            ..drawn
        }
    }
}

/// To three digits: more would say nothing, and a recipe is read by people.
fn rounded(value: f64) -> f64 {
    format!("{value:.2e}").parse().unwrap_or(value)
}

/// How long a candidate is trained.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Effort {
    /// With a quarter of the steps.
    Quarter,
    /// With all.
    Whole,
}

impl Effort {
    /// The recipe with so many steps.
    pub fn of(self, recipe: &Ritz) -> Ritz {
        let steps = match self {
            Self::Quarter => recipe.steps.div_ceil(4),
            Self::Whole => recipe.steps,
        };
        Ritz { steps, ..*recipe }
    }
}

/// A candidate with what became of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Trial {
    /// The candidate.
    pub choice: Choice,
    /// The loss after a quarter of the steps; infinite when training failed.
    pub quarter: f64,
    /// The loss after all; `None` for those that did not get so far.
    pub whole: Option<f64>,
}

/// What a search has found.
#[derive(Debug, Clone, PartialEq)]
pub struct Tuning {
    /// All candidates; the first is the recipe that the search started from.
    pub trials: Vec<Trial>,
    /// Which of them has the lowest loss after all steps.
    pub best: usize,
}

impl Tuning {
    /// What is chosen; nothing when there was no candidate.
    pub fn choice(&self) -> Option<&Choice> {
        self.trials.get(self.best).map(|trial| &trial.choice)
    }
}

/// Tries `candidates` recipes, `own` among them. `judge` trains one and tells its loss.
///
/// # Errors
/// Those of `judge`.
pub fn search<E>(
    own: Choice,
    space: &Space,
    candidates: usize,
    seed: u64,
    mut judge: impl FnMut(&Choice, Effort) -> Result<f64, E>,
) -> Result<Tuning, E> {
    // Its own stream of the seed: initial weights and batches come from others.
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(2);
    let drawn = (1..candidates.max(1)).map(|_| space.draw(&own, &mut rng));
    let mut trials = [own]
        .into_iter()
        .chain(drawn)
        .map(|choice| Ok(Trial { choice, quarter: judge(&choice, Effort::Quarter)?, whole: None }))
        .collect::<Result<Vec<_>, E>>()?;
    for finalist in finalists(&trials) {
        let trial = &mut trials[finalist];
        trial.whole = Some(judge(&trial.choice, Effort::Whole)?);
    }
    let loss = |i: &usize| trials[*i].whole.unwrap_or(f64::INFINITY);
    // Of equal ones the first: the recipe that the search started from, where it is among them.
    let best = (0..trials.len()).min_by(|a, b| loss(a).total_cmp(&loss(b))).unwrap_or(0);
    Ok(Tuning { trials, best })
}

/// The best quarter, and the first candidate in any case; in the order of the candidates.
fn finalists(trials: &[Trial]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..trials.len()).collect();
    order.sort_by(|&a, &b| trials[a].quarter.total_cmp(&trials[b].quarter));
    order.truncate(trials.len().div_ceil(4));
    if !order.contains(&0) {
        order.push(0);
    }
    order.sort_unstable();
    order
}

/// The most steps that a search takes whose every trial trains `trunks` of them.
pub fn most_steps(recipe: &Ritz, candidates: usize, trunks: usize) -> usize {
    let finalists = (candidates.div_ceil(4) + 1).min(candidates);
    let [quarter, whole] = [Effort::Quarter, Effort::Whole].map(|effort| effort.of(recipe).steps);
    trunks * (candidates * quarter + finalists * whole)
}

/// How a recipe is judged: what is trained by it, and how many members it is held against.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Judge {
    /// Trunks of their own, or a shared one.
    pub trunks: Trunks,
    /// How many eigenfunctions need no training.
    pub known: usize,
    /// How many after them are trained.
    pub count: usize,
    /// The last members: trials do not train on them.
    pub held_out: usize,
    /// Seeds initial weights and batches.
    pub seed: u64,
}

/// With trunks of their own so many eigenfunctions stand for all, whatever K: a larger K has the same recipe.
const FIRST: usize = 3;

impl Judge {
    /// For a family of `members`, of which a quarter is held out, one at least; `None` where that leaves nothing to train
    /// on. `wanted` eigenfunctions are to be trained after the `known` ones.
    pub fn new(
        trunks: Trunks,
        known: usize,
        wanted: usize,
        members: usize,
        seed: u64,
    ) -> Option<Self> {
        let held_out = (members / 4).max(1);
        let count = match trunks {
            Trunks::PerEigenfunction => FIRST,
            Trunks::Shared => wanted,
        };
        (held_out < members).then_some(Self { trunks, known, count, held_out, seed })
    }

    /// How many trunks a trial trains.
    pub fn trainings(&self) -> usize {
        match self.trunks {
            Trunks::PerEigenfunction => self.count,
            Trunks::Shared => 1,
        }
    }

    /// Trains by `recipe` and tells the loss on the members that are held out. A training that fails has an infinite one.
    ///
    /// # Errors
    /// [`TrainError::Cancelled`].
    pub fn loss(
        &self,
        recipe: &Ritz,
        members: &[Member],
        nullspaces: &[Dense],
        observer: &dyn Observer,
    ) -> Result<f64, TrainError> {
        let (seen, held_out) = members.split_at(members.len() - self.held_out);
        let (known, there) = nullspaces.split_at(seen.len());
        // Trials go to the end: what is held out is for the judge.
        let recipe = Ritz { held_out: 0, ..*recipe };
        match self.train(&recipe, seen, known, observer) {
            Ok(blocks) => Ok(loss(&blocks, &Sample::all(held_out, there))),
            Err(TrainError::Degenerate { .. }) => Ok(f64::INFINITY),
            Err(TrainError::Cancelled) => Err(TrainError::Cancelled),
        }
    }

    fn train(
        &self,
        recipe: &Ritz,
        members: &[Member],
        known: &[Dense],
        observer: &dyn Observer,
    ) -> Result<Vec<Block>, TrainError> {
        let first = self.known + 1;
        let seed = |k| trunk_seed(self.seed, k);
        if self.trunks == Trunks::Shared {
            let samples = Sample::all(members, known);
            return train_blocks(samples, recipe, self.count, seed(first), observer);
        }
        let (mut earlier, mut blocks) = (known.to_vec(), Vec::new());
        for k in first..first + self.count {
            let samples = Sample::all(members, &earlier);
            let trained = train_blocks(samples, recipe, 1, seed(k), observer)?;
            append_predictions(members, &trained.iter().collect::<Vec<_>>(), &mut earlier);
            blocks.extend(trained);
        }
        Ok(blocks)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ggnn::network::TrunkShape;
    use crate::ggnn::predict::NetworkInput;
    use crate::ggnn::train::Silent;
    use crate::mesh::sample::icosphere;
    use crate::operators::{MassKind, Operators};
    use std::convert::Infallible;

    fn space() -> Space {
        Space { trunks: Trunks::PerEigenfunction, boundary: Boundary::Neumann, members: 6 }
    }

    fn own() -> Choice {
        Choice::of(&Ritz::default(), 1000.0)
    }

    /// A loss with its least at a learning rate of 1e-3, which falls with the steps.
    fn bowl(choice: &Choice, effort: Effort) -> Result<f64, Infallible> {
        let rest = if effort == Effort::Quarter { 0.5 } else { 0.0 };
        Ok((choice.learning_rate / 1e-3).ln().abs() + rest)
    }

    #[test]
    fn the_best_quarter_goes_on_and_the_own_recipe_in_any_case() {
        for candidates in [1, 2, 5, 8, 16] {
            let Ok(found) = search(own(), &space(), candidates, 3, bowl);
            assert_eq!(found.trials.len(), candidates);
            assert_eq!(found.trials[0].choice, own());
            let own_loss = found.trials[0].whole.unwrap();
            assert!(found.trials[found.best].whole.unwrap() <= own_loss);
            let finalists = found.trials.iter().filter(|trial| trial.whole.is_some()).count();
            let quarter = candidates.div_ceil(4);
            assert!([quarter, quarter + 1].contains(&finalists), "{finalists} of {candidates}");
            let worst_in = found.trials[1..].iter().filter(|trial| trial.whole.is_some());
            let worst_in = worst_in.map(|trial| trial.quarter).fold(0.0, f64::max);
            let out = found.trials.iter().filter(|trial| trial.whole.is_none());
            assert!(out.into_iter().all(|trial| trial.quarter >= worst_in));
        }
        let Ok(found) = search(own(), &space(), 16, 3, bowl);
        assert!(found.best > 0 && found.choice().unwrap().learning_rate < 4e-3);
    }

    #[test]
    fn a_search_is_the_same_every_time_and_a_larger_one_begins_with_the_smaller() {
        let Ok(found) = search(own(), &space(), 8, 3, bowl);
        let Ok(again) = search(own(), &space(), 8, 3, bowl);
        assert_eq!(found, again);
        let Ok(other) = search(own(), &space(), 8, 4, bowl);
        assert_ne!(found.trials[1], other.trials[1]);
        let Ok(larger) = search(own(), &space(), 12, 3, bowl);
        let choices = |tuning: &Tuning| tuning.trials.iter().map(|t| t.choice).collect::<Vec<_>>();
        assert!(choices(&larger).starts_with(&choices(&found)));
    }

    #[test]
    fn candidates_stay_within_reach_and_leave_alone_what_does_not_count() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let factor = |a: f64, b: f64| (a / b).ln().abs();
        for _ in 0..200 {
            let drawn = space().draw(&own(), &mut rng);
            // Rounding may go a little beyond.
            assert!(factor(drawn.learning_rate, 6e-3) < 4.05_f64.ln());
            assert!(factor(drawn.ridge, 1e-10) < 101.0_f64.ln());
            assert!((1..=6).contains(&drawn.batch));
            assert_eq!((drawn.spare, drawn.boundary_penalty), (0, 1000.0));
            let text = format!("{:?}", drawn.encoder_range);
            assert!(text.len() <= 6 && text.parse() == Ok(drawn.encoder_range), "{text}");
            let all = Space { trunks: Trunks::Shared, boundary: Boundary::Dirichlet, members: 2 };
            let drawn = all.draw(&Choice { spare: 4, ..own() }, &mut rng);
            assert!(drawn.spare <= 14 && drawn.batch <= 2 && drawn.boundary_penalty >= 99.0);
            let none = Choice { ridge: 0.0, hidden_range: 0.0, ..own() };
            let drawn = space().draw(&none, &mut rng);
            assert_eq!((drawn.ridge, drawn.hidden_range), (0.0, 0.0));
        }
    }

    #[test]
    fn where_no_training_succeeds_the_own_recipe_stays() {
        let failed = |_: &Choice, _| Ok::<_, Infallible>(f64::INFINITY);
        let Ok(found) = search(own(), &space(), 8, 3, failed);
        assert_eq!(found.best, 0);
        let stopped = search(own(), &space(), 8, 3, |_, _| Err(TrainError::Cancelled));
        assert_eq!(stopped, Err(TrainError::Cancelled));
    }

    #[test]
    fn a_choice_goes_into_a_recipe_and_comes_back() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let drawn = space().draw(&own(), &mut rng);
        let recipe = drawn.applied(&Ritz::default());
        assert_eq!(Choice::of(&recipe, 1000.0), drawn);
        assert_eq!(own().applied(&recipe), Ritz::default());
    }

    /// Spheres in three samplings: to train on, to train on, to judge by.
    fn spheres() -> (Vec<Member>, Vec<Dense>) {
        let member = |levels| {
            let mesh = icosphere(levels);
            let operators = Operators::assemble(&mesh, MassKind::Lumped).unwrap();
            let positions: Vec<f64> = mesh.vertices().iter().flatten().copied().collect();
            let input = NetworkInput::new(&positions, &operators.adjacency);
            let member = Member::new(input, operators, Boundary::Neumann, 0.0);
            (member, Dense::from_fn(mesh.n(), 1, |_, _| 1.0))
        };
        [1, 1, 2].map(member).into_iter().unzip()
    }

    #[test]
    fn a_search_over_trainings_is_never_worse_than_its_start_and_stops_when_asked() {
        let (members, known) = spheres();
        let ritz = Ritz::default();
        let shape = TrunkShape { width: 24, layers: 2, ..ritz.shape };
        let recipe = Ritz { shape, steps: 8, ..ritz };
        for trunks in [Trunks::PerEigenfunction, Trunks::Shared] {
            let judge = Judge::new(trunks, 1, 4, members.len(), 5).unwrap();
            let space = Space { trunks, members: 2, ..space() };
            let own = Choice::of(&recipe, 1.0);
            let run = || {
                search(own, &space, 4, 5, |choice, effort| {
                    let recipe = effort.of(&choice.applied(&recipe));
                    judge.loss(&recipe, &members, &known, &Silent)
                })
            };
            let found = run().unwrap();
            let best = found.trials[found.best].whole.unwrap();
            // Three of λ = 2, in units of the area 4π, and nothing is lower but by the error of 162 vertices.
            let bound = (8.0 * std::f64::consts::PI).ln();
            assert!(best <= found.trials[0].whole.unwrap() && best > bound - 0.05, "{found:?}");
            assert_eq!(run(), Ok(found));
        }
        struct Impatient;
        impl Observer for Impatient {
            fn step(&self, _: usize, _: usize, _: f64) {}

            fn cancelled(&self) -> bool {
                true
            }
        }
        let judge = Judge::new(Trunks::Shared, 1, 4, members.len(), 5).unwrap();
        let stopped = judge.loss(&recipe, &members, &known, &Impatient);
        assert_eq!(stopped, Err(TrainError::Cancelled));
    }

    #[test]
    fn a_quarter_of_the_family_judges_and_one_member_at_least() {
        let judge = |members| Judge::new(Trunks::PerEigenfunction, 1, 7, members, 0);
        let held_out = |members| judge(members).map(|judge| judge.held_out);
        assert_eq!([1, 2, 3, 8, 40].map(held_out), [None, Some(1), Some(1), Some(2), Some(10)]);
        assert_eq!(judge(8).map(|judge| judge.count), Some(3));
        let shared = Judge::new(Trunks::Shared, 1, 7, 8, 0).unwrap();
        assert_eq!((shared.count, shared.trainings()), (7, 1));
    }
}
