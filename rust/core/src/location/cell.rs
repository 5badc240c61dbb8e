//! Cells: parts of a patch on which its map is nearly affine, each with the box in its own directions that holds it.

use super::boxes::Rectangle;
use super::sheet::{Net, Part, Sheet};

/// How far, in half lengths of its sides, a cell's map may be from an affine one before it is cut in two.
///
/// A smaller number makes more cells and fewer Newton steps: these square an error of a sixth four times down to rounding.
const BEND: f64 = 1.0 / 6.0;

/// Sine of the least angle between a cell's directions that its own box is made of; below, rounding would widen it.
const FLAT: f64 = 1e-6;

/// Coordinates in which a cell is about [-1, 1]²: `y = inverse (x - centre)`, and the box there that holds the cell.
#[derive(Clone, Copy, Debug)]
struct Frame {
    centre: [f64; 2],
    inverse: [[f64; 2]; 2],
    reach: Rectangle,
}

/// What is known of a part from its control points.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    pub part: Part,
    pub bounds: Rectangle,
    /// None where the part has no two directions.
    frame: Option<Frame>,
    /// Distance from an affine map, infinite without a frame.
    bend: f64,
    /// The direction to cut across.
    axis: usize,
}

impl Cell {
    /// From the control points of a part, all boxes grown by `slack`. `net` is room to work.
    pub fn new(sheet: &Sheet, part: Part, slack: f64, net: &mut Net) -> Self {
        sheet.net(&part, net);
        let [m, n] = sheet.degrees.map(|p| p + 1);
        let point = |i: usize, j: usize| net.points[i * n + j];
        let side = |index: &dyn Fn(usize) -> [f64; 2], count: usize| {
            let sum = (0..count).map(index).fold([0.0; 2], |s, p| [s[0] + p[0], s[1] + p[1]]);
            sum.map(|x| x / count as f64)
        };
        let half = |a: [f64; 2], b: [f64; 2]| [0.5 * (b[0] - a[0]), 0.5 * (b[1] - a[1])];
        let u = half(side(&|j| point(0, j), n), side(&|j| point(m - 1, j), n));
        let v = half(side(&|i| point(i, 0), m), side(&|i| point(i, n - 1), m));
        let bounds = Rectangle::around(&net.points, slack);
        let longer = usize::from(v[0].hypot(v[1]) > u[0].hypot(u[1]));
        let mut cell = Self { part, bounds, frame: None, bend: f64::INFINITY, axis: longer };
        let det = u[0] * v[1] - u[1] * v[0];
        if det.abs() > FLAT * u[0].hypot(u[1]) * v[0].hypot(v[1]) {
            let inverse = [[v[1] / det, -v[0] / det], [-u[1] / det, u[0] / det]];
            if inverse.iter().flatten().all(|x| x.is_finite()) {
                cell.measure(side(&|k| net.points[k], m * n), inverse, [m, n], slack, net);
            }
        }
        cell
    }

    /// The box in the coordinates of `inverse`, and how the control points there differ from an even grid.
    fn measure(
        &mut self,
        centre: [f64; 2],
        inverse: [[f64; 2]; 2],
        [m, n]: [usize; 2],
        slack: f64,
        net: &Net,
    ) {
        let mut frame = Frame { centre, inverse, reach: Rectangle { low: [0.0; 2], high: [0.0; 2] } };
        let y: Vec<[f64; 2]> = net.points.iter().map(|&p| frame.coordinates(p)).collect();
        frame.reach = Rectangle::around(&y, 0.0);
        for c in 0..2 {
            // `slack` is far more than rounding does to coordinates of about one.
            let pad = 2.0 * slack * (inverse[c][0].abs() + inverse[c][1].abs());
            frame.reach.low[c] -= pad;
            frame.reach.high[c] += pad;
        }
        let even = |i: usize, count: usize| 2.0 * i as f64 / (count - 1) as f64 - 1.0;
        let far = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).abs().max((a[1] - b[1]).abs());
        let from_even = (0..m * n).map(|k| far(y[k], [even(k / n, m), even(k % n, n)])).fold(0.0, f64::max);
        // Weights bend a map between control points on an even grid, too.
        let ratio = |k: usize, l: usize| {
            if net.weights.is_empty() { 0.0 } else { (net.weights[l] / net.weights[k]).ln().abs() }
        };
        let largest = |rows: usize, columns: usize, of: &dyn Fn(usize) -> f64| {
            (0..rows * columns).map(|k| of(k / columns * n + k % columns)).fold(0.0, f64::max)
        };
        let second = |step: usize, degree: usize| {
            let scale = (degree * (degree - 1)) as f64;
            move |k: usize, y: &[[f64; 2]]| {
                let [a, b, c] = [y[k], y[k + step], y[k + 2 * step]];
                scale * far([a[0] + c[0], a[1] + c[1]], [2.0 * b[0], 2.0 * b[1]])
            }
        };
        let weighted_u = largest(m - 1, n, &|k| ratio(k, k + n));
        let weighted_v = largest(m, n - 1, &|k| ratio(k, k + 1));
        let (along_u, along_v) = (second(n, m - 1), second(1, n - 1));
        let bent_u = largest(m.saturating_sub(2), n, &|k| along_u(k, &y)) + weighted_u * (m - 1) as f64;
        let bent_v = largest(m, n.saturating_sub(2), &|k| along_v(k, &y)) + weighted_v * (n - 1) as f64;
        // Where neither direction is bent more than the map is twisted, the longer one stays.
        let twist = |k: usize| {
            let sum = |a: [f64; 2], b: [f64; 2]| [a[0] + b[0], a[1] + b[1]];
            ((m - 1) * (n - 1)) as f64 * far(sum(y[k], y[k + n + 1]), sum(y[k + 1], y[k + n]))
        };
        if bent_u.max(bent_v) > largest(m - 1, n - 1, &twist) {
            self.axis = usize::from(bent_v > bent_u);
        }
        self.bend = from_even + largest(m, n, &|k| ratio(0, k)).exp_m1();
        self.frame = Some(frame);
    }

    /// Whether the map is so nearly affine that Newton's method goes straight to the point.
    pub fn is_straight(&self) -> bool {
        self.bend <= BEND
    }

    /// Where in the part `x` may be, with the distance from its centre (1 at the limits); none if it cannot be there.
    pub fn guess(&self, x: [f64; 2]) -> Option<([f64; 2], f64)> {
        if !self.bounds.contains(x) {
            return None;
        }
        let Some(frame) = &self.frame else { return Some((self.part.centre(), f64::INFINITY)) };
        let y = frame.coordinates(x);
        if !frame.reach.contains(y) {
            return None;
        }
        let Part { low, high, .. } = self.part;
        let at = [0, 1].map(|d| low[d] + (high[d] - low[d]) * (0.5 + 0.5 * y[d].clamp(-1.0, 1.0)));
        Some((at, y[0].abs().max(y[1].abs())))
    }

    /// Both halves.
    pub fn halves(&self) -> Option<[Part; 2]> {
        self.part.halves(self.axis).or_else(|| self.part.halves(1 - self.axis))
    }
}

impl Frame {
    fn coordinates(&self, x: [f64; 2]) -> [f64; 2] {
        let d = [x[0] - self.centre[0], x[1] - self.centre[1]];
        [0, 1].map(|c| self.inverse[c][0] * d[0] + self.inverse[c][1] * d[1])
    }
}

/// How often a knot span is halved at most where its map does not become affine: at corners that are straight.
const LEVELS: usize = 12;

/// Cells of a patch: so many a knot span, and so many more, are not exceeded by much. Injective patches need fewer; one
/// that folds would have any number, and the search inside its cells goes on where this ends.
const CELLS: [usize; 2] = [8, 256];

/// Cells that cover a patch.
pub(super) fn cells(sheet: &Sheet, slack: f64) -> Vec<Cell> {
    let mut net = Net::default();
    let parts = sheet.parts();
    let most = CELLS[0] * parts.len() + CELLS[1];
    let mut found = vec![];
    let mut level: Vec<Cell> =
        parts.into_iter().map(|part| Cell::new(sheet, part, slack, &mut net)).collect();
    for depth in 0.. {
        let mut next = vec![];
        for cell in level {
            let room = depth < LEVELS && found.len() + next.len() < most;
            match cell.halves() {
                Some(halves) if room && !cell.is_straight() => {
                    next.extend(halves.map(|part| Cell::new(sheet, part, slack, &mut net)));
                }
                _ => found.push(cell),
            }
        }
        if next.is_empty() {
            break;
        }
        level = next;
    }
    found
}
