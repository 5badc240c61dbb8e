//! Inner distances: lengths of the shortest paths inside a polygonal domain between its vertices.
//!
//! Ling, Jacobs: *Shape classification using the inner-distance*, IEEE TPAMI 29(2), 2007
//! (doi:10.1109/TPAMI.2007.41). They hardly change when a limb turns, unlike distances in the plane.

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

    /// Whether the segment between two vertices stays in the domain.
    fn visible(&self, i: usize, j: usize) -> bool {
        if self.after[i] == j || self.before[i] == j {
            return true;
        }
        if !self.enters(i, j) || !self.enters(j, i) {
            return false;
        }
        let (a, b) = (self.points[i], self.points[j]);
        (0..self.points.len()).all(|k| {
            let l = self.after[k];
            let (c, d) = (self.points[k], self.points[l]);
            let side = area(a, b, c);
            // A segment through a vertex is two, each of which is judged by itself: it may enter a hole there.
            if side == 0.0 && k != i && k != j && between(a, b, c) {
                return false;
            }
            if k == i || k == j || l == i || l == j {
                return true;
            }
            side * area(a, b, d) >= 0.0 || area(c, d, a) * area(c, d, b) >= 0.0
        })
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
            let reach = |j| {
                let (a, b): (Point, Point) = (points[i], points[j]);
                // One test a pair, so that rounding cannot see one way only.
                let visible = domain.visible(i.min(j), i.max(j));
                if visible { (b[0] - a[0]).hypot(b[1] - a[1]) } else { f64::INFINITY }
            };
            (0..n).map(|j| if i == j { 0.0 } else { reach(j) }).collect()
        })
        .collect();
    let paths: Vec<Vec<f64>> = (0..n).into_par_iter().map(|i| shortest_paths(&rows, i)).collect();
    paths.concat()
}

/// Dijkstra's algorithm on a dense graph.
fn shortest_paths(lengths: &[Vec<f64>], start: usize) -> Vec<f64> {
    let n = lengths.len();
    let (mut distance, mut done) = (lengths[start].clone(), vec![false; n]);
    done[start] = true;
    for _ in 1..n {
        let Some(k) = (0..n).filter(|&k| !done[k]).min_by(|&a, &b| distance[a].total_cmp(&distance[b]))
        else {
            break;
        };
        done[k] = true;
        let here = distance[k];
        for (d, step) in distance.iter_mut().zip(&lengths[k]) {
            *d = d.min(here + step);
        }
    }
    distance
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
}
