//! Bending energy of the thin plate through points: the smoothest map of the plane that takes points to given ones.
//!
//! F. L. Bookstein: *Principal warps: thin-plate splines and the decomposition of deformations*, IEEE TPAMI 11(6), 1989
//! (doi:10.1109/34.24792). The plate's saddle point system is solved in the space across the affine functions, where
//! its matrix is positive definite.

use crate::numeric::dense::Definite;

/// Root mean square distance of points from their centroid, and the points in units of it, about the centroid.
fn normalised(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let n = points.len() as f64;
    let mean: [f64; 2] = std::array::from_fn(|c| points.iter().map(|p| p[c]).sum::<f64>() / n);
    let centred: Vec<[f64; 2]> = points.iter().map(|p| [p[0] - mean[0], p[1] - mean[1]]).collect();
    let size = (centred.iter().map(|p| p[0] * p[0] + p[1] * p[1]).sum::<f64>() / n).sqrt();
    centred.iter().map(|p| p.map(|x| x / size)).collect()
}

/// r² log r / 8π, the Green's function of the biharmonic operator.
fn green(a: [f64; 2], b: [f64; 2]) -> f64 {
    let squared = (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2);
    if squared > 0.0 { squared * squared.ln() / (16.0 * std::f64::consts::PI) } else { 0.0 }
}

/// The reflection x - v (v·x) scale that leaves of a vector its entries before `first` and the one there.
struct Reflection {
    first: usize,
    v: Vec<f64>,
    scale: f64,
}

impl Reflection {
    /// None where nothing but rounding is left from `first` on.
    fn new(x: &[f64], first: usize) -> Option<Self> {
        let rest: f64 = x[first..].iter().map(|x| x * x).sum::<f64>().sqrt();
        if rest <= 1e-12 * (x.len() as f64).sqrt() {
            return None;
        }
        let mut v = vec![0.0; x.len()];
        v[first..].copy_from_slice(&x[first..]);
        v[first] += rest.copysign(x[first]);
        let scale = 2.0 / v.iter().map(|v| v * v).sum::<f64>();
        Some(Self { first, v, scale })
    }

    fn apply(&self, x: &mut [f64]) {
        let along = self.scale * dot(&self.v[self.first..], &x[self.first..]);
        for (x, v) in x.iter_mut().zip(&self.v).skip(self.first) {
            *x -= along * v;
        }
    }

    /// Reflect rows and columns of a symmetric matrix.
    fn apply_to_both(&self, matrix: &mut [f64]) {
        let n = self.v.len();
        let mut w: Vec<f64> = (0..n)
            .map(|i| self.scale * dot(&matrix[i * n + self.first..][..n - self.first], &self.v[self.first..]))
            .collect();
        let half = 0.5 * self.scale * dot(&self.v, &w);
        w.iter_mut().zip(&self.v).for_each(|(w, v)| *w -= half * v);
        for (i, row) in matrix.chunks_exact_mut(n).enumerate() {
            let (vi, wi) = (self.v[i], w[i]);
            for ((entry, v), w) in row.iter_mut().zip(&self.v).zip(&w) {
                // Of the sum of both products, so that the matrix stays symmetric to the bit.
                *entry -= vi * w + wi * v;
            }
        }
    }
}

/// Sum of products, eight at a time: compilers do not reorder sums.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (a8, b8) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f64 = a8.remainder().iter().zip(b8.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a8.zip(b8) {
        (0..8).for_each(|k| sums[k] += a[k] * b[k]);
    }
    sums.iter().sum::<f64>() + rest
}

/// Row-major matrix B (n, n) with yᵀ B y the bending energy min ∫ ‖∇²f‖² + Σ (f(pᵢ) - yᵢ)² / `slack` over `points`,
/// scaled to a root mean square distance of 1 from their centroid.
pub fn bending_matrix(points: &[[f64; 2]], slack: f64) -> Vec<f64> {
    let (n, p) = (points.len(), normalised(points));
    let mut matrix = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..i {
            matrix[i * n + j] = green(p[i], p[j]);
            matrix[j * n + i] = matrix[i * n + j];
        }
        matrix[i * n + i] = slack;
    }
    // Affine functions, reflected to the first unit vectors one after the other.
    let affine = [vec![1.0; n], p.iter().map(|p| p[0]).collect(), p.iter().map(|p| p[1]).collect()];
    let mut reflections: Vec<Reflection> = vec![];
    for mut function in affine {
        reflections.iter().for_each(|r| r.apply(&mut function));
        let first = reflections.len();
        if first < n
            && let Some(reflection) = Reflection::new(&function, first)
        {
            reflection.apply_to_both(&mut matrix);
            reflections.push(reflection);
        }
    }
    // What is left across them is positive definite.
    let first = reflections.len();
    let across: Vec<f64> =
        matrix.chunks_exact(n).skip(first).flat_map(|row| &row[first..]).copied().collect();
    let inverse = Definite::new(&across, n - first).inverse();
    matrix.fill(0.0);
    if first == n {
        return matrix;
    }
    for (i, row) in inverse.chunks_exact(n - first).enumerate() {
        matrix[(first + i) * n + first..][..n - first].copy_from_slice(row);
    }
    reflections.iter().rev().for_each(|r| r.apply_to_both(&mut matrix));
    matrix
}

/// Bending energy of heights (x, y) under the matrix, times `weight`; adds to the gradient and to the Gauss–Newton
/// matrix of points that move along `tangents`.
pub fn add_bending(
    matrix: &[f64],
    points: &[[f64; 2]],
    tangents: &[[f64; 2]],
    weight: f64,
    gradient: &mut [f64],
    hessian: &mut [f64],
) -> f64 {
    let n = points.len();
    assert!(matrix.len() == n * n && tangents.len() == n && gradient.len() == n && hessian.len() == n * n);
    let [x, y]: [Vec<f64>; 2] = std::array::from_fn(|c| points.iter().map(|p| p[c]).collect());
    let [tx, ty]: [Vec<f64>; 2] = std::array::from_fn(|c| tangents.iter().map(|t| t[c]).collect());
    let mut energy = 0.0;
    for (i, (row, out)) in matrix.chunks_exact(n).zip(hessian.chunks_exact_mut(n)).enumerate() {
        let force = [dot(row, &x), dot(row, &y)];
        energy += x[i] * force[0] + y[i] * force[1];
        gradient[i] += 2.0 * weight * (tx[i] * force[0] + ty[i] * force[1]);
        let along = [2.0 * weight * tx[i], 2.0 * weight * ty[i]];
        for j in 0..n {
            out[j] += row[j] * (along[0] * tx[j] + along[1] * ty[j]);
        }
    }
    weight * energy
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numeric::dense::{product, solve};
    use proptest::prelude::*;

    const SLACK: f64 = 1e-4;

    /// From the whole saddle point system, as in the literature.
    fn by_elimination(points: &[[f64; 2]]) -> Vec<f64> {
        let (n, p) = (points.len(), normalised(points));
        let m = n + 3;
        let (mut system, mut inverse) = (vec![0.0; m * m], vec![0.0; m * n]);
        for i in 0..n {
            (0..n).for_each(|j| system[i * m + j] = green(p[i], p[j]) + if i == j { SLACK } else { 0.0 });
            for (k, value) in [1.0, p[i][0], p[i][1]].into_iter().enumerate() {
                (system[i * m + n + k], system[(n + k) * m + i]) = (value, value);
            }
            inverse[i * n + i] = 1.0;
        }
        solve(&system, &mut inverse, m);
        inverse[..n * n].to_vec()
    }

    fn spread() -> impl Strategy<Value = Vec<[f64; 2]>> {
        prop::collection::vec(prop::array::uniform2(-1.0f64..1.0), 4..60)
    }

    proptest! {
        #[test]
        fn the_saddle_point_system_gives_the_same(points in spread()) {
            let n = points.len();
            let (found, wanted) = (bending_matrix(&points, SLACK), by_elimination(&points));
            let size = wanted.iter().fold(0.0, |a: f64, b| a.max(b.abs()));
            for k in 0..n * n {
                prop_assert!((found[k] - wanted[k]).abs() <= 1e-9 * size, "{} {}", found[k], wanted[k]);
                prop_assert_eq!(found[k], found[k % n * n + k / n]);
            }
        }

        #[test]
        fn affine_functions_cost_nothing(points in spread(), f in prop::array::uniform3(-1.0f64..1.0)) {
            let n = points.len();
            let heights: Vec<f64> = points.iter().map(|p| f[0] + f[1] * p[0] + f[2] * p[1]).collect();
            let force = product(&bending_matrix(&points, SLACK), &heights, [n, n, 1]);
            prop_assert!(force.iter().all(|x| x.abs() < 1e-8 / SLACK));
        }
    }

    #[test]
    fn few_points_and_points_on_a_line_have_a_plate() {
        for points in [vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], vec![[0.0, 1.0], [2.0, 3.0]]] {
            assert!(bending_matrix(&points, SLACK).iter().all(|x| x.abs() < 1e-8));
        }
        let line: Vec<[f64; 2]> = (0..20).map(|k| [f64::from(k), 2.0 * f64::from(k)]).collect();
        let matrix = bending_matrix(&line, SLACK);
        assert!(matrix.iter().all(|x| x.is_finite()) && matrix[0] > 1.0);
    }

    #[test]
    fn gradient_is_the_derivative() {
        let source: Vec<[f64; 2]> = (0..9).map(|k| [f64::from(k % 3), f64::from(k / 3)]).collect();
        let matrix = bending_matrix(&source, SLACK);
        let points: Vec<[f64; 2]> = source.iter().map(|p| [p[0] + 0.1 * p[1] * p[1], p[1]]).collect();
        let tangents = [[0.6, 0.8]; 9];
        let energy = |points: &[[f64; 2]]| {
            let (mut gradient, mut hessian) = (vec![0.0; 9], vec![0.0; 81]);
            (add_bending(&matrix, points, &tangents, 0.7, &mut gradient, &mut hessian), gradient, hessian)
        };
        let (_, gradient, hessian) = energy(&points);
        let h = 1e-5;
        for i in 0..9 {
            let moved = |h: f64| {
                let mut points = points.clone();
                points[i] = [points[i][0] + 0.6 * h, points[i][1] + 0.8 * h];
                energy(&points)
            };
            let (up, down) = (moved(h), moved(-h));
            assert!(((up.0 - down.0) / (2.0 * h) - gradient[i]).abs() < 1e-6 * (1.0 + gradient[i].abs()));
            for j in 0..9 {
                let slope = (up.1[j] - down.1[j]) / (2.0 * h);
                assert!((slope - hessian[i * 9 + j]).abs() < 1e-6 * (1.0 + slope.abs()));
            }
        }
    }
}
