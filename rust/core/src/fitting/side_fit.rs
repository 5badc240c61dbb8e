//! Orthogonal distance fit of one boundary side to an outline.
//!
//! The side is a spline curve with fixed end points. A sample slides along the outline to the foot of its
//! perpendicular, and residuals along the tangent are damped, not penalised (Gauss–Newton on the orthogonal distance).
//! The first and the last leg of the control polygon may be held on a line through the end point.

use crate::numeric::dense::Definite;
use crate::outline::{Outline, Scratch};
use crate::spline::sampled_basis::SampledBasis;

/// A side that goes on more slowly than this part of the given speed counts as backing up by what is lacking: where it
/// nearly stops it is next to a cusp, and patches behind get thin.
const SLOWEST: f64 = 0.05;

/// Weight that a sample without error keeps in levelling, beside that of the largest error: let go altogether it would
/// become the next largest.
const LEAST_SHARE: f64 = 0.05;
/// Divisor where all that is divided vanishes.
pub(crate) const NOTHING: f64 = 1e-300;

/// What a side is fitted to.
#[derive(Clone, Debug)]
pub struct SideData {
    /// Index of its basis.
    pub basis: usize,
    /// Index of its outline.
    pub outline: usize,
    /// Arc lengths of the samples to begin with, increasing.
    pub lengths: Vec<f64>,
    /// End points.
    pub ends: [[f64; 2]; 2],
    /// Unit tangents of the outline at the ends, in the sense of the curve.
    pub tangents: [[f64; 2]; 2],
    /// Lengths that the legs should have, roughly.
    pub legs: [f64; 2],
    /// Angles from the tangents beyond which the legs rule out a map; infinite where none does.
    pub stray: [f64; 2],
}

/// Unit vector at this angle from unit vector `t`, on the side of `leg`.
fn towards(leg: [f64; 2], t: [f64; 2], angle: f64) -> [f64; 2] {
    let angle = angle.copysign(t[0] * leg[1] - t[1] * leg[0]);
    let (sin, cos) = angle.sin_cos();
    let line = [cos * t[0] - sin * t[1], cos * t[1] + sin * t[0]];
    let size = line[0].hypot(line[1]);
    line.map(|x| x / size)
}

/// A side and the state of its fit.
#[derive(Clone, Debug)]
pub struct SideFit {
    data: SideData,
    /// Arc lengths now.
    lengths: Vec<f64>,
    /// What sliding away from the given arc lengths costs, beside a squared error of 1.
    hold: f64,
    /// Weight of the residual along the tangent; the sliding makes it vanish at the end.
    damping: f64,
    /// A leg on a line gets no shorter than this part of its given length.
    shortest_leg: f64,
    /// Of the inner samples.
    weights: Vec<f64>,
    /// Direction of the line of each leg, if it has one.
    lines: [Option<[f64; 2]>; 2],
    /// Points and tangents of the outline at the arc lengths.
    target: Vec<[f64; 4]>,
    /// Points of the curve there.
    curve: Vec<[f64; 2]>,
    /// Normal equations of the inner control points, coordinates interleaved.
    normal: Vec<f64>,
    right: Vec<f64>,
    control: Vec<[f64; 2]>,
}

/// Stiffness against turning the legs, and the negative gradient of the squared error in the angles.
pub type Turning = ([[f64; 2]; 2], [f64; 2]);

impl SideFit {
    /// `slide_error`: sliding by the whole side costs as much as this error, squared.
    pub fn new(
        data: SideData,
        basis: &SampledBasis,
        slide_error: f64,
        damping: f64,
        shortest_leg: f64,
    ) -> Self {
        let k = data.lengths.len();
        let span = data.lengths[k - 1] - data.lengths[0];
        let mut control = vec![data.ends[0]; basis.control_points()];
        control[basis.control_points() - 1] = data.ends[1];
        Self {
            lengths: data.lengths.clone(),
            hold: (slide_error / span).powi(2),
            damping,
            shortest_leg,
            weights: vec![1.0; k - 2],
            lines: [None; 2],
            target: vec![],
            curve: vec![],
            normal: vec![],
            right: vec![],
            control,
            data,
        }
    }

    fn inner(&self) -> usize {
        self.control.len() - 2
    }

    /// Points and tangents of the outline at the arc lengths; the ends are as given.
    pub fn sample(&mut self, outline: &Outline) {
        let mut scratch = Scratch::default();
        self.target.clear();
        self.target.extend(self.lengths.iter().map(|&s| outline.at(s, false, &mut scratch)));
        let last = self.target.len() - 1;
        for (end, at) in [(0, 0), (1, last)] {
            self.target[at][..2].copy_from_slice(&self.data.ends[end]);
        }
    }

    /// Residual of sample `k`, along the target's tangent and across.
    fn residual(&self, k: usize) -> [f64; 2] {
        let (p, [x, y, tx, ty]) = (self.curve[k], self.target[k]);
        let d = [p[0] - x, p[1] - y];
        [d[0] * tx + d[1] * ty, d[1] * tx - d[0] * ty]
    }

    /// Give samples weight by their residual, so that the largest ones come down (Lawson).
    pub fn level(&mut self) {
        let size = |k: usize| {
            let [along, across] = self.residual(k + 1);
            along.hypot(across)
        };
        let residual: Vec<f64> = (0..self.weights.len()).map(size).collect();
        let largest = residual.iter().fold(NOTHING, |m: f64, &r| m.max(r));
        self.weights.iter_mut().zip(&residual).for_each(|(w, r)| *w *= LEAST_SHARE + r / largest);
        let mean = self.weights.iter().sum::<f64>() / self.weights.len() as f64;
        self.weights.iter_mut().for_each(|w| *w /= mean);
    }

    /// Move the inner samples towards the feet of the perpendiculars from the curve.
    pub fn slide(&mut self) {
        let (first, last) = (self.lengths[0], self.lengths[self.lengths.len() - 1]);
        for k in 1..self.lengths.len() - 1 {
            self.lengths[k] = (self.lengths[k] + self.residual(k)[0]).clamp(first, last);
        }
    }

    /// Normal equations, residuals counted across the target (`isotropic`: alike in all directions).
    pub fn linearise(&mut self, basis: &SampledBasis, isotropic: bool) {
        let along = if isotropic { 1.0 } else { self.damping + self.hold };
        // The damping pulls to where the sample is now, the hold to where it started: one pull to a point in between.
        let back = self.hold / (self.damping + self.hold);
        let pulled = self.target.iter().zip(&self.data.lengths).zip(&self.lengths);
        let mut wanted: Vec<[f64; 2]> = pulled
            .map(|(([x, y, tx, ty], start), now)| {
                let pull = back * (start - now);
                [x + pull * tx, y + pull * ty]
            })
            .collect();
        for (i, end) in [0, basis.control_points() - 1].into_iter().zip(self.data.ends) {
            basis.add(i, end.map(|x| -x), &mut wanted);
        }
        // Metrics xx, xy, yy, and the wanted points in them, at all samples; the ends have none.
        let mut terms = vec![0.0; 5 * basis.samples];
        let [xx, xy, yy, x, y] = {
            let mut rows = terms.chunks_exact_mut(basis.samples);
            std::array::from_fn(|_| rows.next().expect("five rows"))
        };
        for (k, w) in (1..).zip(&self.weights) {
            let [_, _, tx, ty] = self.target[k];
            let reduce = w * (1.0 - along);
            (xx[k], xy[k], yy[k]) = (w - reduce * tx * tx, -reduce * tx * ty, w - reduce * ty * ty);
            x[k] = xx[k] * wanted[k][0] + xy[k] * wanted[k][1];
            y[k] = xy[k] * wanted[k][0] + yy[k] * wanted[k][1];
        }
        basis.normal_matrix([xx, xy, yy], &mut self.normal);
        basis.moments(x, y, &mut self.right);
    }

    /// Largest distance of the samples, across the target only or (`whole`) from the sample's own point.
    pub fn error(&self, whole: bool) -> f64 {
        (0..self.target.len()).fold(0.0, |m: f64, k| {
            let [along, across] = self.residual(k);
            m.max(if whole { along.hypot(across) } else { across.abs() })
        })
    }

    /// Way, summed over samples, that the curve backs up against the target or lacks where it all but stops.
    pub fn backwards(&self) -> f64 {
        (1..self.target.len()).fold(0.0, |sum, k| {
            let (last, p) = (self.curve[k - 1], self.curve[k]);
            let (a, b) = (self.target[k - 1], self.target[k]);
            let step = (p[0] - last[0]) * (a[2] + b[2]) + (p[1] - last[1]) * (a[3] + b[3]);
            let due = SLOWEST * (self.data.lengths[k] - self.data.lengths[k - 1]);
            sum + (due - 0.5 * step).max(0.0)
        })
    }

    /// Index of the basis and of the outline.
    pub fn refers_to(&self) -> [usize; 2] {
        [self.data.basis, self.data.outline]
    }

    /// Control points.
    pub fn control(&self) -> &[[f64; 2]] {
        &self.control
    }

    /// Direction of a leg's line; without a line the leg's own direction.
    pub fn line(&self, end: usize) -> [f64; 2] {
        let [x, y] = self.legs()[end];
        let size = x.hypot(y).max(f64::MIN_POSITIVE);
        self.lines[end].unwrap_or([x / size, y / size])
    }

    /// Put a leg on the line through its end point along a unit vector.
    pub fn set_line(&mut self, end: usize, direction: [f64; 2]) {
        self.lines[end] = Some(direction);
    }

    /// Positions of a leg's coordinates: along and across its line.
    fn leg_at(&self, end: usize) -> usize {
        if end == 0 { 0 } else { 2 * (self.inner() - 1) }
    }

    /// Normal equations with legs on lines in coordinates along and across them.
    fn local(&self) -> (Vec<f64>, Vec<f64>) {
        let (mut a, mut b, size) = (self.normal.clone(), self.right.clone(), 2 * self.inner());
        for end in 0..2 {
            let Some([c, s]) = self.lines[end] else { continue };
            let at = self.leg_at(end);
            for j in 0..size {
                let (x, y) = (a[at * size + j], a[(at + 1) * size + j]);
                (a[at * size + j], a[(at + 1) * size + j]) = (c * x + s * y, c * y - s * x);
            }
            for i in 0..size {
                let (x, y) = (a[i * size + at], a[i * size + at + 1]);
                (a[i * size + at], a[i * size + at + 1]) = (c * x + s * y, c * y - s * x);
            }
            (b[at], b[at + 1]) = (c * b[at] + s * b[at + 1], c * b[at + 1] - s * b[at]);
        }
        (a, b)
    }

    /// Coordinates of an end point along and across the line of its leg.
    fn end_coordinates(&self, end: usize) -> [f64; 2] {
        let ([c, s], [x, y]) = (self.lines[end].unwrap_or([1.0, 0.0]), self.data.ends[end]);
        [c * x + s * y, c * y - s * x]
    }

    /// Control points of the least-squares fit, legs on their lines and pointing forwards.
    pub fn solve(&mut self, basis: &SampledBasis) {
        self.find_control_points();
        self.curve.clear();
        self.curve.resize(basis.samples, [0.0; 2]);
        for (i, c) in self.control.iter().enumerate() {
            basis.add(i, *c, &mut self.curve);
        }
    }

    fn find_control_points(&mut self) {
        let m = self.inner();
        if m == 0 {
            return;
        }
        let (a, b) = self.local();
        let mut fixed = vec![None; 2 * m];
        for end in 0..2 {
            if self.lines[end].is_some() {
                fixed[self.leg_at(end) + 1] = Some(self.end_coordinates(end)[1]);
            }
        }
        let mut x = constrained(&a, &b, &fixed);
        let mut short = false;
        for (end, forward) in [(0, 1.0), (1, -1.0)] {
            let (at, base) = (self.leg_at(end), self.end_coordinates(end)[0]);
            let shortest = self.shortest_leg * self.data.legs[end];
            if self.lines[end].is_some() && forward * (x[at] - base) < shortest {
                fixed[at] = Some(base + forward * shortest);
                short = true;
            }
        }
        if short {
            x = constrained(&a, &b, &fixed);
        }
        for i in 0..m {
            self.control[i + 1] = [x[2 * i], x[2 * i + 1]];
        }
        for end in 0..2 {
            // From the end point, so that collinearity holds to rounding of the leg, not of the coordinates.
            let Some(line) = self.lines[end] else { continue };
            let leg = x[self.leg_at(end)] - self.end_coordinates(end)[0];
            let inner = if end == 0 { 1 } else { m };
            self.control[inner] = std::array::from_fn(|d| self.data.ends[end][d] + leg * line[d]);
        }
    }

    /// Legs at both ends, in the sense of the curve.
    pub fn legs(&self) -> [[f64; 2]; 2] {
        let n = self.control.len();
        let leg = |a: [f64; 2], b: [f64; 2]| [b[0] - a[0], b[1] - a[1]];
        [leg(self.control[0], self.control[1]), leg(self.control[n - 2], self.control[n - 1])]
    }

    /// Put free legs that stray from the outline's tangent by more than the angle `most`, or the side's own, on a line
    /// nearer to it than that by the angle `back`, and solve again.
    pub fn hold_ends(&mut self, basis: &SampledBasis, most: f64, back: f64) {
        let limits = self.data.stray.map(|own| own.min(most));
        // Legs move each other: once one is held, the other may stray.
        for _ in 0..2 {
            let mut straying: Vec<usize> = (0..2).filter(|&end| self.strays(end, limits[end])).collect();
            if self.inner() < 2 {
                // Both legs share what inner point there is: one can be held, and only where a map depends on it.
                straying.retain(|&end| self.data.stray[end] < most && self.lines[1 - end].is_none());
                straying.truncate(self.inner());
            }
            if straying.is_empty() {
                return;
            }
            let legs = self.legs();
            for end in straying {
                let angle = (limits[end] - back).max(0.0);
                self.lines[end] = Some(towards(legs[end], self.data.tangents[end], angle));
            }
            self.solve(basis);
        }
    }

    /// Whether a free leg strays from the outline's tangent by more than this angle.
    fn strays(&self, end: usize, most: f64) -> bool {
        let (leg, t) = (self.legs()[end], self.data.tangents[end]);
        let (along, across) = (leg[0] * t[0] + leg[1] * t[1], t[0] * leg[1] - t[1] * leg[0]);
        self.lines[end].is_none() && across.abs().atan2(along) > most
    }

    /// Quadratic model of the squared error in the angles of the legs on lines, everything else eliminated.
    pub fn turning(&self) -> Turning {
        let size = 2 * self.inner();
        if size < 4 {
            return ([[0.0; 2]; 2], [0.0; 2]);
        }
        let (a, b) = self.local();
        let system = Definite::new(&a, size);
        let across = [self.leg_at(0) + 1, self.leg_at(1) + 1];
        let mut free = b;
        system.solve(&mut free);
        let mut compliance = [[1.0, 0.0], [0.0, 1.0]];
        for e in (0..2).filter(|&e| self.lines[e].is_some()) {
            let mut unit = vec![0.0; size];
            unit[across[e]] = 1.0;
            system.solve(&mut unit);
            for f in (0..2).filter(|&f| self.lines[f].is_some()) {
                compliance[f][e] = unit[across[f]];
            }
        }
        let [[p, q], [r, s]] = compliance;
        let det = p * s - q * r;
        let inverse = [[s / det, -q / det], [-r / det, p / det]];
        let leg: [f64; 2] = std::array::from_fn(|e| {
            let inner = self.control[if e == 0 { 1 } else { self.inner() }];
            let [c, s] = self.lines[e].unwrap_or([1.0, 0.0]);
            c * (inner[0] - self.data.ends[e][0]) + s * (inner[1] - self.data.ends[e][1])
        });
        let (mut stiffness, mut gradient) = ([[0.0; 2]; 2], [0.0; 2]);
        for e in (0..2).filter(|&e| self.lines[e].is_some()) {
            for f in (0..2).filter(|&f| self.lines[f].is_some()) {
                stiffness[e][f] = inverse[e][f] * leg[e] * leg[f];
                gradient[e] += inverse[e][f] * (free[across[f]] - self.end_coordinates(f)[1]) * leg[e];
            }
        }
        (stiffness, gradient)
    }
}

/// Solve `a x = b` with some unknowns given.
fn constrained(a: &[f64], b: &[f64], fixed: &[Option<f64>]) -> Vec<f64> {
    let n = b.len();
    let (mut matrix, mut x) = (a.to_vec(), b.to_vec());
    for j in 0..n {
        let Some(value) = fixed[j] else { continue };
        for i in 0..n {
            x[i] -= matrix[i * n + j] * value;
            (matrix[i * n + j], matrix[j * n + i]) = (0.0, 0.0);
        }
        matrix[j * n + j] = 1.0;
    }
    (0..n).for_each(|j| x[j] = fixed[j].unwrap_or(x[j]));
    Definite::new(&matrix, n).solve(&mut x);
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn systems_with_given_unknowns_are_solved(
            entries in prop::collection::vec(-1.0f64..1.0, 36),
            b in prop::collection::vec(-1.0f64..1.0, 6),
            given in prop::collection::vec(prop::option::of(-1.0f64..1.0), 6),
        ) {
            let n = 6;
            let mut a = vec![0.0; n * n];
            for i in 0..n {
                for j in 0..n {
                    a[i * n + j] = (0..n).map(|k| entries[i * n + k] * entries[j * n + k]).sum::<f64>() + if i == j { 0.1 } else { 0.0 };
                }
            }
            let x = constrained(&a, &b, &given);
            for i in 0..n {
                match given[i] {
                    Some(value) => prop_assert_eq!(x[i], value),
                    None => {
                        let row: f64 = (0..n).map(|j| a[i * n + j] * x[j]).sum();
                        prop_assert!((row - b[i]).abs() < 1e-9);
                    }
                }
            }
        }
    }
}
