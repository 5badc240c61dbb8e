//! Hulls of arcs: control points with a bound on their error, and lines that separate them.
//!
//! A test may use any axis, rounded or not: what it needs is only that products with that axis are bounded. Each margin
//! has an absolute part, [`TINY`], for products that underflow, so an axis as short as subnormal differences make it
//! separates nothing.

use crate::numeric::budget::Budget;
use crate::spline::bernstein::{SLACK, TINY, U, larger};

/// Cross product.
pub(crate) fn cross(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

/// Difference of two points.
pub(crate) fn minus(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

/// Larger side of the bounding box.
pub(crate) fn extent(points: &[[f64; 2]]) -> f64 {
    (0..2)
        .map(|d| {
            let (lo, hi) = range(points.iter().map(|p| p[d]));
            hi - lo
        })
        .fold(0.0, f64::max)
}

/// Smallest and largest value, both NaN if any value is.
pub(crate) fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), x| {
        (if x < lo || x.is_nan() { x } else { lo }, larger(hi, x))
    })
}

/// Cartesian control points of an arc or of a chain of arcs: its hull.
#[derive(Clone, Debug)]
pub(crate) struct Hull {
    pub points: Vec<[f64; 2]>,
    /// Bound on the error of every coordinate.
    pub err: f64,
    /// Largest absolute coordinate.
    pub reach: f64,
}

impl Hull {
    pub fn start(&self) -> [f64; 2] {
        self.points[0]
    }

    pub fn end(&self) -> [f64; 2] {
        self.points[self.points.len() - 1]
    }

    /// `[x0, x1, y0, y1]`, the error included; the whole plane where nothing is known.
    pub fn bounds(&self) -> [f64; 4] {
        let (x, y) = (range(self.points.iter().map(|p| p[0])), range(self.points.iter().map(|p| p[1])));
        let e = 2.0 * self.err + TINY;
        let bounds = [x.0 - e, x.1 + e, y.0 - e, y.1 + e];
        if bounds.iter().any(|x| x.is_nan()) {
            [f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY]
        } else {
            bounds
        }
    }

    pub fn joined(mut self, next: Self) -> Self {
        self.points.extend(next.points);
        Self { points: self.points, err: self.err.max(next.err), reach: self.reach.max(next.reach) }
    }

    /// Whether a line separates the two hulls, by more than the errors.
    ///
    /// Axes: coordinates, centre to centre, and the normals of all lines through two points of either hull,
    /// which include those of the hulls' edges. Rounding: two products, a sum and the difference of two sums.
    pub fn separated(&self, other: &Self, budget: &Budget) -> bool {
        let cost = self.points.len() + other.points.len();
        let clear = |n: [f64; 2]| {
            budget.spend(cost);
            let along = |p: &[f64; 2]| n[0] * p[0] + n[1] * p[1];
            let (a, b) = (range(self.points.iter().map(along)), range(other.points.iter().map(along)));
            let size = n[0].abs() + n[1].abs();
            let margin = SLACK * (self.err + other.err + 4.0 * U * (self.reach + other.reach)) * size + TINY;
            b.0 - a.1 > margin || a.0 - b.1 > margin
        };
        if clear([1.0, 0.0]) || clear([0.0, 1.0]) {
            return true;
        }
        let centre = |f: &Self| {
            let n = f.points.len() as f64;
            let sum = f.points.iter().fold([0.0; 2], |s, p| [s[0] + p[0], s[1] + p[1]]);
            [sum[0] / n, sum[1] / n]
        };
        if clear(minus(centre(other), centre(self))) {
            return true;
        }
        [self, other].iter().any(|f| {
            let n = f.points.len();
            (0..n).any(|i| {
                (i + 1..n).any(|j| {
                    let e = minus(f.points[j], f.points[i]);
                    clear([-e[1], e[0]])
                })
            })
        })
    }
}
