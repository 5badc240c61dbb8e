//! A minimum to the last digits, for derivatives of the minimum.
//!
//! Newton's iteration ends by the energy, whose rounding hides 1e-8 of the points. The gradient sees 1e-16 of them, and
//! with the factorization at hand a correction costs little more than a gradient.

use crate::optimizer::SplineOptimizer;
use crate::optimizer::linearised::{Field, Place};

/// Corrections end with one that does not divide the gradient by this: rounding is reached.
const WORTHWHILE: f64 = 4.0;

/// A map with its energy and gradient, at fixed scale.
#[derive(Clone, Debug)]
pub struct Settled {
    /// All shared points.
    pub points: Field,
    /// Energy, no folds opened (ε → 0).
    pub energy: f64,
    /// Its gradient with respect to all shared points, fixed ones included.
    pub gradient: Field,
    /// The largest component of the gradient with respect to the unknowns.
    pub residual: f64,
    /// Smallest det A over the nodes.
    pub min_det: f64,
}

impl SplineOptimizer {
    /// Correct the map that was linearised by `x −= respond(gradient)` while the gradient falls and no fold appears.
    /// Products and gradients are at the corrected map from now on, responses by the factorization as it is.
    ///
    /// # Panics
    /// When not linearised.
    pub fn settle(&mut self, corrections: usize) -> Settled {
        let mut now = self.here();
        for _ in 0..corrections {
            if now.residual == 0.0 {
                break;
            }
            let step =
                self.answers(self.problem.to_unknowns(&now.gradient), &[vec![[0.0; 2]; now.points.len()]]);
            let pairs = now.points.iter().zip(&step[0]);
            self.look_from(pairs.map(|(x, d)| [x[0] - d[0], x[1] - d[1]]).collect());
            let next = self.here();
            if !(next.min_det > 0.0 && next.residual < now.residual) {
                self.look_from(now.points.clone());
                break;
            }
            let last = next.residual * WORTHWHILE > now.residual;
            now = next;
            if last {
                break;
            }
        }
        now
    }

    /// Take products and gradients at `x` from now on, responses by the factorization as it is.
    ///
    /// # Panics
    /// When not linearised.
    pub fn look_from(&mut self, x: Field) {
        self.linearised.as_mut().expect("linearise first").x = x;
    }

    fn here(&mut self) -> Settled {
        let Place { x, at } = self.linearised.as_ref().expect("linearise first");
        let (found, gradient) = self.problem.evaluator.gradient_everywhere(x, *at);
        let unknown = self.problem.to_unknowns(&gradient);
        let residual = unknown.iter().fold(0.0_f64, |m, g| m.max(g.abs()));
        Settled { points: x.clone(), energy: found.energy, gradient, residual, min_det: found.min_det }
    }
}
