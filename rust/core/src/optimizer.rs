//! Low-distortion, fold-free control points by projected Newton on the spline itself.
//!
//! Minimises `Σ w f(A)` over the free control points, `A = J(x) J_reference⁻¹` scaled to mean determinant 1, with
//! the energy of [`crate::barrier`]. Guarantees: the energy never increases for a given ε; once all nodes have
//! det A > 0 no later iterate loses that. Not guaranteed: that a fold-free map is found, nor anything between the
//! nodes; the certificate decides that.

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
/// Pair of functions with a fixed point: nothing to add.
const NOWHERE: u32 = u32::MAX;

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

/// Sparsity of the Hessian of points with two components, and where every pair of functions goes.
struct Assembly {
    /// Free index of every shared point.
    free_of: Vec<u32>,
    /// Column offsets and row indices of the upper triangle, x and y interleaved.
    offsets: Vec<usize>,
    rows: Vec<usize>,
    /// Per element and pair of functions: position of the 2x2 block's first entry.
    targets: Vec<u32>,
    /// Start of every element's targets.
    starts: Vec<usize>,
    /// Length of the first of the two columns of every free point.
    column: Vec<u32>,
}

impl Assembly {
    fn new(elements: &Elements, n_points: usize, free: &[usize]) -> Self {
        let mut free_of = vec![NOWHERE; n_points];
        for (i, &p) in free.iter().enumerate() {
            free_of[p] = i as u32;
        }
        let n = free.len();
        let mut neighbours: Vec<Vec<u32>> = vec![vec![]; n];
        for e in 0..elements.len() {
            let local: Vec<u32> = elements.points_of(e).iter().map(|&p| free_of[p as usize]).collect();
            for &s in local.iter().filter(|&&s| s != NOWHERE) {
                neighbours[s as usize].extend(local.iter().filter(|&&r| r <= s));
            }
        }
        let (mut offsets, mut rows, mut column) = (vec![0], vec![], vec![]);
        for (s, list) in neighbours.iter_mut().enumerate() {
            list.sort_unstable();
            list.dedup();
            for component in 0..2 {
                for &r in list.iter() {
                    rows.push(2 * r as usize);
                    if (r as usize) < s || component == 1 {
                        rows.push(2 * r as usize + 1);
                    }
                }
                offsets.push(rows.len());
            }
            column.push((offsets[2 * s + 1] - offsets[2 * s]) as u32);
        }
        let (mut targets, mut starts) = (vec![], vec![0]);
        for e in 0..elements.len() {
            let local: Vec<u32> = elements.points_of(e).iter().map(|&p| free_of[p as usize]).collect();
            for &f in &local {
                for &g in &local {
                    let (r, s) = (f.min(g), f.max(g));
                    targets.push(if s == NOWHERE {
                        NOWHERE
                    } else {
                        let at = neighbours[s as usize].binary_search(&r).expect("pair is in the pattern");
                        (offsets[2 * s as usize] + 2 * at) as u32
                    });
                }
            }
            starts.push(targets.len());
        }
        Self { free_of, offsets, rows, targets, starts, column }
    }

    /// Add an element matrix (layout of [`Elements::contract_hessian`]) to the global values.
    fn scatter(&self, e: usize, points: &[u32], (nu, nv): (usize, usize), block: &[f64], values: &mut [f64]) {
        let (n, targets) = (nu * nv, &self.targets[self.starts[e]..self.starts[e + 1]]);
        for b in 0..nv {
            for b2 in b..nv {
                let base = (b * nv + b2) * 4 * nu * nu;
                for a in 0..nu {
                    for a2 in if b == b2 { a..nu } else { 0..nu } {
                        let (f, g) = (a * nv + b, a2 * nv + b2);
                        let at = targets[f * n + g];
                        if at == NOWHERE {
                            continue;
                        }
                        let (r, s) = (self.free_of[points[f] as usize], self.free_of[points[g] as usize]);
                        let k = base + a * nu + a2;
                        let [xx, xy, yx, yy] = std::array::from_fn(|cd| block[k + cd * nu * nu]);
                        // The block of (r, s) stands at the larger point's columns; transpose if they are swapped.
                        let (xy, yx) = if r <= s { (xy, yx) } else { (yx, xy) };
                        let (first, second) =
                            (at as usize, at as usize + self.column[r.max(s) as usize] as usize);
                        values[first] += xx;
                        values[second] += xy;
                        values[second + 1] += yy;
                        if r != s {
                            values[first + 1] += yx;
                        }
                    }
                }
            }
        }
    }
}

/// Unknowns of the linear systems: the free points themselves, or coordinates z with `x_free = x_p + Z z`.
struct Reduced {
    /// `Z`, free points × reduced unknowns, for one component.
    z: CscMatrix<f64>,
    /// `value[to] += weight * full[from]`, sorted by `to`, turns the values of H into those of `Zᵀ H Z`.
    map: Vec<(u32, u32, f64)>,
    /// Number of values of `Zᵀ H Z`.
    values: usize,
}

impl Reduced {
    /// Pattern of `Zᵀ H Z` (upper triangle, interleaved) and the linear map between the values.
    fn new(z: CscMatrix<f64>, assembly: &Assembly) -> (Self, Vec<usize>, Vec<usize>) {
        let rows_of: Vec<Vec<(usize, f64)>> = {
            let mut rows = vec![vec![]; z.nrows()];
            for (i, j, &w) in z.triplet_iter() {
                rows[i].push((j, w));
            }
            rows
        };
        // Every entry (i, j) of the upper triangle stands for (j, i) too.
        let mut triples: Vec<((usize, usize), u32, f64)> = vec![];
        for column in 0..assembly.offsets.len() - 1 {
            for k in assembly.offsets[column]..assembly.offsets[column + 1] {
                let row = assembly.rows[k];
                for &(p, wp) in &rows_of[row / 2] {
                    for &(q, wq) in &rows_of[column / 2] {
                        let (i, j) = (2 * p + row % 2, 2 * q + column % 2);
                        if i <= j {
                            triples.push(((j, i), k as u32, wp * wq));
                        }
                        if row != column && j <= i {
                            triples.push(((i, j), k as u32, wp * wq));
                        }
                    }
                }
            }
        }
        triples.sort_by_key(|&(key, from, _)| (key, from));
        let (mut offsets, mut rows, mut map) = (vec![0; 2 * z.ncols() + 1], vec![], vec![]);
        let mut last = None;
        for (key, from, w) in triples {
            if last != Some(key) {
                rows.push(key.1);
                offsets[key.0 + 1] += 1;
                last = Some(key);
            }
            map.push((rows.len() as u32 - 1, from, w));
        }
        for c in 0..2 * z.ncols() {
            offsets[c + 1] += offsets[c];
        }
        let values = rows.len();
        (Self { z, map, values }, offsets, rows)
    }
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
