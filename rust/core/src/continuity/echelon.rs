//! Dense systems of full row rank, solved for as many unknowns as they have rows.

/// Solution of a system with as many pivots as rows.
pub(super) struct Echelon {
    /// (n, k): from the right-hand side to unknowns, of which all but the pivots are 0.
    pub solution: Vec<f64>,
    /// (n, n - k): null vectors as columns, sparser than orthonormal ones, because the unknowns that are no pivots are
    /// their coordinates.
    pub null: Vec<f64>,
}

/// Solve ``matrix y = b``, (k, n) and of full row rank, by Gauss-Jordan with complete pivoting.
pub(super) fn echelon(matrix: &[f64], [k, n]: [usize; 2]) -> Echelon {
    if n == 0 {
        return Echelon { solution: vec![], null: vec![] };
    }
    let wide = n + k;
    let mut work = vec![0.0; k * wide];
    for i in 0..k {
        work[i * wide..i * wide + n].copy_from_slice(&matrix[i * n..(i + 1) * n]);
        work[i * wide + n + i] = 1.0;
    }
    let mut pivots = vec![usize::MAX; k];
    let mut top = vec![0.0; wide];
    for _ in 0..k {
        let (row, column) = largest(&work, wide, n, &pivots);
        pivots[row] = column;
        let pivot = work[row * wide + column];
        top.iter_mut().zip(&work[row * wide..]).for_each(|(t, w)| *t = w / pivot);
        for (i, line) in work.chunks_exact_mut(wide).enumerate() {
            let factor = line[column];
            if i == row {
                line.copy_from_slice(&top);
            } else if factor != 0.0 {
                line.iter_mut().zip(&top).for_each(|(w, t)| *w -= factor * t);
            }
        }
    }
    let mut is_pivot = vec![false; n];
    pivots.iter().for_each(|&column| is_pivot[column] = true);
    let others: Vec<usize> = (0..n).filter(|&c| !is_pivot[c]).collect();
    let rest = others.len();
    let (mut solution, mut null) = (vec![0.0; n * k], vec![0.0; n * rest]);
    for (line, &column) in work.chunks_exact(wide).zip(&pivots) {
        solution[column * k..(column + 1) * k].copy_from_slice(&line[n..]);
        others.iter().enumerate().for_each(|(j, &other)| null[column * rest + j] = -line[other]);
    }
    others.iter().enumerate().for_each(|(j, &other)| null[other * rest + j] = 1.0);
    Echelon { solution, null }
}

/// Row and column of the largest entry of rows that have no pivot yet.
fn largest(work: &[f64], wide: usize, n: usize, pivots: &[usize]) -> (usize, usize) {
    let (mut best, mut found) = (-1.0, (0, 0));
    for (row, line) in work.chunks_exact(wide).enumerate().filter(|(row, _)| pivots[*row] == usize::MAX) {
        for (column, value) in line[..n].iter().enumerate() {
            if value.abs() > best {
                (best, found) = (value.abs(), (row, column));
            }
        }
    }
    found
}
