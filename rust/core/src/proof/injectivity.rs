//! Proof or disproof of `det J > 0` on spline patches, by Bernstein coefficients and subdivision.
//!
//! On a Bézier piece det J is a polynomial; if all its Bernstein coefficients exceed the rounding bound it is
//! positive. Coefficients at the piece's corners are values of det J; one below minus the bound is a disproof.
//! Otherwise the piece is halved in both directions. A rational piece uses the numerator
//! `det[[X, Y, W], [X_u, Y_u, W_u], [X_v, Y_v, W_v]] = W³ det J`.
//!
//! At a patch corner det J is a positive multiple of the area of a triangle of three control points, whose sign is
//! found exactly: where one patch fills a straight angle it may vanish there, but must not be negative.
//!
//! Coordinates, weights and knots are scaled once by powers of two, so that nothing that matters is subnormal.

use std::sync::Arc;

use rayon::prelude::*;

use crate::numeric::triangle_sign::{slow_turn, turn};
use crate::spline::SplinePatch;
use crate::spline::bernstein::{BoundedBernstein, Extraction, U, extract, larger, power_of_two_above};

/// Coordinates are taken to be known within this many units of roundoff of the largest one when a patch corner
/// is called degenerate: an exactly straight corner does not survive being written down.
const DATA_ULPS: f64 = 16.0;
/// Coefficients of a cell of degree about five; cells with more are as many fewer.
const COEFFICIENTS: usize = 100;
/// Bytes that the cells of one patch may take: some ten thousand of moderate degree.
const MAX_BYTES: usize = 32 << 20;
/// Cells of one kind reported for a patch, the worst ones.
const REPORTED: usize = 32;

/// How far the proof goes before it gives up.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Halvings of a Bézier piece in each direction.
    pub max_depth: usize,
    /// Sub-cells of moderate degree examined in one patch; fewer of high degree.
    pub max_cells: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self { max_depth: 20, max_cells: 50_000 }
    }
}

impl Limits {
    /// Sub-cells examined in all patches together, some seconds' work; every patch has its share, and this at least.
    const ALL_CELLS: usize = 2_000_000;
    const LEAST_CELLS: usize = 2_000;

    /// One patch's share among `patches`.
    fn shared_by(self, patches: usize) -> Self {
        let share = (Self::ALL_CELLS / patches.max(1)).max(Self::LEAST_CELLS);
        Self { max_cells: self.max_cells.min(share), ..self }
    }

    /// Sub-cells with so many coefficients that may be examined.
    fn cells(&self, coefficients: usize) -> usize {
        self.max_cells * COEFFICIENTS / coefficients.max(COEFFICIENTS)
    }
}

/// What is wrong with a cell; the order is that of precedence.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum CellKind {
    /// det J >= 0, zero within the rounding of the coordinates at one patch corner and positive elsewhere.
    Degenerate,
    /// det J < 0 at a patch corner (or of unknown sign), by no more than the rounding of the coordinates.
    BelowRounding,
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
    /// |det J| up to this is zero at a patch corner within the rounding of the coordinates.
    corner_tolerance: f64,
    /// The coefficients at patch corners again, with the right sign; None elsewhere and where it is not known.
    corner_values: [Option<f64>; 4],
    weight: Option<Arc<Weight>>,
}

enum Verdict {
    Proved,
    Degenerate(usize),
    BelowRounding(usize),
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
        let (mut degenerate, mut below) = (None, false);
        let mut folded: Option<(usize, f64)> = None;
        let mut open = false;
        for (c, &at) in corners.iter().enumerate() {
            let value = self.det.coefs[at];
            if self.patch_corners >> c & 1 == 1 && value.abs() <= self.corner_tolerance.max(err) {
                // Two degenerate corners in one cell: subdivision separates them.
                open |= degenerate.replace(c).is_some();
                below |= !self.corner_values[c].is_some_and(|exact| exact >= 0.0);
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
        if let (Some(c), true, false) = (degenerate, below, open) {
            return Verdict::BelowRounding(c);
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
            corner_values: self.corner_values,
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

    /// det J at a corner.
    fn corner_value(&self, corner: usize) -> f64 {
        self.over_weight(corner, self.det.coefs[self.corner_coefficient(corner)])
    }

    /// det J = coefficient / W³ at a corner.
    fn over_weight(&self, corner: usize, coefficient: f64) -> f64 {
        match &self.weight {
            None => coefficient,
            Some(w) => {
                let (p, [u0, u1, v0, v1]) = (self.corner_point(corner), w.bounds);
                coefficient / w.polynomial.value((p[0] - u0) / (u1 - u0), (p[1] - v0) / (v1 - v0)).powi(3)
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

    /// Bound on the error of a polynomial cell's integral; that of a rational one is a quadrature.
    fn uncertainty(&self) -> f64 {
        let [u0, u1, v0, v1] = self.bounds;
        let count = self.det.coefs.len() as f64;
        (self.det.err + count * U * self.det.magnitude()) * (u1 - u0) * (v1 - v0)
    }

    /// The cell in the patch's own parameters, whose units are `units`.
    fn report(&self, kind: CellKind, corner: usize, scale: f64, units: [f64; 2]) -> Cell {
        let exact = self.corner_values[corner].filter(|_| kind == CellKind::BelowRounding);
        let value = exact.map_or_else(|| self.corner_value(corner), |x| self.over_weight(corner, x)) / scale;
        let [u, v] = self.corner_point(corner);
        let bounds = std::array::from_fn(|k| self.bounds[k] * units[k / 2]);
        Cell { kind, bounds, point: [u * units[0], v * units[1]], value }
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
    /// Knots in `units`, powers of two.
    knots: [Vec<f64>; 2],
    units: [f64; 2],
    values: [Extraction; 2],
    slopes: [Extraction; 2],
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

impl<'a> Jacobian<'a> {
    fn new(patch: &'a SplinePatch) -> Self {
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
            values: std::array::from_fn(|d| Extraction::new(&knots[d], degrees[d])),
            slopes: std::array::from_fn(|d| {
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
        let corner_values = std::array::from_fn(|corner| match patch_corners >> corner & 1 {
            1 => self.corner_value(corner, sign),
            _ => None,
        });
        Work { det, bounds, patch_corners, corner_tolerance, corner_values, weight }
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
            extract(eu, ev, at, [2.0 * U, 0.0], |a, b| {
                let k = (i0 + a) * width + j0 + b;
                if c == 2 { self.weights[k] } else { self.weights[k] * (self.points[k][c] - origin[c]) }
            })
        });
        let ends = [eu.ends[at[0]], ev.ends[at[1]]];
        let slopes: [[BoundedBernstein; 3]; 2] =
            std::array::from_fn(|d| std::array::from_fn(|c| h[c].derivative(d, ends[d][1] - ends[d][0], U)));
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
    /// Bound on the error of the integral.
    uncertain: f64,
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
            row.largest = larger(row.largest, work.det.magnitude() + work.det.err);
            row.uncertain += work.uncertainty();
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
    let opposite = total < 0.0;
    let sign_agrees = !opposite;
    if opposite {
        rows = examine(&jacobian, -sign);
        total = rows.iter().map(|r| r.integral).sum();
    }
    let domain: f64 = jacobian.knots.iter().map(|k| k[k.len() - 1] - k[0]).product();
    let largest = rows.iter().map(|r| r.largest).fold(0.0, larger);
    let mean = total / domain;
    // A patch without area has no mean; its values are then relative to the largest coefficient.
    let scale = if mean > 1e-14 * largest { mean } else { largest.max(f64::MIN_POSITIVE) };
    // A positive bound holds relative to the largest mean that rounding allows.
    let pieces = jacobian.spans(0) * jacobian.spans(1);
    let off = rows.iter().map(|r| r.uncertain).sum::<f64>() / domain + (pieces + 64) as f64 * U * largest;
    let relative = |low: f64| if low > 0.0 { low / (scale + off) * (1.0 - 4.0 * U) } else { low / scale };
    let report = |work: &Work, kind, corner| work.report(kind, corner, scale, jacobian.units);
    let mut low = rows.iter().map(|r| r.low).fold(f64::INFINITY, f64::min);
    let mut queue: Vec<Work> = rows.into_iter().flat_map(|r| r.open).collect();
    let mut cells = Vec::new();
    let mut subdivisions = 0;
    for depth in 0.. {
        let mut next = Vec::new();
        for work in queue {
            let size = work.det.coefs.len();
            let fits = subdivisions < limits.cells(size) && next.len() * size * size_of::<f64>() < MAX_BYTES;
            match work.judge() {
                Verdict::Proved => low = low.min(work.lower_bound()),
                Verdict::Degenerate(c) => {
                    low = low.min(0.0);
                    cells.push(report(&work, CellKind::Degenerate, c));
                }
                Verdict::BelowRounding(c) => {
                    low = low.min(work.lower_bound());
                    cells.push(report(&work, CellKind::BelowRounding, c));
                }
                Verdict::Folded(c) => {
                    low = low.min(work.lower_bound());
                    cells.push(report(&work, CellKind::Folded, c));
                }
                Verdict::Open if depth < limits.max_depth && fits => {
                    subdivisions += 4;
                    next.extend(work.halve());
                }
                Verdict::Open => {
                    low = low.min(work.lower_bound());
                    let corner = (0..4)
                        .min_by(|&a, &b| work.corner_value(a).total_cmp(&work.corner_value(b)))
                        .expect("four corners");
                    cells.push(report(&work, CellKind::Undecided, corner));
                }
            }
        }
        if next.is_empty() {
            break;
        }
        queue = next;
    }
    PatchProof { lower_bound: relative(low), sign_agrees, cells: worst(cells), subdivisions }
}

/// The worst cells of each kind, folded ones first.
fn worst(mut cells: Vec<Cell>) -> Vec<Cell> {
    cells.sort_by(|a, b| b.kind.cmp(&a.kind).then(a.value.total_cmp(&b.value)));
    let mut seen = [0; 4];
    cells.retain(|cell| {
        let count = &mut seen[cell.kind as usize];
        *count += 1;
        *count <= REPORTED
    });
    cells
}

/// [`certify_patch`] for several patches at once; the result does not depend on the number of threads.
pub fn certify_patches(patches: &[SplinePatch], signs: &[f64], limits: &Limits) -> Vec<PatchProof> {
    let limits = limits.shared_by(patches.len());
    patches.par_iter().zip(signs).map(|(patch, &sign)| certify_patch(patch, sign, &limits)).collect()
}

#[cfg(test)]
#[path = "injectivity_tests.rs"]
mod tests;
