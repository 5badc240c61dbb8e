//! det J on a cell of a patch: Bernstein coefficients with bounds, the verdict they allow, halving.

use std::sync::Arc;

use crate::numeric::quadrature::GAUSS_4;
use crate::spline::bernstein::{BoundedBernstein, U};

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

/// Weight polynomial of a rational piece and its extent.
#[derive(Debug)]
pub(crate) struct Weight {
    pub polynomial: BoundedBernstein,
    pub bounds: [f64; 4],
    pub low: f64,
    pub high: f64,
}

/// A cell under examination.
#[derive(Debug)]
pub(crate) struct DeterminantCell {
    pub det: BoundedBernstein,
    pub bounds: [f64; 4],
    /// Bit `2 i + j`: the corner (u end i, v end j) is a corner of the patch.
    pub patch_corners: u8,
    /// |det J| up to this is zero at a patch corner within the rounding of the coordinates.
    pub corner_tolerance: f64,
    /// The coefficients at patch corners again, with the right sign; None elsewhere and where it is not known.
    pub corner_values: [Option<f64>; 4],
    pub weight: Option<Arc<Weight>>,
}

/// What is known about a cell, and at which of its corners.
pub(crate) enum Verdict {
    Proved,
    Degenerate(usize),
    BelowRounding(usize),
    Open,
    Folded(usize),
}

impl DeterminantCell {
    fn corner_coefficient(&self, corner: usize) -> usize {
        let [m, n] = self.det.degrees;
        (corner >> 1) * m * (n + 1) + (corner & 1) * n
    }

    /// The coefficient at a corner: det J there, times W³.
    pub fn corner_coefficient_value(&self, corner: usize) -> f64 {
        self.det.coefs[self.corner_coefficient(corner)]
    }

    fn corner_point(&self, corner: usize) -> [f64; 2] {
        [self.bounds[corner >> 1], self.bounds[2 + (corner & 1)]]
    }

    pub fn judge(&self) -> Verdict {
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

    pub fn halve(&self) -> [Self; 4] {
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
    pub fn lower_bound(&self) -> f64 {
        let low = self.det.coefs.iter().copied().fold(f64::INFINITY, f64::min) - self.det.err;
        match &self.weight {
            None => low,
            Some(w) => low / (if low > 0.0 { w.high } else { w.low }).powi(3),
        }
    }

    /// det J at a corner.
    fn corner_value(&self, corner: usize) -> f64 {
        self.over_weight(corner, self.corner_coefficient_value(corner))
    }

    /// The corner with the smallest det J.
    pub fn lowest_corner(&self) -> usize {
        (0..4).min_by(|&a, &b| self.corner_value(a).total_cmp(&self.corner_value(b))).expect("four corners")
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
    pub fn integral(&self) -> f64 {
        let [u0, u1, v0, v1] = self.bounds;
        let mean = match &self.weight {
            None => self.det.coefs.iter().sum::<f64>() / self.det.coefs.len() as f64,
            Some(w) => {
                let nodes = GAUSS_4.iter().flat_map(|s| GAUSS_4.iter().map(move |t| (s, t)));
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
    pub fn uncertainty(&self) -> f64 {
        let [u0, u1, v0, v1] = self.bounds;
        let count = self.det.coefs.len() as f64;
        (self.det.err + count * U * self.det.magnitude()) * (u1 - u0) * (v1 - v0)
    }

    /// The cell in the patch's own parameters, whose units are `units`.
    pub fn report(&self, kind: CellKind, corner: usize, scale: f64, units: [f64; 2]) -> Cell {
        let exact = self.corner_values[corner].filter(|_| kind == CellKind::BelowRounding);
        let value = exact.map_or_else(|| self.corner_value(corner), |x| self.over_weight(corner, x)) / scale;
        let [u, v] = self.corner_point(corner);
        let bounds = std::array::from_fn(|k| self.bounds[k] * units[k / 2]);
        Cell { kind, bounds, point: [u * units[0], v * units[1]], value }
    }
}
