//! Tuning: the recipe that a mesh is trained by. It is the pipeline's own, unless `train.tune` asks for a search; then what
//! the search finds is trained by, and saved as a recipe file beside the results.

use std::time::Instant;

use super::artifacts::TuneArtifact;
use super::context::Context;
use super::family::Prepared;
use super::train::{Chosen, InTraining, Progress, fits, named, of_family, penalty};
use super::trials::Trials;
use super::work::{Work, canonical};
use super::{Failure, stand_in};
use crate::ggnn::recipe::{Recipe, Ritz};
use crate::ggnn::tune::{Choice, Judge, Space, Tuning, most_steps, search};
use crate::pipeline::{FoundRecipe, Train};

/// Searches or recalls the recipe that a mesh is to be trained by.
///
/// A mesh without variants is trained on alone, and leaves nothing to judge by: it keeps the pipeline's recipe, with a
/// warning, since the other meshes of a folder may have families.
///
/// # Errors
/// When a shared trunk is too narrow, or the run is interrupted.
pub fn tune(context: &Context, item: usize, prepared: Prepared) -> Result<InTraining, Failure> {
    let train = &context.pipeline.train;
    let Recipe::Ritz(recipe) = train.recipe(context.pipeline.features.inputs()) else {
        return Ok(as_it_is(train, prepared));
    };
    warn_of_few(&prepared, &recipe);
    let (known, members) = (prepared.training.known, prepared.training.members());
    let wanted = prepared.assembled.loaded.k.saturating_sub(known);
    if train.tune == 0 || wanted == 0 {
        return Ok(as_it_is(train, prepared));
    }
    let Some(judge) = Judge::new(train.trunk, known, wanted, members, train.seed) else {
        let mesh = &prepared.assembled.loaded.job.name;
        tracing::warn!(
            mesh,
            "is trained on alone, so no recipe is searched for: there is no variant to judge it by"
        );
        return Ok(as_it_is(train, prepared));
    };
    fits(&recipe, judge.count)?;
    searched(context, item, prepared, &recipe, &judge)
}

fn as_it_is(train: &Train, prepared: Prepared) -> InTraining {
    InTraining::new(prepared, Chosen { train: train.clone(), recipe_file: None })
}

/// A family that cannot spare as many members as are to be held out costs a warning.
fn warn_of_few(prepared: &Prepared, recipe: &Ritz) {
    let members = prepared.training.members();
    let (asked, held_out) = (recipe.held_out, recipe.held_out_of(members));
    if held_out < asked {
        let mesh = &prepared.assembled.loaded.job.name;
        tracing::warn!(
            mesh,
            "train.held_out = {asked}, but of {members} to train on only {held_out} can be spared"
        );
    }
}

fn searched(
    context: &Context,
    item: usize,
    mut prepared: Prepared,
    recipe: &Ritz,
    judge: &Judge,
) -> Result<InTraining, Failure> {
    let started = Instant::now();
    let train = &context.pipeline.train;
    let own = Choice::of(recipe, train.boundary_penalty);
    let space = Space {
        trunks: train.trunk,
        boundary: context.pipeline.operators.boundary,
        members: prepared.training.members() - judge.held_out,
    };
    let work = work(context, &prepared, recipe, judge).seeded(train.seed, "f32");
    let trials = Trials::of(work.key(), context.writable());
    let recalled = context.recall_costly(item, work, stand_in::tuning, || {
        let mesh = &prepared.assembled.loaded.job.name;
        let steps = most_steps(recipe, train.tune, judge.trainings());
        let message = format!("{mesh}: trying {} recipes", train.tune);
        let progress = Progress::new(mesh, &message, steps, context.stop(item));
        let training = &prepared.training;
        let found = search(own, &space, train.tune, train.seed, |choice, effort| {
            let recipe = effort.of(&choice.applied(recipe));
            let other = choice.boundary_penalty != own.boundary_penalty;
            let under = other.then(|| training.seen_under(choice.boundary_penalty));
            let seen = under.as_ref().unwrap_or_else(|| training.seen());
            trials.loss(choice, effort, || {
                judge.loss(&recipe, &seen.members, &seen.nullspaces, &progress)
            })
        });
        // A training that fails has an infinite loss: what is left is that it is to stop.
        found.map(|tuning| (&tuning).into()).map_err(|_| progress.stopped())
    })?;
    trials.are_over();
    if recalled.stands_in {
        return Ok(as_it_is(train, prepared));
    }
    let tuning = Tuning::from(recalled.artifact);
    let choice = tuning.choice().copied().unwrap_or(own);
    let loaded = &mut prepared.assembled.loaded;
    let found = FoundRecipe {
        mesh: &loaded.job.name,
        hash: loaded.hash.to_string(),
        functions: named(&(judge.known + 1..=judge.known + judge.count)),
        held_out: judge.held_out,
        recipe,
        space,
        tuning: &tuning,
    };
    let (mesh, how, recipe_file) = (&loaded.job.name, recalled.how, found.to_toml());
    tracing::debug!(mesh, ?how, best = tuning.best, "tuned");
    loaded.spent("tune", how, started.elapsed());
    let Prepared { assembled, training } = prepared;
    let prepared = Prepared { assembled, training: training.under(choice.boundary_penalty) };
    let chosen = Chosen { train: train.with(&choice), recipe_file: Some(recipe_file) };
    Ok(InTraining::new(prepared, chosen))
}

/// What a search depends on: with trunks of their own not on K.
fn work(
    context: &Context,
    prepared: &Prepared,
    recipe: &Ritz,
    judge: &Judge,
) -> Work<TuneArtifact> {
    let train = &context.pipeline.train;
    let recipe = Ritz { held_out: 0, ..*recipe };
    let work = Work::of_stage()
        .param("candidates", train.tune.to_string())
        .param("trunk", judge.trunks.name())
        .param("functions", judge.count.to_string())
        .param("held out", judge.held_out.to_string())
        .param("recipe", canonical(&recipe))
        .param("penalty", canonical(&penalty(context, train)));
    of_family(work, context, &prepared.training, train)
}
