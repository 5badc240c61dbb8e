//! How far a map between two models of one layout is from a conformal map: its largest dilatation, enclosed.
//!
//! With tangents `S_u, S_v` and `T_u, T_v` as complex numbers the map f = T ∘ S⁻¹ has the Beltrami coefficient of modulus
//! |μ| = |P|/|Q|, P = S_u T_v - S_v T_u, Q = T_u S̄_v - T_v S̄_u, and the dilatation D = (1 + |μ|)/(1 - |μ|), the ratio of its
//! singular values; |Q|² - |P|² is four times the product of the determinants. The ratio |Q|²/|P|² loses nothing where
//! f is nearly conformal, as cosh log D = (|Q|² + |P|²)/(|Q|² - |P|²) would.

use crate::numeric::quadrature::gauss;
use crate::proof::bounded_ratio::{Corner, Quotient, Search, bounded_minima};
use crate::proof::determinant_cell::DeterminantCell;
use crate::proof::patch_determinant::{PatchDeterminant, Tangents};
use crate::proof::proved_quality::{Bounds, ROUGH, in_own_knots, longest, zero_corners};
use crate::spline::SplinePatch;
use crate::spline::bernstein::{self, BoundedBernstein, U};

/// Degrees up to this are compared, of two polynomial patches and where one is rational: |P|² has 4p - 2 and 8p - 2.
pub const MAX_DEGREES: [usize; 2] = [(bernstein::MAX_DEGREE + 2) / 4, (bernstein::MAX_DEGREE + 2) / 8];
/// Gauss points of a knot span in each direction.
pub const NODES: usize = 5;

/// What is proved of the map between two models, and its samples.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// Of the largest log D, the lower bound a value at `at`.
    pub log_dilatation: Bounds,
    /// Of the smallest and the largest log(det J_T / det J_S), values at `at`.
    pub size: [Bounds; 2],
    /// Cells looked at beyond the Bézier pieces.
    pub cells: usize,
    /// log D at [`NODES`]² Gauss points of every knot span.
    pub samples: Vec<f64>,
}

/// A patch of both models.
struct Pair<'a> {
    number: usize,
    models: [PatchDeterminant<'a>; 2],
    signs: [f64; 2],
    /// Whether the two have different hands: the map turns the plane over.
    mirrored: bool,
}

impl<'a> Pair<'a> {
    fn new(models: [&'a [SplinePatch]; 2], signs: [&[f64]; 2], number: usize) -> Self {
        let signs = signs.map(|s| s[number]);
        Self {
            number,
            models: models.map(|m| PatchDeterminant::new(&m[number])),
            signs,
            mirrored: signs[0] != signs[1],
        }
    }

    fn pieces(&self) -> impl Iterator<Item = [usize; 2]> + use<> {
        let [m, n] = [0, 1].map(|d| self.models[0].spans(d));
        (0..m).flat_map(move |i| (0..n).map(move |j| [i, j]))
    }

    /// Take |Q|²/|P|² and the quotients of the determinants either way into account, those of the second model times
    /// `factor`.
    fn examine(
        &self,
        [s, t]: [&DeterminantCell; 2],
        tangents: [&Tangents; 2],
        factor: f64,
        search: &mut Search<3>,
    ) {
        let corners = [zero_corners(s), zero_corners(t)];
        let either = std::array::from_fn(|c| match (corners[0][c], corners[1][c]) {
            (Corner::Ordinary, other) | (other, Corner::Ordinary) => other,
            (Corner::Zero, Corner::Zero) => Corner::Zero,
            _ => Corner::Tiny,
        });
        let cell = |above, below, corners, floor| Quotient {
            above,
            below,
            patch: self.number,
            bounds: s.bounds,
            corners,
            floor,
            depth: 0,
        };
        let [det_s, det_t] = determinants(s, t);
        let det_t = det_t.times_power(factor);
        search.look_at(1, cell(det_t.clone(), det_s.clone(), corners[1], 0.0));
        search.look_at(2, cell(det_s, det_t, corners[0], 0.0));
        let p = if self.mirrored { conformal(tangents) } else { beltrami(tangents) };
        if search.may_improve(0, rough_bound([s, t], longest(&p))) {
            let q = if self.mirrored { beltrami(tangents) } else { conformal(tangents) };
            search.look_at(0, cell(square(&q), square(&p), either, 1.0));
        }
    }

    /// log D at the Gauss points of a piece.
    fn sample(&self, [a, b]: [&Tangents; 2], bases: &[Basis], samples: &mut Vec<f64>) {
        let values = |t: &Tangents| {
            t.each_ref().map(|t| t.each_ref().map(|x| x.grid(&bases[x.degrees[0]], &bases[x.degrees[1]])))
        };
        let (a, b) = (values(a), values(b));
        let at = |t: &[[Vec<f64>; 2]; 2], k: usize| t.each_ref().map(|x| x.each_ref().map(|c| c[k]));
        samples.extend((0..NODES * NODES).map(|k| log_dilatation(at(&a, k), at(&b, k), self.mirrored)));
    }
}

/// Bernstein polynomials of a degree at the Gauss points, a row a point.
type Basis = Vec<Vec<f64>>;

/// Bases of all degrees that tangents of two patches of degrees up to `most` have: of rational ones up to twice that.
fn gauss_bases(most: usize) -> Vec<Basis> {
    let (nodes, _) = gauss(NODES);
    let basis = |degree| nodes.iter().map(|x| bernstein::basis(degree, 0.5 * (1.0 + x))).collect();
    (0..=2 * most).map(basis).collect()
}

/// P of two pairs of tangents.
fn beltrami([s, t]: [&Tangents; 2]) -> [BoundedBernstein; 2] {
    let ([[ax, ay], [bx, by]], [[cx, cy], [dx, dy]]) = (s, t);
    let sum = BoundedBernstein::sum_of_products;
    [
        sum(&[(1.0, ax, dx), (-1.0, ay, dy), (-1.0, bx, cx), (1.0, by, cy)]),
        sum(&[(1.0, ax, dy), (1.0, ay, dx), (-1.0, bx, cy), (-1.0, by, cx)]),
    ]
}

/// Q of two pairs of tangents.
fn conformal([s, t]: [&Tangents; 2]) -> [BoundedBernstein; 2] {
    let ([[ax, ay], [bx, by]], [[cx, cy], [dx, dy]]) = (s, t);
    let sum = BoundedBernstein::sum_of_products;
    [
        sum(&[(1.0, bx, cx), (1.0, by, cy), (-1.0, ax, dx), (-1.0, ay, dy)]),
        sum(&[(1.0, bx, cy), (-1.0, by, cx), (-1.0, ax, dy), (1.0, ay, dx)]),
    ]
}

fn square([re, im]: &[BoundedBernstein; 2]) -> BoundedBernstein {
    BoundedBernstein::sum_of_products(&[(1.0, re, re), (1.0, im, im)])
}

/// A rough lower bound of |Q|²/|P|² = 1 + 4 d_s d_t/|P|², where |P| is at most `largest`.
fn rough_bound(cells: [&DeterminantCell; 2], largest: f64) -> f64 {
    let [s, t] = cells.map(|cell| {
        let low = cell.det.coefs.iter().copied().fold(f64::INFINITY, f64::min) - cell.det.err;
        // Tangents of a rational patch are taken times W², and det J has W³.
        cell.weight.as_ref().map_or(1.0, |weight| weight.low) * low
    });
    if s > 0.0 && t > 0.0 { (1.0 + 4.0 * s * t / (largest * largest)) * ROUGH } else { f64::NAN }
}

/// log D of two pairs of tangents; infinite where the determinants have different signs or vanish.
fn log_dilatation(s: [[f64; 2]; 2], t: [[f64; 2]; 2], mirrored: bool) -> f64 {
    let ([[ax, ay], [bx, by]], [[cx, cy], [dx, dy]]) = (s, t);
    let p = (ax * dx - ay * dy - bx * cx + by * cy).hypot(ax * dy + ay * dx - bx * cy - by * cx);
    let q = (bx * cx + by * cy - ax * dx - ay * dy).hypot(bx * cy - by * cx - ax * dy + ay * dx);
    let (p, q) = if mirrored { (q, p) } else { (p, q) };
    // Near 1 the quotient of the two has lost what makes the determinants positive.
    let dets = (ax * by - ay * bx) * (cx * dy - cy * dx) * if mirrored { -4.0 } else { 4.0 };
    if dets <= 0.0 {
        f64::INFINITY
    } else if p < 0.5 * q {
        2.0 * (p / q).atanh()
    } else {
        2.0 * (p + q).ln() - dets.ln()
    }
}

/// Both determinants over the same factor.
fn determinants(s: &DeterminantCell, t: &DeterminantCell) -> [BoundedBernstein; 2] {
    let product =
        |a: &BoundedBernstein, b: &BoundedBernstein| BoundedBernstein::sum_of_products(&[(1.0, a, b)]);
    let cube = |w: &BoundedBernstein| product(w, &product(w, w));
    // det J has W³ below it; a polynomial patch counts as one with weights 1.
    let lifted =
        |cell: &DeterminantCell, [p, q]: [usize; 2]| product(&BoundedBernstein::one([p, q]), &cell.det);
    match (&s.weight, &t.weight) {
        (None, None) => [s.det.clone(), t.det.clone()],
        (Some(v), Some(w)) => [product(&s.det, &cube(&w.polynomial)), product(&t.det, &cube(&v.polynomial))],
        (Some(v), None) => {
            let degrees = v.polynomial.degrees;
            let ones = BoundedBernstein::one(degrees.map(|d| 3 * d));
            [product(&s.det, &ones), product(&lifted(t, degrees), &cube(&v.polynomial))]
        }
        (None, Some(w)) => {
            let degrees = w.polynomial.degrees;
            let ones = BoundedBernstein::one(degrees.map(|d| 3 * d));
            [product(&lifted(s, degrees), &cube(&w.polynomial)), product(&t.det, &ones)]
        }
    }
}

/// 1/D where |Q|²/|P|² = t: increasing, 0 where the map folds.
fn inverse_dilatation(t: f64) -> f64 {
    if t > 1.0 {
        let modulus = t.sqrt().recip();
        (1.0 - modulus) / (1.0 + modulus)
    } else {
        0.0
    }
}

/// log D where |Q|²/|P|² = t, moved outwards to the side of `sign`.
fn log_of(t: f64, sign: f64) -> f64 {
    if t.is_nan() || t <= 1.0 {
        return f64::INFINITY;
    }
    let modulus = t.sqrt().recip();
    let delta = 2.0 * modulus.atanh();
    // The modulus is rounded twice, which near 1 is multiplied by the dilatation.
    let rounding = 8.0 * U * (delta + modulus / (1.0 - modulus));
    (delta + sign * rounding).max(0.0)
}

/// log(det J_T / det J_S) where their quotient is t in units whose logarithm is `shift`, outwards to the side of `sign`.
fn log_size(t: f64, shift: f64, sign: f64) -> f64 {
    if t <= 0.0 {
        return f64::NEG_INFINITY;
    }
    let log = t.ln();
    log + shift + if log.is_finite() { sign * 8.0 * U * (log.abs() + shift.abs() + 1.0) } else { 0.0 }
}

/// Compare the models `s` and `t` patch by patch, with the signs of their orientations.
///
/// They have the same degrees and knots, degrees at most [`MAX_DEGREES`]. `width` is relative: of D, of the ratio of sizes.
pub fn compare(s: &[SplinePatch], t: &[SplinePatch], signs: [&[f64]; 2], width: f64) -> Comparison {
    let bases = gauss_bases(s.iter().chain(t).flat_map(|p| p.degrees).max().unwrap_or(1));
    let unit = |k: usize| PatchDeterminant::new(&t[k]).size_unit / PatchDeterminant::new(&s[k]).size_unit;
    let common = if s.is_empty() { 1.0 } else { unit(0) };
    let pieces = |k: usize, search: &mut Search<3>| {
        let pair = Pair::new([s, t], signs, k);
        let factor = pair.models[1].size_unit / pair.models[0].size_unit / common;
        let mut samples = Vec::new();
        for at in pair.pieces() {
            let [(s, a), (t, b)] = [0, 1].map(|m| pair.models[m].piece_and_tangents(at, pair.signs[m]));
            pair.examine([&s, &t], [&a, &b], factor * factor, search);
            pair.sample([&a, &b], &bases, &mut samples);
        }
        samples
    };
    let measures = [inverse_dilatation, |t| t, |t| t];
    let (found, cells, samples) = bounded_minima(s.len(), measures, width, pieces);
    let [angle, smallest, largest] = found.map(|enclosure| in_own_knots(enclosure, s));
    let shift = 2.0 * common.ln();
    let size = |low: f64, high: f64, at| Bounds { lower: low, upper: high, at };
    Comparison {
        log_dilatation: Bounds {
            lower: log_of(angle.high, -1.0),
            upper: log_of(angle.low, 1.0),
            at: angle.at,
        },
        size: [
            size(log_size(smallest.low, shift, -1.0), log_size(smallest.high, shift, 1.0), smallest.at),
            size(-log_size(largest.high, -shift, 1.0), -log_size(largest.low, -shift, -1.0), largest.at),
        ],
        cells,
        samples: samples.concat(),
    }
}

#[cfg(test)]
#[path = "dilatation_tests.rs"]
mod tests;
