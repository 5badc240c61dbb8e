//! Enclosures of the smallest quotient of two polynomials over many cells, in spite of rounding.
//!
//! Where the coefficients `a_i` of the upper polynomial are positive, a/|b| is at least the smallest a_i/|b_i|: the
//! mediant inequality. Corner and centre values bound the minimum from above. Cells that may hold it are halved in both
//! directions until the two bounds meet; of many pieces that is a handful.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use rayon::prelude::*;

use crate::spline::bernstein::{BoundedBernstein, U};

/// Halvings of a cell in each direction, as of a certificate.
const MAX_DEPTH: usize = 20;
/// Sub-cells of moderate degree looked at before the bounds found so far count, a tenth of a second's work; a hundred is
/// many.
const MAX_CELLS: usize = 20_000;
/// Coefficients of a cell of degree about five; of cells with more as many fewer are looked at.
const COEFFICIENTS: usize = 100;
/// Roundings of a quotient of two sums, and of the sums, outwards.
const DOWN: f64 = 1.0 - 4.0 * U;
const UP: f64 = 1.0 + 4.0 * U;

/// What is known of the upper polynomial at a corner of a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Corner {
    /// Nothing but its coefficient.
    Ordinary,
    /// Not negative, and zero within the rounding of the coordinates.
    Tiny,
    /// Exactly zero.
    Zero,
}

/// `above / |below|` on a cell of a patch.
#[derive(Clone, Debug)]
pub(crate) struct Quotient {
    pub above: BoundedBernstein,
    pub below: BoundedBernstein,
    pub patch: usize,
    /// `[u0, u1, v0, v1]`.
    pub bounds: [f64; 4],
    /// At (u end i, v end j), number `2 i + j`.
    pub corners: [Corner; 4],
    /// What the quotient is at a corner of zero, and at least around it.
    pub floor: f64,
    pub depth: usize,
}

/// Proved bounds of the smallest quotient.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Enclosure {
    pub low: f64,
    /// At least the quotient at `at`.
    pub high: f64,
    /// Patch and parameters.
    pub at: Option<(usize, [f64; 2])>,
}

impl Enclosure {
    const UNKNOWN: Self = Self { low: f64::INFINITY, high: f64::INFINITY, at: None };

    /// Take over the smaller upper bound and its place, the first of equal ones.
    fn improve(&mut self, other: &Self) {
        if other.at.is_some() && (self.at.is_none() || other.high < self.high) {
            (self.high, self.at) = (other.high, other.at);
        }
    }
}

/// An increasing function of the quotient: the quantity whose bounds are to meet.
pub(crate) type Measure = fn(f64) -> f64;

/// Whether a lower bound is near enough to a value.
fn near(measure: Measure, low: f64, high: f64, width: f64) -> bool {
    // A negative value is a verdict that no bound improves.
    let (low, high) = (measure(low), measure(high));
    high < 0.0 || low >= high - width * high.abs()
}

/// An upper bound of a quotient by what is above and below, known to the errors; infinite where nothing is known.
fn from_above([above, above_err]: [f64; 2], [below, below_err]: [f64; 2]) -> f64 {
    let (above, below) = (above + above_err, below.abs());
    let quotient = if above > 0.0 {
        let below = below - below_err;
        if below > 0.0 { above / below * UP } else { f64::INFINITY }
    } else {
        above / (below + below_err) * DOWN
    };
    if quotient.is_nan() { f64::INFINITY } else { quotient }
}

impl Quotient {
    fn corner_coefficient(&self, corner: usize) -> usize {
        let [m, n] = self.above.degrees;
        (corner >> 1) * m * (n + 1) + (corner & 1) * n
    }

    /// Bounds of the smallest quotient on the cell, and whether halving it may improve them.
    fn enclose(&self) -> (Enclosure, bool) {
        let (above_err, below_err) = (self.above.err, self.below.err);
        let at: [usize; 4] = std::array::from_fn(|c| self.corner_coefficient(c));
        let zero = |i: usize| (0..4).any(|c| at[c] == i && self.corners[c] != Corner::Ordinary);
        let settled = self.corners.iter().any(|c| *c != Corner::Ordinary);
        let mut low = if settled { self.floor } else { f64::INFINITY };
        let mut open = false;
        for (i, (a, b)) in self.above.coefs.iter().zip(&self.below.coefs).enumerate() {
            let rest = a - above_err;
            if rest > 0.0 {
                low = low.min(rest / (b.abs() + below_err) * DOWN);
            } else {
                open |= !zero(i);
            }
        }
        // Comparisons with NaN are false, so that it is open.
        low = if open || low.is_nan() { f64::NEG_INFINITY } else { low };

        let mut found = Enclosure { low, ..Enclosure::UNKNOWN };
        let [u0, u1, v0, v1] = self.bounds;
        for (c, &i) in at.iter().enumerate() {
            let below = [self.below.coefs[i], below_err];
            let exact = self.corners[c] == Corner::Zero && below[0].abs() > below[1];
            let high = if exact { self.floor } else { from_above([self.above.coefs[i], above_err], below) };
            let place = [[u0, u1][c >> 1], [v0, v1][c & 1]];
            found.improve(&Enclosure { low, high, at: Some((self.patch, place)) });
        }
        let ((a, ea), (b, eb)) = (self.above.centre(), self.below.centre());
        let centre = [0.5 * (u0 + u1), 0.5 * (v0 + v1)];
        found.improve(&Enclosure { low, high: from_above([a, ea], [b, eb]), at: Some((self.patch, centre)) });
        (found, self.depth < MAX_DEPTH && (open || !settled))
    }

    fn halve(&self) -> [Self; 4] {
        let parts = |b: &BoundedBernstein| {
            let [low, high] = b.halve(0);
            let ([a, b], [c, d]) = (low.halve(1), high.halve(1));
            [a, b, c, d]
        };
        let [u0, u1, v0, v1] = self.bounds;
        let (u, v) = (0.5 * (u0 + u1), 0.5 * (v0 + v1));
        let mut halves = parts(&self.above).into_iter().zip(parts(&self.below));
        std::array::from_fn(|corner| {
            let (above, below) = halves.next().expect("four parts");
            self.part(
                above,
                below,
                [[u0, u][corner >> 1], [u, u1][corner >> 1], [v0, v][corner & 1], [v, v1][corner & 1]],
            )
        })
    }

    fn part(&self, above: BoundedBernstein, below: BoundedBernstein, bounds: [f64; 4]) -> Self {
        let corners = std::array::from_fn(|c| {
            let here = |b: &[f64; 4]| [b[c >> 1], b[2 + (c & 1)]];
            if here(&bounds) == here(&self.bounds) { self.corners[c] } else { Corner::Ordinary }
        });
        Self { above, below, patch: self.patch, bounds, corners, floor: self.floor, depth: self.depth + 1 }
    }

    /// The two parts along an axis before and after `t` in [0, 1].
    fn split(&self, axis: usize, t: f64) -> [Self; 2] {
        let (above, below) = (self.above.split(axis, t), self.below.split(axis, t));
        let (start, end) = (self.bounds[2 * axis], self.bounds[2 * axis + 1]);
        let middle = start + t * (end - start);
        let mut halves = above.into_iter().zip(below);
        std::array::from_fn(|half| {
            let (above, below) = halves.next().expect("two parts");
            let mut bounds = self.bounds;
            bounds[2 * axis + 1 - half] = middle;
            self.part(above, below, bounds)
        })
    }

    /// What is left without the squares of side `size` (at most 1/2), relative to the cell, at the corners named.
    pub fn without_corners(self, excluded: u8, size: f64) -> Vec<Self> {
        let Some(corner) = (0..4).find(|c| excluded >> c & 1 == 1) else { return vec![self] };
        // Strips along v, and of those that touch excluded corners what is between.
        let (low, high) = (excluded & 0b0011, excluded & 0b1100);
        let mut strips = Vec::new();
        if low != 0 && high != 0 {
            let [first, rest] = self.split(0, size);
            let [middle, last] = rest.split(0, (1.0 - 2.0 * size) / (1.0 - size));
            strips.extend([(first, low), (middle, 0), (last, high >> 2)]);
        } else if corner < 2 {
            let [first, rest] = self.split(0, size);
            strips.extend([(first, low), (rest, 0)]);
        } else {
            let [rest, last] = self.split(0, 1.0 - size);
            strips.extend([(rest, 0), (last, high >> 2)]);
        }
        strips.into_iter().flat_map(|(strip, ends)| strip.without_ends(ends, size)).collect()
    }

    /// What is left of a strip without its ends of length `size`: bit 0 the start of v, bit 1 its end.
    fn without_ends(self, ends: u8, size: f64) -> Option<Self> {
        let mut left = self;
        if ends & 1 == 1 {
            [_, left] = left.split(1, size);
        }
        if ends & 2 == 2 {
            let t = if ends & 1 == 1 { (1.0 - 2.0 * size) / (1.0 - size) } else { 1.0 - size };
            [left, _] = left.split(1, t);
        }
        let [u0, u1, v0, v1] = left.bounds;
        (u0 < u1 && v0 < v1).then_some(left)
    }
}

/// A cell in the heap, the one with the lowest bound first; of equal ones the first made.
struct Waiting {
    low: f64,
    number: usize,
    may_be_halved: bool,
    cell: Quotient,
}

impl Ord for Waiting {
    fn cmp(&self, other: &Self) -> Ordering {
        other.low.total_cmp(&self.low).then(other.number.cmp(&self.number))
    }
}

impl PartialOrd for Waiting {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Waiting {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Waiting {}

/// What one patch's pieces tell: bounds of those that are done with, and those that may hold the minimum.
struct Scan {
    best: Enclosure,
    waiting: Vec<Waiting>,
}

impl Scan {
    const fn new() -> Self {
        Self { best: Enclosure::UNKNOWN, waiting: Vec::new() }
    }

    fn look_at(&mut self, cell: Quotient, measure: Measure, width: f64) {
        let (found, may_be_halved) = cell.enclose();
        self.best.improve(&found);
        if near(measure, found.low, self.best.high, width) {
            self.best.low = self.best.low.min(found.low);
        } else {
            self.waiting.push(Waiting { low: found.low, number: 0, may_be_halved, cell });
        }
    }

    /// Let go of cells that cannot hold the minimum.
    fn sift(mut self, measure: Measure, width: f64) -> Self {
        let Enclosure { mut low, high, .. } = self.best;
        self.waiting.retain(|waiting| {
            let done = near(measure, waiting.low, high, width);
            low = if done { low.min(waiting.low) } else { low };
            !done
        });
        self.best.low = low;
        self
    }

    fn join(&mut self, other: Self) {
        self.best.improve(&other.best);
        self.best.low = self.best.low.min(other.best.low);
        self.waiting.extend(other.waiting);
    }

    /// Halve the cell with the lowest bound until it is near the value found; the number of cells that took.
    fn finish(mut self, measure: Measure, width: f64) -> (Enclosure, usize) {
        let mut cells = 0;
        let mut heap = BinaryHeap::from_iter(
            self.waiting.into_iter().enumerate().map(|(number, waiting)| Waiting { number, ..waiting }),
        );
        let mut number = heap.len();
        while let Some(worst) = heap.pop() {
            let done = near(measure, worst.low, self.best.high, width);
            let most = MAX_CELLS * COEFFICIENTS / worst.cell.above.coefs.len().max(COEFFICIENTS);
            if done || !worst.may_be_halved || cells >= most {
                self.best.low = self.best.low.min(worst.low);
                break;
            }
            for cell in worst.cell.halve() {
                let (found, may_be_halved) = cell.enclose();
                self.best.improve(&found);
                // Halves are bounded at least as well, but rounded once more.
                heap.push(Waiting { low: found.low.max(worst.low), number, may_be_halved, cell });
                number += 1;
            }
            cells += 4;
        }
        // Rounding may have put the bounds in the wrong order by some ulps.
        self.best.low = self.best.low.min(self.best.high);
        (self.best, cells)
    }
}

/// What is known of the quotients of one patch while its pieces are gone through.
pub(crate) struct Search<const K: usize> {
    scans: [Scan; K],
    measures: [Measure; K],
    width: f64,
}

impl<const K: usize> Search<K> {
    /// Whether a piece whose quotient of a kind is at least `low` may hold a smaller one than those seen.
    pub fn may_improve(&self, kind: usize, low: f64) -> bool {
        let best = self.scans[kind].best.high;
        // NaN may.
        best == f64::INFINITY || !matches!(low.partial_cmp(&best), Some(Ordering::Greater | Ordering::Equal))
    }

    /// Take a piece, or a part of one, into account.
    pub fn look_at(&mut self, kind: usize, cell: Quotient) {
        self.scans[kind].look_at(cell, self.measures[kind], self.width);
    }
}

/// Enclose the smallest quotients of `K` kinds over all pieces of all patches.
///
/// `pieces(k, search)` hands the cells of patch `k` to `search`, one after the other; what it returns is
/// returned patch by patch. The result does not depend on the number of threads. `width` is relative; the number of cells
/// is that beyond the pieces.
pub(crate) fn bounded_minima<const K: usize, R: Send>(
    patches: usize,
    measures: [Measure; K],
    width: f64,
    pieces: impl Fn(usize, &mut Search<K>) -> R + Sync,
) -> ([Enclosure; K], usize, Vec<R>) {
    let (scans, returned): (Vec<[Scan; K]>, Vec<R>) = (0..patches)
        .into_par_iter()
        .map(|k| {
            let mut search = Search { scans: [const { Scan::new() }; K], measures, width };
            let returned = pieces(k, &mut search);
            let mut kinds = measures.into_iter();
            (search.scans.map(|scan| scan.sift(kinds.next().expect("a measure a kind"), width)), returned)
        })
        .unzip();
    let mut joined = [const { Scan::new() }; K];
    for scans in scans {
        for (all, scan) in joined.iter_mut().zip(scans) {
            all.join(scan);
        }
    }
    let mut cells = 0;
    let mut measures = measures.into_iter();
    let found = joined.map(|scan| {
        let (enclosure, more) = scan.finish(measures.next().expect("a measure a kind"), width);
        cells += more;
        enclosure
    });
    (found, cells, returned)
}
