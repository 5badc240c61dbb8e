//! Cyclic tridiagonal systems.

/// Solve a symmetric positive definite system whose entries off the diagonal are `next[i]` between `i` and the one after
/// it, the last and the first being neighbours, in place.
///
/// The last unknown is eliminated from the rest (bordering), the rest without pivoting. With one or two unknowns
/// entries that fall on the same place add up.
pub fn solve_cyclic(diagonal: &[f64], next: &[f64], x: &mut [f64]) {
    let n = diagonal.len();
    if n == 1 {
        x[0] /= diagonal[0] + 2.0 * next[0];
        return;
    }
    let m = n - 1;
    let mut border = vec![0.0; m];
    border[m - 1] += next[m - 1];
    border[0] += next[m];
    let right = border.clone();
    let mut pivots = diagonal[..m].to_vec();
    for i in 1..m {
        let factor = next[i - 1] / pivots[i - 1];
        pivots[i] -= factor * next[i - 1];
        x[i] -= factor * x[i - 1];
        border[i] -= factor * border[i - 1];
    }
    for i in (0..m).rev() {
        if i + 1 < m {
            x[i] -= next[i] * x[i + 1];
            border[i] -= next[i] * border[i + 1];
        }
        x[i] /= pivots[i];
        border[i] /= pivots[i];
    }
    let dot = |a: &[f64]| -> f64 { right.iter().zip(a).map(|(r, a)| r * a).sum() };
    x[m] = (x[m] - dot(&x[..m])) / (diagonal[m] - dot(&border));
    let last = x[m];
    x[..m].iter_mut().zip(&border).for_each(|(x, b)| *x -= b * last);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_solution_fulfils_the_system(
            rows in prop::collection::vec((0.01f64..3.0, -1.0f64..1.0, -1.0f64..1.0), 1..12),
            open in any::<bool>(),
        ) {
            let n = rows.len();
            let mut next: Vec<f64> = rows.iter().map(|r| r.1).collect();
            if open {
                next[n - 1] = 0.0;
            }
            // Diagonally dominant, hence definite.
            let diagonal: Vec<f64> = (0..n).map(|i| rows[i].0 + next[i].abs() + next[(i + n - 1) % n].abs()).collect();
            let right: Vec<f64> = rows.iter().map(|r| r.2).collect();
            let mut x = right.clone();
            solve_cyclic(&diagonal, &next, &mut x);
            let mut back: Vec<f64> = (0..n).map(|i| diagonal[i] * x[i]).collect();
            for i in 0..n {
                let j = (i + 1) % n;
                back[i] += next[i] * x[j];
                back[j] += next[i] * x[i];
            }
            for (found, wanted) in back.iter().zip(&right) {
                prop_assert!((found - wanted).abs() < 1e-9, "{found} for {wanted}");
            }
        }
    }
}
