//! Low-distortion, fold-free control points by projected Newton on the spline itself.
//!
//! Minimises `Σ w f(A)` over the free control points, `A = J(x) J_reference⁻¹` scaled to mean determinant 1, with
//! the energy of [`crate::barrier`]. Large models are solved coarse to fine: a correction of the start is sought in
//! coarser spline spaces first, where a step costs a fraction, and the last steps are taken in the model's own.

use crate::assembly::{Assembly, Reduced};
use crate::coarse::{Coarse, coarsen};
use crate::elements::{ElementError, Elements, ExtraNode, Space};
use crate::evaluation::Evaluator;
use crate::kernel::{Parameters, Summary};
use crate::newton::{EPS_FEASIBLE, Problem};
pub use crate::newton::{Outcome, Settings, Step, Stop};
use crate::ordering::{Net, nested_dissection};
use crate::sparse::{Cholesky, CscMatrix, SparseError};
use crate::spline::SplinePatch;
use std::cell::Cell;
use std::ops::ControlFlow;
use thiserror::Error;

/// Free points from which the Hessian is integrated on fewer nodes.
const FEWER_NODES_FROM: usize = 300;
/// Free points from which interfaces and patches are dissected; below, minimum degree is as good and simpler.
const DISSECT_FROM: usize = 2_000;
/// Free points from which coarser spaces are solved first, and of the coarsest at least.
const COARSE_FROM: usize = 1_000;
const COARSEST: usize = 60;
/// Decrement relative to the energy at which a coarser space is left.
const COARSE_TOLERANCE: f64 = 1e-5;

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
    problem: Problem,
    /// Coarser spaces, the coarsest last.
    coarser: Vec<(Coarse, Problem)>,
    /// Factorization of the Laplacian over the unknowns, once it was asked for.
    laplacian: Option<Cholesky>,
    /// The last map whose determinants were asked for, and these.
    judged: Option<(Vec<[f64; 2]>, (f64, f64))>,
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
        let whole = z.is_none();
        let space = Space { knots: &knots, indices: &model.indices };
        let problem = model.problem(&space, model.n_points, free, z)?;
        let mut coarser: Vec<(Coarse, Problem)> = vec![];
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
        Ok(Self { model, problem, coarser, laplacian: None, judged: None })
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
            self.laplacian = None;
        }
    }

    /// Number of shared points.
    pub fn n_points(&self) -> usize {
        self.model.n_points
    }

    /// Smallest and mean det A of a map, scaled to mean 1 where the mean is positive.
    pub fn determinants(&mut self, x: &[[f64; 2]]) -> (f64, f64) {
        // A caller that looked at its start need not pay for that twice.
        if let Some((_, known)) = self.judged.as_ref().filter(|(last, _)| last == x) {
            return *known;
        }
        let at = Parameters { scale: 1.0, eps: 1.0, lambda: 0.0 };
        let found = self.problem.evaluator.energy(x, at);
        let (min, mean) = (found.min_det, found.mean_det);
        let found = if mean > 0.0 { (min / mean, mean) } else { (min, mean) };
        self.judged = Some((x.to_vec(), found));
        found
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
        let m = residual.len() / 2;
        if m == 0 {
            return Ok(x.to_vec());
        }
        if self.laplacian.is_none() {
            let mut values = vec![0.0; problem.assembly.neighbours.len()];
            problem.evaluator.stiffness(&problem.assembly, &mut values);
            let (offsets, rows, values) = match &problem.reduced {
                None => {
                    let rows = problem.assembly.neighbours.iter().map(|&r| r as usize).collect();
                    (problem.assembly.columns.clone(), rows, values)
                }
                Some(reduced) => reduced.scalar_congruence(&problem.assembly, &values),
            };
            let order = problem.order.as_deref();
            let mut cholesky = Cholesky::analyse(&offsets, &rows, order)?;
            cholesky.factorize(&values)?;
            self.laplacian = Some(cholesky);
        }
        let mut rhs: Vec<f64> = (0..2 * m).map(|k| -residual[k % m * 2 + k / m]).collect();
        self.laplacian.as_ref().expect("just made").solve(&mut rhs);
        let interleaved: Vec<f64> = (0..2 * m).map(|k| rhs[k % 2 * m + k / 2]).collect();
        let mut out = x.to_vec();
        problem.move_points(&mut out, &interleaved, 1.0);
        Ok(out)
    }

    /// Energy and its gradient with respect to all shared points, fixed ones included; no folds are opened (ε → 0).
    pub fn gradient(&mut self, x: &[[f64; 2]], lambda: f64) -> (f64, Vec<[f64; 2]>) {
        let (_, mean) = self.determinants(x);
        let scale = if mean > 0.0 { 1.0 / mean.sqrt() } else { 1.0 };
        self.problem.evaluator.gradient_everywhere(x, Parameters { scale, eps: EPS_FEASIBLE, lambda })
    }

    /// Minimise the distortion from the start `x`, whose fixed points stay (and whose rows hold, with a basis).
    ///
    /// `observe` is called before every step, those in coarser spaces included, and may stop the iteration; the
    /// steps of the outcome are those in the model's own space. With a tolerance no finer than that of the coarser
    /// spaces there are none where the last refinement gained less than the tolerance and no fold is left.
    pub fn minimise(
        &mut self,
        x: &[[f64; 2]],
        settings: Settings,
        mut observe: impl FnMut(&Step) -> ControlFlow<()>,
    ) -> Result<Outcome, SparseError> {
        let mean = self.determinants(x).1;
        // The area is fixed by the boundary, so the scale to mean determinant 1 stays valid.
        let scale = if mean > 0.0 { 1.0 / mean.sqrt() } else { 1.0 };
        let stopped = Cell::new(false);
        let mut watch = |step: &Step| {
            let answer = observe(step);
            stopped.set(stopped.get() || answer.is_break());
            answer
        };
        let start = if self.coarser.is_empty() {
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
        // Judged at the nodes of the finest space, with an ε that sees folds.
        let at = Parameters { scale, eps: 1e-3, lambda: settings.lambda };
        let before = self.problem.evaluator.energy(x, at);
        let same = CoarseStart { points: x.to_vec(), found: before, settled: false };
        let (mut correction, mut gain) = (vec![], f64::INFINITY);
        let levels = self.coarser.len();
        for level in (0..levels).rev() {
            let (space, problem) = &mut self.coarser[level];
            problem.evaluator.elements.set_base(&self.model.reference, &self.model.indices, x);
            correction.resize(space.n_points, [0.0; 2]);
            let found = problem.minimise(&correction, scale, coarse, observe)?;
            if found.stop == Stop::Interrupted {
                return Ok(same);
            }
            gain = match found.steps.as_slice() {
                [first, ..] if level + 1 < levels => first.decrement,
                _ => f64::INFINITY,
            };
            correction = match level {
                0 => space.prolong(&found.points, &self.model.indices, self.model.n_points),
                _ => {
                    let finer = &self.coarser[level - 1].0;
                    self.coarser[level].0.prolong(&found.points, &finer.indices, finer.n_points)
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
    ) -> Result<Problem, SetupError> {
        let rule = |degree: usize| self.nodes_per_degree * degree + 1;
        let mut elements = Elements::on_space(&self.reference, space, rule, &self.extra, &self.excluded)?;
        if free.len() >= FEWER_NODES_FROM {
            elements.use_gauss_hessian(&self.reference, space);
        }
        let assembly = Assembly::new(&elements, n_points, &free);
        let points = (free.len() >= DISSECT_FROM).then(|| self.order(space, &assembly.free_of, free.len()));
        let (reduced, offsets, rows, order) = match z {
            None => (None, None, None, points),
            Some(z) => {
                let order = points.map(|points| order_of_columns(&z, &points));
                let (reduced, offsets, rows) = Reduced::new(z, &assembly);
                (Some(reduced), Some(offsets), Some(rows), order)
            }
        };
        let pairs: Option<Vec<usize>> =
            order.as_ref().map(|o| o.iter().flat_map(|&i| [2 * i, 2 * i + 1]).collect());
        let (offsets, rows) =
            (offsets.as_ref().unwrap_or(&assembly.offsets), rows.as_ref().unwrap_or(&assembly.rows));
        let cholesky = Cholesky::analyse(offsets, rows, pairs.as_deref())?;
        Ok(Problem::new(Evaluator::new(elements), assembly, free, reduced, cholesky, order))
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
mod tests {
    use super::*;
    use crate::sparse::CooMatrix;
    use crate::spline::SplinePatch;

    /// Two bicubic patches of `spans`² spans side by side, bent: model, free points and the start.
    fn bent_pair(spans: usize) -> (Model, Vec<usize>, Vec<[f64; 2]>) {
        let inner = (1..spans).map(|k| k as f64 + 0.2 * (k as f64).sin());
        let end = spans as f64;
        let knots: Vec<f64> = [0.0; 4].into_iter().chain(inner).chain([end; 4]).collect();
        let (n, columns) = (spans + 3, 2 * spans + 5);
        let greville: Vec<f64> =
            (0..n).map(|i| knots[i + 1..i + 4].iter().sum::<f64>() / (3.0 * end)).collect();
        // The second patch is mirrored in u and its knots with it, so that its sense differs.
        let mirrored: Vec<f64> = knots.iter().rev().map(|t| end - t).collect();
        let place = |k: usize, i: usize| if k == 0 { i } else { columns - 1 - i };
        let column: Vec<f64> =
            (0..columns).map(|c| if c < n { greville[c] } else { 2.0 - greville[columns - 1 - c] }).collect();
        let reference: Vec<SplinePatch> = (0..2)
            .map(|k| SplinePatch {
                degrees: [3, 3],
                knots: [knots.clone(), if k == 0 { knots.clone() } else { mirrored.clone() }],
                shape: [n, n],
                points: (0..n * n)
                    .map(|p| [column[place(k, p / n)], greville[if k == 0 { p % n } else { n - 1 - p % n }]])
                    .collect(),
                weights: None,
            })
            .collect();
        let indices: Vec<Vec<u32>> = (0..2)
            .map(|k| {
                let at = |p: usize| place(k, p / n) * n + if k == 0 { p % n } else { n - 1 - p % n };
                (0..n * n).map(|p| at(p) as u32).collect()
            })
            .collect();
        let mut x = vec![[0.0; 2]; columns * n];
        for (patch, index) in reference.iter().zip(&indices) {
            for (&[u, v], &i) in patch.points.iter().zip(index) {
                let (sin, cos) = (0.9 * u).sin_cos();
                x[i as usize] = [(1.0 + v) * sin, (1.0 + v) * cos];
            }
        }
        let inside = |p: &usize| (1..columns - 1).contains(&(p / n)) && (1..n - 1).contains(&(p % n));
        let free: Vec<usize> = (0..columns * n).filter(inside).collect();
        let n_points = columns * n;
        let model =
            Model { reference, indices, n_points, nodes_per_degree: 2, extra: vec![], excluded: vec![] };
        (model, free, x)
    }

    fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
    }

    fn solve(z: Option<CscMatrix<f64>>, threads: usize) -> Outcome {
        let (model, free, mut x) = bent_pair(3);
        // A folded start.
        for &p in &free {
            x[p] = [0.9 - x[p][0], x[p][1]];
        }
        let mut optimizer = SplineOptimizer::new(model, free, z).unwrap();
        on_threads(threads, || {
            optimizer.minimise(&x, Settings::default(), |_| ControlFlow::Continue(())).unwrap()
        })
    }

    /// The same problem without coarser spaces and with all nodes.
    fn plainly(optimizer: &mut SplineOptimizer, x: &[[f64; 2]]) -> Outcome {
        optimizer.coarser.clear();
        optimizer.problem.evaluator.elements.hessian_nodes = None;
        optimizer.minimise(x, Settings::default(), |_| ControlFlow::Continue(())).unwrap()
    }

    #[test]
    fn coarser_spaces_and_threads_lead_to_the_same_map() {
        let (model, free, x) = bent_pair(28);
        assert!(free.len() >= COARSE_FROM);
        let run = |threads: usize| {
            let mut optimizer = SplineOptimizer::new(model.clone(), free.clone(), None).unwrap();
            let harmonic = optimizer.harmonic(&x).unwrap();
            let solve = || optimizer.minimise(&harmonic, Settings::default(), |_| ControlFlow::Continue(()));
            let found = on_threads(threads, solve).unwrap();
            (optimizer, harmonic, found)
        };
        let (mut optimizer, harmonic, found) = run(1);
        assert!(optimizer.coarser.len() >= 2);
        assert_eq!(found.stop, Stop::Converged);
        assert_eq!(run(3).2.points, found.points);
        let plain = plainly(&mut optimizer, &harmonic);
        assert!(plain.steps.len() > found.steps.len());
        assert!((plain.energy - found.energy).abs() < 1e-8 * plain.energy);
        for (a, b) in plain.points.iter().zip(&found.points) {
            assert!((a[0] - b[0]).abs() + (a[1] - b[1]).abs() < 1e-3);
        }
    }

    #[test]
    fn folds_of_a_large_model_open_in_the_coarser_spaces() {
        let (model, free, mut x) = bent_pair(24);
        for &p in &free {
            x[p] = [0.9 - x[p][0], x[p][1]];
        }
        let mut optimizer = SplineOptimizer::new(model, free, None).unwrap();
        let mut all = 0;
        let count = |_: &Step| {
            all += 1;
            ControlFlow::Continue(())
        };
        let found = optimizer.minimise(&x, Settings::default(), count).unwrap();
        assert!(found.stop == Stop::Converged && found.min_det > 0.0, "{:?}", found.stop);
        // The observer sees the steps in coarser spaces, where most folds open.
        assert!(found.steps.len() < all, "{} of {all}", found.steps.len());
    }

    #[test]
    fn prolongation_keeps_the_map() {
        let (model, free, _) = bent_pair(24);
        let optimizer = SplineOptimizer::new(model.clone(), free, None).unwrap();
        let space = &optimizer.coarser[0].0;
        // Random movements of the coarse points, evaluated on both levels.
        let c: Vec<[f64; 2]> =
            (0..space.n_points).map(|k| [(1.7 * k as f64).sin(), (2.3 * k as f64).cos()]).collect();
        let fine = space.prolong(&c, &model.indices, model.n_points);
        for (k, patch) in model.reference.iter().enumerate() {
            let value = |knots: &[Vec<f64>; 2], index: &[u32], x: &[[f64; 2]], t: [f64; 2]| {
                let basis = [0, 1].map(|a| {
                    let span = crate::axis::span_of(&knots[a], 3, t[a], false);
                    crate::axis::Sampling::new(&knots[a], 3, &[(t[a], span)])
                });
                let n_v = knots[1].len() - 4;
                let mut sum = [0.0; 2];
                for a in 0..4 {
                    for b in 0..4 {
                        let p = x[index[(basis[0].first[0] + a) * n_v + basis[1].first[0] + b] as usize];
                        let w = basis[0].values[a] * basis[1].values[b];
                        sum = [sum[0] + w * p[0], sum[1] + w * p[1]];
                    }
                }
                sum
            };
            for s in 0..40 {
                let t = [24.0 * (f64::from(s) * 0.37).fract(), 24.0 * (f64::from(s) * 0.71).fract()];
                let coarse = value(&space.knots[k], &space.indices[k], &c, t);
                let same = value(&patch.knots, &model.indices[k], &fine, t);
                assert!((coarse[0] - same[0]).abs() + (coarse[1] - same[1]).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn folds_open_and_the_bits_do_not_depend_on_the_threads() {
        let one = solve(None, 1);
        assert!(one.steps[0].min_det < 0.0 && one.min_det > 0.0 && one.stop == Stop::Converged);
        for threads in [2, 3] {
            assert_eq!(one.points, solve(None, threads).points);
        }
    }

    #[test]
    fn a_scaled_permutation_as_basis_changes_nothing_but_rounding() {
        let n = bent_pair(3).1.len();
        let mut z = CooMatrix::new(n, n);
        (0..n).for_each(|i| z.push(i, n - 1 - i, 1.0 + i as f64 / n as f64));
        let (plain, scaled) = (solve(None, 1), solve(Some(CscMatrix::from(&z)), 1));
        assert!((plain.energy - scaled.energy).abs() < 1e-10);
        for (a, b) in plain.points.iter().zip(&scaled.points) {
            assert!((a[0] - b[0]).abs() + (a[1] - b[1]).abs() < 1e-6);
        }
    }

    #[test]
    fn the_observer_can_stop_it() {
        let (model, free, x) = bent_pair(3);
        let mut optimizer = SplineOptimizer::new(model, free, None).unwrap();
        let stopped = optimizer.minimise(&x, Settings::default(), |_| ControlFlow::Break(())).unwrap();
        assert_eq!((stopped.stop, stopped.steps.len(), stopped.points), (Stop::Interrupted, 1, x));
    }
}
