//! Projected Newton with line search on one spline space.
//!
//! Guarantees: the energy never increases for a given ε; once all nodes have det A > 0 no later iterate loses that.
//! Not guaranteed: that a fold-free map is found, nor anything between the nodes; the certificate decides that.

use crate::distortion::{EXACT_BELOW, HessianKind};
use crate::numeric::quasi_newton::Memory;
use crate::numeric::sparse::SparseError;
use crate::optimizer::assembly::Assembly;
use crate::optimizer::blocks::BlockPattern;
use crate::optimizer::evaluation::Evaluator;
use crate::optimizer::reduced::Reduced;
use crate::optimizer::strip_kernel::{Parameters, Summary};
use crate::optimizer::systems::{Accuracy, Systems};
use std::ops::ControlFlow;

/// ε once every node is fold-free: small enough to be a barrier, large enough to divide by.
pub(crate) const EPS_FEASIBLE: f64 = 1e-9;
/// Largest power of the energy density: where the determinant is 0 and ε = 1e-9 stands for it, this power and its
/// derivatives are numbers still.
pub const MAX_POWER: u32 = 32;
/// Newton steps for one value of ε while folds remain.
const STEPS_PER_EPS: usize = 4;
/// Factor of ε where the folds do not open: it must fall all the same, or the iteration would stay where it is.
const LOWER_EPS: f64 = 0.9;
/// ε² while folds remain: at least this, to divide by, and this part of the deepest fold's square, a fifth of its depth.
const LEAST_EPS_SQUARED: f64 = 1e-12;
const EPS_PER_FOLD_SQUARED: f64 = 0.04;
/// Relative decrement below which the last factorization may serve for another step ...
const KEEP_BELOW: f64 = 1e-3;
/// ... as long as every such step lowers the decrement by this factor: it costs a third of a factorization.
const KEEP_WHILE: f64 = 0.3;

/// Smallest determinant, relative to the mean, below which the Hessian takes all nodes.
const SHARP: f64 = 0.02;
/// Ratio of successive decrements, near the minimum, that calls for the Hessian on all nodes.
const SLOW: f64 = 0.2;
/// Decrement relative to the energy from which steps longer than Newton's are tried, up to a limit.
const LENGTHEN_FROM: f64 = 1e-2;
const LONGEST: f64 = 8.0;

/// Part of the fall in energy that the slope promises with which a step is content: next to none, as Newton's steps are
/// long enough by themselves (Armijo's rule; Nocedal and Wright, *Numerical Optimization*, §3.1).
const SUFFICIENT: f64 = 1e-4;
/// Part of a Newton step below which the energy changes by rounding.
const SHORTEST: f64 = 1e-8;

/// Settings of [`crate::optimizer::SplineOptimizer::minimise`].
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Weight λ of the area term.
    pub lambda: f64,
    /// Power of the energy density, 1 to [`MAX_POWER`]; 1 for the energy itself.
    pub power: u32,
    /// Newton steps at most.
    pub max_steps: usize,
    /// Stop when the Newton decrement is below this fraction of the energy.
    pub tolerance: f64,
    /// Factor of all Jacobians; by default that which gives the start mean determinant 1.
    pub scale: Option<f64>,
}

/// One Newton step as reported to the observer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Energy before the step.
    pub energy: f64,
    /// Smallest det A over the nodes before the step.
    pub min_det: f64,
    /// Regularisation ε.
    pub eps: f64,
    /// Newton decrement relative to the energy.
    pub decrement: f64,
}

/// Why the iteration ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// The decrement is below the tolerance.
    Converged,
    /// The step limit was reached.
    StepLimit,
    /// No step lowers the energy any more (rounding), or ε cannot be lowered further with folds left.
    Stalled,
    /// The observer asked to stop.
    Interrupted,
}

/// Result of [`crate::optimizer::SplineOptimizer::minimise`].
#[derive(Clone, Debug)]
pub struct Outcome {
    /// All shared points.
    pub points: Vec<[f64; 2]>,
    /// Energy of the result.
    pub energy: f64,
    /// Smallest det A over the nodes; positive means fold-free at all nodes.
    pub min_det: f64,
    /// Every step taken.
    pub steps: Vec<Step>,
    /// Why it ended.
    pub stop: Stop,
}

/// Called before every step; may stop the iteration.
pub(crate) type Observer<'a> = dyn FnMut(&Step) -> ControlFlow<()> + 'a;

/// The energy on one spline space, and the systems of its Newton steps.
pub(crate) struct NewtonProblem {
    pub evaluator: Evaluator,
    pub assembly: Assembly,
    pub free: Vec<usize>,
    pub reduced: Option<Reduced>,
    pub systems: Systems,
    /// Values of the Hessian over the free points, and over the reduced unknowns.
    values: Vec<f64>,
    reduced_values: Vec<f64>,
    full_gradient: Vec<f64>,
    /// Steps on the Hessian's fewer nodes converge too slowly.
    distrust: bool,
    /// Steps since the last factorization.
    memory: Memory,
}

/// A map with its energy.
struct Iterate {
    x: Vec<[f64; 2]>,
    summary: Summary,
    /// With respect to the unknowns.
    gradient: Vec<f64>,
}

/// An iteration under way.
struct Run {
    at: Parameters,
    now: Iterate,
    /// Memory for another iterate.
    trial: Iterate,
    direction: Vec<f64>,
    /// Decrement relative to the energy at which it ends.
    tolerance: f64,
    steps: Vec<Step>,
    /// Steps since ε was changed.
    since_eps: usize,
    /// Whether the last factorization is of the present energy, so that it may be good for another step.
    usable: bool,
}

/// What is known of a direction.
struct Direction {
    /// The energy's slope along it.
    slope: f64,
    /// Whether it is by a factorization of the Hessian here.
    fresh: bool,
}

impl NewtonProblem {
    pub fn new(
        evaluator: Evaluator,
        assembly: Assembly,
        free: Vec<usize>,
        reduced: Option<Reduced>,
        systems: Systems,
    ) -> Self {
        let full_gradient = vec![0.0; 2 * free.len()];
        Self {
            evaluator,
            assembly,
            free,
            reduced,
            systems,
            values: vec![],
            reduced_values: vec![],
            full_gradient,
            distrust: false,
            memory: Memory::default(),
        }
    }

    fn unknowns(&self) -> usize {
        self.systems.unknowns()
    }

    /// Minimise from `x`, whose fixed points stay; all Jacobians are multiplied by `scale`.
    pub fn minimise(
        &mut self,
        x: &[[f64; 2]],
        scale: f64,
        settings: Settings,
        observe: &mut Observer,
    ) -> Result<Outcome, SparseError> {
        let at = Parameters { scale, eps: EPS_FEASIBLE, lambda: settings.lambda, power: settings.power };
        let mut run = self.begin(x, at, settings.tolerance);
        let stop = loop {
            if self.unknowns() == 0 {
                break Stop::Converged;
            }
            if run.steps.len() >= settings.max_steps {
                break Stop::StepLimit;
            }
            let found = self.find_direction(&mut run)?;
            let step = run.steps[run.steps.len() - 1];
            if observe(&step).is_break() {
                break Stop::Interrupted;
            }
            if let Some(stop) = self.go(&mut run, found, step.decrement < settings.tolerance) {
                break stop;
            }
        };
        let Summary { energy, min_det, .. } = run.now.summary;
        Ok(Outcome { points: run.now.x, energy, min_det, steps: run.steps, stop })
    }

    /// The start with its energy, for an ε that sees its folds.
    fn begin(&mut self, x: &[[f64; 2]], mut at: Parameters, tolerance: f64) -> Run {
        self.distrust = false;
        self.systems.restart();
        let mut now = self.iterate(x.to_vec(), at);
        if now.summary.min_det <= 0.0 {
            at.eps = eps_for(now.summary.min_det);
            self.evaluate(&mut now, at);
        }
        let trial = Iterate { x: x.to_vec(), summary: now.summary, gradient: now.gradient.clone() };
        let direction = vec![0.0; self.unknowns()];
        Run { at, now, trial, direction, tolerance, steps: vec![], since_eps: 0, usable: false }
    }

    /// Newton's direction, by the last factorization where that will do, and the step that it promises.
    fn find_direction(&mut self, run: &mut Run) -> Result<Direction, SparseError> {
        let last = run.steps.last().copied();
        let near = |below: f64| last.is_some_and(|s| s.min_det > 0.0 && s.decrement < below);
        let kept = run.usable && near(KEEP_BELOW);
        let mut fresh = !kept;
        if fresh {
            self.factorize(&run.now, run.at, near(EXACT_BELOW))?;
        }
        let mut slope = self.direct(run)?;
        if kept && last.is_some_and(|s| -slope > KEEP_WHILE * s.decrement * s.energy) {
            self.factorize(&run.now, run.at, true)?;
            slope = self.direct(run)?;
            fresh = true;
        }
        let Summary { energy, min_det, .. } = run.now.summary;
        let step = Step { energy, min_det, eps: run.at.eps, decrement: -slope / energy.abs() };
        // Newton's method is nearly quadratic here, or the Hessian is not that of the energy.
        self.distrust |=
            near(EXACT_BELOW) && !kept && last.is_some_and(|s| step.decrement > SLOW * s.decrement);
        run.steps.push(step);
        Ok(Direction { slope, fresh })
    }

    /// Go along the direction, and lower ε while folds remain; why the iteration ends, if it does.
    fn go(&mut self, run: &mut Run, found: Direction, converged: bool) -> Option<Stop> {
        if converged && run.now.summary.min_det > 0.0 {
            self.go_at_last(run);
            return Some(Stop::Converged);
        }
        let goes = !converged && self.search(run, found.slope);
        run.usable = goes;
        if run.now.summary.min_det > 0.0 {
            if !goes {
                return found.fresh.then_some(Stop::Stalled);
            }
            if run.at.eps != EPS_FEASIBLE {
                self.set_eps(run, EPS_FEASIBLE);
            }
            return None;
        }
        run.since_eps += 1;
        if !goes || run.since_eps >= STEPS_PER_EPS {
            let next = eps_for(run.now.summary.min_det).min(LOWER_EPS * run.at.eps);
            run.since_eps = 0;
            self.set_eps(run, next);
        }
        None
    }

    /// The step is at hand, and near the minimum it squares the error: take it whole unless that is no gain.
    fn go_at_last(&mut self, run: &mut Run) {
        run.trial.x.copy_from_slice(&run.now.x);
        self.move_points(&mut run.trial.x, &run.direction, 1.0);
        let summary = self.evaluator.energy(&run.trial.x, run.at);
        if summary.min_det > 0.0 && summary.energy <= run.now.summary.energy {
            std::mem::swap(&mut run.now.x, &mut run.trial.x);
            run.now.summary = summary;
        }
    }

    /// Another energy: nothing factorized is good for it.
    fn set_eps(&mut self, run: &mut Run, eps: f64) {
        (run.at.eps, run.usable) = (eps, false);
        self.evaluate(&mut run.now, run.at);
    }

    fn iterate(&mut self, x: Vec<[f64; 2]>, at: Parameters) -> Iterate {
        let summary = Summary { energy: 0.0, min_det: 0.0, mean_det: 0.0 };
        let mut out = Iterate { x, summary, gradient: vec![0.0; self.unknowns()] };
        self.evaluate(&mut out, at);
        out
    }

    /// Energy and gradient of an iterate.
    fn evaluate(&mut self, iterate: &mut Iterate, at: Parameters) {
        let full = if self.reduced.is_some() { &mut self.full_gradient } else { &mut iterate.gradient };
        iterate.summary = self.evaluator.gradient(&iterate.x, at, &self.assembly, full);
        if let Some(reduced) = &self.reduced {
            reduced.gather(&self.full_gradient, &mut iterate.gradient);
        }
    }

    /// Backtrack along the direction until the energy falls enough; false where it does not.
    fn search(&mut self, run: &mut Run, slope: f64) -> bool {
        let (energy, folded) = (run.now.summary.energy, run.now.summary.min_det <= 0.0);
        let mut length = 1.0;
        while length >= SHORTEST {
            // The gradient costs little more than the energy, and the first trial is nearly always taken.
            self.try_out(run, length);
            let Summary { energy: found, min_det, .. } = run.trial.summary;
            if (folded || min_det > 0.0) && found < energy + SUFFICIENT * length * slope {
                std::mem::swap(&mut run.now, &mut run.trial);
                if -slope < KEEP_BELOW * energy {
                    self.memory.learn(&run.direction, length, &run.trial.gradient, &run.now.gradient);
                }
                if length == 1.0 && -slope > LENGTHEN_FROM * energy {
                    self.lengthen(run);
                }
                return true;
            }
            length *= 0.5;
        }
        false
    }

    /// Go on along a direction that was taken whole while the energy falls: a barrier's Newton step is too short
    /// far from the minimum (for 1/d it is d/2 whatever d).
    fn lengthen(&mut self, run: &mut Run) {
        let mut length = 1.0;
        while length < LONGEST {
            // `now` is at `length` already.
            self.try_out(run, length);
            let (now, trial) = (run.now.summary, run.trial.summary);
            let folds = now.min_det > 0.0 && trial.min_det <= 0.0;
            if folds || trial.energy >= now.energy {
                break;
            }
            std::mem::swap(&mut run.now, &mut run.trial);
            length *= 2.0;
        }
    }

    /// Make the trial the iterate at `length` along the direction.
    fn try_out(&mut self, run: &mut Run, length: f64) {
        run.trial.x.copy_from_slice(&run.now.x);
        self.move_points(&mut run.trial.x, &run.direction, length);
        self.evaluate(&mut run.trial, run.at);
    }

    /// Prepare the Hessian: as it is if `exact` and that is positive definite, else projected.
    fn factorize(&mut self, now: &Iterate, at: Parameters, exact: bool) -> Result<(), SparseError> {
        // Near folds the energy is sharp: there the cheaper quadrature of the Hessian is not used.
        self.evaluator.fewer_nodes = now.summary.min_det > SHARP && !self.distrust;
        self.memory.clear();
        if exact {
            match self.assemble(now, at, HessianKind::Exact) {
                Err(SparseError::NotPositiveDefinite(_)) => {}
                other => return other,
            }
        }
        self.assemble(now, at, HessianKind::Projected)
    }

    fn assemble(&mut self, now: &Iterate, at: Parameters, kind: HessianKind) -> Result<(), SparseError> {
        let sure = kind == HessianKind::Projected;
        let (systems, pattern, values) = self.hessian(&now.x, at, kind);
        systems.prepare(pattern, values, sure)
    }

    /// Factorize the Hessian at `x` on all nodes, as it is.
    pub fn factorize_all_nodes(
        &mut self,
        x: &[[f64; 2]],
        at: Parameters,
        kind: HessianKind,
    ) -> Result<(), SparseError> {
        self.evaluator.fewer_nodes = false;
        self.memory.clear();
        let (systems, pattern, values) = self.hessian(x, at, kind);
        systems.prepare_direct(pattern, values)
    }

    /// Solve by the factorization of [`Self::factorize_all_nodes`], column after column.
    pub fn solve_columns(&self, rhs: &mut [f64]) {
        self.systems.solve_columns(rhs);
    }

    /// The Hessian over the unknowns, and what solves its systems.
    fn hessian(
        &mut self,
        x: &[[f64; 2]],
        at: Parameters,
        kind: HessianKind,
    ) -> (&mut Systems, &BlockPattern, &mut [f64]) {
        self.values.resize(4 * self.assembly.pattern.blocks(), 0.0);
        self.evaluator.hessian(x, at, kind, &self.assembly, &mut self.values);
        match &self.reduced {
            None => (&mut self.systems, &self.assembly.pattern, &mut self.values),
            Some(reduced) => {
                reduced.congruence(&self.values, &mut self.reduced_values);
                (&mut self.systems, &reduced.pattern, &mut self.reduced_values)
            }
        }
    }

    /// Newton's direction by the Hessian prepared last, or the projected one if that turns out indefinite.
    fn direct(&mut self, run: &mut Run) -> Result<f64, SparseError> {
        match self.solve(run) {
            Err(SparseError::NotPositiveDefinite(_)) => {
                self.memory.clear();
                self.assemble(&run.now, run.at, HessianKind::Projected)?;
                self.solve(run)
            }
            other => other,
        }
    }

    /// The direction by the last Hessian and what was learnt since, and the energy's slope along it.
    fn solve(&mut self, run: &mut Run) -> Result<f64, SparseError> {
        let (gradient, direction) = (&run.now.gradient, &mut run.direction);
        let accuracy = Accuracy { energy: run.now.summary.energy, tolerance: run.tolerance };
        let (pattern, values) = match &self.reduced {
            None => (&self.assembly.pattern, &mut self.values),
            Some(reduced) => (&reduced.pattern, &mut self.reduced_values),
        };
        direction.iter_mut().zip(gradient).for_each(|(d, g)| *d = -g);
        let systems = &mut self.systems;
        self.memory.apply(direction, |d| systems.solve(pattern, values, d, accuracy))?;
        Ok(gradient.iter().zip(direction.iter()).map(|(g, d)| g * d).sum())
    }

    /// `x_free += length · Z d` for unknowns d, components interleaved.
    pub fn move_points(&self, x: &mut [[f64; 2]], d: &[f64], length: f64) {
        match &self.reduced {
            None => {
                for (&p, d) in self.free.iter().zip(d.chunks_exact(2)) {
                    x[p] = [x[p][0] + length * d[0], x[p][1] + length * d[1]];
                }
            }
            Some(reduced) => {
                for (i, j, &w) in reduced.z.triplet_iter() {
                    for c in 0..2 {
                        x[self.free[i]][c] += length * w * d[2 * j + c];
                    }
                }
            }
        }
    }
}

/// ε for the deepest fold: large enough for it to feel the barrier, and smaller with every fold that opens.
///
/// Five times faster for Newton steps than the rule of Garanzha et al. 2021 (Eq. 6), which is made for first-order
/// ones.
fn eps_for(min_det: f64) -> f64 {
    (LEAST_EPS_SQUARED + EPS_PER_FOLD_SQUARED * min_det * min_det).sqrt()
}
