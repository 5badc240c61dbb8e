//! Preconditioned conjugate gradients, as far as Newton's method needs them.
//!
//! Hestenes, Stiefel: *Methods of conjugate gradients for solving linear systems*, J. Res. NBS 49, 1952. Every iterate
//! minimises the quadratic model on a growing space, so all of them are directions of descent: it may end anywhere.

use crate::numeric::lanes::{Lanes, WIDTH};

/// Vectors of an iteration, kept for the next.
#[derive(Default)]
pub(crate) struct Workspace {
    residual: Vec<f64>,
    preconditioned: Vec<f64>,
    direction: Vec<f64>,
    product: Vec<f64>,
}

/// What an iteration has reached: twice the fall of the quadratic model, by the last step and altogether.
///
/// The fall is also `b · x`, and the squared error in the energy norm is what it still lacks.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Progress {
    pub iterations: usize,
    pub last: f64,
    pub total: f64,
}

/// Why it ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Ended {
    /// As accurate as wanted.
    Enough,
    /// A direction without positive curvature: the matrix is indefinite.
    Indefinite,
    /// The iterations are used up.
    OutOfPatience,
}

/// Sum of products, in the same order on every machine.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (mut sum, (a, rest_a), (b, rest_b)) = (Lanes::ZERO, a.as_chunks::<WIDTH>(), b.as_chunks::<WIDTH>());
    for (a, b) in a.iter().zip(b) {
        sum = sum + Lanes(*a) * Lanes(*b);
    }
    sum.sum() + rest_a.iter().zip(rest_b).map(|(a, b)| a * b).sum::<f64>()
}

/// Solve `A x = b` from x = 0, where `x` holds b at first, until `enough` of it is done or `patience` is at its end.
///
/// `multiply` and `precondition` write A v and M⁻¹ v for positive definite A and M into their second argument.
pub(crate) fn solve(
    x: &mut [f64],
    work: &mut Workspace,
    patience: usize,
    mut multiply: impl FnMut(&[f64], &mut [f64]),
    mut precondition: impl FnMut(&[f64], &mut [f64]),
    enough: impl Fn(Progress) -> bool,
) -> Ended {
    let Workspace { residual, preconditioned, direction, product } = work;
    let n = x.len();
    preconditioned.resize(n, 0.0);
    product.resize(n, 0.0);
    residual.clear();
    residual.extend_from_slice(x);
    x.fill(0.0);
    precondition(residual, preconditioned);
    direction.clone_from(preconditioned);
    let mut size = dot(residual, preconditioned);
    let mut total = 0.0;
    for iterations in 1..=patience {
        if size <= 0.0 {
            // No residual is left, or nothing that the preconditioner sees of it.
            return Ended::Enough;
        }
        multiply(direction, product);
        let curvature = dot(direction, product);
        // Not a number, either, is no positive curvature.
        if curvature.is_nan() || curvature <= 0.0 {
            return Ended::Indefinite;
        }
        let length = size / curvature;
        for k in 0..n {
            x[k] += length * direction[k];
            residual[k] -= length * product[k];
        }
        let last = length * size;
        total += last;
        if enough(Progress { iterations, last, total }) {
            return Ended::Enough;
        }
        precondition(residual, preconditioned);
        let next = dot(residual, preconditioned);
        let again = next / size;
        size = next;
        for k in 0..n {
            direction[k] = preconditioned[k] + again * direction[k];
        }
    }
    Ended::OutOfPatience
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optimizer::blocks::tests::banded;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn ends_at_the_solution_and_counts_how_far_the_model_fell(
            n in 1usize..20, width in 0usize..4, seed in prop::collection::vec(-1.0..1.0, 37),
        ) {
            let (pattern, values, _) = banded(n, width, &seed);
            let wanted: Vec<f64> = (0..2 * n).map(|i| (1.0 + i as f64).sin()).collect();
            let mut b = vec![0.0; 2 * n];
            pattern.multiply(&values, &wanted, &mut b);
            let (mut x, mut work) = (b.clone(), Workspace::default());
            let last = std::cell::Cell::new(0.0);
            let ended = solve(
                &mut x,
                &mut work,
                200,
                |v, out| pattern.multiply(&values, v, out),
                |v, out| out.copy_from_slice(v),
                |p| {
                    last.set(p.total);
                    p.last <= 1e-28 * p.total
                },
            );
            prop_assert_eq!(ended, Ended::Enough);
            for (x, w) in x.iter().zip(&wanted) {
                prop_assert!((x - w).abs() < 1e-9);
            }
            prop_assert!((last.get() - dot(&b, &x)).abs() <= 1e-10 * last.get());
        }
    }

    #[test]
    fn an_indefinite_matrix_is_told() {
        let mut x = vec![1.0, 1.0];
        let times = |v: &[f64], out: &mut [f64]| out.copy_from_slice(&[v[0], -2.0 * v[1]]);
        let ended =
            solve(&mut x, &mut Workspace::default(), 9, times, |v, out| out.copy_from_slice(v), |_| false);
        assert_eq!(ended, Ended::Indefinite);
    }
}
