//! Proof or disproof of `det J > 0` on spline patches, by Bernstein coefficients and subdivision.
//!
//! On a Bézier piece det J is a polynomial; if all its Bernstein coefficients exceed the rounding bound it is
//! positive. Coefficients at the piece's corners are values of det J; one below minus the bound is a disproof.
//! Otherwise the piece is halved in both directions. A rational piece uses the numerator
//! `det[[X, Y, W], [X_u, Y_u, W_u], [X_v, Y_v, W_v]] = W³ det J`.
//!
//! At a patch corner det J is a positive multiple of the area of a triangle of three control points, whose sign is
//! found exactly: where one patch fills a straight angle it may vanish there, but must not be negative.

use rayon::prelude::*;

pub use crate::proof::determinant_cell::{Cell, CellKind};
use crate::proof::determinant_cell::{DeterminantCell, Verdict};
pub use crate::proof::patch_determinant::DATA_ULPS;
use crate::proof::patch_determinant::PatchDeterminant;
use crate::spline::SplinePatch;
use crate::spline::bernstein::{self, U, larger};

/// Degrees up to this are certified: the Bernstein coefficients of a rational patch's determinant have three times the
/// degree less one, and exact binomials up to that of [`bernstein::MAX_DEGREE`].
pub const MAX_DEGREE: usize = (bernstein::MAX_DEGREE + 1) / 3;
/// Mean of det J, relative to its largest coefficient, up to which the area is the rounding of a sum.
const NO_AREA: f64 = 1e-14;
/// Coefficients of a cell of degree about five; cells with more are as many fewer.
const COEFFICIENTS: usize = 100;
/// Bytes that the cells of one patch may take: some ten thousand of moderate degree.
const MAX_BYTES: usize = 32 << 20;
/// Cells of one kind reported for a patch, the worst ones.
const REPORTED: usize = 32;

/// How far the proof goes before it gives up.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Halvings of a Bézier piece in each direction.
    pub max_depth: usize,
    /// Sub-cells of moderate degree examined in one patch; fewer of high degree.
    pub max_cells: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self { max_depth: 20, max_cells: 50_000 }
    }
}

impl Limits {
    /// Sub-cells examined in all patches together, some seconds' work; every patch has its share, and this at least.
    const ALL_CELLS: usize = 2_000_000;
    const LEAST_CELLS: usize = 2_000;

    /// One patch's share among `patches`.
    fn shared_by(self, patches: usize) -> Self {
        let share = (Self::ALL_CELLS / patches.max(1)).max(Self::LEAST_CELLS);
        Self { max_cells: self.max_cells.min(share), ..self }
    }

    /// Sub-cells with so many coefficients that may be examined.
    fn cells(&self, coefficients: usize) -> usize {
        self.max_cells * COEFFICIENTS / coefficients.max(COEFFICIENTS)
    }
}

/// Outcome for one patch.
#[derive(Clone, Debug, PartialEq)]
pub struct PatchProof {
    /// Proved lower bound of det J relative to its mean; negative where nothing better was proved.
    pub lower_bound: f64,
    /// Whether the sign handed over is that of the patch's area. Otherwise the area's sign was used.
    pub sign_agrees: bool,
    /// Failing or degenerate cells, folded first, the worst of each kind first.
    pub cells: Vec<Cell>,
    /// Number of sub-cells examined beyond the Bézier pieces.
    pub subdivisions: usize,
}

/// What a row of Bézier pieces left over.
#[derive(Default)]
struct Row {
    integral: f64,
    /// Bound on the error of the integral.
    uncertain: f64,
    low: f64,
    largest: f64,
    open: Vec<DeterminantCell>,
}

fn examine(jacobian: &PatchDeterminant<'_>, sign: f64) -> Vec<Row> {
    let row = |i: usize| {
        let mut row = Row { low: f64::INFINITY, ..Row::default() };
        for j in 0..jacobian.spans(1) {
            let cell = jacobian.piece([i, j], sign);
            row.integral += cell.integral();
            row.largest = larger(row.largest, cell.det.magnitude() + cell.det.err);
            row.uncertain += cell.uncertainty();
            if matches!(cell.judge(), Verdict::Proved) {
                row.low = row.low.min(cell.lower_bound());
            } else {
                row.open.push(cell);
            }
        }
        row
    };
    (0..jacobian.spans(0)).into_par_iter().with_min_len(4).map(row).collect()
}

/// Cells under examination in turn, and what was found about those that are settled.
struct Search<'a> {
    limits: &'a Limits,
    /// What det J is relative to, and the units of the parameters.
    scale: f64,
    units: [f64; 2],
    low: f64,
    failing: Vec<Cell>,
    subdivisions: usize,
}

impl Search<'_> {
    /// Halve cells until all are settled or the limits are reached.
    fn run(&mut self, mut queue: Vec<DeterminantCell>) {
        for depth in 0.. {
            let mut next = Vec::new();
            for cell in queue {
                let size = cell.det.coefs.len();
                let fits = depth < self.limits.max_depth
                    && self.subdivisions < self.limits.cells(size)
                    && next.len() * size * size_of::<f64>() < MAX_BYTES;
                if !self.settle(&cell, fits) {
                    self.subdivisions += 4;
                    next.extend(cell.halve());
                }
            }
            if next.is_empty() {
                return;
            }
            queue = next;
        }
    }

    /// Take down what is known about a cell; false where it is open and may be halved.
    fn settle(&mut self, cell: &DeterminantCell, may_be_halved: bool) -> bool {
        let failing = match cell.judge() {
            Verdict::Proved => None,
            Verdict::Degenerate(corner) => Some((CellKind::Degenerate, corner)),
            Verdict::BelowRounding(corner) => Some((CellKind::BelowRounding, corner)),
            Verdict::Folded(corner) => Some((CellKind::Folded, corner)),
            Verdict::Open if may_be_halved => return false,
            Verdict::Open => Some((CellKind::Undecided, cell.lowest_corner())),
        };
        let low = match failing {
            Some((CellKind::Degenerate, _)) => 0.0,
            _ => cell.lower_bound(),
        };
        self.low = self.low.min(low);
        self.failing.extend(failing.map(|(kind, corner)| cell.report(kind, corner, self.scale, self.units)));
        true
    }
}

/// Prove or disprove `sign · det J > 0` on a patch.
///
/// Degrees must not exceed [`MAX_DEGREE`].
pub fn certify_patch(patch: &SplinePatch, sign: f64, limits: &Limits) -> PatchProof {
    let jacobian = PatchDeterminant::new(patch);
    let mut rows = examine(&jacobian, sign);
    let mut total: f64 = rows.iter().map(|r| r.integral).sum();
    let opposite = total < 0.0;
    if opposite {
        rows = examine(&jacobian, -sign);
        total = rows.iter().map(|r| r.integral).sum();
    }
    let domain: f64 = jacobian.knots.iter().map(|k| k[k.len() - 1] - k[0]).product();
    let largest = rows.iter().map(|r| r.largest).fold(0.0, larger);
    let mean = total / domain;
    // A patch without area has no mean; its values are then relative to the largest coefficient.
    let scale = if mean > NO_AREA * largest { mean } else { largest.max(f64::MIN_POSITIVE) };
    // A positive bound holds relative to the largest mean that rounding allows.
    let pieces = jacobian.spans(0) * jacobian.spans(1);
    let off = rows.iter().map(|r| r.uncertain).sum::<f64>() / domain + (pieces + 64) as f64 * U * largest;
    let relative = |low: f64| if low > 0.0 { low / (scale + off) * (1.0 - 4.0 * U) } else { low / scale };
    let low = rows.iter().map(|r| r.low).fold(f64::INFINITY, f64::min);
    let units = jacobian.units;
    let mut search = Search { limits, scale, units, low, failing: vec![], subdivisions: 0 };
    search.run(rows.into_iter().flat_map(|r| r.open).collect());
    PatchProof {
        lower_bound: relative(search.low),
        sign_agrees: !opposite,
        cells: worst(search.failing),
        subdivisions: search.subdivisions,
    }
}

/// The worst cells of each kind, folded ones first.
fn worst(mut cells: Vec<Cell>) -> Vec<Cell> {
    cells.sort_by(|a, b| b.kind.cmp(&a.kind).then(a.value.total_cmp(&b.value)));
    let mut seen = [0; 4];
    cells.retain(|cell| {
        let count = &mut seen[cell.kind as usize];
        *count += 1;
        *count <= REPORTED
    });
    cells
}

/// [`certify_patch`] for several patches at once; the result does not depend on the number of threads.
pub fn certify_patches(patches: &[SplinePatch], signs: &[f64], limits: &Limits) -> Vec<PatchProof> {
    let limits = limits.shared_by(patches.len());
    patches.par_iter().zip(signs).map(|(patch, &sign)| certify_patch(patch, sign, &limits)).collect()
}

#[cfg(test)]
#[path = "injectivity_tests.rs"]
mod tests;
