//! Inner distances: lengths of the shortest paths inside a polygonal domain between its vertices.
//!
//! Ling, Jacobs: *Shape classification using the inner-distance*, IEEE TPAMI 29(2), 2007
//! (doi:10.1109/TPAMI.2007.41). They hardly change when a limb turns, unlike distances in the plane.

use crate::numeric::lanes::{Vectorizable, WIDTH, vectorized};
use rayon::prelude::*;

type Point = [f64; 2];

/// Twice the signed area of the triangle `a b c`.
#[inline(always)]
fn area(a: Point, b: Point, c: Point) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Whether a point on the line through `a` and `b` lies strictly between them.
fn between(a: Point, b: Point, c: Point) -> bool {
    let dot = |p: Point| (p[0] - a[0]) * (b[0] - a[0]) + (p[1] - a[1]) * (b[1] - a[1]);
    0.0 < dot(c) && dot(c) < dot(b)
}

/// Vertices of closed loops with the domain on their left, and the cyclic neighbours of each.
struct Domain<'a> {
    points: &'a [Point],
    before: Vec<usize>,
    after: Vec<usize>,
    /// Ends of the edge after each vertex; the last is repeated up to a multiple of [`WIDTH`].
    edges: Vec<[Point; 2]>,
}

impl Domain<'_> {
    /// Whether the direction from vertex `i` to `j` enters the domain.
    fn enters(&self, i: usize, j: usize) -> bool {
        let (p, q, r) = (self.points[self.before[i]], self.points[i], self.points[self.after[i]]);
        let target = self.points[j];
        let (left_in, left_out) = (area(p, q, target) >= 0.0, area(q, r, target) >= 0.0);
        if area(p, q, r) >= 0.0 { left_in && left_out } else { left_in || left_out }
    }

    /// Whether a shortest path may bend or pass at vertex `i`: not where the domain's angle is clearly convex.
    fn turns_paths(&self, i: usize) -> bool {
        let (p, q, r) = (self.points[self.before[i]], self.points[i], self.points[self.after[i]]);
        let size = (q[0] - p[0]).hypot(q[1] - p[1]) * (r[0] - q[0]).hypot(r[1] - q[1]);
        area(p, q, r) <= 1e-9 * size
    }

    /// Whether the edge after vertex `k` or that vertex blocks the segment between vertices `i` and `j`.
    fn blocks(&self, k: usize, i: usize, j: usize) -> bool {
        let l = self.after[k];
        let (a, b, c, d) = (self.points[i], self.points[j], self.points[k], self.points[l]);
        let side = area(a, b, c);
        // A segment through a vertex is two, each of which is judged by itself: it may enter a hole there.
        if side == 0.0 && k != i && k != j && between(a, b, c) {
            return true;
        }
        if k == i || k == j || l == i || l == j {
            return false;
        }
        side * area(a, b, d) < 0.0 && area(c, d, a) * area(c, d, b) < 0.0
    }

    /// Whether the segment between two vertices stays in the domain. What blocked the last one is tried first.
    #[inline(always)]
    fn visible(&self, i: usize, j: usize, last: &mut usize) -> bool {
        if self.after[i] == j || self.before[i] == j {
            return true;
        }
        if !self.enters(i, j) || !self.enters(j, i) || self.blocks(*last, i, j) {
            return false;
        }
        let (a, b) = (self.points[i], self.points[j]);
        for first in (0..self.points.len()).step_by(WIDTH) {
            // Few edges reach the line through both: eight are told at once that they do not.
            let reach = (0..WIDTH).fold(false, |reach, lane| {
                let [c, d] = self.edges[first + lane];
                reach | (area(a, b, c) * area(a, b, d) <= 0.0)
            });
            if !reach {
                continue;
            }
            let last_one = (first + WIDTH).min(self.points.len());
            if let Some(k) = (first..last_one).find(|&k| self.blocks(k, i, j)) {
                *last = k;
                return false;
            }
        }
        true
    }
}

/// Row-major matrix of inner distances between all vertices of the loops of `sizes` vertices each.
pub fn inner_distances(points: &[Point], sizes: &[usize]) -> Vec<f64> {
    let n = points.len();
    let (mut before, mut after) = (Vec::with_capacity(n), Vec::with_capacity(n));
    let mut first = 0;
    for &size in sizes {
        for k in 0..size {
            before.push(first + (k + size - 1) % size);
            after.push(first + (k + 1) % size);
        }
        first += size;
    }
    assert_eq!(first, n, "loop sizes do not add up to the number of points");
    let edges = (0..n.next_multiple_of(WIDTH)).map(|k| k.min(n.saturating_sub(1)));
    let edges = edges.map(|k| [points[k], points[after[k]]]).collect();
    let domain = Domain { points, before, after, edges };
    // One test a pair, so that rounding cannot see one way only.
    let mut rows: Vec<Vec<f64>> =
        (0..n).into_par_iter().map(|i| vectorized(SeenFrom { domain: &domain, i })).collect();
    for i in 0..n {
        let (above, row) = rows.split_at_mut(i);
        above.iter().zip(&mut row[0]).for_each(|(other, length)| *length = other[i]);
    }
    let through: Vec<bool> = (0..n).map(|i| domain.turns_paths(i)).collect();
    let paths: Vec<Vec<f64>> = (0..n)
        .into_par_iter()
        .map(|start| vectorized(PathsFrom { lengths: &rows, through: &through, start }))
        .collect();
    paths.concat()
}

/// Lengths of the segments from vertex `i` to later ones, infinite where they leave the domain.
struct SeenFrom<'a> {
    domain: &'a Domain<'a>,
    i: usize,
}

impl Vectorizable for SeenFrom<'_> {
    type Output = Vec<f64>;

    #[inline(always)]
    fn run<const FUSED: bool>(self) -> Vec<f64> {
        let (Domain { points, .. }, i) = (self.domain, self.i);
        let (mut last, mut lengths) = (0, vec![0.0; points.len()]);
        for j in i + 1..points.len() {
            lengths[j] = if self.domain.visible(i, j, &mut last) {
                (points[j][0] - points[i][0]).hypot(points[j][1] - points[i][1])
            } else {
                f64::INFINITY
            };
        }
        lengths
    }
}

/// Shortest paths from a vertex.
struct PathsFrom<'a> {
    lengths: &'a [Vec<f64>],
    through: &'a [bool],
    start: usize,
}

impl Vectorizable for PathsFrom<'_> {
    type Output = Vec<f64>;

    #[inline(always)]
    fn run<const FUSED: bool>(self) -> Vec<f64> {
        shortest_paths(self.lengths, self.through, self.start)
    }
}

/// Dijkstra's algorithm on a dense graph, paths `through` some of the vertices only.
#[inline(always)]
fn shortest_paths(lengths: &[Vec<f64>], through: &[bool], start: usize) -> Vec<f64> {
    let mut distance = lengths[start].clone();
    let mut open: Vec<usize> = (0..lengths.len()).filter(|&k| through[k] && k != start).collect();
    while !open.is_empty() {
        let (mut nearest, mut here) = (0, f64::INFINITY);
        for (place, &k) in open.iter().enumerate() {
            if distance[k] < here {
                (nearest, here) = (place, distance[k]);
            }
        }
        if here == f64::INFINITY {
            break;
        }
        let k = open.swap_remove(nearest);
        for (d, step) in distance.iter_mut().zip(&lengths[k]) {
            *d = if here + step < *d { here + step } else { *d };
        }
    }
    distance
}

/// Weighted squares of the change of distances, and what Gauss–Newton needs of them.
pub struct DistanceModel {
    /// Σ w (scale · found − wanted)² over all pairs of different positions.
    pub energy: f64,
    /// Derivatives by the positions.
    pub gradient: Vec<f64>,
    /// Row-major Gauss–Newton matrix.
    pub hessian: Vec<f64>,
}

/// Position on a sampled boundary.
#[derive(Clone, Copy)]
pub struct Position {
    /// Node before it.
    pub before: usize,
    /// Node after it.
    pub after: usize,
    /// Part of the way between the two.
    pub fraction: f64,
    /// Length of the way between the two.
    pub gap: f64,
}

/// Compare distances between the positions, interpolated in the row-major matrix of distances between `nodes` nodes,
/// with the wanted ones, up to the best common scale. All matrices are row-major and symmetric.
pub fn compare_distances(
    distances: &[f64],
    nodes: usize,
    positions: &[Position],
    wanted: &[f64],
    weight: &[f64],
) -> DistanceModel {
    let n = positions.len();
    assert!(distances.len() == nodes * nodes && wanted.len() == n * n && weight.len() == n * n);
    let (found, slopes) = interpolated(distances, nodes, positions);
    let (mut cross, mut square) = (0.0, 0.0);
    for a in 0..n {
        for k in a * n..a * n + a {
            cross += weight[k] * wanted[k] * found[k];
            square += weight[k] * found[k] * found[k];
        }
    }
    let scale = cross / square;
    let (mut energy, mut gradient, mut hessian) = (0.0, vec![0.0; n], vec![0.0; n * n]);
    let mut diagonal = vec![0.0; n];
    for a in 0..n {
        let (mut force, mut stiffness) = (0.0, 0.0);
        for b in 0..a {
            let k = a * n + b;
            let (w, residual) = (weight[k], scale * found[k] - wanted[k]);
            let [here, there] = slopes[k].map(|slope| scale * slope);
            energy += 2.0 * w * residual * residual;
            force += 4.0 * w * residual * here;
            stiffness += 4.0 * w * here * here;
            gradient[b] += 4.0 * w * residual * there;
            diagonal[b] += 4.0 * w * there * there;
            hessian[k] = 4.0 * w * here * there;
            hessian[b * n + a] = hessian[k];
        }
        gradient[a] += force;
        diagonal[a] += stiffness;
    }
    (0..n).for_each(|a| hessian[a * n + a] = diagonal[a]);
    DistanceModel { energy, gradient, hessian }
}

/// Row-major distances of every position to those before it, and their derivatives by the two.
fn interpolated(distances: &[f64], nodes: usize, positions: &[Position]) -> (Vec<f64>, Vec<[f64; 2]>) {
    let n = positions.len();
    let (mut found, mut slopes) = (vec![0.0; n * n], vec![[0.0; 2]; n * n]);
    let mut row = vec![[0.0; 2]; nodes];
    for (a, p) in positions.iter().enumerate() {
        let (low, high) = (&distances[p.before * nodes..][..nodes], &distances[p.after * nodes..][..nodes]);
        for ((out, low), high) in row.iter_mut().zip(low).zip(high) {
            *out = [low * (1.0 - p.fraction) + high * p.fraction, (high - low) / p.gap];
        }
        for (b, q) in positions[..a].iter().enumerate() {
            let (first, second) = (row[q.before], row[q.after]);
            let between = |c: usize| first[c] * (1.0 - q.fraction) + second[c] * q.fraction;
            found[a * n + b] = between(0);
            slopes[a * n + b] = [between(1), (second[0] - first[0]) / q.gap];
        }
    }
    (found, slopes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_in_an_l_go_round_its_corner() {
        let l = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];
        let d = inner_distances(&l, &[6]);
        assert!((d[2 * 6 + 4] - 2.0).abs() < 1e-12 && (d[5] - 2.0).abs() < 1e-12);
        assert!((d[2 * 6 + 5] - (1.0 + f64::sqrt(2.0))).abs() < 1e-12);
        for i in 0..6 {
            for j in 0..6 {
                assert_eq!(d[6 * i + j], d[6 * j + i]);
                let [a, b] = [l[i], l[j]];
                assert!(d[6 * i + j] >= (a[0] - b[0]).hypot(a[1] - b[1]) - 1e-12);
            }
        }
    }

    #[test]
    fn paths_go_round_holes() {
        let points =
            [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0], [1.0, 1.0], [1.0, 3.0], [3.0, 3.0], [3.0, 1.0]];
        let d = inner_distances(&points, &[4, 4]);
        assert!((d[2] - 2.0 * f64::sqrt(10.0)).abs() < 1e-12);
        assert!((d[4 * 8 + 6] - 4.0).abs() < 1e-12);
    }

    #[test]
    fn gradient_is_the_derivative() {
        let n = 24;
        let points: Vec<Point> = (0..n)
            .map(|k| {
                let a = k as f64 / n as f64 * std::f64::consts::TAU;
                [2.0 * a.cos(), a.sin() + 0.3 * (2.0 * a).cos()]
            })
            .collect();
        let d = inner_distances(&points, &[n]);
        let wanted: Vec<f64> =
            (0..n * n).map(|k| d[k] * (1.0 + 0.1 * ((k / n + k % n) as f64).sin())).collect();
        let weight = vec![1.0 / (n * n) as f64; n * n];
        let model = |x: &[f64]| {
            let at: Vec<Position> = x
                .iter()
                .map(|&y| {
                    let k = y.floor() as usize;
                    Position { before: k % n, after: (k + 1) % n, fraction: y - y.floor(), gap: 1.0 }
                })
                .collect();
            compare_distances(&d, n, &at, &wanted, &weight)
        };
        let x: Vec<f64> = (0..n).map(|k| k as f64 + 0.4).collect();
        let found = model(&x);
        let h = 1e-5;
        for i in [0, 5, 17] {
            let (mut up, mut down) = (x.clone(), x.clone());
            up[i] += h;
            down[i] -= h;
            let slope = (model(&up).energy - model(&down).energy) / (2.0 * h);
            assert!(
                (slope - found.gradient[i]).abs() < 1e-6 * (1e-3 + slope.abs()),
                "{slope} {}",
                found.gradient[i]
            );
            assert!(found.hessian[i * n + i] > 0.0);
        }
    }
}
