//! The nearest point on the sides of patches, for points outside.

use super::boxes::{BoxTree, Rectangle};
use super::sheet::{Net, Part, Sheet, Work};

/// To what share of its distance the nearest point is the nearest one: of points that are equally far, as on a circle from
/// its centre, all would have to be compared to the last digit.
const SHARE: f64 = 1e-6;

/// Steps from the point that halving has found to the nearest one: they square the error.
const STEPS: usize = 8;

/// A knot span of a side, of the patch with that number.
#[derive(Clone, Copy)]
struct Piece {
    sheet: usize,
    /// Direction that runs along the side; in the other one both limits are the same.
    axis: usize,
    part: Part,
}

/// The nearest point that was found.
#[derive(Clone, Copy, Debug)]
pub(super) struct Nearest {
    pub sheet: usize,
    pub at: [f64; 2],
    pub distance: f64,
}

/// All sides of all patches.
pub(super) struct Border {
    pieces: Vec<Piece>,
    tree: BoxTree,
}

impl Border {
    pub fn new(sheets: &[Sheet], slack: f64) -> Self {
        let mut pieces = vec![];
        for (number, sheet) in sheets.iter().enumerate() {
            let ends = [0, 1].map(|d| sheet.domain(d));
            for part in sheet.parts() {
                for across in 0..2 {
                    for (limit, end) in [part.low[across], part.high[across]].into_iter().zip(ends[across]) {
                        if limit == end {
                            let mut part = part;
                            (part.low[across], part.high[across]) = (end, end);
                            pieces.push(Piece { sheet: number, axis: 1 - across, part });
                        }
                    }
                }
            }
        }
        let mut net = Net::default();
        let bounds = |piece: &Piece| Rectangle::around(control_points(sheets, piece, &mut net), slack);
        let boxes: Vec<Rectangle> = pieces.iter().map(bounds).collect();
        Self { tree: BoxTree::new(&boxes), pieces }
    }

    /// The point of all sides that is nearest to `x`, if it is within `limit`.
    pub fn nearest(&self, sheets: &[Sheet], x: [f64; 2], limit: f64, slack: f64) -> Option<Nearest> {
        let (mut best, mut work, mut net, mut stack) = (None, Work::default(), Net::default(), vec![]);
        let margin = |distance: f64| slack.max(SHARE * distance);
        // Pieces are given up when they cannot be nearer by more than the margin.
        self.tree.nearest(x, limit + 2.0 * margin(limit), |number, least| {
            stack.push(self.pieces[number]);
            while let Some(piece) = stack.pop() {
                let (below, along) = below_distance(control_points(sheets, &piece, &mut net), x);
                if below + margin(*least) >= *least && best.is_some() || below > *least {
                    continue;
                }
                let Piece { sheet, axis, part } = piece;
                let mut at = part.low;
                at[axis] += along * (part.high[axis] - part.low[axis]);
                let distance = away(sheets[sheet].jet(part.span, at, &mut work).point, x);
                if distance < *least {
                    *least = distance;
                    best = Some((piece, at));
                }
                if let Some(halves) = part.halves(axis) {
                    let nearer_last = if along < 0.5 { [1, 0] } else { [0, 1] };
                    stack.extend(nearer_last.map(|h| Piece { sheet, axis, part: halves[h] }));
                }
            }
        });
        let (piece, at) = best?;
        let found = settle(&sheets[piece.sheet], &piece, at, x, &mut work);
        (found.distance <= limit).then_some(found)
    }
}

/// Bézier points of a piece.
fn control_points<'a>(
    sheets: &[Sheet],
    piece: &Piece,
    net: &'a mut Net,
) -> impl Iterator<Item = &'a [f64; 2]> + Clone {
    let sheet = &sheets[piece.sheet];
    sheet.net(&piece.part, net);
    // All rows across are the same.
    let step = if piece.axis == 0 { sheet.degrees[1] + 1 } else { 1 };
    net.points.iter().step_by(step).take(sheet.degrees[piece.axis] + 1)
}

fn away(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// A number that no point of the curve is nearer to `x` than, and where along its chord that is (0 to 1): it stays as near
/// to the chord as its control points do.
fn below_distance<'a>(points: impl Iterator<Item = &'a [f64; 2]> + Clone, x: [f64; 2]) -> (f64, f64) {
    let start = *points.clone().next().expect("a curve has control points");
    let end = *points.clone().last().expect("a curve has control points");
    let d = [end[0] - start[0], end[1] - start[1]];
    let length2 = d[0] * d[0] + d[1] * d[1];
    let from_chord = |p: [f64; 2]| {
        let along = (p[0] - start[0]) * d[0] + (p[1] - start[1]) * d[1];
        let along = if length2 > 0.0 { (along / length2).clamp(0.0, 1.0) } else { 0.0 };
        (away(p, [start[0] + along * d[0], start[1] + along * d[1]]), along)
    };
    let off = points.map(|&p| from_chord(p).0).fold(0.0, f64::max);
    let (distance, along) = from_chord(x);
    (distance - off, along)
}

/// Along the piece's knot span to where the distance no longer falls.
fn settle(sheet: &Sheet, piece: &Piece, at: [f64; 2], x: [f64; 2], work: &mut Work) -> Nearest {
    let (axis, span) = (piece.axis, piece.part.span);
    let whole = sheet.whole(span);
    let mut jet = sheet.jet(span, at, work);
    let mut best = Nearest { sheet: piece.sheet, at, distance: away(jet.point, x) };
    for _ in 0..STEPS {
        let (r, d) = ([0, 1].map(|c| x[c] - jet.point[c]), jet.by[axis]);
        let step = (d[0] * r[0] + d[1] * r[1]) / (d[0] * d[0] + d[1] * d[1]);
        let mut next = best.at;
        next[axis] = (next[axis] + step).clamp(whole.low[axis], whole.high[axis]);
        if next[axis].is_nan() {
            break;
        }
        jet = sheet.jet(span, next, work);
        let distance = away(jet.point, x);
        if distance >= best.distance {
            break;
        }
        (best.at, best.distance) = (next, distance);
    }
    best
}
