//! Proof or disproof of `det J > 0` on spline patches, by Bernstein coefficients and subdivision.
//!
//! On a Bézier piece det J is a polynomial; if all its Bernstein coefficients exceed the rounding bound it is
//! positive. Coefficients at the piece's corners are values of det J; one below minus the bound is a disproof.
//! Otherwise the piece is halved in both directions. A rational piece uses the numerator
//! `det[[X, Y, W], [X_u, Y_u, W_u], [X_v, Y_v, W_v]] = W³ det J`.

use std::sync::Arc;

use rayon::prelude::*;

use crate::bernstein::{BoundedBernstein, Extraction, U, extract, knot_uncertainty};
use crate::spline::SplinePatch;

/// Coordinates are taken to be known within this many units of roundoff of the largest one when a patch corner
/// is called degenerate: an exactly straight corner does not survive being written down.
const DATA_ULPS: f64 = 16.0;
/// Cells of one kind reported for a patch, the worst ones.
const REPORTED: usize = 32;

/// How far the proof goes before it gives up.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Halvings of a Bézier piece in each direction.
    pub max_depth: usize,
    /// Sub-cells examined in one patch.
    pub max_cells: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self { max_depth: 20, max_cells: 50_000 }
    }
}

/// What is wrong with a cell; the order is that of precedence.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum CellKind {
    /// det J vanishes within rounding at one patch corner and is positive elsewhere.
    Degenerate,
    /// Neither proved nor disproved.
    Undecided,
    /// det J < 0 at a point.
    Folded,
}

/// A place where det J > 0 is not proved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// What is wrong.
    pub kind: CellKind,
    /// `[u0, u1, v0, v1]`.
    pub bounds: [f64; 4],
    /// The corner of the cell with the smallest det J (the degenerate one).
    pub point: [f64; 2],
    /// det J there relative to its mean on the patch.
    pub value: f64,
}

/// Outcome for one patch.
#[derive(Clone, Debug, PartialEq)]
pub struct PatchProof {
    /// Proved lower bound of det J relative to its mean; negative where nothing better was proved.
    pub lower_bound: f64,
    /// Whether the sign handed over is that of the patch's area. Otherwise the area's sign was used.
    pub sign_agrees: bool,
    /// Failing or degenerate cells, folded first, the worst of each kind first.
    pub cells: Vec<Cell>,
    /// Number of sub-cells examined beyond the Bézier pieces.
    pub subdivisions: usize,
}

/// Weight polynomial of a rational piece and its extent.
#[derive(Debug)]
struct Weight {
    polynomial: BoundedBernstein,
    bounds: [f64; 4],
    low: f64,
    high: f64,
}

/// A cell under examination.
#[derive(Debug)]
struct Work {
    det: BoundedBernstein,
    bounds: [f64; 4],
    /// Bit `2 i + j`: the corner (u end i, v end j) is a corner of the patch.
    patch_corners: u8,
    /// |det J| up to this is zero at a patch corner.
    corner_tolerance: f64,
    weight: Option<Arc<Weight>>,
}

enum Verdict {
    Proved,
    Degenerate(usize),
    Open,
    Folded(usize),
}

impl Work {
    fn corner_coefficient(&self, corner: usize) -> usize {
        let [m, n] = self.det.degrees;
        (corner >> 1) * m * (n + 1) + (corner & 1) * n
    }

    fn corner_point(&self, corner: usize) -> [f64; 2] {
        [self.bounds[corner >> 1], self.bounds[2 + (corner & 1)]]
    }

    fn judge(&self) -> Verdict {
        let err = self.det.err;
        let corners: [usize; 4] = std::array::from_fn(|c| self.corner_coefficient(c));
        let mut degenerate = None;
        let mut folded: Option<(usize, f64)> = None;
        let mut open = false;
        for (c, &at) in corners.iter().enumerate() {
            let value = self.det.coefs[at];
            if self.patch_corners >> c & 1 == 1 && value.abs() <= self.corner_tolerance.max(err) {
                // Two degenerate corners in one cell: subdivision separates them.
                open |= degenerate.replace(c).is_some();
            } else if value < -err {
                if folded.is_none_or(|(_, worst)| value < worst) {
                    folded = Some((c, value));
                }
            } else {
                open |= value.is_nan() || value <= err;
            }
        }
        if let Some((c, _)) = folded {
            return Verdict::Folded(c);
        }
        let proved = |(i, v): (usize, &f64)| *v > err || corners.contains(&i);
        if open || !self.det.coefs.iter().enumerate().all(proved) {
            return Verdict::Open;
        }
        degenerate.map_or(Verdict::Proved, Verdict::Degenerate)
    }

    fn halve(&self) -> [Self; 4] {
        let [u0, u1, v0, v1] = self.bounds;
        let (u, v) = (0.5 * (u0 + u1), 0.5 * (v0 + v1));
        let [low, high] = self.det.halve(0);
        let ([a, b], [c, d]) = (low.halve(1), high.halve(1));
        let child = |det, corner: usize| Self {
            det,
            bounds: [[u0, u][corner >> 1], [u, u1][corner >> 1], [v0, v][corner & 1], [v, v1][corner & 1]],
            patch_corners: self.patch_corners & (1 << corner),
            corner_tolerance: self.corner_tolerance,
            weight: self.weight.clone(),
        };
        [child(a, 0), child(b, 1), child(c, 2), child(d, 3)]
    }

    /// Proved lower bound of det J on the cell.
    fn lower_bound(&self) -> f64 {
        let low = self.det.coefs.iter().copied().fold(f64::INFINITY, f64::min) - self.det.err;
        match &self.weight {
            None => low,
            Some(w) => low / (if low > 0.0 { w.high } else { w.low }).powi(3),
        }
    }

    /// det J = coefficient / W³ at a corner.
    fn corner_value(&self, corner: usize) -> f64 {
        let value = self.det.coefs[self.corner_coefficient(corner)];
        match &self.weight {
            None => value,
            Some(w) => {
                let (p, [u0, u1, v0, v1]) = (self.corner_point(corner), w.bounds);
                value / w.polynomial.value((p[0] - u0) / (u1 - u0), (p[1] - v0) / (v1 - v0)).powi(3)
            }
        }
    }

    /// ∫ det J over the cell; by quadrature on a rational one.
    fn integral(&self) -> f64 {
        let [u0, u1, v0, v1] = self.bounds;
        let mean = match &self.weight {
            None => self.det.coefs.iter().sum::<f64>() / self.det.coefs.len() as f64,
            Some(w) => {
                let nodes = GAUSS.iter().flat_map(|s| GAUSS.iter().map(move |t| (s, t)));
                nodes
                    .map(|(&(s, ws), &(t, wt))| {
                        ws * wt * self.det.value(s, t) / w.polynomial.value(s, t).powi(3)
                    })
                    .sum()
            }
        };
        mean * (u1 - u0) * (v1 - v0)
    }

    fn report(&self, kind: CellKind, corner: usize, scale: f64) -> Cell {
        let value = self.corner_value(corner) / scale;
        Cell { kind, bounds: self.bounds, point: self.corner_point(corner), value }
    }
}

/// Gauss–Legendre nodes and weights on [0, 1].
const GAUSS: [(f64, f64); 4] = [
    (0.069_431_844_202_973_71, 0.173_927_422_568_726_93),
    (0.330_009_478_207_571_87, 0.326_072_577_431_273_07),
    (0.669_990_521_792_428_1, 0.326_072_577_431_273_07),
    (0.930_568_155_797_026_3, 0.173_927_422_568_726_93),
];

/// det J of a patch on its Bézier pieces, prepared once.
struct Jacobian<'a> {
    patch: &'a SplinePatch,
    /// Control points scaled by a power of two to magnitude one.
    points: Vec<[f64; 2]>,
    /// Weights scaled likewise; empty for a polynomial patch.
    weights: Vec<f64>,
    values: [Extraction; 2],
    slopes: [Extraction; 2],
    relative: [f64; 2],
    /// Largest coordinate.
    size: f64,
}

fn power_of_two_above(x: f64) -> f64 {
    if x > 0.0 { x.log2().ceil().clamp(-1000.0, 1000.0).exp2() } else { 1.0 }
}

impl<'a> Jacobian<'a> {
    fn new(patch: &'a SplinePatch) -> Self {
        let largest = patch.points.iter().flatten().fold(0.0, |m, x| f64::max(m, x.abs()));
        let unit = power_of_two_above(largest);
        let points = patch.points.iter().map(|p| [p[0] / unit, p[1] / unit]).collect();
        let weights = patch.weights.as_ref().map_or(Vec::new(), |w| {
            let unit = power_of_two_above(w.iter().copied().fold(0.0, f64::max));
            w.iter().map(|x| x / unit).collect()
        });
        let knots = &patch.knots;
        Self {
            patch,
            points,
            weights,
            values: std::array::from_fn(|d| Extraction::new(&knots[d], patch.degrees[d])),
            slopes: std::array::from_fn(|d| {
                Extraction::new(&knots[d][1..knots[d].len() - 1], patch.degrees[d] - 1)
            }),
            relative: std::array::from_fn(|d| 4.0 * U + knot_uncertainty(&knots[d])),
            size: largest / unit,
        }
    }

    fn spans(&self, axis: usize) -> usize {
        self.values[axis].first.len()
    }

    /// The Bézier piece of det J on a span pair, oriented by `sign`.
    fn piece(&self, at: [usize; 2], sign: f64) -> Work {
        let (u, v) = (self.values[0].ends[at[0]], self.values[1].ends[at[1]]);
        let mut patch_corners = 0;
        for corner in 0..4 {
            let ends = [corner >> 1, corner & 1];
            if (0..2).all(|d| at[d] == if ends[d] == 0 { 0 } else { self.spans(d) - 1 }) {
                patch_corners |= 1 << corner;
            }
        }
        let bounds = [u[0], u[1], v[0], v[1]];
        let (det, zero, weight) = if self.weights.is_empty() {
            let (det, zero) = self.polynomial(at, sign);
            (det, zero, None)
        } else {
            self.rational(at, sign)
        };
        let corner_tolerance = det.err + zero;
        Work { det, bounds, patch_corners, corner_tolerance, weight }
    }

    /// det J and how much it changes at a patch corner when the coordinates are rounded.
    fn polynomial(&self, at: [usize; 2], sign: f64) -> (BoundedBernstein, f64) {
        let width = self.patch.shape[1];
        let slope = |axis: usize, c: usize| {
            let (eu, ev) = if axis == 0 {
                (&self.slopes[0], &self.values[1])
            } else {
                (&self.values[0], &self.slopes[1])
            };
            let (i0, j0) = (eu.first[at[0]], ev.first[at[1]]);
            let p = self.patch.degrees[axis];
            let (knots, step) = (&self.patch.knots[axis], if axis == 0 { width } else { 1 });
            extract(eu, ev, at, self.relative[axis], |a, b| {
                let (i, j) = (i0 + a, j0 + b);
                let k = if axis == 0 { i } else { j };
                let here = i * width + j;
                let difference = self.points[here + step][c] - self.points[here][c];
                p as f64 * difference / (knots[k + p + 1] - knots[k + 1])
            })
        };
        let (xu, yu, xv, yv) = (slope(0, 0), slope(0, 1), slope(1, 0), slope(1, 1));
        let det = BoundedBernstein::sum_of_products(&[(sign, &xu, &yv), (-sign, &yu, &xv)]);
        let (mu, mv) = (xu.magnitude().max(yu.magnitude()), xv.magnitude().max(yv.magnitude()));
        let [du, dv] = self.slope_rounding(at);
        (det, 2.0 * (du * mv + dv * mu))
    }

    /// Change of the derivatives' Bézier points at an end of the patch when coordinates are rounded.
    fn slope_rounding(&self, at: [usize; 2]) -> [f64; 2] {
        std::array::from_fn(|d| {
            let h = self.values[d].ends[at[d]];
            2.0 * DATA_ULPS * U * self.size * self.patch.degrees[d] as f64 / (h[1] - h[0])
        })
    }

    fn rational(&self, at: [usize; 2], sign: f64) -> (BoundedBernstein, f64, Option<Arc<Weight>>) {
        let width = self.patch.shape[1];
        let [eu, ev] = &self.values;
        let (i0, j0) = (eu.first[at[0]], ev.first[at[1]]);
        // The numerator does not change when (X, Y) moves by a multiple of W; about a control point of the
        // piece itself little is lost to cancellation.
        let origin = self.points[(i0 + eu.degree / 2) * width + j0 + ev.degree / 2];
        let h: [BoundedBernstein; 3] = std::array::from_fn(|c| {
            extract(eu, ev, at, 2.0 * U, |a, b| {
                let k = (i0 + a) * width + j0 + b;
                if c == 2 { self.weights[k] } else { self.weights[k] * (self.points[k][c] - origin[c]) }
            })
        });
        let ends = [eu.ends[at[0]], ev.ends[at[1]]];
        let slopes: [[BoundedBernstein; 3]; 2] = std::array::from_fn(|d| {
            let relative = U + knot_uncertainty(&self.patch.knots[d]);
            std::array::from_fn(|c| h[c].derivative(d, ends[d][1] - ends[d][0], relative))
        });
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

        let polynomial = h.into_iter().nth(2).expect("three components");
        let rows = (0..=eu.degree).map(|a| (i0 + a) * width + j0);
        let weights = rows.flat_map(|k| &self.weights[k..=k + ev.degree]);
        let (low, high) =
            weights.fold((f64::INFINITY, 0.0), |(lo, hi), &w| (f64::min(lo, w), f64::max(hi, w)));
        let bounds = [ends[0][0], ends[0][1], ends[1][0], ends[1][1]];
        (det, zero, Some(Arc::new(Weight { polynomial, bounds, low, high })))
    }
}

/// What a row of Bézier pieces left over.
#[derive(Default)]
struct Row {
    integral: f64,
    low: f64,
    largest: f64,
    open: Vec<Work>,
}

fn examine(jacobian: &Jacobian<'_>, sign: f64) -> Vec<Row> {
    let row = |i: usize| {
        let mut row = Row { low: f64::INFINITY, ..Row::default() };
        for j in 0..jacobian.spans(1) {
            let work = jacobian.piece([i, j], sign);
            row.integral += work.integral();
            row.largest = row.largest.max(work.det.magnitude() + work.det.err);
            if matches!(work.judge(), Verdict::Proved) {
                row.low = row.low.min(work.lower_bound());
            } else {
                row.open.push(work);
            }
        }
        row
    };
    (0..jacobian.spans(0)).into_par_iter().with_min_len(4).map(row).collect()
}

/// Prove or disprove `sign · det J > 0` on a patch.
///
/// Degrees must not exceed 19 (the products' binomials are exact up to degree 56).
pub fn certify_patch(patch: &SplinePatch, sign: f64, limits: &Limits) -> PatchProof {
    let jacobian = Jacobian::new(patch);
    let mut rows = examine(&jacobian, sign);
    let mut total: f64 = rows.iter().map(|r| r.integral).sum();
    let sign_agrees = total >= 0.0;
    if !sign_agrees {
        rows = examine(&jacobian, -sign);
        total = rows.iter().map(|r| r.integral).sum();
    }
    let domain: f64 = patch.knots.iter().map(|k| k[k.len() - 1] - k[0]).product();
    let largest = rows.iter().map(|r| r.largest).fold(0.0, f64::max);
    let mean = total / domain;
    // A patch without area has no mean; its values are then relative to the largest coefficient.
    let scale = if mean > 1e-14 * largest { mean } else { largest.max(f64::MIN_POSITIVE) };
    let mut low = rows.iter().map(|r| r.low).fold(f64::INFINITY, f64::min);
    let mut queue: Vec<Work> = rows.into_iter().flat_map(|r| r.open).collect();
    let mut cells = Vec::new();
    let mut subdivisions = 0;
    for depth in 0.. {
        let mut next = Vec::new();
        for work in queue {
            let verdict = work.judge();
            let bound = work.lower_bound();
            match verdict {
                Verdict::Proved => {}
                Verdict::Degenerate(c) => cells.push(work.report(CellKind::Degenerate, c, scale)),
                Verdict::Folded(c) => cells.push(work.report(CellKind::Folded, c, scale)),
                Verdict::Open if depth < limits.max_depth && subdivisions < limits.max_cells => {
                    subdivisions += 4;
                    next.extend(work.halve());
                    continue;
                }
                Verdict::Open => {
                    let corner = (0..4)
                        .min_by(|&a, &b| work.corner_value(a).total_cmp(&work.corner_value(b)))
                        .expect("four corners");
                    cells.push(work.report(CellKind::Undecided, corner, scale));
                }
            }
            low = low.min(bound);
        }
        if next.is_empty() {
            break;
        }
        queue = next;
    }
    PatchProof { lower_bound: low / scale, sign_agrees, cells: worst(cells), subdivisions }
}

/// The worst cells of each kind, folded ones first.
fn worst(mut cells: Vec<Cell>) -> Vec<Cell> {
    cells.sort_by(|a, b| b.kind.cmp(&a.kind).then(a.value.total_cmp(&b.value)));
    let mut seen = [0; 3];
    cells.retain(|cell| {
        let count = &mut seen[cell.kind as usize];
        *count += 1;
        *count <= REPORTED
    });
    cells
}

/// [`certify_patch`] for several patches at once; the result does not depend on the number of threads.
pub fn certify_patches(patches: &[SplinePatch], signs: &[f64], limits: &Limits) -> Vec<PatchProof> {
    patches.par_iter().zip(signs).map(|(patch, &sign)| certify_patch(patch, sign, limits)).collect()
}

#[cfg(test)]
#[path = "injectivity_tests.rs"]
mod tests;
