//! What is left of each function beside all earlier ones, for many functions at once: Gram–Schmidt on their Gram matrix.
//!
//! Two passes over the functions in place of one for every pair: G = ΦᵀBΦ, then Φ ← ΦC, where C is what Gram–Schmidt in the inner
//! product of G makes of the unit vectors. Rounding in G costs digits where functions are close to dependent, so all of it is done
//! twice, and functions that are closer than that are refused.

use faer::linalg::matmul::matmul;
use faer::{Accum, Par};
use rayon::prelude::*;

use crate::spectrum::Dense;
use crate::spectrum::pencil::InnerProduct;

/// Rows that are worked on at a time.
const ROWS: usize = 512;

/// Of the square of a function's norm, what must be left of it beside the earlier ones.
const LEAST: f64 = 1e-8;

/// Makes the columns of `phi`, n×k, from the one numbered `first` on B-orthogonal to all columns before them, and
/// B-normalised. `None` where they are close to linearly dependent or not numbers.
pub fn orthonormalise(phi: &mut Dense, first: usize, mass: &impl InnerProduct) -> Option<()> {
    for _ in 0..2 {
        let coefficients = schmidt(&gram(phi, &mass.product(phi)))?;
        combine(phi, first, &coefficients);
    }
    Some(())
}

/// XᵀY, k×k, in an order of summation that depends on the sizes alone.
fn gram(x: &Dense, y: &Dense) -> Dense {
    let (n, k) = (x.nrows(), x.ncols());
    let chunk = |number: usize| {
        let start = number * ROWS;
        let [x, y] = [x, y].map(|x| x.subrows(start, ROWS.min(n - start)));
        let mut sum = Dense::zeros(k, k);
        matmul(sum.as_mut(), Accum::Replace, x.transpose(), y, 1.0, Par::Seq);
        sum
    };
    let chunks: Vec<Dense> = (0..n.div_ceil(ROWS)).into_par_iter().map(chunk).collect();
    chunks.iter().fold(Dense::zeros(k, k), |sum, chunk| sum + chunk)
}

/// Upper triangular C with CᵀGC = I, k×k.
fn schmidt(gram: &Dense) -> Option<Dense> {
    let k = gram.ncols();
    let mut c = Dense::zeros(k, k);
    for j in 0..k {
        let mut rest: Vec<f64> = (0..k).map(|i| f64::from(i == j)).collect();
        for i in 0..j {
            let overlap: f64 = (0..=i).map(|l| c[(l, i)] * gram[(l, j)]).sum();
            (0..=i).for_each(|l| rest[l] -= overlap * c[(l, i)]);
        }
        let image = |l: usize| (0..=j).map(|m| gram[(l, m)] * rest[m]).sum::<f64>();
        let square: f64 = (0..=j).map(|l| rest[l] * image(l)).sum();
        let left = square > LEAST * gram[(j, j)] && square.is_finite();
        left.then_some(())?;
        (0..=j).for_each(|l| c[(l, j)] = rest[l] / square.sqrt());
    }
    Some(c)
}

/// Φ ← ΦC for the columns from `first` on.
fn combine(phi: &mut Dense, first: usize, c: &Dense) {
    let new = phi.ncols() - first;
    phi.as_mut().par_row_chunks_mut(ROWS).for_each(|mut rows| {
        let old = rows.to_owned();
        let into = rows.as_mut().subcols_mut(first, new);
        matmul(into, Accum::Replace, old.as_ref(), c.subcols(first, new), 1.0, Par::Seq);
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ggnn::deflation::Deflation;
    use crate::mesh::sample::icosphere;
    use crate::operators::{MassKind, Operators};
    use crate::spectrum::eigenpairs::normalise;
    use crate::spectrum::pencil::{column_mut, inner};

    fn functions(k: usize) -> (Dense, crate::operators::Sparse) {
        let mesh = icosphere(3);
        let mass = Operators::assemble(&mesh, MassKind::Consistent).unwrap().mass;
        let wave = |i: usize, j: usize| {
            let [x, y, z] = mesh.vertices()[i];
            (x * (j + 1) as f64 + 0.4 * y + z * j as f64).sin() + 0.3
        };
        (Dense::from_fn(mesh.n(), k, wave), mass)
    }

    #[test]
    fn they_are_those_of_one_after_the_other() {
        let (mut phi, mass) = functions(7);
        let mut expected = phi.clone();
        (0..2).for_each(|k| normalise(column_mut(&mut expected, k), &mass));
        phi.subcols_mut(0, 2).copy_from(expected.subcols(0, 2));
        for k in 2..7 {
            let earlier = Deflation::new(&mass, expected.subcols(0, k).to_owned());
            earlier.apply(column_mut(&mut expected, k));
            normalise(column_mut(&mut expected, k), &mass);
        }
        orthonormalise(&mut phi, 2, &mass).unwrap();
        assert!((&phi - &expected).norm_max() < 1e-9);
        let gram = inner(&phi, &mass.product(&phi)).submatrix(2, 2, 5, 5).to_owned();
        assert!((gram - Dense::identity(5, 5)).norm_max() < 1e-14);
    }

    #[test]
    fn functions_that_depend_on_one_another_are_refused() {
        let (mut phi, mass) = functions(3);
        let sum = Dense::from_fn(phi.nrows(), 1, |i, _| phi[(i, 0)] - phi[(i, 1)]);
        phi.subcols_mut(2, 1).copy_from(&sum);
        assert_eq!(orthonormalise(&mut phi, 0, &mass), None);
        phi[(3, 2)] = f64::NAN;
        assert_eq!(orthonormalise(&mut phi, 0, &mass), None);
    }

    #[test]
    fn the_bits_do_not_depend_on_the_number_of_threads() {
        let (phi, mass) = functions(5);
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut phi = phi.clone();
            pool.install(|| orthonormalise(&mut phi, 1, &mass)).unwrap();
            phi
        };
        assert_eq!(on(1), on(3));
    }
}
