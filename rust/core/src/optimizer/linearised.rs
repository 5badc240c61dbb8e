//! The energy to second order at a map: its Hessian as an operator, and how the inside follows the boundary.
//!
//! At a minimum over the unknowns the inside answers a motion of the boundary so that the gradient there stays zero:
//! `v = f + respond(−H f)` with `respond(q) = Z (Zᵀ H Z)⁻¹ Zᵀ q` (the implicit function theorem). What is left of the
//! Hessian on such motions is its Schur complement.

use crate::distortion::HessianKind;
use crate::numeric::sparse::SparseError;
use crate::optimizer::SplineOptimizer;
use crate::optimizer::newton::{EPS_FEASIBLE, NewtonProblem};
use crate::optimizer::strip_kernel::Parameters;

/// A displacement of all shared points, or a force on them.
pub type Field = Vec<[f64; 2]>;

/// A map at which the Hessian over the unknowns is factorized.
pub(crate) struct Place {
    pub(super) x: Field,
    pub(super) at: Parameters,
}

/// Motions of the boundary that the inside follows, and the energy along them.
#[derive(Clone, Debug)]
pub struct Motions {
    /// The motions of all points.
    pub fields: Vec<Field>,
    /// Slope of the energy along each.
    pub slopes: Vec<f64>,
    /// Its second derivatives, row after row: symmetric.
    pub hessian: Vec<f64>,
}

impl SplineOptimizer {
    /// Factorize the Hessian over the unknowns at `x`, on all nodes, no folds opened (ε → 0) and at fixed scale, by default
    /// that of mean determinant 1.
    ///
    /// # Errors
    /// [`SparseError::NotPositiveDefinite`] where the exact Hessian is not: `x` is no strict minimum.
    pub fn linearise(
        &mut self,
        x: &[[f64; 2]],
        lambda: f64,
        kind: HessianKind,
        scale: Option<f64>,
    ) -> Result<(), SparseError> {
        self.linearised = None;
        let scale = scale.unwrap_or_else(|| self.scale_to_mean(x));
        let at = Parameters { scale, eps: EPS_FEASIBLE, lambda, power: 1 };
        self.problem.factorize_all_nodes(x, at, kind)?;
        self.linearised = Some(Place { x: x.to_vec(), at });
        Ok(())
    }

    /// Whether [`Self::linearise`] has succeeded since anything else was factorized.
    pub fn is_linearised(&self) -> bool {
        self.linearised.is_some()
    }

    /// `Z (Zᵀ H Z)⁻¹ Zᵀ q` for forces on all points; nothing where points are fixed.
    ///
    /// # Panics
    /// When not linearised.
    pub fn respond(&self, forces: &[Field]) -> Vec<Field> {
        assert!(self.is_linearised(), "linearise first");
        let unknown: Vec<f64> = forces.iter().flat_map(|q| self.problem.to_unknowns(q)).collect();
        self.answers(unknown, &vec![vec![[0.0; 2]; self.n_points()]; forces.len()])
    }

    /// The exact Hessian over all points, fixed ones included, times a direction.
    ///
    /// # Panics
    /// When not linearised.
    pub fn product(&mut self, direction: &[[f64; 2]]) -> Field {
        let mut out = vec![[0.0; 2]; direction.len()];
        self.add_product(direction, |p, g| (0..2).for_each(|c| out[p][c] += g[c]));
        out
    }

    /// The motions that begin with the given ones of the fixed points, the inside following, and the energy along them.
    ///
    /// # Panics
    /// When not linearised.
    pub fn motions(&mut self, begins: Vec<Field>) -> Motions {
        let count = begins.len();
        let forces: Vec<Field> = begins.iter().map(|f| self.product(f)).collect();
        let unknown =
            forces.iter().flat_map(|q| self.problem.to_unknowns(q).into_iter().map(|v| -v)).collect();
        let fields = self.answers(unknown, &begins);
        let place = self.linearised.as_ref().expect("products were made");
        let (_, gradient) = self.problem.evaluator.gradient_everywhere(&place.x, place.at);
        let dot = |a: &Field, b: &Field| a.iter().zip(b).map(|(a, b)| a[0] * b[0] + a[1] * b[1]).sum::<f64>();
        let slopes = fields.iter().map(|v| dot(&gradient, v)).collect();
        // fᵀ H f + fᵀ H respond(−H f): the force H f reaches the neighbours of what moves only.
        let mut hessian = vec![0.0; count * count];
        for (k, force) in forces.iter().enumerate() {
            for (p, q) in force.iter().enumerate().filter(|(_, q)| **q != [0.0; 2]) {
                for (l, v) in fields.iter().enumerate() {
                    hessian[k * count + l] += q[0] * v[p][0] + q[1] * v[p][1];
                }
            }
        }
        for k in 0..count {
            for l in 0..k {
                let mean = (hessian[k * count + l] + hessian[l * count + k]) / 2.0;
                (hessian[k * count + l], hessian[l * count + k]) = (mean, mean);
            }
        }
        Motions { fields, slopes, hessian }
    }

    fn add_product(&mut self, direction: &[[f64; 2]], add: impl FnMut(usize, [f64; 2])) {
        let place = self.linearised.as_ref().expect("linearise first");
        self.problem.evaluator.product(&place.x, direction, place.at, add);
    }

    /// `begin + Z y` for every column y of the solution.
    pub(super) fn answers(&self, mut unknown: Vec<f64>, begins: &[Field]) -> Vec<Field> {
        self.problem.solve_columns(&mut unknown);
        let n = unknown.len() / begins.len().max(1);
        let mut out = begins.to_vec();
        for (field, column) in out.iter_mut().zip(unknown.chunks(n.max(1))) {
            self.problem.move_points(field, column, 1.0);
        }
        out
    }
}

impl NewtonProblem {
    /// `Zᵀ q` for forces on all points, components interleaved.
    pub(super) fn to_unknowns(&self, forces: &[[f64; 2]]) -> Vec<f64> {
        let free: Vec<f64> = self.free.iter().flat_map(|&p| forces[p]).collect();
        match &self.reduced {
            None => free,
            Some(reduced) => {
                let mut out = vec![0.0; 2 * reduced.z.ncols()];
                reduced.gather(&free, &mut out);
                out
            }
        }
    }
}
