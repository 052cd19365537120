//! The heads of a trained trunk, solved anew on other samplings of the shape than it was trained on.
//!
//! A trunk whose layers read coordinates is a smooth function on the surface, and training needs few vertices to shape it.
//! The head decides which combinations of its features are the eigenfunctions, and is as wrong as the elements that it is
//! solved with: on 500 vertices by per cents. Solved on the same members with finer triangles it costs one forward pass
//! over them, and no training.

use dfdx::prelude::NoneTape;
use rayon::prelude::*;

use super::block::Block;
use super::head::{Grams, Head};
use super::predict::predict_all;
use super::sample::{Member, Sample};
use crate::spectrum::Dense;

/// The blocks of one trunk with heads that are solved over `samples`; `None` when its features do not span as many
/// functions there.
///
/// The records keep the quotients of training.
pub fn solve_heads(blocks: &[Block], samples: &[Sample], ridge: f64) -> Option<Vec<Block>> {
    let first = blocks.first()?;
    let trunk = first.trunk();
    let (width, layers) = (first.shape.width, trunk.prepared());
    let gram = |sample: &Sample| {
        let mut grams = Grams::zeros(width);
        sample.forward(&trunk, &layers, NoneTape, &mut grams);
        grams
    };
    // Added in the order of the samples.
    let parts: Vec<Grams> = samples.par_iter().map(gram).collect();
    let mut sum = Grams::zeros(width);
    parts.iter().for_each(|part| sum.add(part));
    let heads = sum.solve(ridge, blocks.len())?;
    let with = |(block, head): (&Block, Head)| Block { head: head.weights, ..block.clone() };
    Some(blocks.iter().zip(heads).map(with).collect())
}

/// The eigenfunctions on one mesh by the trunks of `blocks` with heads that are solved on this very mesh, n×(c + blocks),
/// after the c `zeros`, its eigenfunctions of λ = 0; `None` when the features do not span as many functions there.
///
/// Each has unit norm in the inner product of `member`'s mass. Where every eigenfunction has a trunk of its own,
/// neighbours may come out mixed: each head is solved against those before it. Rayleigh–Ritz on the span of all of them
/// parts them.
pub fn functions_on(member: &Member, zeros: &Dense, blocks: &[Block], ridge: f64) -> Option<Dense> {
    let mut phi = zeros.clone();
    for heads in blocks.chunk_by(Block::shares_trunk) {
        let solved = solve_heads(heads, &[Sample::new(member, &phi)], ridge)?;
        let solved: Vec<&Block> = solved.iter().collect();
        phi = predict_all(&phi, &solved, &member.input, &member.mass);
    }
    Some(phi)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ggnn::network::{Ranges, TrunkShape};
    use crate::ggnn::predict::{NetworkInput, predict_all};
    use crate::ggnn::recipe::Ritz;
    use crate::ggnn::sample::Member;
    use crate::ggnn::train::{Silent, train_blocks};
    use crate::mesh::sample::icosphere;
    use crate::operators::{Boundary, MassKind, Operators};
    use crate::spectrum::Dense;
    use crate::spectrum::pencil::{column, quadratic};

    fn sphere(levels: u32) -> Member {
        let mesh = icosphere(levels);
        let operators = Operators::assemble(&mesh, MassKind::Lumped).unwrap();
        let positions: Vec<f64> = mesh.vertices().iter().flatten().copied().collect();
        let input = NetworkInput::new(&positions, &operators.adjacency);
        Member::new(input, operators, Boundary::Neumann, 0.0)
    }

    fn constant(member: &Member) -> Dense {
        Dense::from_fn(member.input.n(), 1, |_, _| 1.0)
    }

    #[test]
    fn heads_of_a_finer_sphere_predict_better_on_a_still_finer_one() {
        let ritz = Ritz::default();
        let shape = TrunkShape { width: 32, layers: 2, ..ritz.shape };
        let ranges = Ranges { encoder: 1.0, ..ritz.ranges };
        let recipe = Ritz { shape, ranges, steps: 20, spare: 2, ..ritz };
        let (coarse, fine, test) = (sphere(1), sphere(3), sphere(4));
        let sample = |member: &Member| Sample::new(member, &constant(member));
        let blocks = train_blocks(vec![sample(&coarse)], &recipe, 8, 3, &Silent).unwrap();
        let again = solve_heads(&blocks, &[sample(&fine)], recipe.ridge).unwrap();
        assert!(again[0].shares_trunk(&again[7]) && again[0].record == blocks[0].record);
        // Eigenvalues of a sphere of unit area: 4π l(l + 1), three of l = 1 and five of l = 2.
        let error = |blocks: &[Block]| {
            let blocks: Vec<&Block> = blocks.iter().collect();
            let phi = predict_all(&constant(&test), &blocks, &test.input, &test.mass);
            let off = |(k, l): (usize, f64)| {
                let quotient = quadratic(&test.stiffness, column(&phi, k));
                (quotient / (4.0 * std::f64::consts::PI * l * (l + 1.0)) - 1.0).abs()
            };
            (1..9).map(|k| off((k, if k < 4 { 1.0 } else { 2.0 }))).fold(0.0, f64::max)
        };
        let (before, after) = (error(&blocks), error(&again));
        assert!(after < 0.3 * before && after < 0.02, "{before} {after}");
    }
}
