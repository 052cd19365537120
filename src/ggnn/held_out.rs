//! Members that training does not see: what its functions are worth there, and when it should have ended.
//!
//! The measure is the mean of log R over the predicted functions, deflated and orthonormal in their order. Their quotients
//! are the diagonal of a matrix whose eigenvalues are Ritz values (Schur), the logarithm is concave, and Ritz values are no
//! lower than eigenvalues: so it is bounded below by what the true eigenfunctions of the member have, and lower is better. No
//! reference solver takes part.

use super::block::{Block, Check};
use super::checkpoint::Checkpoint;
use super::ops::rayleigh::MemberPencil;
use super::predict::predict_all;
use super::sample::Sample;
use crate::spectrum::pencil::{column, quadratic};

/// How often a training is checked.
const CHECKS: usize = 10;

/// After so many checks without a lower loss it ends.
const PATIENCE: usize = 4;

/// The mean of log R over the functions that `blocks` add on each of `samples`, and over these; in units of 1/area. A
/// hundredth more is one per cent in every λ. Infinite when a function has no quotient.
pub fn loss(blocks: &[Block], samples: &[Sample]) -> f64 {
    let blocks: Vec<&Block> = blocks.iter().collect();
    let of_one = |sample: &Sample| {
        let MemberPencil { stiffness, mass, deflation } = &*sample.pencil;
        let earlier = deflation.phi();
        let phi = predict_all(earlier, &blocks, &sample.input, mass);
        let logarithm = |k: usize| quadratic(stiffness, column(&phi, k)).ln();
        (earlier.ncols()..phi.ncols()).map(logarithm).sum::<f64>() / blocks.len() as f64
    };
    let loss = samples.iter().map(of_one).sum::<f64>() / samples.len() as f64;
    if loss.is_finite() { loss } else { f64::INFINITY }
}

/// Watches a training on members that it does not see, and keeps the best of what it made.
pub(super) struct Watch<'s> {
    held_out: &'s [Sample],
    steps: usize,
    every: usize,
    checks: Vec<Check>,
    best: Option<(f64, Vec<Block>)>,
    in_vain: usize,
}

impl<'s> Watch<'s> {
    /// For a training of `steps` steps; without members that are held out it never has anything to say.
    pub fn new(held_out: &'s [Sample], steps: usize) -> Self {
        let every = steps.div_ceil(CHECKS).max(1);
        Self { held_out, steps, every, checks: Vec::new(), best: None, in_vain: 0 }
    }

    /// Whether there is a check after so many steps: at regular intervals, and after the last.
    pub fn is_due(&self, step: usize) -> bool {
        !self.held_out.is_empty() && (step == self.steps || step.is_multiple_of(self.every))
    }

    /// Judges what training has made in so many steps.
    pub fn check(&mut self, step: usize, blocks: Vec<Block>) {
        let loss = loss(&blocks, self.held_out);
        self.checks.push(Check { step, loss });
        if self.best.as_ref().map_or(f64::INFINITY, |(best, _)| *best) > loss {
            self.best = Some((loss, blocks));
            self.in_vain = 0;
        } else {
            self.in_vain += 1;
        }
    }

    /// Whether nothing has become better for long.
    pub fn is_over(&self) -> bool {
        self.in_vain >= PATIENCE
    }

    /// Goes on from what was found before, and the blocks of the best of it.
    pub fn resume(&mut self, checks: Vec<Check>, best: Vec<Block>) {
        let losses = checks.iter().map(|check| check.loss);
        let lowest = losses.clone().fold(f64::INFINITY, f64::min);
        // The first of the lowest is the best one.
        let at = losses.clone().position(|loss| loss == lowest && !best.is_empty());
        self.in_vain = checks.len() - at.map_or(0, |at| at + 1);
        self.best = (!best.is_empty()).then_some((lowest, best));
        self.checks = checks;
    }

    /// A checkpoint with what was found so far.
    pub fn with_findings(&self, checkpoint: Checkpoint) -> Checkpoint {
        let best = self.best.as_ref().map(|(_, blocks)| blocks.clone());
        Checkpoint { checks: self.checks.clone(), best: best.unwrap_or_default(), ..checkpoint }
    }

    /// The blocks of the best check, unless there was none, and all checks.
    pub fn into_best(self) -> (Option<Vec<Block>>, Vec<Check>) {
        (self.best.map(|(_, blocks)| blocks), self.checks)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ggnn::network::{Ranges, TrunkShape};
    use crate::ggnn::predict::NetworkInput;
    use crate::ggnn::recipe::Ritz;
    use crate::ggnn::sample::Member;
    use crate::ggnn::train::{Silent, train_blocks};
    use crate::mesh::TriMesh;
    use crate::mesh::sample::icosphere;
    use crate::operators::{Boundary, MassKind, Operators};
    use crate::spectrum::factor::Analysis;
    use crate::spectrum::fem::lowest;
    use crate::spectrum::{Dense, Problem};

    /// A sphere drawn out along x, so that no eigenvalue is multiple for a reason that training could use.
    fn egg(levels: u32) -> TriMesh {
        let sphere = icosphere(levels);
        let vertices = sphere.vertices().iter().map(|&[x, y, z]| [1.3 * x, y, 0.9 * z]);
        TriMesh::new(vertices.collect(), sphere.faces().to_vec()).unwrap()
    }

    fn sample(mesh: &TriMesh) -> Sample {
        let operators = Operators::assemble(mesh, MassKind::Lumped).unwrap();
        let positions: Vec<f64> = mesh.vertices().iter().flatten().copied().collect();
        let input = NetworkInput::new(&positions, &operators.adjacency);
        let member = Member::new(input, operators, Boundary::Neumann, 0.0);
        Sample::new(&member, &Dense::from_fn(mesh.n(), 1, |_, _| 1.0))
    }

    fn recipe(steps: usize, learning_rate: f64) -> Ritz {
        let ritz = Ritz::default();
        let shape = TrunkShape { width: 24, layers: 2, ..ritz.shape };
        let ranges = Ranges { encoder: 1.0, ..ritz.ranges };
        Ritz { shape, ranges, steps, learning_rate, held_out: 1, ..ritz }
    }

    #[test]
    fn the_loss_is_bounded_by_the_true_eigenvalues() {
        let mesh = egg(2);
        let blocks = train_blocks(vec![sample(&mesh)], &recipe(20, 6e-3), 5, 1, &Silent).unwrap();
        let operators = Operators::assemble(&mesh, MassKind::Lumped).unwrap();
        let problem = Problem::new(&operators, Boundary::Neumann, &vec![0; mesh.n()]).unwrap();
        let analysis = Analysis::new(problem.pencil()).unwrap();
        let values = lowest(&problem, &analysis, 6).unwrap().pairs.values;
        let area = operators.total_mass();
        let bound = values[1..6].iter().map(|lambda| (lambda * area).ln()).sum::<f64>() / 5.0;
        let found = loss(&blocks, &[sample(&mesh)]);
        assert!((bound..bound + 0.05).contains(&found), "{found} {bound}");
        // Functions in another order, or fewer that are worse, are no way below.
        let turned: Vec<_> = blocks.iter().rev().cloned().collect();
        assert!(loss(&turned, &[sample(&mesh)]) >= bound);
    }

    #[test]
    fn the_best_weights_come_back_and_an_overlong_training_ends() {
        let family = || vec![sample(&icosphere(1)), sample(&egg(1)), sample(&egg(2))];
        let recipe = recipe(200, 0.1);
        let blocks = train_blocks(family(), &recipe, 2, 1, &Silent).unwrap();
        let record = &blocks[0].record;
        let least = record.held_out.iter().map(|check| check.loss).fold(f64::INFINITY, f64::min);
        assert_eq!(loss(&blocks, &[sample(&egg(2))]), least);
        assert_eq!(record.held_out.last().map(|check| check.step), Some(record.history.len()));
        assert!(record.history.len() < 200, "{record:?}");
        let again = train_blocks(family(), &recipe, 2, 1, &Silent).unwrap();
        assert_eq!(again, blocks);
    }

    #[test]
    fn training_sees_nothing_of_what_is_held_out() {
        let family = |last: TriMesh| vec![sample(&icosphere(1)), sample(&egg(1)), sample(&last)];
        let recipe = recipe(10, 6e-3);
        let train = |family| train_blocks(family, &recipe, 1, 1, &Silent).unwrap().remove(0);
        let (one, other) = (train(family(egg(2))), train(family(icosphere(2))));
        // One of them may have ended before the other.
        let same = |a: &Block, b: &Block| {
            let histories = a.record.history.iter().zip(&b.record.history);
            histories.into_iter().all(|(a, b)| a == b)
        };
        assert!(same(&one, &other));
        assert_ne!(one.record.held_out, other.record.held_out);
        let alone = Ritz { held_out: 0, ..recipe };
        let seen = family(egg(2)).into_iter().take(2).collect();
        let alone = train_blocks(seen, &alone, 1, 1, &Silent).unwrap().remove(0);
        assert!(same(&alone, &one));
        assert!(alone.record.held_out.is_empty() && alone.record.history.len() == 10);
    }

    #[test]
    fn a_family_of_one_holds_nothing_out() {
        let block = train_blocks(vec![sample(&egg(1))], &recipe(5, 6e-3), 1, 1, &Silent).unwrap();
        assert!(block[0].record.held_out.is_empty() && block[0].record.history.len() == 5);
    }
}
