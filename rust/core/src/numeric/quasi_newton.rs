//! Corrections of a factorized Hessian by the steps taken since: BFGS with limited memory on top of it.
//!
//! A factorization costs as much as several gradients, and near the minimum it stays nearly right. What a step shows
//! of its error (the Hessian moved on, or was integrated on fewer nodes than the energy) is used for the next one.
//! Nocedal, Wright: *Numerical Optimization*, 2nd ed., Algorithm 7.4, with the factorization for the initial matrix.

use std::collections::VecDeque;

/// Steps that are remembered at most.
const PAIRS: usize = 8;

/// A step and how it changed the gradient.
struct Pair {
    step: Vec<f64>,
    change: Vec<f64>,
    /// step · change, positive.
    curvature: f64,
    /// Of the last call, between the two loops.
    alpha: f64,
}

/// What was learnt since the last factorization.
#[derive(Default)]
pub(crate) struct Memory {
    pairs: VecDeque<Pair>,
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn add(to: &mut [f64], factor: f64, v: &[f64]) {
    to.iter_mut().zip(v).for_each(|(t, v)| *t += factor * v);
}

impl Memory {
    pub fn clear(&mut self) {
        self.pairs.clear();
    }

    /// Learn from the step `length · direction` between two gradients.
    pub fn learn(&mut self, direction: &[f64], length: f64, before: &[f64], after: &[f64]) {
        let step: Vec<f64> = direction.iter().map(|d| length * d).collect();
        let change: Vec<f64> = after.iter().zip(before).map(|(a, b)| a - b).collect();
        let curvature = dot(&step, &change);
        // Only positive curvature keeps the matrix definite; the bound is on the angle.
        if curvature <= 1e-10 * (dot(&step, &step) * dot(&change, &change)).sqrt() {
            return;
        }
        if self.pairs.len() == PAIRS {
            self.pairs.pop_front();
        }
        self.pairs.push_back(Pair { step, change, curvature, alpha: 0.0 });
    }

    /// Replace `x` by the corrected inverse times `x`; `solve` does so for the factorization alone.
    pub fn apply<E>(
        &mut self,
        x: &mut [f64],
        solve: impl FnOnce(&mut [f64]) -> Result<(), E>,
    ) -> Result<(), E> {
        for pair in self.pairs.iter_mut().rev() {
            pair.alpha = dot(&pair.step, x) / pair.curvature;
            add(x, -pair.alpha, &pair.change);
        }
        solve(x)?;
        for pair in &self.pairs {
            let beta = dot(&pair.change, x) / pair.curvature;
            add(x, pair.alpha - beta, &pair.step);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Minimise ½ xᵀ A x - bᵀ x for a diagonal A with exact line searches, the identity standing in for A.
    fn steps_to_minimum(diagonal: &[f64]) -> usize {
        let n = diagonal.len();
        let gradient =
            |x: &[f64]| -> Vec<f64> { (0..n).map(|i| diagonal[i] * x[i] - 1.0 - i as f64).collect() };
        let mut memory = Memory::default();
        let (mut x, mut g) = (vec![0.0; n], gradient(&vec![0.0; n]));
        for count in 0..100 {
            if dot(&g, &g) < 1e-20 {
                return count;
            }
            let mut direction: Vec<f64> = g.iter().map(|g| -g).collect();
            memory.apply(&mut direction, |_| Ok::<(), ()>(())).unwrap();
            assert!(dot(&direction, &g) < 0.0);
            let curvature: f64 = direction.iter().zip(diagonal).map(|(d, a)| a * d * d).sum();
            let length = -dot(&direction, &g) / curvature;
            add(&mut x, length, &direction);
            let next = gradient(&x);
            memory.learn(&direction, length, &g, &next);
            g = next;
        }
        100
    }

    #[test]
    fn a_quadratic_takes_as_many_steps_as_unknowns() {
        // Textbook: with exact line searches BFGS is the conjugate gradient method on a quadratic.
        assert!(steps_to_minimum(&[1.0, 3.0, 10.0, 40.0, 0.2]) <= 5);
        assert!(steps_to_minimum(&[2.0; 6]) <= 1);
    }

    #[test]
    fn the_secant_equation_holds_for_the_last_step() {
        let mut memory = Memory::default();
        memory.learn(&[1.0, 2.0, 0.0], 0.5, &[0.0; 3], &[1.0, 3.0, -1.0]);
        memory.learn(&[0.0, 1.0, 1.0], 1.0, &[1.0, 3.0, -1.0], &[1.5, 4.0, 0.5]);
        let mut x = vec![0.5, 1.0, 1.5];
        let solve = |x: &mut [f64]| {
            x.iter_mut().for_each(|v| *v *= 0.3);
            Ok::<(), ()>(())
        };
        memory.apply(&mut x, solve).unwrap();
        for (x, s) in x.iter().zip([0.0, 1.0, 1.0]) {
            assert!((x - s).abs() < 1e-14);
        }
    }

    #[test]
    fn negative_curvature_is_not_learnt() {
        let mut memory = Memory::default();
        memory.learn(&[1.0, 0.0], 1.0, &[0.0, 0.0], &[-1.0, 0.0]);
        assert!(memory.pairs.is_empty());
    }
}
