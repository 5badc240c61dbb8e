//! A patch as a query sees it: values with first derivatives on a knot span, and control points of any part of one.

use crate::spline::{SplinePatch, basis_on_span, spans};

/// A point of a patch with the first derivatives there.
#[derive(Clone, Copy, Debug)]
pub(super) struct Jet {
    pub point: [f64; 2],
    pub by: [[f64; 2]; 2],
}

/// A part of a knot span: the span's number in either direction, and limits of the parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Part {
    pub span: [usize; 2],
    pub low: [f64; 2],
    pub high: [f64; 2],
}

impl Part {
    pub fn centre(&self) -> [f64; 2] {
        [0, 1].map(|d| 0.5 * (self.low[d] + self.high[d]))
    }

    /// Both halves along a direction, none where no number lies between the limits.
    pub fn halves(&self, axis: usize) -> Option<[Self; 2]> {
        let middle = 0.5 * (self.low[axis] + self.high[axis]);
        if !(self.low[axis] < middle && middle < self.high[axis]) {
            return None;
        }
        let (mut first, mut second) = (*self, *self);
        first.high[axis] = middle;
        second.low[axis] = middle;
        Some([first, second])
    }
}

/// Bézier points of a part, `[i, j]` is `points[i * (degrees[1] + 1) + j]`; no weights on a polynomial patch.
#[derive(Clone, Debug, Default)]
pub(super) struct Net {
    pub points: Vec<[f64; 2]>,
    pub weights: Vec<f64>,
}

/// Room for the basis functions of one point.
#[derive(Clone, Debug, Default)]
pub(super) struct Work {
    values: [Vec<f64>; 2],
    slopes: [Vec<f64>; 2],
}

/// A patch moved and scaled to coordinates of about one.
pub(super) struct Sheet {
    pub degrees: [usize; 2],
    pub knots: [Vec<f64>; 2],
    shape: [usize; 2],
    points: Vec<[f64; 2]>,
    weights: Option<Vec<f64>>,
}

impl Sheet {
    pub fn new(patch: &SplinePatch, moved: impl Fn([f64; 2]) -> [f64; 2]) -> Self {
        let points = patch.points.iter().map(|&p| moved(p)).collect();
        let SplinePatch { degrees, knots, shape, weights, .. } = patch.clone();
        Self { degrees, knots, shape, points, weights }
    }

    /// All knot spans.
    pub fn parts(&self) -> Vec<Part> {
        let [along_u, along_v] = [0, 1].map(|d| spans(&self.knots[d], self.degrees[d]));
        along_u.iter().flat_map(|&k| along_v.iter().map(move |&l| self.whole([k, l]))).collect()
    }

    /// A whole knot span.
    pub fn whole(&self, span: [usize; 2]) -> Part {
        let at = |shift: usize| [0, 1].map(|d| self.knots[d][span[d] + shift]);
        Part { span, low: at(0), high: at(1) }
    }

    /// First and last parameter of a direction.
    pub fn domain(&self, axis: usize) -> [f64; 2] {
        let knots = &self.knots[axis];
        [knots[0], knots[knots.len() - 1]]
    }

    /// Point and derivatives at a parameter of a span.
    pub fn jet(&self, span: [usize; 2], at: [f64; 2], work: &mut Work) -> Jet {
        for d in 0..2 {
            work.values[d].resize(self.degrees[d] + 1, 0.0);
            work.slopes[d].resize(self.degrees[d] + 1, 0.0);
            basis_on_span(
                &self.knots[d],
                self.degrees[d],
                span[d],
                at[d],
                &mut work.values[d],
                &mut work.slopes[d],
            );
        }
        let first = [0, 1].map(|d| span[d] - self.degrees[d]);
        let width = self.degrees[1] + 1;
        let mut sums = [[0.0; 3]; 3];
        for (a, (b, slope)) in work.values[0].iter().zip(&work.slopes[0]).enumerate() {
            let from = (first[0] + a) * self.shape[1] + first[1];
            let points = &self.points[from..][..width];
            let along = work.values[1].iter().zip(&work.slopes[1]);
            let mut row = [[0.0; 3]; 2];
            match &self.weights {
                None => {
                    for (p, (b, slope)) in points.iter().zip(along) {
                        for c in 0..2 {
                            row[0][c] += b * p[c];
                            row[1][c] += slope * p[c];
                        }
                    }
                }
                Some(weights) => {
                    for ((p, w), (b, slope)) in points.iter().zip(&weights[from..]).zip(along) {
                        for (c, x) in [p[0] * w, p[1] * w, *w].into_iter().enumerate() {
                            row[0][c] += b * x;
                            row[1][c] += slope * x;
                        }
                    }
                }
            }
            for c in 0..3 {
                sums[0][c] += b * row[0][c];
                sums[1][c] += slope * row[0][c];
                sums[2][c] += b * row[1][c];
            }
        }
        let [value, by_u, by_v] = sums;
        if self.weights.is_none() {
            let plane = |v: [f64; 3]| [v[0], v[1]];
            return Jet { point: plane(value), by: [plane(by_u), plane(by_v)] };
        }
        let point = [0, 1].map(|c| value[c] / value[2]);
        let by = [by_u, by_v].map(|d| [0, 1].map(|c| (d[c] - d[2] * point[c]) / value[2]));
        Jet { point, by }
    }

    /// Bézier points of a part.
    pub fn net(&self, part: &Part, out: &mut Net) {
        let [along_u, along_v] = [0, 1]
            .map(|d| restriction(&self.knots[d], self.degrees[d], part.span[d], part.low[d], part.high[d]));
        let first = [0, 1].map(|d| part.span[d] - self.degrees[d]);
        let [m, n] = self.degrees.map(|p| p + 1);
        let own = |i: usize, j: usize| (first[0] + i) * self.shape[1] + first[1] + j;
        let weight = |k: usize| self.weights.as_ref().map_or(1.0, |w| w[k]);
        // Rows of the span along v first: [i, j] of homogeneous coordinates.
        let mut rows = vec![[0.0; 3]; m * n];
        for i in 0..m {
            for j in 0..n {
                for (l, c) in along_v[j * n..][..n].iter().enumerate() {
                    let (k, row) = (own(i, l), &mut rows[i * n + j]);
                    let w = c * weight(k);
                    *row = [row[0] + w * self.points[k][0], row[1] + w * self.points[k][1], row[2] + w];
                }
            }
        }
        out.points.clear();
        out.weights.clear();
        for i in 0..m {
            for j in 0..n {
                let mut h = [0.0; 3];
                for (l, c) in along_u[i * m..][..m].iter().enumerate() {
                    for (h, x) in h.iter_mut().zip(rows[l * n + j]) {
                        *h += c * x;
                    }
                }
                let rational = self.weights.is_some();
                out.points.push(if rational { [h[0] / h[2], h[1] / h[2]] } else { [h[0], h[1]] });
                out.weights.extend(rational.then_some(h[2]));
            }
        }
    }
}

/// Bézier coefficients on [a, b] as sums of the `degree + 1` coefficients of span `k`, row by row: blossoms at copies of
/// a and b, by de Boor's recursion. Inside the span all factors lie in [0, 1], and nothing cancels.
fn restriction(knots: &[f64], degree: usize, k: usize, a: f64, b: f64) -> Vec<f64> {
    let n = degree + 1;
    let mut out = Vec::with_capacity(n * n);
    let mut rows = vec![0.0; n * n];
    for i in 0..n {
        rows.fill(0.0);
        (0..n).for_each(|j| rows[j * n + j] = 1.0);
        for r in 1..n {
            let x = if r <= degree - i { a } else { b };
            for j in (r..n).rev() {
                let (lo, hi) = (knots[k + j - degree], knots[k + 1 + j - r]);
                let share = (x - lo) / (hi - lo);
                for l in 0..n {
                    rows[j * n + l] = (1.0 - share) * rows[(j - 1) * n + l] + share * rows[j * n + l];
                }
            }
        }
        out.extend_from_slice(&rows[degree * n..]);
    }
    out
}
