//! The piece of a trace in one triangle, and which other pieces it crosses there.

use std::cmp::Ordering;

use super::charts::Direction;

/// The point at a share of the way.
pub fn between(a: [f64; 2], b: [f64; 2], t: f64) -> [f64; 2] {
    [a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t]
}

/// The share of the way from `a` to `b` at which `x` lies, within the way.
fn share(a: f64, b: f64, x: f64) -> f64 {
    // A chord through a corner may have no length.
    if a == b { 0.0 } else { ((x - a) / (b - a)).clamp(0.0, 1.0) }
}

/// An end of a chord on the circumference of its triangle, comparable with those of other chords: corner or side, then
/// the place on the side counter-clockwise, then who crossed the side first.
pub type Rim = (usize, f64, i64);

fn compare(a: &Rim, b: &Rim) -> Ordering {
    a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2))
}

/// Where a trace crosses an edge.
#[derive(Debug, Clone, Copy)]
pub struct Gate {
    /// From the smaller vertex of the edge to the larger one.
    pub fraction: f64,
    /// Number among all gates.
    pub serial: i64,
    /// Where it is in the plane.
    pub point: [f64; 2],
}

/// How a trace comes into a triangle.
#[derive(Debug, Clone, Copy)]
pub struct Entry {
    /// The triangle.
    pub face: usize,
    /// Where it goes in the triangle's chart.
    pub direction: Direction,
    /// Coordinate to the left, constant.
    pub line: f64,
    /// Coordinate forward.
    pub forward: f64,
    /// When.
    pub time: f64,
    /// Where in the plane.
    pub point: [f64; 2],
    /// Where on the rim.
    pub rim: Rim,
}

/// The piece of a trace in one triangle.
#[derive(Debug, Clone, Copy)]
pub struct Chord {
    /// The trace.
    pub trace: usize,
    /// Number of triangles that it crossed before.
    pub step: usize,
    /// Where it comes in.
    pub entry: Entry,
    /// Side of the triangle where it leaves.
    pub exit: usize,
    /// Coordinate forward where it leaves.
    pub forward: f64,
    /// When it leaves.
    pub time: f64,
    /// Where it leaves on the rim.
    pub rim: Rim,
    /// Where it leaves on the edge.
    pub gate: Gate,
    /// The chord laid before in the same triangle.
    pub before: Option<usize>,
}

impl Chord {
    /// Time at which it has a coordinate forward.
    pub fn time_at(&self, forward: f64) -> f64 {
        let start = self.entry.time;
        start + share(self.entry.forward, self.forward, forward) * (self.time - start)
    }

    /// Place in the plane at a time.
    pub fn point_at(&self, time: f64) -> [f64; 2] {
        between(self.entry.point, self.gate.point, share(self.entry.time, self.time, time))
    }

    /// Time at which it crosses the line of a chord across.
    pub fn time_on(&self, other: &Self) -> f64 {
        let same_sense = (other.entry.direction + 1) % 4 == self.entry.direction;
        self.time_at(if same_sense { other.entry.line } else { -other.entry.line })
    }

    /// Whether a place on the rim is on its left; `None` at its own ends.
    fn has_left(&self, place: &Rim) -> Option<bool> {
        let (from, to) = (&self.entry.rim, &self.rim);
        let (a, b) = (compare(place, from), compare(place, to));
        if a == Ordering::Equal || b == Ordering::Equal {
            return None;
        }
        // Counter-clockwise from the exit back to the entry is the left.
        Some(if compare(from, to) == Ordering::Less {
            a.is_lt() || b.is_gt()
        } else {
            a.is_lt() && b.is_gt()
        })
    }

    /// If the other chord crosses this one: whether it comes from the left.
    pub fn crossed_from_left(&self, other: &Self) -> Option<bool> {
        let (from, to) = (self.has_left(&other.entry.rim)?, self.has_left(&other.rim)?);
        (from != to).then_some(from)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chord of the triangle (0, 0), (1, 0), (0, 1) in one of the directions, at a coordinate to its left.
    fn chord(direction: Direction, line: f64, span: [f64; 2], rim: [Rim; 2]) -> Chord {
        let entry =
            Entry { face: 0, direction, line, forward: span[0], time: 2.0, point: [0.0; 2], rim: rim[0] };
        let gate = Gate { fraction: 0.0, serial: 0, point: [1.0, 0.0] };
        let time = 2.0 + span[1] - span[0];
        Chord { trace: 0, step: 0, entry, exit: 0, forward: span[1], time, rim: rim[1], gate, before: None }
    }

    #[test]
    fn chords_cross_by_the_order_of_their_ends() {
        // To the right at height 0.25, from the side u = 0 to the long one; upwards at u = 0.5, from the lower side.
        let right = chord(0, 0.25, [0.0, 0.75], [(5, 0.75, 1), (3, 0.25, 2)]);
        let up = chord(1, -0.5, [0.0, 0.5], [(1, 0.5, 3), (3, 0.5, 4)]);
        assert_eq!(right.crossed_from_left(&up), Some(false));
        assert_eq!(up.crossed_from_left(&right), Some(true));
        assert_eq!((right.time_on(&up), up.time_on(&right)), (2.5, 2.25));
        assert_eq!(right.point_at(2.5), [2.0 / 3.0, 0.0]);
    }

    #[test]
    fn chords_through_one_place_of_a_side_are_ordered_by_who_came_first() {
        let right = chord(0, 0.5, [0.0, 0.5], [(5, 0.5, 1), (3, 0.5, 2)]);
        let before = chord(1, -0.5, [0.0, 0.5], [(1, 0.5, 3), (3, 0.5, 1)]);
        let after = chord(1, -0.5, [0.0, 0.5], [(1, 0.5, 3), (3, 0.5, 4)]);
        assert_eq!(right.crossed_from_left(&before), None);
        assert_eq!(right.crossed_from_left(&after), Some(false));
    }

    #[test]
    fn chords_from_one_corner_do_not_cross() {
        let right = chord(0, 0.0, [0.0, 1.0], [(0, 0.0, 0), (3, 0.0, 2)]);
        let up = chord(1, 0.0, [0.0, 1.0], [(0, 0.0, 0), (3, 1.0, 4)]);
        assert_eq!(right.crossed_from_left(&up), None);
    }
}
