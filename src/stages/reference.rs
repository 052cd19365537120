//! The two independent solutions of a mesh's eigenproblem. They depend on the operators alone: no block, and no tolerance
//! of the verdict, enters their keys, and nothing of theirs enters training.

use super::artifacts::{ReferenceArtifact, SecondOpinionArtifact};
use super::assemble::Assembled;
use super::context::{Context, Recalled};
use super::work::{Work, canonical};
use super::{Failure, stand_in};
use crate::pipeline::{MpgdDirection, MpgdStep};
use crate::spectrum::certificate::SecondOpinion;
use crate::spectrum::factor::Analysis;
use crate::spectrum::mpgd::{self, Direction, Options, Step, StoppedBy};
use crate::spectrum::{Eigenpairs, fem};
use crate::store::Artifact;

/// The reference solver's pairs, to the end of the cluster of λ_K.
///
/// # Errors
/// When the mesh cannot have the boundary condition, the solver fails, or the run is interrupted.
pub fn fem(
    context: &Context,
    item: usize,
    assembled: &Assembled,
) -> Result<Recalled<ReferenceArtifact>, Failure> {
    let work = fem_work(context, assembled);
    let (n, k) = (free_vertices(context, assembled), assembled.loaded.k);
    let stand_in = || stand_in::reference(n, k);
    context.recall_costly(item, work.seeded(0, "f64"), stand_in, || {
        let problem = assembled.problem(context.pipeline.operators.boundary)?;
        let analysis = Analysis::new(problem.pencil())?;
        Ok((&fem::lowest(&problem, &analysis, k)?).into())
    })
}

/// What the reference solver's pairs depend on.
pub fn fem_work(context: &Context, assembled: &Assembled) -> Work<ReferenceArtifact> {
    posed(context, assembled)
}

/// M-PGD's pairs, `count` of them: a cluster that K cuts is compared as a whole.
///
/// # Errors
/// As [`fem`].
pub fn mpgd(
    context: &Context,
    item: usize,
    assembled: &Assembled,
    count: usize,
) -> Result<Recalled<SecondOpinionArtifact>, Failure> {
    let verify = &context.pipeline.verify;
    let work = posed::<SecondOpinionArtifact>(context, assembled)
        .param("count", count.to_string())
        .param("stopping", canonical(&verify.stopping()))
        .param("step", canonical(&verify.mpgd_step))
        .param("direction", canonical(&verify.mpgd_direction));
    let n = free_vertices(context, assembled);
    let stand_in = || stand_in::second_opinion(n, count);
    context.recall_costly(item, work.seeded(verify.mpgd_seed, "f64"), stand_in, || {
        let problem = assembled.problem(context.pipeline.operators.boundary)?;
        let pencil = problem.pencil();
        let zeros = problem.nullspace();
        let vectors = zeros.subcols(0, zeros.ncols().min(count)).to_owned();
        let known = Eigenpairs { values: vec![0.0; vectors.ncols()], vectors };
        let (analysis, factor);
        let step = match (verify.mpgd_step, verify.mpgd_direction) {
            (MpgdStep::Fixed(alpha), _) => Step::Fixed(alpha),
            (MpgdStep::Exact, MpgdDirection::Gradient) => Step::Exact(Direction::Gradient),
            (MpgdStep::Exact, MpgdDirection::Preconditioned) => {
                analysis = Analysis::new(pencil)?;
                factor = analysis.positive(1.0 / pencil.area())?;
                Step::Exact(Direction::Preconditioned(&factor))
            }
        };
        let options = Options { step, stopping: verify.stopping(), seed: verify.mpgd_seed };
        let cancelled = || context.cancel.is_cancelled();
        let (pairs, runs) = mpgd::lowest(pencil, &known, count, options, &cancelled);
        if runs.iter().any(|run| run.stopped_by == StoppedBy::Cancelled) {
            return Err(Failure::Interrupted);
        }
        Ok((&SecondOpinion { pairs, runs }).into())
    })
}

/// The vertices that no boundary condition holds.
fn free_vertices(context: &Context, assembled: &Assembled) -> usize {
    let operators = &assembled.operators;
    let fixed = context.pipeline.operators.boundary.fixed(&operators.boundary);
    operators.stiffness.rows() - fixed.len()
}

/// Work on the eigenproblem of a mesh.
fn posed<A: Artifact>(context: &Context, assembled: &Assembled) -> Work<A> {
    Work::<A>::of_stage()
        .param("k", assembled.loaded.k.to_string())
        .param("boundary", context.pipeline.operators.boundary.name())
        .input("mesh", &assembled.loaded.digest())
        .input("operators", &assembled.operators_digest)
}
