//! Least conformal distortion of a flip-free mesh map, by projected Newton steps that never flip a face.
//!
//! Minimises the mean of σ₁/σ₂ + σ₂/σ₁ = ‖J‖²/det J, weighted by the faces' areas (at least 2, which conformal maps
//! have; the energy of MIPS, Hormann & Greiner 2000), over maps with fixed vertices and linear constraints (Xu et
//! al. 2023, end of §3.3.3). A step is shortened to stay before the first face that it would flip, then until the
//! energy falls.

use rayon::prelude::*;

use crate::distortion::{self, EXACT_BELOW, HessianKind, PACKED};
use crate::mesh::laplacian::{FaceGeometry, MeshError};
use crate::numeric::lanes::Lanes;
use crate::numeric::sparse::{Cholesky, CooMatrix, CscMatrix, NOWHERE, congruence, multiply, upper_triangle};

/// ε of the barrier: nothing, on faces that are not flipped.
const EPS: f64 = 0.0;
/// Sums are formed per chunk and added in order, so results do not depend on the number of threads.
const CHUNK: usize = 1024;
/// Fraction of the way to the first flip that a step may go.
const WAY: f64 = 0.9;
const HALVINGS: usize = 40;
/// Shifts of the diagonal tried in turn, relative to its largest entry.
const SHIFTS: [f64; 5] = [0.0, 1e-14, 1e-12, 1e-9, 1e-4];

/// Why the descent ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stop {
    /// The Newton decrement is below the tolerance.
    Converged,
    /// The step limit was reached.
    StepLimit,
    /// No step lowers the energy (rounding).
    Stalled,
    /// The observer asked to stop.
    Interrupted,
    /// The given map has a face with det J ≤ 0; it is left as it is.
    Flipped,
}

/// What happened in [`DistortionDescent::minimise`].
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// Energy of the given map, then after every step; falls.
    pub energy: Vec<f64>,
    /// Why it ended.
    pub stop: Stop,
}

/// A mesh with fixed vertices and constraints, its patterns analysed once.
pub struct DistortionDescent {
    triangles: Vec<[usize; 3]>,
    geometry: FaceGeometry,
    total_area: f64,
    free: Vec<usize>,
    number: Vec<Option<usize>>,
    pattern: CscMatrix<f64>,
    /// For every face the place of each of its 6 × 6 entries among the pattern's values, or `NOWHERE`.
    places: Vec<[[u32; 6]; 6]>,
    null_space: Option<CscMatrix<f64>>,
    cholesky: Cholesky,
}

impl DistortionDescent {
    /// Prepare a mesh: counter-clockwise faces, fixed vertices (any order), and a basis Z of the displacements of the
    /// free vertices (in increasing order) that the constraints leave; `None` leaves all.
    pub fn new(
        points: &[[f64; 2]],
        triangles: &[[usize; 3]],
        fixed: &[usize],
        null_space: Option<&CscMatrix<f64>>,
    ) -> Result<Self, MeshError> {
        let geometry = FaceGeometry::new(points, triangles)?;
        let mut number = vec![Some(0); points.len()];
        for &vertex in fixed {
            *number.get_mut(vertex).ok_or(MeshError::UnknownVertex { vertex })? = None;
        }
        let free: Vec<usize> = (0..points.len()).filter(|&v| number[v].is_some()).collect();
        for (i, &v) in free.iter().enumerate() {
            number[v] = Some(i);
        }
        if let Some(z) = null_space
            && z.nrows() != free.len()
        {
            return Err(MeshError::NullSpaceShape { rows: z.nrows(), free: free.len() });
        }
        let pattern = hessian_pattern(triangles, &number, 2 * free.len());
        let null_space = null_space.map(interleaved);
        let upper = match &null_space {
            None => upper_triangle(&pattern),
            Some(z) => upper_triangle(&congruence(&pattern, z)),
        };
        let cholesky = Cholesky::analyse(upper.col_offsets(), upper.row_indices(), None)?;
        let places = triangles.iter().map(|t| face_places(&pattern, t.map(|v| number[v]))).collect();
        let total_area = geometry.areas.iter().sum();
        let triangles = triangles.to_vec();
        Ok(Self { triangles, geometry, total_area, free, number, pattern, places, null_space, cholesky })
    }

    /// Number of vertices.
    pub fn n_vertices(&self) -> usize {
        self.number.len()
    }

    /// Energy of a map; infinite when a face has det J ≤ 0.
    pub fn energy(&self, u: &[[f64; 2]]) -> f64 {
        let faces = self.triangles.par_chunks(CHUNK).enumerate();
        let partial: Vec<f64> = faces
            .map(|(chunk, triangles)| {
                let mut sum = 0.0;
                for (i, &t) in triangles.iter().enumerate() {
                    let face = chunk * CHUNK + i;
                    let j = self.geometry.jacobian(face, t, u);
                    let (e, det) = distortion::energy(&j.map(Lanes::splat), EPS, 0.0);
                    let (e, det) = (e.first(), det.first());
                    sum += if det > 0.0 { self.geometry.areas[face] * e } else { f64::INFINITY };
                }
                sum
            })
            .collect();
        partial.iter().sum::<f64>() / self.total_area
    }

    /// Lower the energy of `u` until the squared Newton decrement is below `tolerance` times the energy, `max_steps`
    /// are done, or `proceed` (asked before each step) says no. Fixed vertices do not move, no face is ever flipped.
    pub fn minimise(
        &mut self,
        u: &mut [[f64; 2]],
        max_steps: usize,
        tolerance: f64,
        mut proceed: impl FnMut() -> bool,
    ) -> Report {
        assert_eq!(u.len(), self.n_vertices(), "one position for each vertex");
        let mut energy = vec![self.energy(u)];
        let finish = |energy, stop| Report { energy, stop };
        if !energy[0].is_finite() {
            return finish(energy, Stop::Flipped);
        }
        let mut kind = HessianKind::Projected;
        while energy.len() <= max_steps {
            if !proceed() {
                return finish(energy, Stop::Interrupted);
            }
            let now = energy[energy.len() - 1];
            let (step, decrement) = self.newton_step(u, kind);
            if decrement.is_nan() || decrement == f64::INFINITY {
                return finish(energy, Stop::Stalled);
            }
            if decrement <= tolerance * now {
                return finish(energy, Stop::Converged);
            }
            kind = if decrement < EXACT_BELOW * now { HessianKind::Exact } else { HessianKind::Projected };
            match self.line_search(u, &step, now, decrement) {
                Some((next, value)) => {
                    u.copy_from_slice(&next);
                    energy.push(value);
                }
                None => return finish(energy, Stop::Stalled),
            }
        }
        finish(energy, Stop::StepLimit)
    }

    /// Newton displacement of all vertices and the squared decrement −gᵀ step.
    fn newton_step(&mut self, u: &[[f64; 2]], kind: HessianKind) -> (Vec<[f64; 2]>, f64) {
        let (gradient, reduced) = loop_free_gradient(self, u);
        let mut solution: Vec<f64> = reduced.iter().map(|g| -g).collect();
        let exact = kind == HessianKind::Exact && self.factorize(u, HessianKind::Exact, 0.0);
        // Next to a face that is flat within rounding the projected Hessian is definite only in exact arithmetic.
        let definite = exact || SHIFTS.iter().any(|&shift| self.factorize(u, HessianKind::Projected, shift));
        if !definite {
            return (vec![[0.0; 2]; u.len()], f64::INFINITY);
        }
        self.cholesky.solve(&mut solution);
        let free_step = match &self.null_space {
            None => solution,
            Some(z) => multiply(z, &solution, 1),
        };
        let decrement = -gradient.iter().zip(&free_step).map(|(g, s)| g * s).sum::<f64>();
        let mut step = vec![[0.0; 2]; u.len()];
        for (i, &v) in self.free.iter().enumerate() {
            step[v] = [free_step[2 * i], free_step[2 * i + 1]];
        }
        (step, decrement)
    }

    /// Factorize the Hessian with `shift` times its largest diagonal entry added to the diagonal.
    fn factorize(&mut self, u: &[[f64; 2]], kind: HessianKind, shift: f64) -> bool {
        let (triangles, geometry) = (&self.triangles, &self.geometry);
        let blocks: Vec<[[f64; 6]; 6]> = (0..triangles.len())
            .into_par_iter()
            .with_min_len(CHUNK)
            .map(|face| {
                let j = geometry.jacobian(face, triangles[face], u);
                let weight = geometry.areas[face] / self.total_area;
                let hessian = distortion::hessian(&j.map(Lanes::splat), EPS, 0.0, kind).map(Lanes::first);
                face_hessian(&geometry.gradients[face], &hessian, weight)
            })
            .collect();
        let values = self.pattern.values_mut();
        values.fill(0.0);
        for (block, places) in blocks.iter().zip(&self.places) {
            for (value, &place) in block.as_flattened().iter().zip(places.as_flattened()) {
                if place != NOWHERE {
                    values[place as usize] += value;
                }
            }
        }
        let mut upper = match &self.null_space {
            None => upper_triangle(&self.pattern),
            Some(z) => upper_triangle(&congruence(&self.pattern, z)),
        };
        let diagonal = self.cholesky.diagonal();
        let values = upper.values_mut();
        let largest = diagonal.iter().map(|&i| values[i]).fold(0.0, f64::max);
        for &i in &diagonal {
            values[i] += shift * largest;
        }
        self.cholesky.factorize(upper.values()).is_ok()
    }

    /// The first map along `step` that lowers the energy enough, and its energy.
    fn line_search(
        &self,
        u: &[[f64; 2]],
        step: &[[f64; 2]],
        now: f64,
        decrement: f64,
    ) -> Option<(Vec<[f64; 2]>, f64)> {
        let way = (0..self.triangles.len())
            .into_par_iter()
            .with_min_len(CHUNK)
            .map(|face| {
                let t = self.triangles[face];
                first_flip(self.geometry.jacobian(face, t, u), self.geometry.jacobian(face, t, step))
            })
            .reduce(|| f64::INFINITY, f64::min);
        let mut length = (WAY * way).min(1.0);
        for _ in 0..HALVINGS {
            let next: Vec<[f64; 2]> =
                u.iter().zip(step).map(|(p, s)| [p[0] + length * s[0], p[1] + length * s[1]]).collect();
            let value = self.energy(&next);
            if value <= now - 1e-4 * length * decrement && value < now {
                return Some((next, value));
            }
            length *= 0.5;
        }
        None
    }
}

/// Gradient over the free components, and the same over the reduced unknowns.
fn loop_free_gradient(descent: &DistortionDescent, u: &[[f64; 2]]) -> (Vec<f64>, Vec<f64>) {
    let mut gradient = vec![0.0; 2 * descent.free.len()];
    for (face, &t) in descent.triangles.iter().enumerate() {
        let j = descent.geometry.jacobian(face, t, u).map(Lanes::splat);
        let by_j = distortion::gradient(&j, EPS, 0.0).2.map(Lanes::first);
        let weight = descent.geometry.areas[face] / descent.total_area;
        for (corner, g) in descent.geometry.gradients[face].iter().enumerate() {
            if let Some(i) = descent.number[t[corner]] {
                gradient[2 * i] += weight * (by_j[0] * g[0] + by_j[1] * g[1]);
                gradient[2 * i + 1] += weight * (by_j[2] * g[0] + by_j[3] * g[1]);
            }
        }
    }
    let reduced = match &descent.null_space {
        None => gradient.clone(),
        Some(z) => z
            .col_iter()
            .map(|c| c.row_indices().iter().zip(c.values()).map(|(&i, v)| v * gradient[i]).sum())
            .collect(),
    };
    (gradient, reduced)
}

/// Z for both components of every vertex: row and column 2i + c.
fn interleaved(z: &CscMatrix<f64>) -> CscMatrix<f64> {
    let mut coo = CooMatrix::new(2 * z.nrows(), 2 * z.ncols());
    for (i, j, &v) in z.triplet_iter() {
        for c in 0..2 {
            coo.push(2 * i + c, 2 * j + c, v);
        }
    }
    CscMatrix::from(&coo)
}

fn hessian_pattern(triangles: &[[usize; 3]], number: &[Option<usize>], size: usize) -> CscMatrix<f64> {
    let (mut rows, mut columns) = (Vec::new(), Vec::new());
    for t in triangles {
        let unknowns = unknowns(t.map(|v| number[v]));
        for &row in unknowns.iter().flatten() {
            for &column in unknowns.iter().flatten() {
                rows.push(row);
                columns.push(column);
            }
        }
    }
    let values = vec![0.0; rows.len()];
    let coo =
        CooMatrix::try_from_triplets(size, size, rows, columns, values).expect("numbers are below size");
    CscMatrix::from(&coo)
}

fn unknowns(numbers: [Option<usize>; 3]) -> [Option<usize>; 6] {
    std::array::from_fn(|a| numbers[a / 2].map(|i| 2 * i + a % 2))
}

fn face_places(pattern: &CscMatrix<f64>, numbers: [Option<usize>; 3]) -> [[u32; 6]; 6] {
    let unknowns = unknowns(numbers);
    let (offsets, rows) = (pattern.col_offsets(), pattern.row_indices());
    std::array::from_fn(|a| {
        std::array::from_fn(|b| match (unknowns[a], unknowns[b]) {
            (Some(row), Some(column)) => {
                let range = &rows[offsets[column]..offsets[column + 1]];
                let at = offsets[column] + range.binary_search(&row).expect("the pattern holds every pair");
                u32::try_from(at).expect("fewer than 4e9 entries")
            }
            _ => NOWHERE,
        })
    })
}

/// Hessian over the three corners' components from the packed one over the Jacobian's entries.
fn face_hessian(g: &[[f64; 2]; 3], packed: &[f64; 10], weight: f64) -> [[f64; 6]; 6] {
    std::array::from_fn(|a| {
        let (corner, row) = (a / 2, a % 2);
        std::array::from_fn(|b| {
            let (other, column) = (b / 2, b % 2);
            let mut sum = 0.0;
            for d in 0..2 {
                for e in 0..2 {
                    sum += g[corner][d] * packed[PACKED[2 * row + d][2 * column + e]] * g[other][e];
                }
            }
            weight * sum
        })
    })
}

/// Smallest t > 0 with det(J + t D) = 0, for det J > 0; infinite when there is none.
fn first_flip(j: [f64; 4], d: [f64; 4]) -> f64 {
    let a = d[0] * d[3] - d[1] * d[2];
    let b = j[0] * d[3] + d[0] * j[3] - j[1] * d[2] - d[1] * j[2];
    let c = j[0] * j[3] - j[1] * j[2];
    let discriminant = b * b - 4.0 * a * c;
    if discriminant < 0.0 {
        return f64::INFINITY;
    }
    // Both roots without cancellation.
    let q = -0.5 * (b + discriminant.sqrt().copysign(b));
    let roots = [q / a, c / q];
    roots.into_iter().filter(|t| *t > 0.0).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn det(j: [f64; 4]) -> f64 {
        j[0] * j[3] - j[1] * j[2]
    }

    /// (n + 1)² grid on the unit square and its boundary vertices.
    fn grid(n: usize) -> (Vec<[f64; 2]>, Vec<[usize; 3]>, Vec<usize>) {
        let at = |i: usize, j: usize| i * (n + 1) + j;
        let all = (n + 1) * (n + 1);
        let points =
            (0..all).map(|v| [(v / (n + 1)) as f64, (v % (n + 1)) as f64].map(|x| x / n as f64)).collect();
        let mut triangles = Vec::new();
        for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
            triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
        let rim = |v: &usize| [v / (n + 1), v % (n + 1)].iter().any(|&c| c == 0 || c == n);
        (points, triangles, (0..all).filter(rim).collect())
    }

    fn warped(points: &[[f64; 2]], fixed: &[usize]) -> Vec<[f64; 2]> {
        let mut u: Vec<[f64; 2]> = points.iter().map(|p| [2.0 * p[0] + 0.3 * p[1] * p[1], p[1]]).collect();
        for v in (0..u.len()).filter(|v| fixed.binary_search(v).is_err()) {
            u[v][0] += 0.02 * (12.9898 * v as f64).sin();
            u[v][1] += 0.02 * (78.233 * v as f64).cos();
        }
        u
    }

    proptest! {
        #[test]
        fn first_flip_is_where_the_determinant_vanishes(j in prop::array::uniform4(-2.0..2.0f64),
                                                        d in prop::array::uniform4(-2.0..2.0f64)) {
            prop_assume!(det(j) > 1e-3);
            let t = first_flip(j, d);
            let at = |t: f64| det([0, 1, 2, 3].map(|i| j[i] + t * d[i]));
            if t.is_finite() {
                prop_assert!(at(t).abs() < 1e-9 * (1.0 + t * t));
            }
            // Before that no sample is flipped.
            for i in 1..50 {
                prop_assert!(at(f64::from(i) / 50.0 * t.min(10.0) * (1.0 - 1e-9)) > -1e-12);
            }
        }
    }

    #[test]
    fn descends_to_a_stationary_map() {
        let (points, triangles, fixed) = grid(10);
        let mut u = warped(&points, &fixed);
        let given = u.clone();
        let mut descent = DistortionDescent::new(&points, &triangles, &fixed, None).unwrap();
        let report = descent.minimise(&mut u, 100, 1e-12, || true);
        assert_eq!(report.stop, Stop::Converged);
        assert!(report.energy.len() > 3 && report.energy.windows(2).all(|w| w[1] < w[0]));
        assert!(fixed.iter().all(|&v| u[v] == given[v]));
        // Stationary by differences: no vertex can move and lower the energy to first order.
        let least = descent.energy(&u);
        for v in (0..u.len()).filter(|v| fixed.binary_search(v).is_err()).step_by(7) {
            for c in 0..2 {
                let mut moved = u.clone();
                moved[v][c] += 1e-5;
                let up = descent.energy(&moved);
                moved[v][c] -= 2e-5;
                assert!(((up - descent.energy(&moved)) / 2e-5).abs() < 1e-6);
                assert!(up >= least - 1e-14);
            }
        }
    }

    #[test]
    fn same_bits_for_any_number_of_threads() {
        let (points, triangles, fixed) = grid(40);
        assert!(triangles.len() > 3 * CHUNK);
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let mut u: Vec<[f64; 2]> = points
                    .iter()
                    .map(|p| [2.0 * p[0] + 0.3 * p[1] * p[1], p[1] + 0.1 * (3.0 * p[0]).sin()])
                    .collect();
                let mut descent = DistortionDescent::new(&points, &triangles, &fixed, None).unwrap();
                (descent.minimise(&mut u, 20, 1e-10, || true), u)
            })
        };
        let one = run(1);
        assert!(one.0.energy.len() > 2);
        assert_eq!(one, run(2));
    }

    #[test]
    fn null_space_ties_vertices_and_flips_are_refused() {
        let (points, triangles, fixed) = grid(6);
        let mut u = warped(&points, &fixed);
        let free: Vec<usize> = (0..u.len()).filter(|v| fixed.binary_search(v).is_err()).collect();
        let mut z = CooMatrix::new(free.len(), free.len() - 1);
        for i in 0..free.len() {
            z.push(i, i.saturating_sub(1), 1.0);
        }
        let z = CscMatrix::from(&z);
        let mut descent = DistortionDescent::new(&points, &triangles, &fixed, Some(&z)).unwrap();
        let gap = |u: &[[f64; 2]]| [0, 1].map(|c| u[free[1]][c] - u[free[0]][c]);
        let before = gap(&u);
        let report = descent.minimise(&mut u, 100, 1e-10, || true);
        assert_eq!(report.stop, Stop::Converged);
        assert!(report.energy.len() > 2);
        let after = gap(&u);
        assert!((0..2).all(|c| (after[c] - before[c]).abs() < 1e-13));

        u[free[0]] = [5.0, 5.0];
        let given = u.clone();
        let report = descent.minimise(&mut u, 5, 0.0, || true);
        assert_eq!((report.stop, u), (Stop::Flipped, given));
        let wrong = CscMatrix::identity(3);
        let error = DistortionDescent::new(&points, &triangles, &fixed, Some(&wrong)).err().unwrap();
        assert_eq!(error, MeshError::NullSpaceShape { rows: 3, free: free.len() });
    }
}
