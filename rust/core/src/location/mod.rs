//! Where points lie in a multi-patch: which patch, and at which parameters.
//!
//! Patches are cut into cells on which their map is nearly affine. A tree of boxes gives the cells that may hold a point;
//! in a cell's own directions its box is so narrow that it is mostly one. From there Newton's method goes to the point.
//! Where it does not, the cell is halved until it does or no part is left: control points bound a patch, so nothing is
//! missed and nothing is taken for inside that is not. Each point is found by itself, in any order.

mod border;
mod boxes;
mod cell;
mod inside;
mod sheet;
#[cfg(test)]
mod tests;

use border::Border;
use boxes::BoxTree;
use cell::{Cell, cells};
use inside::{Found, Room, newton, search};
use rayon::prelude::*;
use sheet::Sheet;

use crate::spline::SplinePatch;
use crate::spline::bernstein::{U, power_of_two_above};

/// Distance that counts as none, in units of roundoff of the largest coordinate: a point that was evaluated by whatever
/// route, and our own evaluation of it, each lose about as many units as the two degrees have together, twice for weights.
const SLACK_ULPS: f64 = 128.0;

/// Points that a thread takes at once.
const CHUNK: usize = 256;

/// Where a point lies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Number of the patch.
    pub patch: usize,
    /// Parameters.
    pub at: [f64; 2],
}

/// Patches prepared for finding points.
pub struct Locator {
    origin: [f64; 2],
    unit: f64,
    /// What counts as no distance, in that unit.
    slack: f64,
    sheets: Vec<Sheet>,
    /// Cells of all patches, one patch after the other, and which patch they are of.
    cells: Vec<(u32, Cell)>,
    tree: BoxTree,
    border: Border,
}

impl Locator {
    /// Prepare at least one patch, with finite control points and positive weights.
    pub fn new(patches: &[SplinePatch]) -> Self {
        let all = || patches.iter().flat_map(|p| &p.points);
        // Halves, or the sum of two coordinates might overflow.
        let limit =
            |c: usize, of: fn(f64, f64) -> f64| all().map(|p| 0.5 * p[c]).reduce(of).expect("a patch");
        let (low, high) = ([0, 1].map(|c| limit(c, f64::min)), [0, 1].map(|c| limit(c, f64::max)));
        let origin = [0, 1].map(|c| low[c] + high[c]);
        let unit = power_of_two_above((high[0] - low[0]).max(high[1] - low[1]));
        let largest = all().flatten().fold(0.0, |m: f64, x| m.max(x.abs()));
        let slack = SLACK_ULPS * U * (largest / unit).max(1.0);
        let moved = |p: [f64; 2]| [0, 1].map(|c| p[c] / unit - origin[c] / unit);
        let sheets: Vec<Sheet> = patches.par_iter().map(|p| Sheet::new(p, moved)).collect();
        let each: Vec<Vec<Cell>> = sheets.par_iter().map(|sheet| cells(sheet, slack)).collect();
        let numbered =
            each.into_iter().zip(0..).flat_map(|(cells, k)| cells.into_iter().map(move |c| (k, c)));
        let cells: Vec<(u32, Cell)> = numbered.collect();
        let boxes: Vec<_> = cells.iter().map(|(_, cell)| cell.bounds).collect();
        let border = Border::new(&sheets, slack);
        Self { origin, unit, slack, sheets, tree: BoxTree::new(&boxes), cells, border }
    }

    /// The places of points, in parallel. A point outside that is at most `tolerance` from a side gets the nearest point of
    /// the sides; others have none. Of several patches that hold a point, the first.
    pub fn locate(&self, points: &[[f64; 2]], tolerance: f64) -> Vec<Option<Place>> {
        let chunks = points.par_chunks(CHUNK).flat_map_iter(|chunk| {
            let (mut room, mut candidates) = (Room::default(), vec![]);
            chunk.iter().map(move |&x| self.place(x, tolerance, &mut room, &mut candidates))
        });
        chunks.collect()
    }

    fn place(
        &self,
        x: [f64; 2],
        tolerance: f64,
        room: &mut Room,
        candidates: &mut Vec<Candidate>,
    ) -> Option<Place> {
        let x = [0, 1].map(|c| x[c] / self.unit - self.origin[c] / self.unit);
        candidates.clear();
        self.tree.containing(x, |number| {
            if let Some((start, off_centre)) = self.cells[number].1.guess(x) {
                candidates.push(Candidate { off_centre, number, start });
            }
        });
        self.inside(x, room, candidates).or_else(|| {
            let limit = (tolerance / self.unit).max(self.slack);
            let nearest = self.border.nearest(&self.sheets, x, limit, self.slack)?;
            Some(Place { patch: nearest.sheet, at: nearest.at })
        })
    }

    /// The place of a point that lies in one of the candidates.
    fn inside(&self, x: [f64; 2], room: &mut Room, candidates: &mut [Candidate]) -> Option<Place> {
        candidates
            .sort_unstable_by(|a, b| a.off_centre.total_cmp(&b.off_centre).then(a.number.cmp(&b.number)));
        let mut first = None;
        for candidate in candidates.iter() {
            let (sheet, cell) = &self.cells[candidate.number];
            let own = &self.sheets[*sheet as usize];
            let found = newton(own, cell.part.span, x, candidate.start, self.slack, room);
            if found.distance <= self.slack {
                if !found.is_at_side(own, self.slack) {
                    return Some(place(*sheet, &found));
                }
                first = Some((*sheet, found));
                break;
            }
        }
        // On a side the patch across may come first; and where Newton's method failed, a point may be there all the same.
        candidates.sort_unstable_by_key(|candidate| candidate.number);
        for candidate in candidates.iter() {
            let (sheet, cell) = &self.cells[candidate.number];
            if first.is_some_and(|(known, _)| known <= *sheet) {
                break;
            }
            if let Some(found) = search(&self.sheets[*sheet as usize], cell, x, self.slack, room) {
                return Some(place(*sheet, &found));
            }
        }
        first.map(|(sheet, found)| place(sheet, &found))
    }
}

/// A cell that may hold a point.
struct Candidate {
    /// Distance from its centre, 1 at its limits.
    off_centre: f64,
    number: usize,
    /// Where in it the point may be.
    start: [f64; 2],
}

fn place(sheet: u32, found: &Found) -> Place {
    Place { patch: sheet as usize, at: found.at }
}
