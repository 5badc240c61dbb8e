//! Inner distances: lengths of the shortest paths inside a polygonal domain between its vertices.
//!
//! Ling, Jacobs: *Shape classification using the inner-distance*, IEEE TPAMI 29(2), 2007
//! (doi:10.1109/TPAMI.2007.41). They hardly change when a limb turns, unlike distances in the plane. Also their least
//! squares for points that slide along the boundary.

use rayon::prelude::*;

type Point = [f64; 2];

/// Twice the signed area of the triangle `a b c`.
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
    fn visible(&self, i: usize, j: usize, last: &mut usize) -> bool {
        if self.after[i] == j || self.before[i] == j {
            return true;
        }
        if !self.enters(i, j) || !self.enters(j, i) || self.blocks(*last, i, j) {
            return false;
        }
        match (0..self.points.len()).find(|&k| self.blocks(k, i, j)) {
            Some(k) => {
                *last = k;
                false
            }
            None => true,
        }
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
    let domain = Domain { points, before, after };
    let rows: Vec<Vec<f64>> = (0..n)
        .into_par_iter()
        .map(|i| {
            let mut last = 0;
            (0..n)
                .map(|j| {
                    let (a, b): (Point, Point) = (points[i], points[j]);
                    if i == j {
                        0.0
                    // One test a pair, so that rounding cannot see one way only.
                    } else if domain.visible(i.min(j), i.max(j), &mut last) {
                        (b[0] - a[0]).hypot(b[1] - a[1])
                    } else {
                        f64::INFINITY
                    }
                })
                .collect()
        })
        .collect();
    let through: Vec<bool> = (0..n).map(|i| domain.turns_paths(i)).collect();
    let paths: Vec<Vec<f64>> = (0..n).into_par_iter().map(|i| shortest_paths(&rows, &through, i)).collect();
    paths.concat()
}

/// Dijkstra's algorithm on a dense graph, paths `through` some of the vertices only.
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
            *d = d.min(here + step);
        }
    }
    distance
}

/// Weighted squares of the change of distances, and what Gauss–Newton needs of them.
pub struct DistanceModel {
    /// Σ w (scale · found − wanted)².
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
/// with the wanted ones, up to the best common scale. `wanted` and `weight` are row-major and symmetric.
pub fn compare_distances(
    distances: &[f64],
    nodes: usize,
    positions: &[Position],
    wanted: &[f64],
    weight: &[f64],
) -> DistanceModel {
    let n = positions.len();
    assert!(distances.len() == nodes * nodes && wanted.len() == n * n && weight.len() == n * n);
    let (mut found, mut slope, mut other) = (vec![0.0; n * n], vec![0.0; n * n], vec![0.0; n * n]);
    let (mut cross, mut square) = (0.0, 0.0);
    // The pair (a, b) has one slope for each of its ends.
    for (a, p) in positions.iter().enumerate() {
        let (low, high) = (&distances[p.before * nodes..][..nodes], &distances[p.after * nodes..][..nodes]);
        for (b, q) in positions.iter().enumerate() {
            let first = low[q.before] * (1.0 - q.fraction) + low[q.after] * q.fraction;
            let second = high[q.before] * (1.0 - q.fraction) + high[q.after] * q.fraction;
            let k = a * n + b;
            found[k] = first * (1.0 - p.fraction) + second * p.fraction;
            slope[k] = (second - first) / p.gap;
            let along = (low[q.after] - low[q.before]) * (1.0 - p.fraction)
                + (high[q.after] - high[q.before]) * p.fraction;
            other[k] = along / q.gap;
            cross += weight[k] * wanted[k] * found[k];
            square += weight[k] * found[k] * found[k];
        }
    }
    let scale = cross / square;
    let (mut energy, mut gradient, mut hessian) = (0.0, vec![0.0; n], vec![0.0; n * n]);
    for a in 0..n {
        let mut diagonal = 0.0;
        for b in 0..n {
            let k = a * n + b;
            let (w, residual) = (weight[k], scale * found[k] - wanted[k]);
            let s = scale * slope[k];
            energy += w * residual * residual;
            gradient[a] += 4.0 * w * residual * s;
            diagonal += 4.0 * w * s * s;
            hessian[k] = 4.0 * w * s * scale * other[k];
        }
        hessian[a * n + a] += diagonal;
    }
    DistanceModel { energy, gradient, hessian }
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
