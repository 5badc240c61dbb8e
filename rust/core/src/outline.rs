//! A closed chain of curves parameterized by arc length, with nearest-point search.

use crate::numeric::quadrature::gauss;
use crate::spline::{SplineCurve, bezier_extract};

/// Aim for this many entries in the arc-length table, 4 to 16 a Bézier piece.
const TABLE: usize = 1024;
/// Chords in a leaf of the box tree.
const LEAF: usize = 4;
/// Samples of a loop projected onto another one at most.
const MOST_SAMPLES: usize = 2048;
/// Newton steps to a foot of a perpendicular at most.
const FOOT_STEPS: usize = 8;

/// Bézier pieces of equal degree and the arc lengths at `intervals` equal parameter steps on each of them.
///
/// Arc length is integrated by 3-point Gauss in every interval (relative error about 1e-8 on smooth pieces) and inverted
/// linearly: points are exactly on the curves, their arc length is approximate.
#[derive(Clone, Debug)]
pub struct Outline {
    /// Homogeneous Bézier points, `degree + 1` a piece.
    pieces: Vec<[f64; 3]>,
    degree: usize,
    /// All weights are 1.
    polynomial: bool,
    /// Increasing arc lengths, `intervals` a piece and the total length.
    table: Vec<f64>,
    intervals: usize,
    /// First piece of every curve, and the number of pieces.
    first: Vec<usize>,
    /// Distinct knots of every curve.
    breaks: Vec<Vec<f64>>,
    /// Points at the table's arc lengths.
    samples: Vec<[f64; 2]>,
    /// Boxes `[x0, y0, x1, y1]` around runs of chords between samples, in the order of a binary heap.
    boxes: Vec<[f64; 4]>,
}

impl Outline {
    /// Chain of curves, each of which ends where the next starts, and the last where the first starts.
    pub fn new(curves: &[SplineCurve]) -> Self {
        let degree = curves.iter().map(|c| c.degree).max().unwrap_or(1);
        let (mut pieces, mut first, mut breaks) = (vec![], vec![0], vec![]);
        for curve in curves {
            let homogeneous: Vec<[f64; 3]> = curve
                .points
                .iter()
                .enumerate()
                .map(|(i, p)| {
                    let w = curve.weights.as_ref().map_or(1.0, |w| w[i]);
                    [w * p[0], w * p[1], w]
                })
                .collect();
            let own = bezier_extract(&curve.knots, curve.degree, &homogeneous);
            for piece in own.chunks_exact(curve.degree + 1) {
                pieces.extend(raised(piece.to_vec(), degree));
            }
            first.push(pieces.len() / (degree + 1));
            let mut knots = curve.knots.clone();
            knots.dedup();
            breaks.push(knots);
        }
        let m = pieces.len() / (degree + 1);
        let intervals = (TABLE / m.max(1)).clamp(4, 16);
        let mut outline = Self {
            pieces,
            degree,
            polynomial: curves.iter().all(|c| c.weights.is_none()),
            table: vec![0.0],
            intervals,
            first,
            breaks,
            samples: vec![],
            boxes: vec![],
        };
        outline.integrate(m);
        outline.samples = (0..m * intervals)
            .map(|k| {
                let t = (k % intervals) as f64 / intervals as f64;
                outline.on_piece(k / intervals, t, &mut vec![]).0
            })
            .collect();
        outline.boxes = vec![[0.0; 4]; 2 * leaves(outline.samples.len()).next_power_of_two()];
        outline.enclose(1, 0, outline.samples.len());
        outline
    }

    fn integrate(&mut self, m: usize) {
        let (nodes, weights) = gauss(3);
        let (n, mut scratch) = (self.intervals as f64, vec![]);
        let mut total = 0.0;
        for piece in 0..m {
            for k in 0..self.intervals {
                let speed = |x: &f64, scratch: &mut Vec<[f64; 3]>| {
                    norm(self.on_piece(piece, (k as f64 + 0.5 * (x + 1.0)) / n, scratch).1)
                };
                let sum: f64 = nodes.iter().zip(&weights).map(|(x, w)| w * speed(x, &mut scratch)).sum();
                total += sum / (2.0 * n);
                self.table.push(total);
            }
        }
    }

    /// Box of the chords `from..to`, stored as node `at` with its halves below.
    fn enclose(&mut self, at: usize, from: usize, to: usize) -> [f64; 4] {
        let around = if to - from <= LEAF {
            let points = (from..=to).map(|i| self.samples[i % self.samples.len()]);
            points.fold([f64::INFINITY, f64::INFINITY, -f64::INFINITY, -f64::INFINITY], |b, p| {
                [b[0].min(p[0]), b[1].min(p[1]), b[2].max(p[0]), b[3].max(p[1])]
            })
        } else {
            let middle = from + (to - from) / 2;
            let (a, b) = (self.enclose(2 * at, from, middle), self.enclose(2 * at + 1, middle, to));
            [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])]
        };
        if self.boxes.len() <= at {
            self.boxes.resize(at + 1, [0.0; 4]);
        }
        self.boxes[at] = around;
        around
    }

    /// Total length.
    pub fn length(&self) -> f64 {
        self.table[self.table.len() - 1]
    }

    /// Diagonal of the bounding box of the samples.
    pub fn diameter(&self) -> f64 {
        let [x0, y0, x1, y1] = self.boxes[1];
        norm([x1 - x0, y1 - y0])
    }

    /// Signed area of the polygon of the samples, positive when the loop runs counter-clockwise.
    pub fn area(&self) -> f64 {
        // About a sample: far from the origin the products would lose the area.
        let [x, y] = self.samples[0];
        let pairs = self.samples.windows(2);
        pairs.map(|w| 0.5 * ((w[0][0] - x) * (w[1][1] - y) - (w[0][1] - y) * (w[1][0] - x))).sum()
    }

    /// Arc lengths where the curves start, and the total length.
    pub fn joints(&self) -> Vec<f64> {
        self.first.iter().map(|&f| self.table[f * self.intervals]).collect()
    }

    /// Arc lengths where the Bézier pieces start.
    pub fn piece_starts(&self) -> Vec<f64> {
        self.table[..self.table.len() - 1].iter().step_by(self.intervals).copied().collect()
    }

    /// Arc lengths of the table without the last, and the points there.
    pub fn samples(&self) -> (&[f64], &[[f64; 2]]) {
        (&self.table[..self.table.len() - 1], &self.samples)
    }

    /// Arc length at the parameter `t` of a curve, linear in every table interval.
    pub fn arc_length(&self, curve: usize, t: f64) -> f64 {
        let breaks = &self.breaks[curve];
        let span = breaks.partition_point(|&b| b <= t).clamp(1, breaks.len() - 1) - 1;
        let local = ((t - breaks[span]) / (breaks[span + 1] - breaks[span])).clamp(0.0, 1.0);
        let at = local * self.intervals as f64;
        let k = (at as usize).min(self.intervals - 1);
        let row = (self.first[curve] + span) * self.intervals + k;
        self.table[row] + (at - k as f64) * (self.table[row + 1] - self.table[row])
    }

    /// Piece and local parameter at arc length `s`, taken modulo the length; at breaks the later piece, or the
    /// earlier one with `from_left`. Linear in every table interval; `near` is a row of the table nearby.
    fn locate(&self, s: f64, from_left: bool, near: usize) -> (usize, f64, usize) {
        let length = self.length();
        // The remainder is slow, and seldom needed.
        let mut s = if (0.0..length).contains(&s) { s } else { s.rem_euclid(length) };
        if from_left && s == 0.0 {
            s = length;
        }
        let k = self.row(s, from_left, near);
        let step = (self.table[k + 1] - self.table[k]).max(f64::MIN_POSITIVE);
        let fraction = ((s - self.table[k]) / step).clamp(0.0, 1.0);
        (k / self.intervals, ((k % self.intervals) as f64 + fraction) / self.intervals as f64, k)
    }

    /// Row of the table whose interval holds `s`; `near` and the one after it are tried first.
    fn row(&self, s: f64, from_left: bool, near: usize) -> usize {
        let last = self.table.len() - 2;
        for k in near..=(near + 1).min(last) {
            if self.table[k] < s && s < self.table[k + 1] {
                return k;
            }
        }
        let after = self.table.partition_point(|&x| if from_left { x < s } else { x <= s });
        after.saturating_sub(1).min(last)
    }

    /// Point and derivative with respect to the local parameter (de Casteljau).
    fn on_piece(&self, piece: usize, t: f64, scratch: &mut Vec<[f64; 3]>) -> ([f64; 2], [f64; 2]) {
        let points = &self.pieces[piece * (self.degree + 1)..][..self.degree + 1];
        match (self.polynomial, self.degree) {
            (true, 1) => return casteljau::<2>(points, t),
            (true, 2) => return casteljau::<3>(points, t),
            (true, 3) => return casteljau::<4>(points, t),
            (true, 4) => return casteljau::<5>(points, t),
            _ => (),
        }
        scratch.clear();
        scratch.extend_from_slice(points);
        for level in (2..=self.degree).rev() {
            for i in 0..level {
                for d in 0..3 {
                    scratch[i][d] += t * (scratch[i + 1][d] - scratch[i][d]);
                }
            }
        }
        let slope: [f64; 3] = std::array::from_fn(|d| self.degree as f64 * (scratch[1][d] - scratch[0][d]));
        let value: [f64; 3] = std::array::from_fn(|d| scratch[0][d] + t * (scratch[1][d] - scratch[0][d]));
        let point = [value[0] / value[2], value[1] / value[2]];
        (point, std::array::from_fn(|d| (slope[d] - slope[2] * point[d]) / value[2]))
    }

    /// Point and unit tangent `[x, y, tx, ty]` at arc length `s`.
    pub fn at(&self, s: f64, from_left: bool, scratch: &mut Scratch) -> [f64; 4] {
        let (piece, t, row) = self.locate(s, from_left, scratch.row);
        scratch.row = row;
        let points = &mut scratch.points;
        let (point, mut d) = self.on_piece(piece, t, points);
        let mut size = norm(d);
        if size <= 1e-9 * self.length() {
            // Coinciding end control points: the direction is the limit from inside.
            let inside = if t > 0.5 { t - 1e-3 } else { t + 1e-3 };
            d = self.on_piece(piece, inside, points).1;
            size = norm(d).max(f64::MIN_POSITIVE);
        }
        [point[0], point[1], d[0] / size, d[1] / size]
    }

    /// Points and unit tangents at the arc lengths `s`, `[x, y, tx, ty]` each.
    pub fn evaluate(&self, s: &[f64], from_left: bool) -> Vec<[f64; 4]> {
        let mut scratch = Scratch::default();
        s.iter().map(|&s| self.at(s, from_left, &mut scratch)).collect()
    }

    /// Nearest points of the loop to `points`: `[arc length, distance]` each.
    ///
    /// From the nearest chord between samples, found exactly, Newton steps (projection onto the tangent) as long as
    /// the distance falls.
    pub fn nearest(&self, points: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let (mut scratch, mut chord) = (Scratch::default(), 0);
        points
            .iter()
            .map(|point| {
                let (k, fraction) = self.nearest_chord(point, self.downhill(point, chord).0);
                chord = k;
                let step = self.table[k + 1] - self.table[k];
                let [s, distance] = self.foot(point, self.table[k] + fraction * step, step, &mut scratch);
                [s.rem_euclid(self.length()), distance]
            })
            .collect()
    }

    /// Signed turning angles of the tangent at the arc lengths `s`, non-zero at corners only.
    pub fn turn(&self, s: &[f64]) -> Vec<f64> {
        // A position computed by arithmetic may miss the corner by rounding.
        let (near, mut scratch) = (1e-9 * self.length(), Scratch::default());
        s.iter()
            .map(|s| {
                let [_, _, ax, ay] = self.at(s - near, true, &mut scratch);
                let [_, _, bx, by] = self.at(s + near, false, &mut scratch);
                (ax * by - ay * bx).atan2(ax * bx + ay * by)
            })
            .collect()
    }

    /// Two-sided Hausdorff distance of two loops, from their samples: every n-th where there are more than 2048.
    pub fn hausdorff(&self, other: &Self) -> f64 {
        self.farthest(other).max(other.farthest(self))
    }

    /// Largest distance of another loop's samples from this one.
    fn farthest(&self, other: &Self) -> f64 {
        let (mut worst, mut chord, mut scratch) = (0.0, 0, Scratch::default());
        for point in other.samples.iter().step_by(other.samples.len().div_ceil(MOST_SAMPLES).max(1)) {
            let mut distance_at = |(k, fraction): (usize, f64)| {
                let step = self.table[k + 1] - self.table[k];
                let s = self.table[k] + fraction * step;
                let here = self.at(s, false, &mut scratch);
                (norm([point[0] - here[0], point[1] - here[1]]), s, step)
            };
            // Consecutive points have neighbouring feet. Any point of the loop bounds the distance from above, so the
            // nearest one matters only where this one is farther away than any before.
            let near = self.downhill(point, chord);
            chord = near.0;
            if distance_at(near).0 <= worst {
                continue;
            }
            let nearest = self.nearest_chord(point, chord);
            chord = nearest.0;
            let (distance, s, step) = distance_at(nearest);
            if distance > worst {
                worst = self.foot(point, s, step, &mut scratch)[1].max(worst);
            }
        }
        worst
    }

    /// Squared distance of a point from chord `k`, and the fraction of the chord where it is nearest.
    fn chord(&self, k: usize, p: &[f64; 2]) -> (f64, f64) {
        let (a, b) = (self.samples[k], self.samples[if k + 1 == self.samples.len() { 0 } else { k + 1 }]);
        let d = [b[0] - a[0], b[1] - a[1]];
        let along = (p[0] - a[0]) * d[0] + (p[1] - a[1]) * d[1];
        let t = (along / (d[0] * d[0] + d[1] * d[1]).max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        let (x, y) = (p[0] - a[0] - t * d[0], p[1] - a[1] - t * d[1]);
        (x * x + y * y, t)
    }

    /// Chord from which the distance to `p` grows both ways, walking down from a `guess`.
    fn downhill(&self, p: &[f64; 2], guess: usize) -> (usize, f64) {
        let count = self.samples.len();
        let (mut found, (mut best, mut t)) = (guess, self.chord(guess, p));
        for step in [1, count - 1] {
            loop {
                let next = (found + step) % count;
                let (distance, fraction) = self.chord(next, p);
                if distance >= best {
                    break;
                }
                (found, best, t) = (next, distance, fraction);
            }
        }
        (found, t)
    }

    /// Nearest chord and the fraction of it where it is nearest, by branch and bound; `guess` is a chord nearby.
    fn nearest_chord(&self, p: &[f64; 2], guess: usize) -> (usize, f64) {
        let outside = |b: &[f64; 4]| {
            let (dx, dy) = ((b[0] - p[0]).max(p[0] - b[2]).max(0.0), (b[1] - p[1]).max(p[1] - b[3]).max(0.0));
            dx * dx + dy * dy
        };
        let (mut best, t) = self.chord(guess, p);
        let mut found = (guess, t);
        // Depth first: one open box a level, and there are no more levels than bits.
        let (mut stack, mut open) = ([(1, 0, self.samples.len(), 0.0); usize::BITS as usize + 1], 1);
        while open > 0 {
            open -= 1;
            let (at, from, to, bound) = stack[open];
            if bound >= best {
                continue;
            }
            if to - from <= LEAF {
                for k in from..to {
                    let (distance, t) = self.chord(k, p);
                    if distance < best {
                        (best, found) = (distance, (k, t));
                    }
                }
                continue;
            }
            let middle = from + (to - from) / 2;
            let lower = (2 * at, from, middle, outside(&self.boxes[2 * at]));
            let upper = (2 * at + 1, middle, to, outside(&self.boxes[2 * at + 1]));
            // The nearer half is looked at first, so it is pushed last.
            let (near, far) = if lower.3 <= upper.3 { (lower, upper) } else { (upper, lower) };
            (stack[open], stack[open + 1]) = (far, near);
            open += 2;
        }
        found
    }

    /// Foot of the perpendicular from a point, starting at `s`, by Newton steps no longer than `reach`.
    fn foot(&self, point: &[f64; 2], s: f64, reach: f64, scratch: &mut Scratch) -> [f64; 2] {
        let small = 1e-9 * self.length();
        let (mut at, mut best) = (s, [s, f64::INFINITY]);
        for _ in 0..FOOT_STEPS {
            let here = self.at(at, false, scratch);
            let offset = [point[0] - here[0], point[1] - here[1]];
            let distance = norm(offset);
            if distance >= best[1] {
                break;
            }
            best = [at, distance];
            let step = (offset[0] * here[2] + offset[1] * here[3]).clamp(-reach, reach);
            if step.abs() <= small {
                break;
            }
            at += step;
        }
        best
    }
}

/// Point and derivative of a polynomial piece of degree `N - 1`, all in registers.
fn casteljau<const N: usize>(points: &[[f64; 3]], t: f64) -> ([f64; 2], [f64; 2]) {
    let mut p: [[f64; 2]; N] = std::array::from_fn(|i| [points[i][0], points[i][1]]);
    for level in (2..N).rev() {
        for i in 0..level {
            p[i] = std::array::from_fn(|d| p[i][d] + t * (p[i + 1][d] - p[i][d]));
        }
    }
    let step: [f64; 2] = std::array::from_fn(|d| p[1][d] - p[0][d]);
    (std::array::from_fn(|d| p[0][d] + t * step[d]), step.map(|x| (N - 1) as f64 * x))
}

/// Room for an evaluation, and where the last one was: the next one is often nearby.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    points: Vec<[f64; 3]>,
    row: usize,
}

/// Faster than `hypot`, whose range coordinates do not need.
fn norm([x, y]: [f64; 2]) -> f64 {
    (x * x + y * y).sqrt()
}

fn leaves(chords: usize) -> usize {
    chords.div_ceil(LEAF).max(1)
}

/// Bézier points of a higher degree.
fn raised(mut points: Vec<[f64; 3]>, degree: usize) -> Vec<[f64; 3]> {
    while points.len() <= degree {
        let p = points.len();
        let inner = (1..p).map(|i| {
            let a = i as f64 / p as f64;
            std::array::from_fn(|d| a * points[i - 1][d] + (1.0 - a) * points[i][d])
        });
        points = std::iter::once(points[0]).chain(inner).chain([points[p - 1]]).collect();
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn polygon(corners: &[[f64; 2]]) -> Outline {
        let n = corners.len();
        let curves: Vec<SplineCurve> = (0..n)
            .map(|i| SplineCurve {
                degree: 1,
                knots: vec![0.0, 0.0, 1.0, 1.0],
                points: vec![corners[i], corners[(i + 1) % n]],
                weights: None,
            })
            .collect();
        Outline::new(&curves)
    }

    #[test]
    fn a_square_is_walked_by_arc_length_and_corners_have_two_tangents() {
        let outline = polygon(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]);
        // Arc lengths are sums of quadratures: right to rounding only.
        let close = |found: &[f64], wanted: &[f64]| {
            assert!(found.iter().zip(wanted).all(|(f, w)| (f - w).abs() < 1e-14), "{found:?} for {wanted:?}");
        };
        let joints = outline.joints();
        close(&joints, &[0.0, 1.0, 2.0, 3.0, 4.0]);
        let at = |s: f64, before: bool| outline.evaluate(&[s], before)[0];
        close(&at(1.25, false), &[1.0, 0.25, 0.0, 1.0]);
        close(&at(1.25 + joints[4], false), &[1.0, 0.25, 0.0, 1.0]);
        close(&at(-0.75, false), &[0.0, 0.75, 0.0, -1.0]);
        close(&at(joints[1], false), &[1.0, 0.0, 0.0, 1.0]);
        close(&at(joints[1], true), &[1.0, 0.0, 1.0, 0.0]);
        close(&at(0.0, true), &[0.0, 0.0, 0.0, -1.0]);
        for (found, wanted) in
            outline.nearest(&[[0.3, -0.5], [1.2, 0.6]]).iter().zip([[0.3, 0.5], [1.6, 0.2]])
        {
            assert!((found[0] - wanted[0]).abs() < 1e-12 && (found[1] - wanted[1]).abs() < 1e-12);
        }
        close(&[outline.arc_length(2, 0.5)], &[2.5]);
    }

    proptest! {
        #[test]
        fn the_nearest_chord_is_the_nearest(
            radii in prop::collection::vec(0.3f64..2.0, 3..40),
            points in prop::collection::vec(prop::array::uniform2(-3.0f64..3.0), 1..20),
        ) {
            let n = radii.len() as f64;
            let corners: Vec<[f64; 2]> = radii.iter().enumerate().map(|(i, r)| {
                let (sin, cos) = (std::f64::consts::TAU * i as f64 / n).sin_cos();
                [r * cos, r * sin]
            }).collect();
            let outline = polygon(&corners);
            for (p, found) in points.iter().zip(outline.nearest(&points)) {
                let by_hand = (0..corners.len()).map(|i| {
                    let (a, b) = (corners[i], corners[(i + 1) % corners.len()]);
                    let d = [b[0] - a[0], b[1] - a[1]];
                    let t = (((p[0] - a[0]) * d[0] + (p[1] - a[1]) * d[1]) / (d[0] * d[0] + d[1] * d[1])).clamp(0.0, 1.0);
                    (p[0] - a[0] - t * d[0]).hypot(p[1] - a[1] - t * d[1])
                }).fold(f64::INFINITY, f64::min);
                prop_assert!((found[1] - by_hand).abs() < 1e-12);
                let back = outline.evaluate(&[found[0]], false)[0];
                prop_assert!(((back[0] - p[0]).hypot(back[1] - p[1]) - found[1]).abs() < 1e-9);
            }
        }
    }
}
