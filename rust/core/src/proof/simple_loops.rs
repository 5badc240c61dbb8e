//! Proof that closed loops of spline curves are simple and pairwise disjoint.
//!
//! Curves become Bézier arcs, halved until every arc and every pair of consecutive arcs is monotone in some
//! direction (all derivative control vectors in an open half plane), hence free of self-intersections. All other
//! pairs of arcs must be separated by a line (separating axes of the control polygons' hulls, a margin for
//! rounding), halving where they are not. A crossing is proved where two sub-arcs traverse a parallelogram from
//! side to opposite side each: by the intermediate value theorem they meet.
//!
//! Work and memory are bounded for the whole call ([`Budget`]): where they end, the loops are undecided.

use crate::numeric::budget::Budget;
use crate::proof::hull::{Hull, cross, extent};
pub use crate::proof::loop_arcs::Place;
use crate::proof::loop_arcs::{Bezier, LoopArc, Slope, arcs_of_loop, frame_of, monotone};
use crate::proof::winding;
use crate::spline::SplineCurve;
use crate::spline::bernstein::{self, SLACK, TINY, U};

/// Degrees up to this are certified: numerators of rational arcs' derivatives have twice the degree, and exact binomials
/// up to that of [`bernstein::MAX_DEGREE`].
pub const MAX_DEGREE: usize = bernstein::MAX_DEGREE / 2;
/// Halvings of an arc while looking for monotone pairs.
const MAX_ROUNDS: usize = 40;
/// Tests spent on one pair of arcs.
const PAIR_BUDGET: usize = 20_000;
/// Crossings after which no more are looked for: one disproves the loops, a few dozen show where they are.
pub const MAX_CROSSINGS: usize = 32;
/// Undecided places kept, beside which further ones tell nothing new.
const MAX_UNDECIDED: usize = 1000;
/// Arcs of a chain that is tried whole: a cluster of knots has at most as many as the degree, up to [`MAX_DEGREE`].
const MAX_CHAIN: usize = 32;
/// Meetings closer than this, relative to the model, are one.
const SAME: f64 = 1e-7;
/// A crossing is located to within this size, relative to the model.
const LOCATED: f64 = 1e-10;

/// What is known about two places that are too close.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeetingKind {
    /// Proved to cross.
    Crossing,
    /// Could not be separated: they touch or nearly so.
    Near,
    /// A single place where the loop turns back on itself (a cusp), or nearly so.
    Cusp,
    /// The search ended here: it would have needed too many pieces.
    Unfinished,
}

/// Two places of the loops that cross or that could not be separated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Meeting {
    /// What is known.
    pub kind: MeetingKind,
    /// First place.
    pub a: Place,
    /// Second place.
    pub b: Place,
    /// Where it is, to about the size of the sub-arcs.
    pub point: [f64; 2],
}

/// Outcome for a set of loops.
#[derive(Clone, Debug, PartialEq)]
pub struct LoopsProof {
    /// Crossings and undecided places; empty when all loops are proved simple and disjoint.
    pub meetings: Vec<Meeting>,
    /// +1 counter-clockwise, -1 clockwise, 0 undecided; meaningful for simple loops.
    pub orientation: Vec<i8>,
    /// For each loop, the loops that wind around it; `None` if undecided.
    pub around: Vec<Option<Vec<usize>>>,
    /// Largest distance between a curve's end and the next one's start (which is taken for both).
    pub gap: f64,
    /// Number of Bézier arcs used.
    pub arcs: usize,
}

/// Examine closed loops: consecutive curves share end points, the last ends where the first starts.
pub fn check_loops(loops: &[Vec<SplineCurve>]) -> LoopsProof {
    let (origin, unit) = frame_of(loops);
    let mut gap: f64 = 0.0;
    let mut chains: Vec<Vec<LoopArc>> = Vec::with_capacity(loops.len());
    let mut meetings = Vec::new();
    for (k, curves) in loops.iter().enumerate() {
        let (arcs, loop_gap) = arcs_of_loop(k, curves, origin, unit);
        gap = gap.max(loop_gap);
        chains.push(arcs);
    }
    let mut pieces: usize = chains.iter().map(Vec::len).sum();
    let budget = Budget::new(pieces);
    for arcs in &mut chains {
        make_monotone(arcs, &mut meetings, &mut pieces, &budget);
    }
    let hulls: Vec<Vec<Hull>> =
        chains.iter().map(|arcs| arcs.iter().map(|a| a.bezier.hull()).collect()).collect();
    separate(&chains, &hulls, &budget, &mut meetings);
    let orientation =
        chains.iter().zip(&hulls).map(|(arcs, hulls)| winding::orientation(arcs, hulls, &budget)).collect();
    let boxes: Vec<[f64; 4]> = hulls.iter().map(|hulls| enclosing(hulls)).collect();
    let around = (0..chains.len())
        .map(|k| {
            let Some(first) = hulls[k].first() else { return Some(Vec::new()) };
            let mut around = Vec::new();
            for m in (0..chains.len()).filter(|&m| m != k) {
                // A loop does not wind around what lies off its hull.
                if overlap(&first.bounds(), &boxes[m])
                    && winding::winding_number(&chains[m], &hulls[m], first, &budget)? != 0
                {
                    around.push(m);
                }
            }
            Some(around)
        })
        .collect();
    for meeting in &mut meetings {
        for d in 0..2 {
            meeting.point[d] = meeting.point[d] * unit + origin[d];
        }
    }
    let arcs = chains.iter().map(Vec::len).sum();
    LoopsProof { meetings, orientation, around, gap, arcs }
}

fn overlap(a: &[f64; 4], b: &[f64; 4]) -> bool {
    a[0] <= b[1] && b[0] <= a[1] && a[2] <= b[3] && b[2] <= a[3]
}

/// Bounds of all hulls of a loop.
fn enclosing(hulls: &[Hull]) -> [f64; 4] {
    let nothing = [f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY];
    hulls
        .iter()
        .map(Hull::bounds)
        .fold(nothing, |a, b| [a[0].min(b[0]), a[1].max(b[1]), a[2].min(b[2]), a[3].max(b[3])])
}

/// Halve arcs until there are four or more and every two consecutive ones are monotone together.
///
/// `pieces` counts the arcs of all loops.
fn make_monotone(arcs: &mut Vec<LoopArc>, meetings: &mut Vec<Meeting>, pieces: &mut usize, budget: &Budget) {
    for round in 0.. {
        let n = arcs.len();
        if n == 0 {
            return;
        }
        let mut split = vec![n < 4; n];
        let mut bad = Vec::new();
        for i in 0..n {
            let (a, b) = (&arcs[i], &arcs[(i + 1) % n]);
            if !monotone(&[&a.slope, &b.slope]) {
                bad.push(i);
                if a.slope.is_lost() || b.slope.is_lost() {
                    continue;
                }
                let alone = [&a.slope, &b.slope].map(|s| monotone(&[s]));
                let both = alone[0] && alone[1];
                split[i] |= both || !alone[0];
                split[(i + 1) % n] |= both || !alone[1];
            }
        }
        let more = split.iter().filter(|&&s| s).count();
        let ends = round == MAX_ROUNDS || more == 0;
        if ends || !budget.allows_parts(*pieces + more) {
            let kind = if ends { MeetingKind::Cusp } else { MeetingKind::Unfinished };
            for i in bad.into_iter().take(MAX_UNDECIDED) {
                let (a, b) = (&arcs[i], &arcs[(i + 1) % n]);
                let point = b.bezier.hull().start();
                meetings.push(Meeting { kind, a: a.place(1.0), b: b.place(0.0), point });
            }
            return;
        }
        *pieces += more;
        *arcs = arcs
            .drain(..)
            .zip(split)
            .flat_map(|(arc, split)| if split { Vec::from(arc.halve()) } else { vec![arc] })
            .collect();
    }
}

/// Separate all pairs of arcs that are not neighbours, or report where that fails.
fn separate(chains: &[Vec<LoopArc>], hulls: &[Vec<Hull>], budget: &Budget, meetings: &mut Vec<Meeting>) {
    let index: Vec<(usize, usize)> =
        chains.iter().enumerate().flat_map(|(k, arcs)| (0..arcs.len()).map(move |i| (k, i))).collect();
    let boxes: Vec<[f64; 4]> = hulls.iter().flatten().map(Hull::bounds).collect();
    let mut order: Vec<usize> = (0..index.len()).collect();
    order.sort_by(|&a, &b| boxes[a][0].total_cmp(&boxes[b][0]).then(a.cmp(&b)));
    let mut active: Vec<usize> = Vec::new();
    let mut found = Found::default();
    'search: for &b in &order {
        active.retain(|&a| boxes[a][1] >= boxes[b][0]);
        budget.spend(active.len());
        for &a in &active {
            let (first, second) = (a.min(b), a.max(b));
            if !overlap(&boxes[a], &boxes[b]) || neighbours(chains, index[a], index[b]) {
                continue;
            }
            if hulls[index[a].0][index[a].1].separated(&hulls[index[b].0][index[b].1], budget) {
                continue;
            }
            if monotone_chain(chains, index[first], index[second]) {
                continue;
            }
            if let Some(meeting) = separate_pair(chains, index[first], index[second], budget) {
                found.add(meeting);
            }
            if budget.is_spent() || found.crossings.len() == MAX_CROSSINGS {
                break 'search;
            }
        }
        active.push(b);
        // Also where the spending is the sweep's.
        if budget.is_spent() {
            let (k, i) = index[b];
            let (arc, point) = (&chains[k][i], hulls[k][i].start());
            found.add(Meeting { kind: MeetingKind::Unfinished, a: arc.place(0.0), b: arc.place(1.0), point });
            break;
        }
    }
    meetings.extend(found.sorted());
}

/// Meetings of pairs of arcs, those at one place once.
#[derive(Default)]
struct Found {
    crossings: Vec<Meeting>,
    others: Vec<Meeting>,
}

impl Found {
    fn add(&mut self, meeting: Meeting) {
        let crosses = meeting.kind == MeetingKind::Crossing;
        let list = if crosses { &mut self.crossings } else { &mut self.others };
        if list.len() < MAX_UNDECIDED && !list.iter().any(|other| close(other, &meeting)) {
            list.push(meeting);
        }
    }

    /// Crossings first, without other places where there is a crossing; each kind by its place.
    fn sorted(mut self) -> Vec<Meeting> {
        let crossings = self.crossings;
        self.others.retain(|other| !crossings.iter().any(|crossing| close(crossing, other)));
        let mut all = [crossings, self.others].concat();
        all.sort_by_key(|m| {
            (m.kind != MeetingKind::Crossing, m.a.loop_index, m.a.curve, m.b.loop_index, m.b.curve)
        });
        all
    }
}

fn close(a: &Meeting, b: &Meeting) -> bool {
    (a.point[0] - b.point[0]).hypot(a.point[1] - b.point[1]) < SAME
}

/// Whether two arcs of a loop do not meet because all arcs from one to the other are monotone in one direction.
///
/// The pieces between nearly equal knots may be too short to hold their neighbours apart.
fn monotone_chain(chains: &[Vec<LoopArc>], a: (usize, usize), b: (usize, usize)) -> bool {
    let arcs = &chains[a.0];
    let chain = |from: usize, steps: usize| {
        let slopes = || (0..=steps).map(|k| &arcs[(from + k) % arcs.len()].slope).collect::<Vec<&Slope>>();
        steps <= MAX_CHAIN && monotone(&slopes())
    };
    let steps = b.1.abs_diff(a.1);
    a.0 == b.0 && (chain(a.1.min(b.1), steps) || chain(a.1.max(b.1), arcs.len() - steps))
}

fn neighbours(chains: &[Vec<LoopArc>], a: (usize, usize), b: (usize, usize)) -> bool {
    let n = chains[a.0].len();
    a.0 == b.0 && (a.1.abs_diff(b.1) <= 1 || a.1.abs_diff(b.1) == n - 1)
}

/// A part of an arc over the parameters `s` of the arc.
#[derive(Clone)]
struct Part {
    bezier: Bezier,
    hull: Hull,
    s: [f64; 2],
}

impl Part {
    fn length(&self) -> f64 {
        self.s[1] - self.s[0]
    }

    fn halve(&self) -> [Self; 2] {
        let middle = 0.5 * (self.s[0] + self.s[1]);
        let [a, b] = self.bezier.halve();
        let part = |bezier: Bezier, s| Self { hull: bezier.hull(), bezier, s };
        [part(a, [self.s[0], middle]), part(b, [middle, self.s[1]])]
    }
}

fn separate_pair(
    chains: &[Vec<LoopArc>],
    a: (usize, usize),
    b: (usize, usize),
    budget: &Budget,
) -> Option<Meeting> {
    let whole = |(k, i): (usize, usize)| {
        let bezier = chains[k][i].bezier.clone();
        Part { hull: bezier.hull(), bezier, s: [0.0, 1.0] }
    };
    let meeting = |kind, pa: &Part, pb: &Part| {
        let place = |(k, i): (usize, usize), part: &Part| chains[k][i].place(0.5 * (part.s[0] + part.s[1]));
        Meeting { kind, a: place(a, pa), b: place(b, pb), point: pa.hull.start() }
    };
    let mut near = None;
    let mut left = PAIR_BUDGET;
    let mut stack = vec![(whole(a), whole(b), false)];
    while let Some((pa, pb, mut crosses)) = stack.pop() {
        if pa.hull.separated(&pb.hull, budget) {
            continue;
        }
        // Near the end of a part a crossing shows only on parts that reach farther.
        let wide = || pa.length().max(pb.length()) <= 0.25;
        crosses |= crossing(&pa.hull, &pb.hull)
            || wide() && crossing(&window(&chains[a.0], a.1, pa.s), &window(&chains[b.0], b.1, pb.s));
        let (size_a, size_b) = (extent(&pa.hull.points), extent(&pb.hull.points));
        let size = size_a.max(size_b);
        if crosses && size < LOCATED {
            return Some(meeting(MeetingKind::Crossing, &pa, &pb));
        }
        left = left.saturating_sub(1);
        // Halving, windows and the test for a crossing take some products of every two points.
        budget.spend(16 * pa.hull.points.len() * pb.hull.points.len());
        let exhausted = left == 0 || budget.is_spent();
        // Not so where the bound is NaN either.
        let parts_may_differ = size >= 64.0 * (pa.hull.err + pb.hull.err);
        if exhausted || !parts_may_differ {
            let kind = match crosses {
                true => MeetingKind::Crossing,
                false if exhausted => MeetingKind::Unfinished,
                false => MeetingKind::Near,
            };
            near.get_or_insert_with(|| meeting(kind, &pa, &pb));
            left = left.min(PAIR_BUDGET / 10);
            if exhausted {
                break;
            }
        } else if size_a >= size_b {
            let [low, high] = pa.halve();
            stack.push((high, pb.clone(), crosses));
            stack.push((low, pb, crosses));
        } else {
            let [low, high] = pb.halve();
            stack.push((pa.clone(), high, crosses));
            stack.push((pa, low, crosses));
        }
    }
    near
}

/// The chain over the parameters `s` of an arc, widened by three times its length on either side, into less
/// than half of the neighbouring arcs (so that windows of arcs with one arc between them stay apart).
fn window(arcs: &[LoopArc], i: usize, s: [f64; 2]) -> Hull {
    let n = arcs.len();
    let reach = 3.0 * (s[1] - s[0]);
    let (from, to) = (s[0] - reach, s[1] + reach);
    let mut hull = arcs[i].bezier.restrict(from.max(0.0), to.min(1.0)).hull();
    if from < 0.0 {
        let before = arcs[(i + n - 1) % n].bezier.restrict((1.0 + from).max(0.55), 1.0).hull();
        hull = before.joined(hull);
    }
    if to > 1.0 {
        hull = hull.joined(arcs[(i + 1) % n].bezier.restrict(0.0, (to - 1.0).min(0.45)).hull());
    }
    hull
}

/// Whether two chains are proved to cross.
///
/// In the oblique frame of the two chords, chain A stays between the lines y = min A and y = max A and runs
/// from left of all of B to right of it; B likewise from below all of A to above. Within the parallelogram that
/// the four lines bound, one path joins left and right and the other bottom and top.
fn crossing(a: &Hull, b: &Hull) -> bool {
    let e1 = [a.end()[0] - a.start()[0], a.end()[1] - a.start()[1]];
    let mut e2 = [b.end()[0] - b.start()[0], b.end()[1] - b.start()[1]];
    let (mut low, mut high) = (b.start(), b.end());
    if cross(e1, e2) < 0.0 {
        e2 = [-e2[0], -e2[1]];
        (low, high) = (high, low);
    }
    let x = |p: [f64; 2]| cross(p, e2);
    let y = |p: [f64; 2]| cross(e1, p);
    let margin =
        |e: [f64; 2], of: &Hull| SLACK * (of.err + 4.0 * U * of.reach) * (e[0].abs() + e[1].abs()) + TINY;
    let (mx, my) = (margin(e2, a) + margin(e2, b), margin(e1, a) + margin(e1, b));
    let left = b.points.iter().all(|&p| x(p) > x(a.start()) + mx);
    let right = b.points.iter().all(|&p| x(p) < x(a.end()) - mx);
    let below = a.points.iter().all(|&p| y(p) > y(low) + my);
    let above = a.points.iter().all(|&p| y(p) < y(high) - my);
    left && right && below && above
}

#[cfg(test)]
#[path = "simple_loops_tests.rs"]
mod tests;
