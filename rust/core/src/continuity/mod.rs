//! A sparse basis of the maps that satisfy continuity rows, by local elimination.
//!
//! Rows with a slave are read as substitutions ([`substitution`]); what other rows say about the points that remain is
//! solved in the small groups that they tie together, one around every extraordinary vertex or around several that are
//! close ([`groups`]). Rows that couple a whole interface are first solved for the points that belong to that interface
//! alone ([`interfaces`]). The derivation is in `docs/continuity.md`.

use crate::numeric::dense::NoConvergence;
use crate::numeric::sparse::{Cholesky, CscMatrix, SparseError, gram, upper_triangle};
use std::sync::OnceLock;
use thiserror::Error;

mod consistency;
mod echelon;
mod groups;
mod interfaces;
mod lift;
mod nearest;
mod sparse_rows;
mod substitution;
#[cfg(test)]
mod tests;

use lift::Reduced;
pub use nearest::nearest;
pub use sparse_rows::SparseRows;
use sparse_rows::Sum;

/// Singular values below this are zero; rows have unit size (the gap is from 0.01 to 1e-15 in nearly all models).
const RANK_TOLERANCE: f64 = 1e-10;
/// Entries below this are rounding.
const ROUNDING: f64 = 1e-13;

/// Why rows are not eliminated.
#[derive(Debug, Error, Clone, PartialEq, Eq)]
pub enum ContinuityError {
    /// Substitutions that need each other.
    #[error("C1 rows depend on each other in a circle")]
    Circle,
    /// A coefficient is not finite.
    #[error(transparent)]
    NoConvergence(#[from] NoConvergence),
    /// ZᵀZ cannot be factorized.
    #[error(transparent)]
    Sparse(#[from] SparseError),
}

/// Rows B u = 0 on shared control points.
#[derive(Debug, Clone, Default)]
pub struct Rows {
    /// One row for every equation, one column for every point.
    pub matrix: SparseRows,
    /// The point that a row expresses by others, with the factor -1; none for rows that are no substitution.
    pub slave: Vec<Option<usize>>,
    /// Where a row comes from.
    pub interface: Vec<usize>,
    /// Which rows to keep first where not all can hold: lower numbers.
    pub order: Vec<i64>,
}

impl Rows {
    fn without(&self, interfaces: &[usize]) -> (Self, Vec<usize>) {
        let kept: Vec<usize> =
            (0..self.slave.len()).filter(|&r| !interfaces.contains(&self.interface[r])).collect();
        let rows = Self {
            matrix: self.matrix.select(&kept),
            slave: kept.iter().map(|&r| self.slave[r]).collect(),
            interface: kept.iter().map(|&r| self.interface[r]).collect(),
            order: kept.iter().map(|&r| self.order[r]).collect(),
        };
        (rows, kept)
    }
}

/// All maps with given boundary points that satisfy the rows.
pub struct RowSpace {
    active: SparseRows,
    interior: Vec<usize>,
    basis: CscMatrix<f64>,
    particular: SparseRows,
    dropped: Vec<usize>,
    redundant: usize,
    /// Of ZᵀZ, once a map is projected.
    normal: OnceLock<Result<Cholesky, SparseError>>,
}

impl RowSpace {
    /// Eliminate the rows for given boundary points.
    ///
    /// Points not in `interior`, which is sorted, are fixed. Where rows contradict them, rows are dropped.
    pub fn new(rows: &Rows, interior: &[usize], points: &[[f64; 2]]) -> Result<Self, ContinuityError> {
        let mut free = vec![false; points.len()];
        interior.iter().for_each(|&i| free[i] = true);
        let together = !(0..rows.slave.len()).any(|r| rows.slave[r].is_some_and(|s| free[s]));
        let reduced =
            if together { interfaces::solved(rows, &free)? } else { substitution::substituted(rows, &free)? };
        let solved = groups::solved(&reduced, points, &rows.order)?;
        if together && !solved.dropped.is_empty() {
            return Self::without_contradictions(rows, &solved.dropped, interior, points);
        }
        let (basis, particular) = assembled(&reduced, &solved, interior);
        let active = (0..rows.slave.len()).filter(|r| solved.dropped.binary_search(r).is_err());
        Ok(Self {
            active: rows.matrix.select(&active.collect::<Vec<_>>()),
            interior: interior.to_vec(),
            basis,
            particular,
            dropped: solved.dropped,
            redundant: solved.redundant,
            normal: OnceLock::new(),
        })
    }

    /// Equations are combinations of an interface's rows here: it loses them all if one is contradicted.
    fn without_contradictions(
        rows: &Rows,
        dropped: &[usize],
        interior: &[usize],
        points: &[[f64; 2]],
    ) -> Result<Self, ContinuityError> {
        let lost: Vec<usize> = dropped.iter().map(|&r| rows.interface[r]).collect();
        let (fewer, kept) = rows.without(&lost);
        let mut space = Self::new(&fewer, interior, points)?;
        let inner: Vec<usize> = space.dropped.iter().map(|&r| kept[r]).collect();
        space.dropped = (0..rows.slave.len())
            .filter(|r| lost.contains(&rows.interface[*r]) || inner.binary_search(r).is_ok())
            .collect();
        Ok(space)
    }

    /// (interior, m): columns span the displacements of the interior points that keep the rows.
    pub fn basis(&self) -> &CscMatrix<f64> {
        &self.basis
    }

    /// (interior, points): from the boundary points to interior points that satisfy the rows.
    pub fn particular(&self) -> &SparseRows {
        &self.particular
    }

    /// Rows that the boundary contradicts, sorted; of rows without slaves all those of an interface.
    pub fn dropped(&self) -> &[usize] {
        &self.dropped
    }

    /// How many active rows follow from the others.
    pub fn redundant(&self) -> usize {
        self.redundant
    }

    /// The map nearest to `points` that satisfies the rows and has the same boundary.
    pub fn project(&self, points: &[[f64; 2]]) -> Result<Vec<[f64; 2]>, SparseError> {
        let mut moved = points.to_vec();
        let start = self.particular.times(points);
        let m = self.basis.ncols();
        // Both components, one after the other.
        let mut along = vec![0.0; 2 * m];
        for (i, j, v) in self.basis.triplet_iter() {
            for c in 0..2 {
                along[c * m + j] += v * (points[self.interior[i]][c] - start[i][c]);
            }
        }
        self.normal.get_or_init(|| normal(&self.basis)).as_ref().map_err(Clone::clone)?.solve(&mut along);
        self.interior.iter().zip(start).for_each(|(&i, x)| moved[i] = x);
        for (i, j, v) in self.basis.triplet_iter() {
            for c in 0..2 {
                moved[self.interior[i]][c] += v * along[c * m + j];
            }
        }
        Ok(moved)
    }

    /// Largest residual of an active row, a length.
    pub fn residual(&self, points: &[[f64; 2]]) -> f64 {
        self.active.times(points).iter().map(|[x, y]| x.hypot(*y)).fold(0.0, f64::max)
    }
}

fn normal(basis: &CscMatrix<f64>) -> Result<Cholesky, SparseError> {
    let upper = upper_triangle(&gram(basis));
    let mut factor = Cholesky::analyse(upper.col_offsets(), upper.row_indices(), None)?;
    factor.factorize(upper.values())?;
    Ok(factor)
}

/// Basis and particular solution on the interior points: lifted from the unknowns that were solved for.
fn assembled(reduced: &Reduced, solved: &groups::Solved, interior: &[usize]) -> (CscMatrix<f64>, SparseRows) {
    let n = reduced.lift.points();
    let (mut basis, mut particular) = (SparseRows::new(solved.width), SparseRows::new(n));
    let (mut along, mut at_fixed) = (Sum::new(solved.width), Sum::new(n));
    for &point in interior {
        let (columns, weights) = reduced.lift.of(point);
        for (&column, &weight) in columns.iter().zip(weights) {
            if let Some(unknown) = column.checked_sub(n) {
                along.add_row(weight, solved.null.row(unknown));
                at_fixed.add_row(weight, solved.particular.row(unknown));
            } else {
                at_fixed.add(column, weight);
            }
        }
        along.finish(&mut basis);
        at_fixed.finish(&mut particular);
    }
    (basis.by_columns(), particular)
}
