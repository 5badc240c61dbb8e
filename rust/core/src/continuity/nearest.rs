//! The nearest points that satisfy a few rows.

use super::SparseRows;
use crate::numeric::sparse::{Cholesky, SparseError, gram, upper_triangle};

/// Part of the largest pivot that is added to all, against those that rounding leaves of dependent rows: far below what
/// shows in the points.
const LIFTED: f64 = 1e-13;

/// The nearest points that satisfy the rows with the indices `chosen`, moving the points that are `free` only.
///
/// Columns of every row must be sorted and distinct.
pub fn nearest(
    rows: &SparseRows,
    chosen: &[usize],
    free: &[bool],
    points: &[[f64; 2]],
) -> Result<Vec<[f64; 2]>, SparseError> {
    let mut movable = SparseRows::new(points.len());
    let mut kept = vec![];
    for &row in chosen {
        // Points that are all fixed cannot be brought nearer to a row.
        if rows.row(row).0.iter().any(|&point| free[point]) {
            movable.push(rows.entries(row).filter(|entry| free[entry.0]));
            kept.push(row);
        }
    }
    let m = kept.len();
    let residuals = rows.select(&kept).times(points);
    let by_row = movable.clone().transposed();
    let mut matrix = upper_triangle(&gram(&by_row));
    let mut factor = Cholesky::analyse(matrix.col_offsets(), matrix.row_indices(), None)?;
    let pivots = factor.diagonal();
    let largest = pivots.iter().map(|&at| matrix.values()[at]).fold(0.0, f64::max);
    pivots.iter().for_each(|&at| matrix.values_mut()[at] += LIFTED * largest);
    factor.factorize(matrix.values())?;
    // Both components, one after the other.
    let mut forces: Vec<f64> = [0, 1].iter().flat_map(|&c| residuals.iter().map(move |r| r[c])).collect();
    factor.solve(&mut forces);
    let mut moved = points.to_vec();
    for row in 0..m {
        for (point, value) in movable.entries(row) {
            moved[point][0] -= value * forces[row];
            moved[point][1] -= value * forces[m + row];
        }
    }
    Ok(moved)
}
