//! Orientation and winding number of closed loops of arcs, by the polygon of their chords.

use std::borrow::Cow;

use crate::numeric::budget::Budget;
use crate::proof::hull::{Hull, cross, extent, minus};
use crate::proof::loop_arcs::{Bezier, LoopArc};
use crate::spline::bernstein::{SLACK, TINY, U, larger};

/// Chords below this length have no direction: products with them may underflow.
const SHORT: f64 = 1e-140;

/// Sense of a simple loop: +1 counter-clockwise, -1 clockwise, 0 undecided.
///
/// The area between an arc and its chord is at most the largest distance from the chord times the length of the
/// control polygon; the polygon of chords decides once it outweighs all of that. `hulls` are the arcs' hulls.
pub(crate) fn orientation(arcs: &[LoopArc], hulls: &[Hull], budget: &Budget) -> i8 {
    let mut parts: Vec<Bezier> = Vec::new();
    let mut hulls = Cow::Borrowed(hulls);
    for round in 0..8 {
        if round > 0 {
            if !budget.allows_parts(2 * hulls.len()) {
                return 0;
            }
            let whole = arcs.iter().map(|a| &a.bezier).filter(|_| round == 1);
            parts = whole.chain(&parts).flat_map(Bezier::halve).collect();
            hulls = parts.iter().map(Bezier::hull).collect();
        }
        let (mut area, mut uncertain, mut total) = (0.0, 0.0, 0.0);
        for hull in hulls.iter() {
            let (a, b) = (hull.start(), hull.end());
            area += 0.5 * cross(a, b);
            total += cross(a, b).abs();
            let chord = minus(b, a);
            let length = chord[0].hypot(chord[1]);
            let off = |&p: &[f64; 2]| {
                let d = minus(p, a);
                if length > SHORT { cross(chord, d).abs() / length } else { d[0].hypot(d[1]) }
            };
            let polygon: f64 =
                hull.points.windows(2).map(|w| minus(w[1], w[0])).map(|d| d[0].hypot(d[1])).sum();
            let distance = hull.points.iter().map(off).fold(0.0, larger);
            uncertain +=
                distance * polygon + 4.0 * (hull.err + 8.0 * U * hull.reach) * (polygon + hull.reach);
        }
        // Adding n numbers rounds n times, relative to the sum of their sizes.
        if area.abs() > SLACK * (uncertain + hulls.len() as f64 * 4.0 * U * total) + TINY {
            return if area > 0.0 { 1 } else { -1 };
        }
    }
    0
}

/// Winding number of a loop about the first point of `around`, `None` if that is too close to the loop.
///
/// Arcs whose hull stays away from the point may be replaced by their chords; others are halved. The angles under
/// which the chords are seen add up to a multiple of 2π. `hulls` are the arcs' hulls.
pub(crate) fn winding_number(
    arcs: &[LoopArc],
    hulls: &[Hull],
    around: &Hull,
    budget: &Budget,
) -> Option<i32> {
    let y = around.start();
    let mut point = Hull { points: vec![y], err: 0.0, reach: 1.0 };
    let mut uncertain = 0.0;
    let mut angle_under = |hull: &Hull, point: &mut Hull| {
        point.err = around.err + 1e3 * (hull.err + U);
        let (a, b) = (minus(hull.start(), y), minus(hull.end(), y));
        point.separated(hull, budget).then(|| {
            // Neighbouring chords share their joint but for the rounding of a quotient by weights.
            uncertain += 16.0 * U * (1.0 + hull.reach / a[0].hypot(a[1]).min(b[0].hypot(b[1])));
            cross(a, b).atan2(a[0] * b[0] + a[1] * b[1])
        })
    };
    let mut total = 0.0;
    for (arc, hull) in arcs.iter().zip(hulls) {
        if let Some(angle) = angle_under(hull, &mut point) {
            total += angle;
            continue;
        }
        let mut stack = vec![arc.bezier.clone()];
        while let Some(part) = stack.pop() {
            for half in part.halve() {
                let hull = half.hull();
                let parts_may_differ = extent(&hull.points) > point.err && !budget.is_spent();
                match angle_under(&hull, &mut point) {
                    Some(angle) => total += angle,
                    None if parts_may_differ => stack.push(half),
                    // Smaller parts would not come off the point either.
                    None => return None,
                }
            }
        }
    }
    (uncertain < 1.0).then(|| (total / std::f64::consts::TAU).round() as i32)
}
