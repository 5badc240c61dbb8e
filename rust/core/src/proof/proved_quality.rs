//! The smallest scaled Jacobian and the largest condition number of spline patches, enclosed.
//!
//! With E, F, G the first fundamental form and d = det J the scaled Jacobian is d/√(EG) = t/√(1 + t²), t = d/|F|, and
//! the condition number (E + G)/d: quotients of polynomials hardly higher in degree than det J (Johnen, Remacle and
//! Geuzaine bound its like: *Geometrical validity of curvilinear finite elements*, J. Comput. Phys. 2013). Tangents of a
//! rational patch are taken times W², which cancels.

use crate::proof::bounded_ratio::{Corner, Enclosure, Quotient, Search, bounded_minima};
use crate::proof::determinant_cell::DeterminantCell;
use crate::proof::patch_determinant::{PatchDeterminant, Tangents};
use crate::spline::SplinePatch;
use crate::spline::bernstein::{self, BoundedBernstein, TINY, U, larger};

/// Degrees up to this are enclosed, of polynomial and of rational patches: E + G has 2p and 4p.
pub const MAX_DEGREES: [usize; 2] = [bernstein::MAX_DEGREE / 2, bernstein::MAX_DEGREE / 4];

/// Proved bounds of a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Not above the number.
    pub lower: f64,
    /// Not below it.
    pub upper: f64,
    /// Patch and parameters where the bound that is a value is taken, if there is one.
    pub at: Option<(usize, [f64; 2])>,
}

/// Smallest scaled Jacobian and largest condition number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProvedQuality {
    /// The upper bound is the value at `at`.
    pub scaled_jacobian: Bounds,
    /// The lower bound is the value at `at`.
    pub condition_number: Bounds,
    /// Cells looked at beyond the Bézier pieces.
    pub cells: usize,
}

/// Enclose the quality of all patches, with the signs of their orientations.
///
/// Without the corners named for each patch (bits 1 and 2: at the end of u, of v): squares of `size` of the knot span
/// there. `width` is relative. Degrees must not exceed [`MAX_DEGREES`].
pub fn prove_quality(
    patches: &[SplinePatch],
    signs: &[f64],
    excluded: &[Vec<usize>],
    size: f64,
    width: f64,
) -> ProvedQuality {
    let pieces = |k: usize, search: &mut Search<2>| {
        let jacobian = PatchDeterminant::new(&patches[k]);
        let left_out = excluded[k].iter().fold(0, |bits, c| bits | 1u8 << (c % 2 * 2 + c / 2));
        for i in 0..jacobian.spans(0) {
            for j in 0..jacobian.spans(1) {
                let (det, tangents) = jacobian.piece_and_tangents([i, j], signs[k]);
                let here = left_out & det.patch_corners;
                let piece = Piece::new(det, tangents, k, jacobian.units);
                for kind in 0..2 {
                    if search.may_improve(kind, piece.at_least(kind)) {
                        let parts = piece.quotient(kind).without_corners(here, size);
                        parts.into_iter().for_each(|part| search.look_at(kind, part));
                    }
                }
            }
        }
    };
    let (found, cells, _) = bounded_minima(patches.len(), [sine_of, |t| t], width, pieces);
    let [angle, condition] = found.map(|enclosure| in_own_knots(enclosure, patches));
    ProvedQuality {
        scaled_jacobian: Bounds {
            lower: outwards(sine_of(angle.low), -1.0).max(-1.0),
            upper: outwards(sine_of(angle.high), 1.0).min(1.0),
            at: angle.at,
        },
        condition_number: Bounds {
            lower: outwards(reciprocal(condition.high), -1.0).max(2.0),
            upper: outwards(reciprocal(condition.low), 1.0),
            at: condition.at,
        },
        cells,
    }
}

/// A Bézier piece whose quotients d/|F| (kind 0) and d/(E + G) (kind 1) are made when they are needed.
struct Piece {
    det: BoundedBernstein,
    tangents: Tangents,
    patch: usize,
    bounds: [f64; 4],
    corners: [Corner; 4],
    /// Of the units of v and u: in those of the parameters E and G are not comparable.
    ratio: f64,
}

impl Piece {
    fn new(cell: DeterminantCell, tangents: Tangents, patch: usize, units: [f64; 2]) -> Self {
        let (corners, bounds) = (zero_corners(&cell), cell.bounds);
        Self { det: times_weight(cell), tangents, patch, bounds, corners, ratio: units[1] / units[0] }
    }

    /// A rough lower bound of a quotient, by the longest tangents; minus infinity where d may vanish.
    fn at_least(&self, kind: usize) -> f64 {
        let low = self.det.coefs.iter().copied().fold(f64::INFINITY, f64::min) - self.det.err;
        if low.is_nan() || low <= 0.0 {
            return f64::NEG_INFINITY;
        }
        let [u, v] = self.tangents.each_ref().map(longest);
        if kind == 1 {
            return ROUGH * low / (u * u * self.ratio + v * v / self.ratio);
        }
        let sine = ROUGH * low / (u * v);
        // The quotient is the tangent of the angle whose sine this is at least.
        if sine < 1.0 { sine / ((1.0 - sine) * (1.0 + sine)).sqrt() } else { f64::NEG_INFINITY }
    }

    fn quotient(&self, kind: usize) -> Quotient {
        let [[xu, yu], [xv, yv]] = &self.tangents;
        let product = BoundedBernstein::sum_of_products;
        let one = BoundedBernstein::one;
        let (above, below) = if kind == 0 {
            (self.det.clone(), product(&[(1.0, xu, xv), (1.0, yu, yv)]))
        } else {
            let e = product(&[(1.0, xu, xu), (1.0, yu, yu)]).times_power(self.ratio);
            let g = product(&[(1.0, xv, xv), (1.0, yv, yv)]).times_power(self.ratio.recip());
            let trace = product(&[(1.0, &one([2, 0]), &e), (1.0, &one([0, 2]), &g)]);
            (product(&[(1.0, &one([1, 1]), &self.det)]), trace)
        };
        let Self { patch, bounds, corners, .. } = *self;
        Quotient { above, below, patch, bounds, corners, floor: 0.0, depth: 0 }
    }
}

/// Covers the rounding of rough bounds, and is far from what they miss.
pub(crate) const ROUGH: f64 = 1.0 - 1e-12;

/// A bound of the length of a tangent, or of the modulus of a complex polynomial, by its coefficients.
pub(crate) fn longest([x, y]: &[BoundedBernstein; 2]) -> f64 {
    let squares = x.coefs.iter().zip(&y.coefs).map(|(x, y)| x * x + y * y);
    squares.fold(0.0, larger).sqrt() + x.err + y.err + TINY
}

/// det J times the factor that two tangents bring along.
pub(crate) fn times_weight(cell: DeterminantCell) -> BoundedBernstein {
    match cell.weight {
        None => cell.det,
        Some(weight) => BoundedBernstein::sum_of_products(&[(1.0, &weight.polynomial, &cell.det)]),
    }
}

/// Patch corners where det J is zero within the rounding of the coordinates, and not below.
pub(crate) fn zero_corners(cell: &DeterminantCell) -> [Corner; 4] {
    std::array::from_fn(|c| {
        let value = cell.corner_coefficient_value(c);
        match cell.corner_values[c] {
            Some(exact) if value.abs() <= cell.corner_tolerance => match exact {
                0.0 => Corner::Zero,
                _ if exact > 0.0 => Corner::Tiny,
                _ => Corner::Ordinary,
            },
            _ => Corner::Ordinary,
        }
    })
}

/// An enclosure in the knots of the patches, which `PatchDeterminant` scales.
pub(crate) fn in_own_knots(found: Enclosure, patches: &[SplinePatch]) -> Enclosure {
    let at = found.at.map(|(k, [u, v])| {
        let units = PatchDeterminant::new(&patches[k]).units;
        (k, [u * units[0], v * units[1]])
    });
    Enclosure { at, ..found }
}

/// Away by the roundings of a square root, a division and a sum, to the side of `sign`.
pub(crate) fn outwards(x: f64, sign: f64) -> f64 {
    if x.is_finite() { x + sign * 8.0 * U * x.abs() } else { x }
}

/// Sine of the angle whose cotangent is 1/t.
fn sine_of(t: f64) -> f64 {
    if t.is_infinite() { t.signum() } else { t / t.hypot(1.0) }
}

/// 1/t, infinite where t is not positive.
fn reciprocal(t: f64) -> f64 {
    if t > 0.0 { t.recip() } else { f64::INFINITY }
}

#[cfg(test)]
#[path = "proved_quality_tests.rs"]
mod tests;
