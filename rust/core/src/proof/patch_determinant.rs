//! det J of a patch on its Bézier pieces, in Bernstein form.
//!
//! Coordinates, weights and knots are scaled once by powers of two, so that nothing that matters is subnormal.

use std::sync::Arc;

use crate::numeric::triangle_sign::{slow_turn, turn};
use crate::proof::determinant_cell::{DeterminantCell, Weight};
use crate::spline::SplinePatch;
use crate::spline::bernstein::{BoundedBernstein, Extraction, U, extract, larger, power_of_two_above};

/// Coordinates are taken to be known within this many units of roundoff of the largest one when a patch corner
/// is called degenerate: an exactly straight corner does not survive being written down.
pub const DATA_ULPS: f64 = 16.0;

/// B_u and B_v on a Bézier piece, by axis and coordinate; those of a rational patch times W².
pub(crate) type Tangents = [[BoundedBernstein; 2]; 2];
/// X, Y and W, and their derivatives along both axes.
type Homogeneous = ([BoundedBernstein; 3], [[BoundedBernstein; 3]; 2]);

/// det J of a patch on its Bézier pieces, prepared once.
pub(crate) struct PatchDeterminant<'a> {
    pub patch: &'a SplinePatch,
    /// Control points scaled by a power of two to magnitude one.
    pub points: Vec<[f64; 2]>,
    /// Weights scaled likewise; empty for a polynomial patch.
    pub weights: Vec<f64>,
    /// Knots in `units`, powers of two.
    pub knots: [Vec<f64>; 2],
    pub units: [f64; 2],
    /// The power of two that `points` are divided by.
    pub size_unit: f64,
    pub values: [Extraction; 2],
    derived: [Extraction; 2],
    /// Largest coordinate.
    size: f64,
    /// What a difference quotient of control points loses at most when coordinates underflow.
    lost: [f64; 2],
}

/// Knots in units of a power of two in which they range over about one, if they are exact there, and the unit.
fn scaled(knots: &[f64]) -> (Vec<f64>, f64) {
    let unit = power_of_two_above(knots[knots.len() - 1] - knots[0]);
    let scaled: Vec<f64> = knots.iter().map(|t| t / unit).collect();
    if scaled.iter().zip(knots).all(|(s, t)| s * unit == *t) { (scaled, unit) } else { (knots.to_vec(), 1.0) }
}

impl<'a> PatchDeterminant<'a> {
    pub fn new(patch: &'a SplinePatch) -> Self {
        let largest = patch.points.iter().flatten().fold(0.0, |m, x| larger(m, x.abs()));
        let unit = power_of_two_above(largest);
        let points = patch.points.iter().map(|p| [p[0] / unit, p[1] / unit]).collect();
        let weights = patch.weights.as_ref().map_or(Vec::new(), |w| {
            let unit = power_of_two_above(w.iter().copied().fold(0.0, larger));
            w.iter().map(|x| x / unit).collect()
        });
        let [(u, unit_u), (v, unit_v)] = [0, 1].map(|d| scaled(&patch.knots[d]));
        let knots = [u, v];
        let degrees = patch.degrees;
        Self {
            patch,
            points,
            weights,
            units: [unit_u, unit_v],
            size_unit: unit,
            values: std::array::from_fn(|d| Extraction::new(&knots[d], degrees[d])),
            derived: std::array::from_fn(|d| {
                Extraction::new(&knots[d][1..knots[d].len() - 1], degrees[d] - 1)
            }),
            size: largest / unit,
            lost: std::array::from_fn(|d| {
                let p = degrees[d];
                let supports = knots[d].windows(p + 1).skip(1).map(|w| w[p] - w[0]);
                let shortest = supports.filter(|h| *h > 0.0).fold(f64::INFINITY, f64::min);
                (p + 1) as f64 * f64::MIN_POSITIVE / shortest
            }),
            knots,
        }
    }

    pub fn spans(&self, axis: usize) -> usize {
        self.values[axis].first.len()
    }

    /// The Bézier piece of det J on a span pair, oriented by `sign`.
    pub fn piece(&self, at: [usize; 2], sign: f64) -> DeterminantCell {
        if self.weights.is_empty() {
            self.polynomial(at, sign, &self.slopes(at))
        } else {
            self.rational(at, sign, self.homogeneous(at))
        }
    }

    /// [`Self::piece`] and the tangents there.
    pub fn piece_and_tangents(&self, at: [usize; 2], sign: f64) -> (DeterminantCell, Tangents) {
        if self.weights.is_empty() {
            let tangents = self.slopes(at);
            (self.polynomial(at, sign, &tangents), tangents)
        } else {
            let parts = self.homogeneous(at);
            let (h, slopes) = &parts;
            let tangents = std::array::from_fn(|d| {
                std::array::from_fn(|c| {
                    let terms = [(1.0, &slopes[d][c], &h[2]), (-1.0, &h[c], &slopes[d][2])];
                    BoundedBernstein::sum_of_products(&terms)
                })
            });
            (self.rational(at, sign, parts), tangents)
        }
    }

    fn cell(
        &self,
        at: [usize; 2],
        sign: f64,
        (det, zero): (BoundedBernstein, f64),
        weight: Option<Arc<Weight>>,
    ) -> DeterminantCell {
        let (u, v) = (self.values[0].ends[at[0]], self.values[1].ends[at[1]]);
        let mut patch_corners = 0;
        for corner in 0..4 {
            let ends = [corner >> 1, corner & 1];
            if (0..2).all(|d| at[d] == if ends[d] == 0 { 0 } else { self.spans(d) - 1 }) {
                patch_corners |= 1 << corner;
            }
        }
        let bounds = [u[0], u[1], v[0], v[1]];
        let corner_tolerance = det.err + zero;
        let corner_values = std::array::from_fn(|corner| match patch_corners >> corner & 1 {
            1 => self.corner_value(corner, sign),
            _ => None,
        });
        DeterminantCell { det, bounds, patch_corners, corner_tolerance, corner_values, weight }
    }

    /// det J (times W³) at a patch corner, of the right sign: a positive multiple of the area of the triangle of the
    /// corner's control point and its two neighbours. None where knots or weights are so far apart that it underflows.
    fn corner_value(&self, corner: usize, sign: f64) -> Option<f64> {
        let [m, n] = self.patch.shape;
        let (i, beside_i) = if corner >> 1 == 0 { (0, 1) } else { (m - 1, m - 2) };
        let (j, beside_j) = if corner & 1 == 0 { (0, 1) } else { (n - 1, n - 2) };
        let triangle = [(beside_i, j), (i, beside_j), (i, j)].map(|(i, j)| i * n + j);
        let area = turn(triangle.map(|k| self.points[k])).unwrap_or_else(|| {
            // Of the points as they are stored: scaled ones may have lost digits.
            slow_turn(triangle.map(|k| self.patch.points[k]))
        });
        // Along u and v inwards, which turns the sense at two of the corners.
        let inwards = if (corner >> 1) == (corner & 1) { sign } else { -sign };
        let speeds = [(0, corner >> 1), (1, corner & 1)].map(|(d, end)| {
            let (p, t) = (self.patch.degrees[d], &self.knots[d]);
            let h = if end == 0 { t[p + 1] - t[1] } else { t[t.len() - 2] - t[t.len() - 2 - p] };
            p as f64 / h
        });
        let weights = triangle.iter().filter_map(|&k| self.weights.get(k)).product::<f64>();
        let value = area * inwards * speeds[0] * speeds[1] * weights;
        (value != 0.0 || area == 0.0).then_some(value)
    }

    /// B_u and B_v of a polynomial patch.
    fn slopes(&self, at: [usize; 2]) -> Tangents {
        let width = self.patch.shape[1];
        let slope = |axis: usize, c: usize| {
            let (eu, ev) = if axis == 0 {
                (&self.derived[0], &self.values[1])
            } else {
                (&self.values[0], &self.derived[1])
            };
            let (i0, j0) = (eu.first[at[0]], ev.first[at[1]]);
            let p = self.patch.degrees[axis];
            let (knots, step) = (&self.knots[axis], if axis == 0 { width } else { 1 });
            // A difference of points and one of knots, a product and a quotient.
            extract(eu, ev, at, [4.0 * U, self.lost[axis]], |a, b| {
                let (i, j) = (i0 + a, j0 + b);
                let k = if axis == 0 { i } else { j };
                let here = i * width + j;
                let difference = self.points[here + step][c] - self.points[here][c];
                p as f64 * difference / (knots[k + p + 1] - knots[k + 1])
            })
        };
        std::array::from_fn(|axis| std::array::from_fn(|c| slope(axis, c)))
    }

    /// det J, and how much it changes at a patch corner when the coordinates are rounded.
    fn polynomial(&self, at: [usize; 2], sign: f64, tangents: &Tangents) -> DeterminantCell {
        let [[xu, yu], [xv, yv]] = tangents;
        let det = BoundedBernstein::sum_of_products(&[(sign, xu, yv), (-sign, yu, xv)]);
        let (mu, mv) = (xu.magnitude().max(yu.magnitude()), xv.magnitude().max(yv.magnitude()));
        let [du, dv] = self.slope_rounding(at);
        self.cell(at, sign, (det, 2.0 * (du * mv + dv * mu)), None)
    }

    /// Change of the derivatives' Bézier points at an end of the patch when coordinates are rounded.
    fn slope_rounding(&self, at: [usize; 2]) -> [f64; 2] {
        std::array::from_fn(|d| {
            let h = self.values[d].ends[at[d]];
            2.0 * DATA_ULPS * U * self.size * self.patch.degrees[d] as f64 / (h[1] - h[0])
        })
    }

    /// Homogeneous coordinates X, Y, W of a rational patch, and their derivatives.
    fn homogeneous(&self, at: [usize; 2]) -> Homogeneous {
        let width = self.patch.shape[1];
        let [eu, ev] = &self.values;
        let (i0, j0) = (eu.first[at[0]], ev.first[at[1]]);
        // The numerator does not change when (X, Y) moves by a multiple of W; about a control point of the
        // piece itself little is lost to cancellation.
        let origin = self.points[(i0 + eu.degree / 2) * width + j0 + ev.degree / 2];
        let h: [BoundedBernstein; 3] = std::array::from_fn(|c| {
            extract(eu, ev, at, [2.0 * U, 0.0], |a, b| {
                let k = (i0 + a) * width + j0 + b;
                if c == 2 { self.weights[k] } else { self.weights[k] * (self.points[k][c] - origin[c]) }
            })
        });
        let ends = [eu.ends[at[0]], ev.ends[at[1]]];
        let slopes =
            std::array::from_fn(|d| std::array::from_fn(|c| h[c].derivative(d, ends[d][1] - ends[d][0], U)));
        (h, slopes)
    }

    fn rational(&self, at: [usize; 2], sign: f64, (h, slopes): Homogeneous) -> DeterminantCell {
        let width = self.patch.shape[1];
        let [eu, ev] = &self.values;
        let (i0, j0) = (eu.first[at[0]], ev.first[at[1]]);
        let minor = |a: usize, b: usize| {
            let [u, v] = &slopes;
            BoundedBernstein::sum_of_products(&[(sign, &u[a], &v[b]), (-sign, &u[b], &v[a])])
        };
        let minors = [minor(1, 2), minor(2, 0), minor(0, 1)];
        let terms: [_; 3] = std::array::from_fn(|c| (1.0, &h[c], &minors[c]));
        let det = BoundedBernstein::sum_of_products(&terms);

        let size = |b: &[BoundedBernstein; 3]| (b[0].magnitude().max(b[1].magnitude()), b[2].magnitude());
        let ((m, w), (mu, wu), (mv, wv)) = (size(&h), size(&slopes[0]), size(&slopes[1]));
        let [du, dv] = self.slope_rounding(at).map(|d| d * w);
        let d0 = DATA_ULPS * U * self.size * w;
        let zero = 2.0 * (d0 * (mu * wv + mv * wu) + du * (m * wv + mv * w) + dv * (m * wu + mu * w));

        let [_, _, polynomial] = h;
        let rows = (0..=eu.degree).map(|a| (i0 + a) * width + j0);
        let weights = rows.flat_map(|k| &self.weights[k..=k + ev.degree]);
        let (low, high) =
            weights.fold((f64::INFINITY, 0.0), |(lo, hi), &w| (f64::min(lo, w), f64::max(hi, w)));
        let (u, v) = (eu.ends[at[0]], ev.ends[at[1]]);
        let bounds = [u[0], u[1], v[0], v[1]];
        let weight = Arc::new(Weight { polynomial, bounds, low, high });
        self.cell(at, sign, (det, zero), Some(weight))
    }
}
