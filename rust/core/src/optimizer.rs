//! Low-distortion, fold-free control points by projected Newton on the spline itself.
//!
//! Minimises `Σ w f(A)` over the free control points, `A = J(x) J_reference⁻¹` scaled to mean determinant 1, with
//! the energy of [`crate::barrier`]. Guarantees: the energy never increases for a given ε; once all nodes have
//! det A > 0 no later iterate loses that. Not guaranteed: that a fold-free map is found, nor anything between the
//! nodes; the certificate decides that.

use crate::assembly::{Assembly, NOWHERE, Reduced};
use crate::barrier::{self, HessianKind};
use crate::elements::{Elements, Scratch};
use crate::sparse::{Cholesky, CooMatrix, CscMatrix, SparseError, upper_triangle};
use rayon::prelude::*;
use std::ops::ControlFlow;

/// ε once every node is fold-free: small enough to be a barrier, large enough to divide by.
const EPS_FEASIBLE: f64 = 1e-9;
/// Newton steps for one value of ε while folds remain.
const STEPS_PER_EPS: usize = 4;
/// Relative decrement below which the exact Hessian is tried.
const EXACT_BELOW: f64 = 1e-2;
/// Elements evaluated in parallel before their contributions are added, in order, by one thread.
const CHUNK: usize = 512;

/// Settings of [`SplineOptimizer::minimise`].
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Weight λ of the area term.
    pub lambda: f64,
    /// Newton steps at most.
    pub max_steps: usize,
    /// Stop when the Newton decrement is below this fraction of the energy.
    pub tolerance: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { lambda: 0.3, max_steps: 200, tolerance: 1e-8 }
    }
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

/// Result of [`SplineOptimizer::minimise`].
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

/// A multi-patch prepared for harmonic maps and distortion minimisation; all symbolic work is done once.
pub struct SplineOptimizer {
    elements: Elements,
    n_points: usize,
    free: Vec<usize>,
    assembly: Assembly,
    reduced: Option<Reduced>,
    cholesky: Cholesky,
    /// Unknowns of a linear system, per component.
    reduced_unknowns: usize,
}

impl SplineOptimizer {
    /// Prepare for the free points `free` (sorted) of `n_points` shared points; `z` maps reduced unknowns to them.
    pub fn new(
        elements: Elements,
        n_points: usize,
        free: Vec<usize>,
        z: Option<CscMatrix<f64>>,
    ) -> Result<Self, SparseError> {
        let assembly = Assembly::new(&elements, n_points, &free);
        let (reduced, cholesky, reduced_unknowns) = match z {
            None => (None, Cholesky::analyse(&assembly.offsets, &assembly.rows, None)?, free.len()),
            Some(z) => {
                let unknowns = z.ncols();
                let (reduced, offsets, rows) = Reduced::new(z, &assembly);
                (Some(reduced), Cholesky::analyse(&offsets, &rows, None)?, unknowns)
            }
        };
        Ok(Self { elements, n_points, free, assembly, reduced, cholesky, reduced_unknowns })
    }

    /// Number of shared points.
    pub fn n_points(&self) -> usize {
        self.n_points
    }

    /// Smallest and mean det A of a map, scaled to mean 1 where the mean is positive.
    pub fn determinants(&self, x: &[[f64; 2]]) -> (f64, f64) {
        let (min, mean) = self.elements.determinants(x, 1.0);
        if mean > 0.0 { (min / mean, mean) } else { (min, mean) }
    }

    /// The spline harmonic map (Galerkin on the reference map) with the fixed points of `x`.
    ///
    /// With a null-space basis, `x` must satisfy the rows, and the result does.
    pub fn harmonic(&self, x: &[[f64; 2]]) -> Result<Vec<[f64; 2]>, SparseError> {
        let n = self.free.len();
        let mut k = CooMatrix::new(n, n);
        // Residual K x of the given map; the correction solves K_ff d = -residual.
        let mut residual = vec![[0.0; 2]; n];
        let mut block = vec![0.0; self.elements.max_functions().pow(2)];
        for e in 0..self.elements.len() {
            let points = self.elements.points_of(e);
            self.elements.stiffness(e, &mut block);
            for (f, &p) in points.iter().enumerate() {
                let row = self.assembly.free_of[p as usize];
                if row == NOWHERE {
                    continue;
                }
                for (g, &q) in points.iter().enumerate() {
                    let (value, column) = (block[f * points.len() + g], self.assembly.free_of[q as usize]);
                    for c in 0..2 {
                        residual[row as usize][c] += value * x[q as usize][c];
                    }
                    if column != NOWHERE {
                        k.push(row as usize, column as usize, value);
                    }
                }
            }
        }
        let mut matrix = CscMatrix::from(&k);
        let m = self.reduced_unknowns;
        let mut rhs = vec![0.0; 2 * m];
        match &self.reduced {
            None => (0..m).for_each(|i| (0..2).for_each(|c| rhs[c * m + i] = -residual[i][c])),
            Some(reduced) => {
                matrix = crate::sparse::congruence(&matrix, &reduced.z);
                for (i, j, &w) in reduced.z.triplet_iter() {
                    (0..2).for_each(|c| rhs[c * m + j] -= w * residual[i][c]);
                }
            }
        }
        let upper = upper_triangle(&matrix);
        let mut cholesky = Cholesky::analyse(upper.col_offsets(), upper.row_indices(), None)?;
        cholesky.factorize(upper.values())?;
        cholesky.solve(&mut rhs);
        let interleaved: Vec<f64> = (0..2 * m).map(|k| rhs[k % 2 * m + k / 2]).collect();
        let mut out = x.to_vec();
        self.move_points(&mut out, &interleaved, 1.0);
        Ok(out)
    }

    /// Energy and its gradient with respect to all shared points, fixed ones included; no folds are opened (ε → 0).
    pub fn gradient(&self, x: &[[f64; 2]], lambda: f64) -> (f64, Vec<[f64; 2]>) {
        let (_, mean) = self.elements.determinants(x, 1.0);
        let scale = if mean > 0.0 { 1.0 / mean.sqrt() } else { 1.0 };
        let width = self.elements.max_functions();
        let per_element: Vec<(f64, Vec<[f64; 2]>)> = (0..self.elements.len())
            .into_par_iter()
            .with_min_len(16)
            .map_init(Scratch::default, |scratch, e| {
                let (mut sum, mut by_a) = (0.0, vec![[0.0; 4]; self.elements.nodes_of(e)]);
                self.elements.for_each_node(e, x, scale, scratch, |node, a, w| {
                    let (f, _, g) = barrier::gradient(a, EPS_FEASIBLE, lambda);
                    sum += w * f;
                    by_a[node] = g.map(|v| w * v);
                });
                let mut local = vec![[0.0; 2]; width];
                self.elements.scatter_gradient(e, &by_a, scale, scratch, &mut local);
                (sum, local)
            })
            .collect();
        // Summed in the order of the elements: the same bits for any number of threads.
        let (mut energy, mut gradient) = (0.0, vec![[0.0; 2]; self.n_points]);
        for (e, (sum, local)) in per_element.iter().enumerate() {
            energy += sum;
            for (&p, g) in self.elements.points_of(e).iter().zip(local) {
                (0..2).for_each(|c| gradient[p as usize][c] += g[c]);
            }
        }
        (energy, gradient)
    }

    /// Minimise the distortion from the start `x`, whose fixed points stay (and whose rows hold, with a basis).
    ///
    /// `observe` is called before every step and may stop the iteration.
    pub fn minimise(
        &mut self,
        x: &[[f64; 2]],
        settings: Settings,
        mut observe: impl FnMut(&Step) -> ControlFlow<()>,
    ) -> Result<Outcome, SparseError> {
        let mut x = x.to_vec();
        let mut steps: Vec<Step> = vec![];
        let (_, mean) = self.elements.determinants(&x, 1.0);
        // The area is fixed by the boundary, so the scale to mean determinant 1 stays valid.
        let scale = if mean > 0.0 { 1.0 / mean.sqrt() } else { 1.0 };
        let lambda = settings.lambda;
        let (mut min_det, _) = self.elements.determinants(&x, scale);
        let mut eps = if min_det > 0.0 { EPS_FEASIBLE } else { (1e-12 + 0.04 * min_det * min_det).sqrt() };
        let (mut since_eps, mut energy_at_eps) = (0, f64::INFINITY);
        let finish = |x: Vec<[f64; 2]>, energy, min_det, steps, stop| Outcome {
            points: x,
            energy,
            min_det,
            steps,
            stop,
        };
        let mut energy = self.energy(&x, scale, eps, lambda).0;
        if self.reduced_unknowns == 0 {
            return Ok(finish(x, energy, min_det, steps, Stop::Converged));
        }
        let (mut gradient, mut values) = (vec![], vec![]);
        loop {
            if steps.len() >= settings.max_steps {
                return Ok(finish(x, energy, min_det, steps, Stop::StepLimit));
            }
            let near = steps.last().is_some_and(|s| s.min_det > 0.0 && s.decrement < EXACT_BELOW);
            let mut kind = if near { HessianKind::Exact } else { HessianKind::Projected };
            loop {
                self.derivatives(&x, scale, eps, lambda, kind, &mut gradient, &mut values);
                match self.cholesky.factorize(&values) {
                    Err(SparseError::NotPositiveDefinite(_)) if kind == HessianKind::Exact => {
                        kind = HessianKind::Projected
                    }
                    Err(SparseError::NotPositiveDefinite(_)) => {
                        // The projected Hessian is definite but for rounding: lift the diagonal a little.
                        self.lift_diagonal(&mut values);
                        self.cholesky.factorize(&values)?;
                        break;
                    }
                    other => {
                        other?;
                        break;
                    }
                }
            }
            let mut direction: Vec<f64> = gradient.iter().map(|g| -g).collect();
            self.cholesky.solve(&mut direction);
            let slope: f64 = gradient.iter().zip(&direction).map(|(g, d)| g * d).sum();
            let step = Step { energy, min_det, eps, decrement: -slope / energy.abs() };
            steps.push(step);
            if observe(&step).is_break() {
                return Ok(finish(x, energy, min_det, steps, Stop::Interrupted));
            }
            let converged = step.decrement < settings.tolerance;
            if converged && min_det > 0.0 {
                // The step is at hand, and near the minimum it squares the error.
                let mut trial = x.clone();
                self.move_points(&mut trial, &direction, 1.0);
                let (e, d) = self.energy(&trial, scale, eps, lambda);
                if d > 0.0 && e <= energy {
                    (x, energy, min_det) = (trial, e, d);
                }
                return Ok(finish(x, energy, min_det, steps, Stop::Converged));
            }
            let moved = !converged && {
                let mut length = 1.0;
                loop {
                    let mut trial = x.clone();
                    self.move_points(&mut trial, &direction, length);
                    let (e, d) = self.energy(&trial, scale, eps, lambda);
                    if (min_det <= 0.0 || d > 0.0) && e < energy + 1e-4 * length * slope {
                        (x, energy, min_det) = (trial, e, d);
                        break true;
                    }
                    length *= 0.5;
                    if length < 1e-8 {
                        break false;
                    }
                }
            };
            if min_det > 0.0 {
                if !moved {
                    return Ok(finish(x, energy, min_det, steps, Stop::Stalled));
                }
                if eps != EPS_FEASIBLE {
                    eps = EPS_FEASIBLE;
                    energy = self.energy(&x, scale, eps, lambda).0;
                }
                continue;
            }
            since_eps += 1;
            if !moved || since_eps >= STEPS_PER_EPS {
                // Garanzha et al. 2021, Eq. 6: lower ε no faster than the energy fell, so that folds open one by one.
                let sigma =
                    if energy_at_eps.is_finite() { (1.0 - energy / energy_at_eps).max(0.1) } else { 0.1 };
                let mu = (1.0 - sigma) * barrier::chi(eps, min_det).0;
                let next = if min_det < mu { 2.0 * (mu * (mu - min_det)).sqrt() } else { EPS_FEASIBLE };
                let next = next.min(0.9 * eps);
                if next < 1e-7 * min_det.abs().max(1e-3) {
                    return Ok(finish(x, energy, min_det, steps, Stop::Stalled));
                }
                (eps, since_eps) = (next, 0);
                energy = self.energy(&x, scale, eps, lambda).0;
                energy_at_eps = energy;
            }
        }
    }

    /// `x_free += length · Z d` for reduced unknowns d, components interleaved.
    fn move_points(&self, x: &mut [[f64; 2]], d: &[f64], length: f64) {
        match &self.reduced {
            None => {
                for (i, &p) in self.free.iter().enumerate() {
                    for c in 0..2 {
                        x[p][c] += length * d[2 * i + c];
                    }
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

    /// Energy and smallest determinant.
    fn energy(&self, x: &[[f64; 2]], scale: f64, eps: f64, lambda: f64) -> (f64, f64) {
        let per_element: Vec<(f64, f64)> = (0..self.elements.len())
            .into_par_iter()
            .with_min_len(16)
            .map_init(Scratch::default, |scratch, e| {
                let (mut sum, mut min) = (0.0, f64::INFINITY);
                self.elements.for_each_node(e, x, scale, scratch, |_, a, w| {
                    let (f, det) = barrier::energy(a, eps, lambda);
                    sum += w * f;
                    min = min.min(det);
                });
                (sum, min)
            })
            .collect();
        // Summed in the order of the elements: the same bits for any number of threads.
        per_element.into_iter().fold((0.0, f64::INFINITY), |s, r| (s.0 + r.0, s.1.min(r.1)))
    }

    /// Gradient and values of the Hessian with respect to the reduced unknowns.
    #[allow(clippy::too_many_arguments)]
    fn derivatives(
        &self,
        x: &[[f64; 2]],
        scale: f64,
        eps: f64,
        lambda: f64,
        kind: HessianKind,
        gradient: &mut Vec<f64>,
        values: &mut Vec<f64>,
    ) {
        let (n, width) = (self.free.len(), self.elements.max_functions());
        let mut full_gradient = vec![0.0; 2 * n];
        let mut full_values = vec![0.0; self.assembly.rows.len()];
        let chunk = CHUNK.min(self.elements.len());
        let mut local: Vec<(Vec<[f64; 2]>, Vec<f64>)> =
            (0..chunk).map(|_| (vec![[0.0; 2]; width], vec![0.0; 4 * width * width])).collect();
        for start in (0..self.elements.len()).step_by(chunk.max(1)) {
            let count = chunk.min(self.elements.len() - start);
            local[..count].par_iter_mut().with_min_len(4).enumerate().for_each_init(
                || (Scratch::default(), vec![], vec![]),
                |(scratch, by_a, by_aa): &mut (Scratch, Vec<[f64; 4]>, Vec<[f64; 10]>), (k, (g, block))| {
                    let e = start + k;
                    let nodes = self.elements.nodes_of(e);
                    by_a.clear();
                    by_a.resize(nodes, [0.0; 4]);
                    by_aa.clear();
                    by_aa.resize(nodes, [0.0; 10]);
                    self.elements.for_each_node(e, x, scale, scratch, |node, a, w| {
                        by_a[node] = barrier::gradient(a, eps, lambda).2.map(|v| w * v);
                        by_aa[node] = barrier::hessian(a, eps, lambda, kind).map(|v| w * v);
                    });
                    g.fill([0.0; 2]);
                    self.elements.scatter_gradient(e, by_a, scale, scratch, g);
                    self.elements.contract_hessian(e, by_aa, scale, scratch, block);
                },
            );
            for (k, (g, block)) in local[..count].iter().enumerate() {
                let e = start + k;
                let points = self.elements.points_of(e);
                for (&p, g) in points.iter().zip(g) {
                    let f = self.assembly.free_of[p as usize];
                    if f != NOWHERE {
                        full_gradient[2 * f as usize] += g[0];
                        full_gradient[2 * f as usize + 1] += g[1];
                    }
                }
                self.assembly.scatter(e, points, self.elements.functions_of(e), block, &mut full_values);
            }
        }
        match &self.reduced {
            None => (*gradient, *values) = (full_gradient, full_values),
            Some(reduced) => {
                *gradient = vec![0.0; 2 * self.reduced_unknowns];
                for (i, j, &w) in reduced.z.triplet_iter() {
                    for c in 0..2 {
                        gradient[2 * j + c] += w * full_gradient[2 * i + c];
                    }
                }
                *values = vec![0.0; reduced.values];
                for &(to, from, w) in &reduced.map {
                    values[to as usize] += w * full_values[from as usize];
                }
            }
        }
    }

    /// Add 1e-9 of the mean diagonal to the diagonal (the last entry of every column of the upper triangle).
    fn lift_diagonal(&self, values: &mut [f64]) {
        let diagonal = self.cholesky.diagonal();
        let mean = diagonal.iter().map(|&k| values[k]).sum::<f64>() / diagonal.len() as f64;
        for k in diagonal {
            values[k] += 1e-9 * mean;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spline::SplinePatch;

    /// Two bicubic patches of 3 × 3 spans side by side, bent; knots, shared indices, free points and the start.
    fn bent_pair() -> (Elements, usize, Vec<usize>, Vec<[f64; 2]>) {
        let knots: Vec<f64> = [0.0; 4].into_iter().chain([1.0, 2.0]).chain([3.0; 4]).collect();
        let greville: Vec<f64> = (0..6).map(|i| knots[i + 1..i + 4].iter().sum::<f64>() / 9.0).collect();
        let (n, columns) = (6, 11);
        let patches: Vec<SplinePatch> = (0..2)
            .map(|k| SplinePatch {
                degrees: [3, 3],
                knots: [knots.clone(), knots.clone()],
                shape: [n, n],
                points: (0..n * n).map(|p| [f64::from(k) + greville[p / n], greville[p % n]]).collect(),
                weights: None,
            })
            .collect();
        let indices: Vec<Vec<u32>> = (0..2)
            .map(|k| (0..n * n).map(|p| ((k * (n - 1) + p / n) * n + p % n) as u32).collect())
            .collect();
        let elements = Elements::new(&patches, &indices, |p| 2 * p + 1, &[], &[]).unwrap();
        let mut x = vec![[0.0; 2]; columns * n];
        for (patch, index) in patches.iter().zip(&indices) {
            for (&[u, v], &i) in patch.points.iter().zip(index) {
                let (sin, cos) = (0.9 * u).sin_cos();
                x[i as usize] = [(1.0 + v) * sin, (1.0 + v) * cos];
            }
        }
        let inside = |p: &usize| (1..columns - 1).contains(&(p / n)) && (1..n - 1).contains(&(p % n));
        let free: Vec<usize> = (0..columns * n).filter(inside).collect();
        (elements, columns * n, free, x)
    }

    fn solve(z: Option<CscMatrix<f64>>, threads: usize) -> Outcome {
        let (elements, n, free, mut x) = bent_pair();
        // A folded start.
        for &p in &free {
            x[p] = [0.9 - x[p][0], x[p][1]];
        }
        let mut optimizer = SplineOptimizer::new(elements, n, free, z).unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| optimizer.minimise(&x, Settings::default(), |_| ControlFlow::Continue(())).unwrap())
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
        let n = bent_pair().2.len();
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
        let (elements, n, free, x) = bent_pair();
        let mut optimizer = SplineOptimizer::new(elements, n, free, None).unwrap();
        let stopped = optimizer.minimise(&x, Settings::default(), |_| ControlFlow::Break(())).unwrap();
        assert_eq!((stopped.stop, stopped.steps.len(), stopped.points), (Stop::Interrupted, 1, x));
    }
}
