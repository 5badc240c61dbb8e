//! How much work and memory a proof may use: shared by a whole call, counted, never by the clock.

use std::cell::Cell;

/// Products with one point that are made at most, about two seconds' work.
///
/// Loops of thousands of curves that lie close together need some 10⁷; what needs more has places by the thousand that
/// cannot be told apart.
const WORK: usize = 400_000_000;
/// Pieces that the curves given may be cut into, beside [`PIECES_A_CURVE`] for each: with some hundred bytes a piece
/// these are tens of megabytes.
const PIECES: usize = 20_000;
/// Pieces for each Bézier arc of the curves: monotone pieces of a curve of degree p are about 2 p.
const PIECES_A_CURVE: usize = 4;

/// What is left of a call's work.
#[derive(Debug)]
pub(crate) struct Budget {
    work: Cell<usize>,
    pieces: usize,
}

impl Budget {
    /// For loops of so many Bézier arcs.
    pub fn new(arcs: usize) -> Self {
        Self { work: Cell::new(WORK), pieces: PIECES + PIECES_A_CURVE * arcs }
    }

    pub fn spend(&self, work: usize) {
        self.work.set(self.work.get().saturating_sub(work));
    }

    pub fn is_spent(&self) -> bool {
        self.work.get() == 0
    }

    /// Whether the loops may be cut into so many pieces.
    pub fn allows_parts(&self, parts: usize) -> bool {
        parts <= self.pieces
    }
}
