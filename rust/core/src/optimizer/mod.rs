//! Low-distortion, fold-free control points by projected Newton on the spline itself.
//!
//! Minimises `Σ w f(A)` over the free control points, `A = J(x) J_reference⁻¹` scaled to mean determinant 1, with
//! the energy of [`crate::distortion`]. Large models are solved coarse to fine: a correction of the start is sought in
//! coarser spline spaces first, where a step costs a fraction, and the last steps are taken in the model's own.

mod assembly;
mod axis;
mod blocks;
mod coarse;
mod conjugate_gradients;
pub mod elements;
mod evaluation;
mod laplacian;
mod linearised;
mod newton;
mod ordering;
mod preconditioner;
mod reduced;
mod settled;
mod strip_kernel;
mod systems;

use crate::numeric::sparse::{CscMatrix, SparseError};
use crate::optimizer::assembly::Assembly;
use crate::optimizer::coarse::{Coarse, coarsen};
use crate::optimizer::elements::{ElementError, Elements, ExtraNode, Space};
use crate::optimizer::evaluation::Evaluator;
use crate::optimizer::laplacian::Laplacian;
use crate::optimizer::linearised::Place;
pub use crate::optimizer::linearised::{Field, Motions};
use crate::optimizer::newton::{EPS_FEASIBLE, NewtonProblem};
pub use crate::optimizer::newton::{MAX_POWER, Outcome, Settings, Step, Stop};
use crate::optimizer::ordering::{Net, nested_dissection};
use crate::optimizer::reduced::Reduced;
pub use crate::optimizer::settled::Settled;
use crate::optimizer::strip_kernel::{Parameters, Summary};
use crate::optimizer::systems::Systems;
use crate::spline::SplinePatch;
use std::cell::Cell;
use std::ops::ControlFlow;
use thiserror::Error;

/// Free points from which the Hessian is integrated on fewer nodes.
const FEWER_NODES_FROM: usize = 300;
/// Free points from which interfaces and patches are dissected; below, minimum degree is as good and simpler.
const DISSECT_FROM: usize = 2_000;
/// Unknown points from which systems are solved by conjugate gradients: at 6,784 they and their preconditioner take
/// 0.4 of the factorization's time, at 26,368 and 1e5 a third of it; below there is little to be won.
const ITERATE_FROM: usize = 5_000;
/// Free points from which coarser spaces are solved first, and of the coarsest at least.
const COARSE_FROM: usize = 1_000;
const COARSEST: usize = 60;
/// Decrement relative to the energy at which a coarser space is left.
const COARSE_TOLERANCE: f64 = 1e-5;
/// ε with which a start from coarser spaces is compared with the given one: large enough for folds to count by their
/// depth, small enough not to blur maps without.
const EPS_COMPARED: f64 = 1e-3;

/// Why an optimizer cannot be set up.
#[derive(Debug, Error, Clone, PartialEq)]
pub enum SetupError {
    /// The reference map is of no use.
    #[error(transparent)]
    Element(#[from] ElementError),
    /// The matrices cannot be analysed.
    #[error(transparent)]
    Sparse(#[from] SparseError),
}

/// A multi-patch, and where its distortion is measured.
#[derive(Clone, Debug)]
pub struct Model {
    /// Knots, and the map that distortion is measured against.
    pub reference: Vec<SplinePatch>,
    /// Index among the shared points of every control point of every patch.
    pub indices: Vec<Vec<u32>>,
    /// Number of shared points.
    pub n_points: usize,
    /// Gauss–Lobatto nodes a span and direction are `nodes_per_degree * degree + 1`.
    pub nodes_per_degree: usize,
    /// Additional nodes.
    pub extra: Vec<ExtraNode>,
    /// Patch corners (patch, corner) without a node, corner 0..4 = (0,0), (1,0), (0,1), (1,1).
    pub excluded: Vec<(usize, usize)>,
}

/// A multi-patch prepared for harmonic maps and distortion minimisation; all symbolic work is done once.
pub struct SplineOptimizer {
    model: Model,
    problem: NewtonProblem,
    /// Coarser spaces, the coarsest last.
    coarser: Vec<(Coarse, NewtonProblem)>,
    /// Factorization of the Laplacian over the unknowns, once it was asked for.
    laplacian: Option<Laplacian>,
    /// Where the Hessian is factorized, if that is what was factorized last.
    linearised: Option<Place>,
    /// The last map whose determinants were asked for.
    judged: Option<Judged>,
}

/// A map with its smallest and mean determinant.
struct Judged {
    points: Vec<[f64; 2]>,
    determinants: (f64, f64),
}

/// Where the coarser spaces lead.
struct CoarseStart {
    points: Vec<[f64; 2]>,
    found: Summary,
    /// The last refinement gained less than the tolerance, so the next one will.
    settled: bool,
}

impl SplineOptimizer {
    /// Prepare for the free points `free` (sorted); `z` maps reduced unknowns to them.
    pub fn new(model: Model, free: Vec<usize>, z: Option<CscMatrix<f64>>) -> Result<Self, SetupError> {
        let knots: Vec<[Vec<f64>; 2]> = model.reference.iter().map(|p| p.knots.clone()).collect();
        // Coarser spaces of rational patches would need weights of their own.
        let whole = z.is_none() && model.reference.iter().all(|p| p.weights.is_none());
        let space = Space { knots: &knots, indices: &model.indices };
        let problem = model.problem(&space, model.n_points, free, z)?;
        let mut coarser: Vec<(Coarse, NewtonProblem)> = vec![];
        if whole && problem.free.len() >= COARSE_FROM {
            let degrees: Vec<[usize; 2]> = model.reference.iter().map(|p| p.degrees).collect();
            loop {
                let next = match coarser.last() {
                    None => coarsen(&knots, &degrees, &model.indices, &problem.assembly.free_of),
                    Some((c, p)) => coarsen(&c.knots, &degrees, &c.indices, &p.assembly.free_of),
                };
                let Some(next) = next.filter(|c| c.free.len() >= COARSEST) else { break };
                let space = Space { knots: &next.knots, indices: &next.indices };
                let problem = model.problem(&space, next.n_points, next.free.clone(), None)?;
                coarser.push((next, problem));
            }
        }
        Ok(Self { model, problem, coarser, laplacian: None, linearised: None, judged: None })
    }

    /// Number of entries of the null-space basis, 0 without one.
    pub fn basis_entries(&self) -> usize {
        self.problem.reduced.as_ref().map_or(0, |r| r.z.nnz())
    }

    /// Other values for the entries of the null-space basis, by columns; all symbolic work stays.
    ///
    /// # Panics
    /// When their number is not [`Self::basis_entries`].
    pub fn set_basis(&mut self, values: &[f64]) {
        assert_eq!(values.len(), self.basis_entries(), "the pattern of the basis stays");
        if let Some(reduced) = &mut self.problem.reduced {
            reduced.set_values(values);
            (self.laplacian, self.linearised) = (None, None);
        }
    }

    /// Number of shared points.
    pub fn n_points(&self) -> usize {
        self.model.n_points
    }

    /// Smallest and mean det A of a map, scaled to mean 1 where the mean is positive.
    pub fn determinants(&mut self, x: &[[f64; 2]]) -> (f64, f64) {
        // A caller that looked at its start need not pay for that twice.
        if let Some(last) = self.judged.as_ref().filter(|last| last.points == x) {
            return last.determinants;
        }
        let at = Parameters { scale: 1.0, eps: 1.0, lambda: 0.0, power: 1 };
        let found = self.problem.evaluator.energy(x, at);
        let (min, mean) = (found.min_det, found.mean_det);
        let determinants = if mean > 0.0 { (min / mean, mean) } else { (min, mean) };
        self.judged = Some(Judged { points: x.to_vec(), determinants });
        determinants
    }

    /// The spline harmonic map (Galerkin on the reference map) with the fixed points of `x`.
    ///
    /// With a null-space basis, `x` must satisfy the rows, and the result does.
    pub fn harmonic(&mut self, x: &[[f64; 2]]) -> Result<Vec<[f64; 2]>, SparseError> {
        let problem = &mut self.problem;
        let n = problem.free.len();
        // Residual K x of the given map; the correction solves K_ff d = -residual.
        let mut residual = vec![0.0; 2 * n];
        problem.evaluator.dirichlet(x, &problem.assembly, &mut residual);
        if let Some(reduced) = &problem.reduced {
            let full = residual;
            residual = vec![0.0; 2 * reduced.z.ncols()];
            reduced.gather(&full, &mut residual);
        }
        if residual.is_empty() {
            return Ok(x.to_vec());
        }
        let pattern = problem.reduced.as_ref().map_or(&problem.assembly.pattern, |r| &r.pattern);
        let laplacian = match &mut self.laplacian {
            Some(known) => known,
            none => {
                let mut values = vec![0.0; problem.assembly.pattern.blocks()];
                problem.evaluator.stiffness(&problem.assembly, &mut values);
                if let Some(reduced) = &problem.reduced {
                    values = reduced.scalar_congruence(&values);
                }
                let large = problem.systems.are_large();
                none.insert(Laplacian::new(problem.systems.scalar(pattern)?, pattern, values, large)?)
            }
        };
        residual.iter_mut().for_each(|r| *r = -*r);
        laplacian.solve(pattern, &mut residual)?;
        let mut out = x.to_vec();
        problem.move_points(&mut out, &residual, 1.0);
        Ok(out)
    }

    /// Energy and its gradient with respect to all shared points, fixed ones included; no folds are opened (ε → 0).
    pub fn gradient(&mut self, x: &[[f64; 2]], lambda: f64) -> (f64, Vec<[f64; 2]>) {
        let scale = self.scale_to_mean(x);
        let at = Parameters { scale, eps: EPS_FEASIBLE, lambda, power: 1 };
        let (found, gradient) = self.problem.evaluator.gradient_everywhere(x, at);
        (found.energy, gradient)
    }

    /// The factor of all Jacobians that makes the mean determinant of a map 1.
    fn scale_to_mean(&mut self, x: &[[f64; 2]]) -> f64 {
        let mean = self.determinants(x).1;
        if mean > 0.0 { 1.0 / mean.sqrt() } else { 1.0 }
    }

    /// Minimise the distortion from the start `x`, whose fixed points stay (and whose rows hold, with a basis).
    ///
    /// `observe` is called before every step, those in coarser spaces included, and may stop the iteration, which gives
    /// the best map so far; the steps of the outcome are those in the model's own space. With a tolerance no finer than that of the coarser
    /// spaces there are none where the last refinement gained less than the tolerance and no fold is left; that
    /// needs a smooth start, as the harmonic map is, for coarser spaces do not see what only the finest can move.
    pub fn minimise(
        &mut self,
        x: &[[f64; 2]],
        settings: Settings,
        mut observe: impl FnMut(&Step) -> ControlFlow<()>,
    ) -> Result<Outcome, SparseError> {
        self.linearised = None;
        // The area is fixed by the boundary, so the scale to mean determinant 1 stays valid.
        let scale = settings.scale.unwrap_or_else(|| self.scale_to_mean(x));
        let stopped = Cell::new(false);
        let mut watch = |step: &Step| {
            let answer = observe(step);
            stopped.set(stopped.get() || answer.is_break());
            answer
        };
        // A power begins where a lower one ended: coarser spaces would only find that again.
        let start = if self.coarser.is_empty() || settings.power > 1 {
            None
        } else {
            Some(self.coarse_start(x, scale, settings, &mut watch)?)
        };
        if let Some(CoarseStart { points, found, settled }) = start {
            let stop = if stopped.get() { Stop::Interrupted } else { Stop::Converged };
            if stopped.get() || (settled && found.min_det > 0.0) {
                let (energy, min_det) = (found.energy, found.min_det);
                return Ok(Outcome { points, energy, min_det, steps: vec![], stop });
            }
            return self.problem.minimise(&points, scale, settings, &mut watch);
        }
        self.problem.minimise(x, scale, settings, &mut watch)
    }

    /// A better start: `x` plus the best correction in the coarser spaces, unless that folds what was not folded.
    fn coarse_start(
        &mut self,
        x: &[[f64; 2]],
        scale: f64,
        settings: Settings,
        observe: &mut dyn FnMut(&Step) -> ControlFlow<()>,
    ) -> Result<CoarseStart, SparseError> {
        let coarse = Settings { tolerance: settings.tolerance.max(COARSE_TOLERANCE), ..settings };
        // At the nodes of the finest space.
        let at = Parameters { scale, eps: EPS_COMPARED, lambda: settings.lambda, power: settings.power };
        let before = self.problem.evaluator.energy(x, at);
        let same = CoarseStart { points: x.to_vec(), found: before, settled: false };
        let (mut correction, mut gain, mut stopped) = (vec![], f64::INFINITY, false);
        let levels = self.coarser.len();
        for level in (0..levels).rev() {
            let (space, problem) = &mut self.coarser[level];
            problem.evaluator.elements.set_base(&self.model.reference, &self.model.indices, x);
            correction.resize(space.n_points, [0.0; 2]);
            // Once stopped, what was found is only carried to the finest space.
            if !stopped {
                let found = problem.minimise(&correction, scale, coarse, observe)?;
                stopped = found.stop == Stop::Interrupted;
                gain = match found.steps.as_slice() {
                    [first, ..] if level + 1 < levels && !stopped => first.decrement,
                    _ => f64::INFINITY,
                };
                correction = found.points;
            }
            if problem.systems.are_large() {
                problem.evaluator.elements.drop_base();
            }
            correction = match level {
                0 => space.prolong(&correction, &self.model.indices, self.model.n_points),
                _ => {
                    let finer = &self.coarser[level - 1].0;
                    self.coarser[level].0.prolong(&correction, &finer.indices, finer.n_points)
                }
            };
        }
        let mut points = x.to_vec();
        for &p in &self.problem.free {
            points[p] = [x[p][0] + correction[p][0], x[p][1] + correction[p][1]];
        }
        let found = self.problem.evaluator.energy(&points, at);
        let keeps = before.min_det <= 0.0 || found.min_det > 0.0;
        if keeps && found.energy < before.energy {
            let settled = settings.tolerance >= COARSE_TOLERANCE && gain < settings.tolerance;
            Ok(CoarseStart { points, found, settled })
        } else {
            Ok(same)
        }
    }
}

impl Model {
    /// The energy over movements in a spline space.
    fn problem(
        &self,
        space: &Space,
        n_points: usize,
        free: Vec<usize>,
        z: Option<CscMatrix<f64>>,
    ) -> Result<NewtonProblem, SetupError> {
        let rule = |degree: usize| self.nodes_per_degree * degree + 1;
        let mut elements = Elements::on_space(&self.reference, space, rule, &self.extra, &self.excluded)?;
        if free.len() >= FEWER_NODES_FROM {
            elements.use_gauss_hessian(&self.reference, space);
        }
        let assembly = Assembly::new(&elements, n_points, &free);
        let points = (free.len() >= DISSECT_FROM).then(|| self.order(space, &assembly.free_of, free.len()));
        let (reduced, order) = match z {
            None => (None, points),
            Some(z) => {
                let order = points.map(|points| order_of_columns(&z, &points));
                (Some(Reduced::new(z, &assembly.pattern)), order)
            }
        };
        let pattern = reduced.as_ref().map_or(&assembly.pattern, |r: &Reduced| &r.pattern);
        let systems = Systems::new(pattern, order, pattern.points() >= ITERATE_FROM)?;
        Ok(NewtonProblem::new(Evaluator::new(elements), assembly, free, reduced, systems))
    }

    fn order(&self, space: &Space, free_of: &[u32], n_free: usize) -> Vec<usize> {
        let nets: Vec<Net> = self
            .reference
            .iter()
            .enumerate()
            .map(|(k, patch)| {
                let shape = [0, 1].map(|a| space.knots[k][a].len() - patch.degrees[a] - 1);
                let free = space.indices[k].iter().map(|&p| free_of[p as usize]).collect();
                let sum = patch.points.iter().fold([0.0; 2], |s, p| [s[0] + p[0], s[1] + p[1]]);
                let centre = sum.map(|s| s / patch.points.len() as f64);
                Net { degrees: patch.degrees, shape, free, centre }
            })
            .collect();
        nested_dissection(&nets, n_free)
    }
}

/// Order of reduced unknowns: each with the last of the points it moves.
fn order_of_columns(z: &CscMatrix<f64>, points: &[usize]) -> Vec<usize> {
    let mut rank = vec![0; points.len()];
    points.iter().enumerate().for_each(|(k, &p)| rank[p] = k);
    let mut last = vec![0; z.ncols()];
    for (i, j, _) in z.triplet_iter() {
        last[j] = rank[i].max(last[j]);
    }
    let mut order: Vec<usize> = (0..z.ncols()).collect();
    order.sort_by_key(|&j| last[j]);
    order
}

#[cfg(test)]
mod tests;
