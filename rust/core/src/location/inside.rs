//! The parameters of a point that lies in a cell: Newton's method within the knot span, and where it fails, halving.

use super::cell::Cell;
use super::sheet::{Jet, Net, Part, Sheet, Work};

/// Newton steps at most. It takes four or five at regular points; at a corner whose Jacobian vanishes the residual falls
/// by a factor of four a step, which is 25 steps for all digits.
const STEPS: usize = 40;

/// Steps that may fail to halve the residual: the first ones of a bent cell do, and those at rounding.
const POOR_STEPS: usize = 3;

/// Parts of a cell that are looked at before it is given up: ten times as many as two to four at every halving down to the
/// last digit of either parameter. Next to a side that is a single point there would be any number.
const PARTS: usize = 4096;

/// Room to work, reused from point to point.
#[derive(Default)]
pub(super) struct Room {
    work: Work,
    net: Net,
    stack: Vec<Cell>,
}

/// The nearest point of a knot span that was found.
#[derive(Clone, Copy, Debug)]
pub(super) struct Found {
    pub at: [f64; 2],
    pub distance: f64,
    jet: Jet,
}

impl Found {
    /// Whether the point is so near a side of its patch that the one across may hold it, too.
    pub fn is_at_side(&self, sheet: &Sheet, slack: f64) -> bool {
        let [u, v] = self.jet.by;
        let det = (u[0] * v[1] - u[1] * v[0]).abs();
        (0..2).any(|d| {
            let along = self.jet.by[1 - d];
            let nearest =
                sheet.domain(d).map(|end| (self.at[d] - end).abs()).into_iter().fold(f64::INFINITY, f64::min);
            // Four times: it is a distance to the first order only.
            nearest * det <= 4.0 * slack * along[0].hypot(along[1])
        })
    }
}

/// Newton's method for B = x in a knot span, from `start`: the nearest point on its way. Limits of the span hold it back;
/// there it goes on along the limit, to the nearest point of that.
pub(super) fn newton(
    sheet: &Sheet,
    span: [usize; 2],
    x: [f64; 2],
    start: [f64; 2],
    slack: f64,
    room: &mut Room,
) -> Found {
    let whole = sheet.whole(span);
    let evaluate = |at: [f64; 2], work: &mut Work| {
        let jet = sheet.jet(span, at, work);
        Found { at, distance: (jet.point[0] - x[0]).hypot(jet.point[1] - x[1]), jet }
    };
    let mut here = evaluate(start, &mut room.work);
    let (mut best, mut poor) = (here, 0);
    for _ in 0..STEPS {
        // A sixteenth of what is accepted: another step may still bring digits, then not.
        if best.distance <= slack / 16.0 || poor > POOR_STEPS {
            break;
        }
        let step = step(&here, x, &whole);
        let next = [0, 1].map(|d| (here.at[d] + step[d]).clamp(whole.low[d], whole.high[d]));
        if next == here.at || next.iter().any(|t| t.is_nan()) {
            break;
        }
        here = evaluate(next, &mut room.work);
        poor += usize::from(here.distance > 0.5 * best.distance);
        if here.distance < best.distance {
            best = here;
        }
    }
    best
}

/// A Newton step; along a limit where that holds it back, or where the derivatives have one direction only.
fn step(here: &Found, x: [f64; 2], whole: &Part) -> [f64; 2] {
    let r = [0, 1].map(|c| x[c] - here.jet.point[c]);
    let [u, v] = here.jet.by;
    let dot = |a: [f64; 2], b: [f64; 2]| a[0] * b[0] + a[1] * b[1];
    let along = |d: usize| {
        let length2 = dot(here.jet.by[d], here.jet.by[d]);
        if length2 > 0.0 { dot(here.jet.by[d], r) / length2 } else { 0.0 }
    };
    let det = u[0] * v[1] - u[1] * v[0];
    if det == 0.0 {
        return if dot(u, u) >= dot(v, v) { [along(0), 0.0] } else { [0.0, along(1)] };
    }
    let full = [(r[0] * v[1] - r[1] * v[0]) / det, (u[0] * r[1] - u[1] * r[0]) / det];
    let held = |d: usize, step: f64| {
        (here.at[d] == whole.low[d] && step < 0.0) || (here.at[d] == whole.high[d] && step > 0.0)
    };
    match (held(0, full[0]), held(1, full[1])) {
        (false, false) => full,
        (true, false) => [0.0, along(1)],
        (false, true) => [along(0), 0.0],
        // Held in a corner by both, it may still go along one of them.
        (true, true) => {
            let single = [along(0), along(1)];
            [0, 1].map(|d| if held(d, single[d]) { 0.0 } else { single[d] })
        }
    }
}

/// A point of the cell within `slack` of `x`, if there is one: parts whose control points stay away from x have none, and
/// the others are halved until Newton's method goes from one of them to it.
pub(super) fn search(sheet: &Sheet, cell: &Cell, x: [f64; 2], slack: f64, room: &mut Room) -> Option<Found> {
    let mut stack = std::mem::take(&mut room.stack);
    stack.clear();
    stack.push(*cell);
    let mut found = None;
    for _ in 0..PARTS {
        let Some(cell) = stack.pop() else { break };
        let Some((start, _)) = cell.guess(x) else { continue };
        let reached = newton(sheet, cell.part.span, x, start, slack, room);
        if reached.distance <= slack {
            found = Some(reached);
            break;
        }
        if let Some(halves) = cell.halves() {
            stack.extend(halves.map(|part| Cell::new(sheet, part, slack, &mut room.net)));
        }
    }
    room.stack = stack;
    found
}
