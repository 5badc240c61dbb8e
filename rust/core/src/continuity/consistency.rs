//! Which rows of a group can hold together.

use super::RANK_TOLERANCE;
use crate::numeric::dense::{NoConvergence, product, svd};

/// Which of the rows ``dense y = -fixed``, (m, n) and (m, 2), to keep so that they can hold together to `tolerance`; the
/// first in `order` stay.
pub(super) fn consistent(
    dense: &[f64],
    n: usize,
    fixed: &[[f64; 2]],
    tolerance: f64,
    order: &[i64],
) -> Result<Vec<bool>, NoConvergence> {
    let m = fixed.len();
    let holds = |kept: &[bool]| -> Result<bool, NoConvergence> {
        let rows: Vec<usize> = (0..m).filter(|&i| kept[i]).collect();
        let matrix: Vec<f64> = rows.iter().flat_map(|&i| &dense[i * n..(i + 1) * n]).copied().collect();
        let b: Vec<[f64; 2]> = rows.iter().map(|&i| fixed[i]).collect();
        Ok(violation(&matrix, n, &b)? <= tolerance)
    };
    let mut kept = vec![true; m];
    if holds(&kept)? {
        return Ok(kept);
    }
    kept.fill(false);
    let mut sequence: Vec<usize> = (0..m).collect();
    sequence.sort_by_key(|&i| order[i]);
    for i in sequence {
        kept[i] = true;
        kept[i] = holds(&kept)?;
    }
    Ok(kept)
}

/// Largest entry of ``matrix y + fixed`` for the y with the least sum of squares.
fn violation(matrix: &[f64], n: usize, fixed: &[[f64; 2]]) -> Result<f64, NoConvergence> {
    let m = fixed.len();
    if m == 0 {
        return Ok(0.0);
    }
    let found = svd(matrix, [m, n], false)?;
    let largest = found.sigma.first().copied().unwrap_or(0.0);
    let rank = found.sigma.iter().filter(|&&s| s > RANK_TOLERANCE * largest).count();
    Ok(missed(&found.u, rank, fixed).into_iter().flatten().fold(0.0, |a, x| a.max(x.abs())))
}

/// What of the vectors `fixed`, (m, 2), lies outside of the span of the first `rank` columns of `u`, row-major.
pub(super) fn missed(u: &[f64], rank: usize, fixed: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let m = fixed.len();
    let wide = u.len() / m;
    let inside: Vec<f64> = (0..m).flat_map(|i| &u[i * wide..i * wide + rank]).copied().collect();
    let across: Vec<f64> = (0..rank).flat_map(|k| (0..m).map(move |i| u[i * wide + k])).collect();
    let part = product(&inside, &product(&across, fixed.as_flattened(), [rank, m, 2]), [m, rank, 2]);
    fixed.iter().zip(part.as_chunks::<2>().0).map(|(f, p)| [f[0] - p[0], f[1] - p[1]]).collect()
}
