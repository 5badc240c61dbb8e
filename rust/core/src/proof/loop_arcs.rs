//! Bézier arcs of closed loops and their tangents, with bounds on their rounding.
//!
//! Coordinates are scaled once to magnitude one (`frame_of`), weights of a curve likewise.

use std::sync::LazyLock;

use crate::proof::hull::{Hull, cross, minus, range};
use crate::spline::SplineCurve;
use crate::spline::bernstein::{
    BoundedBernstein, Extraction, SLACK, TINY, U, extract, larger, power_of_two_above,
};

/// A point of a loop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Index of the loop.
    pub loop_index: usize,
    /// Index of the curve in the loop.
    pub curve: usize,
    /// Parameter on the curve.
    pub t: f64,
}

/// A point in the middle of all control points and a power of two above their distance from it.
pub(crate) fn frame_of(loops: &[Vec<SplineCurve>]) -> ([f64; 2], f64) {
    let points = || loops.iter().flatten().flat_map(|c| &c.points);
    let origin: [f64; 2] = std::array::from_fn(|d| {
        let (lo, hi) = range(points().map(|p| p[d]));
        0.5 * lo + 0.5 * hi
    });
    let size = points().map(|&p| minus(p, origin)).fold(0.0, |m, p| f64::max(m, p[0].abs().max(p[1].abs())));
    (origin, power_of_two_above(size))
}

/// A Bézier arc in homogeneous coordinates; the third one is exactly 1 on a polynomial arc.
#[derive(Clone, Debug)]
pub(crate) struct Bezier {
    points: Vec<[f64; 3]>,
    err: [f64; 2],
}

impl Bezier {
    fn magnitude(&self) -> (f64, f64) {
        self.points
            .iter()
            .fold((0.0, 0.0), |(m, w), p| (larger(larger(m, p[0].abs()), p[1].abs()), larger(w, p[2])))
    }

    fn with_rounding(points: Vec<[f64; 3]>, before: &Self, steps: f64) -> Self {
        let (m, w) = before.magnitude();
        let after = |err: f64, size: f64| SLACK * (err + steps * U * size) + TINY;
        let weight = if before.is_polynomial() { 0.0 } else { after(before.err[1], w) };
        Self { points, err: [after(before.err[0], m), weight] }
    }

    fn is_polynomial(&self) -> bool {
        self.err[1] == 0.0
    }

    /// The two halves; the middle point is the same bits in both.
    pub fn halve(&self) -> [Self; 2] {
        let n = self.points.len();
        let (mut low, mut high) = (self.points.clone(), self.points.clone());
        for level in 1..n {
            for i in 0..n - level {
                high[i] = std::array::from_fn(|d| 0.5 * (high[i][d] + high[i + 1][d]));
            }
            low[level] = high[0];
        }
        [low, high].map(|points| Self::with_rounding(points, self, n as f64))
    }

    /// The part over [a, b]: the control points are the blossoms at (a, ..., b, ...).
    pub fn restrict(&self, a: f64, b: f64) -> Self {
        let n = self.points.len();
        let blossom = |ends: usize| {
            let mut c = self.points.clone();
            for level in 1..n {
                let x = if level <= ends { b } else { a };
                for i in 0..n - level {
                    let w = |d: usize| {
                        if d == 2 && self.is_polynomial() {
                            1.0
                        } else {
                            (1.0 - x) * c[i][d] + x * c[i + 1][d]
                        }
                    };
                    c[i] = [w(0), w(1), w(2)];
                }
            }
            c[0]
        };
        // Four roundings a level.
        Self::with_rounding((0..n).map(blossom).collect(), self, 5.0 * n as f64)
    }

    pub fn hull(&self) -> Hull {
        let points: Vec<[f64; 2]> = self.points.iter().map(|p| [p[0] / p[2], p[1] / p[2]]).collect();
        let reach = points.iter().flatten().fold(0.0, |m, x| larger(m, x.abs()));
        let err = if self.is_polynomial() {
            self.err[0]
        } else {
            let low = self.points.iter().map(|p| p[2]).fold(f64::INFINITY, f64::min) - self.err[1];
            // No bound if the weights are lost in rounding: nothing will be proved then.
            let err = (self.err[0] + reach * self.err[1]) / low + 2.0 * U * reach;
            if low > 0.0 { SLACK * err + TINY } else { f64::INFINITY }
        };
        Hull { points, err, reach }
    }
}

/// Control vectors of an arc's direction of travel, up to a positive factor.
#[derive(Clone, Debug)]
pub(crate) struct Slope {
    vectors: Vec<[f64; 2]>,
    /// Vectors that vanish exactly, because control points coincide.
    zero: Vec<bool>,
    err: f64,
}

impl Slope {
    fn halve(&self) -> [Self; 2] {
        let n = self.vectors.len();
        let (mut low, mut high) = (self.clone(), self.clone());
        for level in 1..n {
            for i in 0..n - level {
                high.vectors[i] =
                    std::array::from_fn(|d| 0.5 * (high.vectors[i][d] + high.vectors[i + 1][d]));
                high.zero[i] &= high.zero[i + 1];
            }
            low.vectors[level] = high.vectors[0];
            low.zero[level] = high.zero[0];
        }
        let err = SLACK * (self.err + n as f64 * U * self.size()) + TINY;
        low.err = err;
        high.err = err;
        [low, high]
    }

    fn size(&self) -> f64 {
        self.vectors.iter().flatten().fold(0.0, |m, x| larger(m, x.abs()))
    }

    /// Whether rounding drowns all vectors: then it does on every part too, and halving is of no use.
    ///
    /// A vector needs one and a half times the error to ascend along itself; with a little more it would take
    /// thousands of parts to find directions in which all do.
    pub fn is_lost(&self) -> bool {
        let felt = self.size() > 4.0 * self.err; // Not so where they are NaN.
        !felt
    }

    /// Whether all vectors that do not vanish have a positive component along `n`, beyond rounding.
    fn ascends(&self, n: [f64; 2]) -> bool {
        self.vectors.iter().zip(&self.zero).all(|(v, &zero)| {
            let margin =
                self.err * (n[0].abs() + n[1].abs()) + 4.0 * U * ((v[0] * n[0]).abs() + (v[1] * n[1]).abs());
            zero || v[0] * n[0] + v[1] * n[1] > SLACK * margin + TINY
        })
    }
}

/// Whether a chain of arcs is monotone in a common direction, proved; then it does not meet itself.
pub(crate) fn monotone(slopes: &[&Slope]) -> bool {
    let vectors = || slopes.iter().flat_map(|s| s.vectors.iter().zip(&s.zero)).filter(|v| !v.1).map(|v| *v.0);
    let unit = |v: [f64; 2]| {
        let length = v[0].hypot(v[1]);
        [v[0] / length, v[1] / length]
    };
    let mean = vectors().map(unit).fold([0.0; 2], |s, v| [s[0] + v[0], s[1] + v[1]]);
    let ascends = |n| slopes.iter().all(|s| s.ascends(n));
    if ascends(mean) {
        return true;
    }
    // Otherwise the bisector of the extreme directions is the best choice.
    let angle = |v: [f64; 2]| cross(mean, v).atan2(mean[0] * v[0] + mean[1] * v[1]);
    let (lo, hi) = range(vectors().map(angle));
    let (sin, cos) = (0.5 * (lo + hi)).sin_cos();
    ascends(unit([mean[0] * cos - mean[1] * sin, mean[0] * sin + mean[1] * cos]))
}

/// An arc of a loop.
#[derive(Clone, Debug)]
pub(crate) struct LoopArc {
    pub bezier: Bezier,
    pub slope: Slope,
    loop_index: usize,
    curve: usize,
    t: [f64; 2],
}

impl LoopArc {
    pub fn halve(self) -> [Self; 2] {
        let middle = 0.5 * (self.t[0] + self.t[1]);
        let ([b0, b1], [s0, s1]) = (self.bezier.halve(), self.slope.halve());
        let arc = |bezier, slope, t| Self { bezier, slope, t, ..self };
        [arc(b0, s0, [self.t[0], middle]), arc(b1, s1, [middle, self.t[1]])]
    }

    /// The place at `s` in [0, 1] of the arc.
    pub fn place(&self, s: f64) -> Place {
        let t = self.t[0] + s * (self.t[1] - self.t[0]);
        Place { loop_index: self.loop_index, curve: self.curve, t }
    }
}

/// Bézier arcs of a closed loop about `origin` in units of `unit`, and the largest gap between its curves.
///
/// Each curve's last control point is taken to be the next one's first. Arcs of no extent are left out.
pub(crate) fn arcs_of_loop(
    loop_index: usize,
    curves: &[SplineCurve],
    origin: [f64; 2],
    unit: f64,
) -> (Vec<LoopArc>, f64) {
    let mut gap: f64 = 0.0;
    let mut arcs: Vec<LoopArc> = Vec::new();
    let mut extractions = None;
    for (index, curve) in curves.iter().enumerate() {
        let next = curves[(index + 1) % curves.len()].points[0];
        let end = curve.points.len() - 1;
        let off = minus(curve.points[end], next);
        gap = gap.max(off[0].hypot(off[1]));
        let mut curve = curve.clone();
        curve.points[end] = next;
        // Only ratios of weights matter; magnitude one keeps products from underflow.
        if let Some(weights) = &mut curve.weights {
            let unit = power_of_two_above(weights.iter().copied().fold(0.0, larger));
            weights.iter_mut().for_each(|w| *w /= unit);
        }
        // Neighbours mostly have the same knots.
        if !(index > 0 && curve.degree == curves[index - 1].degree && curve.knots == curves[index - 1].knots)
        {
            let inner = &curve.knots[1..curve.knots.len() - 1];
            extractions =
                Some((Extraction::new(&curve.knots, curve.degree), Extraction::new(inner, curve.degree - 1)));
        }
        let (values, slopes) = extractions.as_ref().expect("made for the first curve");
        for span in 0..values.first.len() {
            let slope = match curve.weights {
                None => polynomial_slope(&curve, unit, slopes, span),
                Some(_) => rational_slope(&curve, unit, values, span),
            };
            if !slope.zero.iter().all(|z| *z) {
                let bezier = bezier_of(&curve, origin, unit, values, span);
                arcs.push(LoopArc { bezier, slope, loop_index, curve: index, t: values.ends[span] });
            }
        }
    }
    // Neighbouring arcs share the bits of their common point, so that their chords form a closed polygon.
    for i in 0..arcs.len() {
        let next = arcs[(i + 1) % arcs.len()].bezier.points[0];
        let bezier = &mut arcs[i].bezier;
        let last = bezier.points.last_mut().expect("arcs have control points");
        let moved = if last[2] == next[2] { next } else { [0, 1, 2].map(|d| next[d] / next[2] * last[2]) };
        let shift = (0..3).map(|d| (moved[d] - last[d]).abs()).fold(0.0, larger);
        *last = moved;
        bezier.err[0] += SLACK * shift;
        if bezier.err[1] > 0.0 {
            bezier.err[1] += SLACK * shift;
        }
    }
    (arcs, gap)
}

/// The trivial extraction for the second variable of a univariate spline.
static CONSTANT: LazyLock<Extraction> = LazyLock::new(|| Extraction::new(&[0.0, 1.0], 0));

fn bezier_of(curve: &SplineCurve, origin: [f64; 2], unit: f64, values: &Extraction, span: usize) -> Bezier {
    let first = values.first[span];
    let weight = |k: usize| curve.weights.as_ref().map_or(1.0, |w| w[k]);
    let coordinate = |c: usize| {
        extract(values, &CONSTANT, [span, 0], [2.0 * U, 0.0], |a, _| {
            let k = first + a;
            if c == 2 { weight(k) } else { weight(k) * ((curve.points[k][c] - origin[c]) / unit) }
        })
    };
    let (x, y, w) = (coordinate(0), coordinate(1), curve.weights.as_ref().map(|_| coordinate(2)));
    let points =
        (0..=values.degree).map(|i| [x.coefs[i], y.coefs[i], w.as_ref().map_or(1.0, |w| w.coefs[i])]);
    Bezier { points: points.collect(), err: [larger(x.err, y.err), w.as_ref().map_or(0.0, |w| w.err)] }
}

/// Derivative of a polynomial arc by its extraction `slopes`.
fn polynomial_slope(curve: &SplineCurve, unit: f64, slopes: &Extraction, span: usize) -> Slope {
    let (p, knots, points) = (curve.degree, &curve.knots, &curve.points);
    let first = slopes.first[span];
    // Only the direction matters: in units of the last knot span the numbers stay near one.
    let ratio = |a: usize| {
        let k = first + a;
        let h = (knots[k + p + 1] - knots[k + 1]) / (knots[first + p + 1] - knots[first + p]);
        // A subnormal ratio has lost digits: nothing is known then.
        if h >= f64::MIN_POSITIVE { h } else { f64::NAN }
    };
    // What coordinates lose to underflow when they are scaled.
    let absolute = (0..p).map(ratio).fold(0.0, |m, h| larger(m, f64::MIN_POSITIVE / h));
    let [x, y]: [BoundedBernstein; 2] = std::array::from_fn(|c| {
        // Two differences of knots and one of points, two quotients.
        extract(slopes, &CONSTANT, [span, 0], [6.0 * U, absolute], |a, _| {
            let k = first + a;
            (points[k + 1][c] - points[k][c]) / unit / ratio(a)
        })
    });
    let zero = zeros(slopes, span, |a| points[first + a] == points[first + a + 1]);
    let err = larger(x.err, y.err);
    Slope { vectors: x.coefs.into_iter().zip(y.coefs).map(|(x, y)| [x, y]).collect(), zero, err }
}

/// Extracted vectors that only vanishing ones contribute to.
fn zeros(e: &Extraction, span: usize, vanishes: impl Fn(usize) -> bool) -> Vec<bool> {
    let rows = e.matrix(span).chunks_exact(e.degree + 1);
    rows.map(|row| row.iter().enumerate().all(|(a, &w)| w == 0.0 || vanishes(a))).collect()
}

/// Numerator X'W - XW' of a rational arc's derivative, about a control point of the arc itself.
fn rational_slope(curve: &SplineCurve, unit: f64, values: &Extraction, span: usize) -> Slope {
    let (p, first, points) = (values.degree, values.first[span], &curve.points);
    let weights = curve.weights.as_ref().expect("a rational curve");
    let origin = points[first + p / 2];
    let h: [BoundedBernstein; 3] = std::array::from_fn(|c| {
        extract(values, &CONSTANT, [span, 0], [2.0 * U, 0.0], |a, _| {
            let k = first + a;
            if c == 2 { weights[k] } else { weights[k] * ((points[k][c] - origin[c]) / unit) }
        })
    });
    let slopes = [0, 1, 2].map(|c| h[c].derivative(0, 1.0, 0.0));
    let [x, y] = [0, 1]
        .map(|c| BoundedBernstein::sum_of_products(&[(1.0, &slopes[c], &h[2]), (-1.0, &h[c], &slopes[2])]));
    let err = larger(x.err, y.err);
    let vectors: Vec<[f64; 2]> = x.coefs.into_iter().zip(y.coefs).map(|(x, y)| [x, y]).collect();
    let mut zero = vec![(0..=p).all(|a| points[first + a] == points[first]); vectors.len()];
    // At the clamped ends of the curve the end vectors are multiples of the control polygon's.
    zero[0] |= span == 0 && points[0] == points[1];
    let end = points.len() - 1;
    *zero.last_mut().expect("degree at least one") |=
        span + 1 == values.first.len() && points[end] == points[end - 1];
    Slope { vectors, zero, err }
}
