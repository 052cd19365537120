//! What a training needs to go on, when its process has ended, as if it had not: all that changes from step to step, to the bit.
//!
//! What the seed gives is not in it: the batches are drawn again, up to the step where it goes on.

use dfdx::shapes::HasShape;

use super::block::{Block, Check};
use super::ops::{Matrix, entries};
use super::train::Moments;

/// A training between two steps.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Checkpoint {
    /// Steps that are done: batches, by either recipe.
    pub step: usize,
    /// Every parameter, row-major.
    pub parameters: Vec<Vec<f32>>,
    /// Adam's first and second moments of every parameter.
    pub moments: [Vec<Vec<f32>>; 2],
    /// How often Adam has changed them.
    pub updates: u32,
    /// The Rayleigh quotients of the steps; for recipe `paper`, of the epochs.
    pub history: Vec<f64>,
    /// By recipe `paper`, the sums of the terms over the batches of the epoch that is under way.
    pub under_way: Vec<f64>,
    /// What was found on members that are held out.
    pub checks: Vec<Check>,
    /// The blocks of the best of these checks; none without checks.
    pub best: Vec<Block>,
}

impl Checkpoint {
    /// A training after `step` steps, without what was found on members that are held out.
    pub(super) fn of<'p>(
        step: usize,
        parameters: impl IntoIterator<Item = &'p Matrix<f32>>,
        adam: &Moments,
        history: &[f64],
    ) -> Self {
        let (moments, updates) = adam.state();
        Self {
            step,
            parameters: parameters.into_iter().map(entries).collect(),
            moments,
            updates,
            history: history.to_vec(),
            ..Self::default()
        }
    }

    /// Puts back parameters and moments. Whether that was possible: not where it is of a network of other sizes, beyond the last
    /// of `steps`, or without the `quotients` of its steps.
    pub(super) fn restore(
        &self,
        steps: usize,
        quotients: usize,
        parameters: Vec<&mut Matrix<f32>>,
        adam: &mut Moments,
    ) -> bool {
        let sizes = |all: &[Vec<f32>]| all.iter().map(Vec::len).collect::<Vec<_>>();
        let expected: Vec<usize> = parameters.iter().map(|p| p.shape().0 * p.shape().1).collect();
        let [first, second] = &self.moments;
        let fits = [&self.parameters, first, second].iter().all(|all| sizes(all) == expected);
        if !fits || self.step > steps || self.history.len() != quotients {
            return false;
        }
        for (parameter, values) in parameters.into_iter().zip(&self.parameters) {
            parameter.copy_from(values);
        }
        adam.set(&self.moments, self.updates);
        true
    }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;

    use super::*;
    use crate::ggnn::network::TrunkShape;
    use crate::ggnn::paper::{self, Paper, train_block};
    use crate::ggnn::predict::NetworkInput;
    use crate::ggnn::recipe::Ritz;
    use crate::ggnn::sample::{Member, Sample};
    use crate::ggnn::train::{Observer, Silent, TrainError, train_blocks};
    use crate::mesh::sample::icosphere;
    use crate::operators::{Boundary, MassKind, Operators};
    use crate::remesh::{Family, FamilyRecipe};
    use crate::spectrum::Dense;

    /// Stops a training after so many batches, and goes on from what it left.
    struct Stopping {
        after: usize,
        asked: RefCell<usize>,
        kept: RefCell<Option<Checkpoint>>,
    }

    impl Observer for Stopping {
        fn step(&self, _: usize, _: usize, _: f64) {}
        fn cancelled(&self) -> bool {
            // Before every batch.
            self.asked.replace_with(|asked| *asked + 1) == self.after
        }
        fn kept(&self) -> Option<Checkpoint> {
            self.kept.borrow().clone()
        }
        fn wants_checkpoint(&self) -> bool {
            *self.asked.borrow() == self.after
        }
        fn keep(&self, checkpoint: Checkpoint) {
            self.kept.replace(Some(checkpoint));
        }
    }

    impl Stopping {
        fn after(after: usize) -> Self {
            Self { after, asked: RefCell::default(), kept: RefCell::default() }
        }
    }

    fn members() -> Vec<Member> {
        let recipe = FamilyRecipe { members: 5, vertices: 90.into(), ..FamilyRecipe::default() };
        let member = |mesh: &crate::mesh::TriMesh| {
            let operators = Operators::assemble(mesh, MassKind::Lumped).unwrap();
            let positions: Vec<f64> = mesh.vertices().iter().flatten().copied().collect();
            let input = NetworkInput::new(&positions, &operators.adjacency);
            Member::new(input, operators, Boundary::Neumann, 0.0)
        };
        Family::of(&icosphere(2), &recipe).unwrap().members.iter().map(member).collect()
    }

    fn constants(members: &[Member]) -> Vec<Dense> {
        members.iter().map(|m| Dense::from_fn(m.input.n(), 1, |_, _| 1.0)).collect()
    }

    const SHAPE: TrunkShape = TrunkShape {
        inputs: 3,
        width: 12,
        layers: 2,
        iterations: 1,
        layer: crate::ggnn::network::Layer::Pointwise,
        activation: crate::ggnn::ops::activation::Activation::Sin,
    };

    #[test]
    fn a_training_that_was_stopped_ends_with_the_bits_of_one_that_was_not() {
        let members = members();
        let earlier = constants(&members);
        for (held_out, batch) in [(0, 2), (2, 1)] {
            let recipe = Ritz { shape: SHAPE, steps: 30, batch, held_out, ..Ritz::default() };
            let train = |observer: &dyn Observer| {
                train_blocks(Sample::all(&members, &earlier), &recipe, 2, 7, observer)
            };
            let expected = train(&Silent).unwrap();
            for after in [2, 11, 29] {
                let observer = Stopping::after(after);
                assert_eq!(train(&observer), Err(TrainError::Cancelled));
                let kept = observer.kept().unwrap();
                assert_eq!(kept.step, after);
                let observer = Stopping { kept: Some(kept).into(), ..Stopping::after(1000) };
                assert!(train(&observer).unwrap() == expected, "{held_out} {after}");
            }
        }
    }

    #[test]
    fn so_does_one_by_the_paper_recipe() {
        let members = members();
        let earlier = constants(&members);
        let samples = members.iter().zip(&earlier);
        let samples: Vec<_> = samples.map(|(m, e)| paper::Sample::new(m, e)).collect();
        let recipe = Paper { shape: SHAPE, epochs: 9, batch: 2, ..Paper::default() };
        let expected = train_block(&samples, &recipe, 7, &Silent).unwrap();
        // Three batches an epoch: after its last one, its first, its second.
        for after in [15, 16, 23] {
            let observer = Stopping::after(after);
            assert_eq!(train_block(&samples, &recipe, 7, &observer), Err(TrainError::Cancelled));
            assert_eq!(observer.kept().unwrap().step, after);
            let observer = Stopping { kept: observer.kept().into(), ..Stopping::after(1000) };
            assert!(train_block(&samples, &recipe, 7, &observer).unwrap() == expected, "{after}");
        }
    }

    #[test]
    fn what_is_of_another_network_is_not_gone_on_from() {
        let members = members();
        let earlier = constants(&members);
        let train = |width: usize, observer: &dyn Observer| {
            let shape = TrunkShape { width, ..SHAPE };
            let recipe = Ritz { shape, steps: 8, ..Ritz::default() };
            train_blocks(Sample::all(&members, &earlier), &recipe, 1, 7, observer)
        };
        let observer = Stopping::after(4);
        assert_eq!(train(12, &observer), Err(TrainError::Cancelled));
        let observer = Stopping { kept: observer.kept().into(), ..Stopping::after(1000) };
        assert!(train(10, &observer).unwrap() == train(10, &Silent).unwrap());
    }
}
