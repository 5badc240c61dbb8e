//! Symmetric matrices of 2 × 2 blocks, one row of blocks a point: pattern, product, scalar part.

use crate::numeric::sparse::{SparseError, Symbolic};

/// Blocks (r, s) with r ≤ s; block k of the pattern has the values `[4 k..4 k + 4]`, row by row.
#[derive(Debug)]
pub(crate) struct BlockPattern {
    /// `columns[s]..columns[s + 1]` of `rows`: the points r ≤ s in ascending order, s itself last.
    pub columns: Vec<usize>,
    pub rows: Vec<u32>,
}

/// Half the trace of a block: the mean of the matrices of either component.
pub(crate) fn scalar_part(values: &[f64], k: usize) -> f64 {
    0.5 * (values[4 * k] + values[4 * k + 3])
}

impl BlockPattern {
    /// Number of points.
    pub fn points(&self) -> usize {
        self.columns.len() - 1
    }

    /// Number of blocks.
    pub fn blocks(&self) -> usize {
        self.rows.len()
    }

    /// The blocks of column s above the diagonal, and the place of the diagonal one.
    fn column(&self, s: usize) -> (std::ops::Range<usize>, usize) {
        let last = self.columns[s + 1] - 1;
        debug_assert_eq!(self.rows[last] as usize, s);
        (self.columns[s]..last, last)
    }

    /// The pattern of a matrix with one number for every block.
    pub fn scalar_symbolic(&self, order: Option<&[usize]>) -> Result<Symbolic, SparseError> {
        Symbolic::narrow(self.columns.iter().map(|&c| c as u32).collect(), self.rows.clone(), order)
    }

    /// The pattern of the whole matrix, x and y of a point side by side.
    pub fn symbolic(&self, order: Option<&[usize]>) -> Result<Symbolic, SparseError> {
        let (mut offsets, mut rows) = (vec![0], Vec::with_capacity(4 * self.blocks()));
        for s in 0..self.points() {
            let (above, _) = self.column(s);
            for component in 0..2 {
                rows.extend(self.rows[above.clone()].iter().flat_map(|&r| [2 * r, 2 * r + 1]));
                rows.extend((0..=component).map(|c| 2 * s as u32 + c));
                offsets.push(rows.len() as u32);
            }
        }
        let pairs: Option<Vec<usize>> = order.map(|o| o.iter().flat_map(|&i| [2 * i, 2 * i + 1]).collect());
        Symbolic::narrow(offsets, rows, pairs.as_deref())
    }

    /// The values in the order of [`Self::symbolic`].
    pub fn by_columns(&self, values: &[f64], out: &mut Vec<f64>) {
        out.clear();
        out.reserve_exact(4 * self.blocks() - self.points());
        for s in 0..self.points() {
            let (above, diagonal) = self.column(s);
            let whole = &values[4 * above.start..4 * above.end];
            for component in 0..2 {
                out.extend(whole.chunks_exact(4).flat_map(|b| [b[component], b[2 + component]]));
                out.extend((0..=component).map(|c| values[4 * diagonal + 2 * c + component]));
            }
        }
    }

    /// `y = A x`, components interleaved.
    pub fn multiply(&self, values: &[f64], x: &[f64], y: &mut [f64]) {
        y.fill(0.0);
        for s in 0..self.points() {
            let (above, diagonal) = self.column(s);
            let [x0, x1] = [x[2 * s], x[2 * s + 1]];
            let b: &[f64; 4] = values[4 * diagonal..].first_chunk().expect("four values a block");
            let mut sum = [b[0] * x0 + b[1] * x1, b[1] * x0 + b[3] * x1];
            for (&r, b) in self.rows[above.clone()].iter().zip(values[4 * above.start..].chunks_exact(4)) {
                let r = 2 * r as usize;
                let [r0, r1] = [x[r], x[r + 1]];
                y[r] += b[0] * x0 + b[1] * x1;
                y[r + 1] += b[2] * x0 + b[3] * x1;
                sum[0] += b[0] * r0 + b[2] * r1;
                sum[1] += b[1] * r0 + b[3] * r1;
            }
            y[2 * s] += sum[0];
            y[2 * s + 1] += sum[1];
        }
    }

    /// `y = A x` for a matrix with one number for every block, on both components.
    pub fn multiply_scalar(&self, values: &[f64], x: &[f64], y: &mut [f64]) {
        y.fill(0.0);
        for s in 0..self.points() {
            let (above, diagonal) = self.column(s);
            let [x0, x1] = [x[2 * s], x[2 * s + 1]];
            let mut sum = [values[diagonal] * x0, values[diagonal] * x1];
            for (&r, b) in self.rows[above.clone()].iter().zip(&values[above]) {
                let r = 2 * r as usize;
                y[r] += b * x0;
                y[r + 1] += b * x1;
                sum[0] += b * x[r];
                sum[1] += b * x[r + 1];
            }
            y[2 * s] += sum[0];
            y[2 * s + 1] += sum[1];
        }
    }

    /// Lift the diagonal by a part of its mean.
    pub fn lift(&self, values: &mut [f64], part: f64) {
        let places = (0..self.points()).map(|s| 4 * (self.columns[s + 1] - 1)).flat_map(|k| [k, k + 3]);
        let mean = places.clone().map(|k| values[k]).sum::<f64>() / (2 * self.points()) as f64;
        places.for_each(|k| values[k] += part * mean);
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::numeric::sparse::Cholesky;
    use proptest::prelude::*;
    use std::sync::Arc;

    /// A positive definite matrix on a band of blocks, by its pattern, values and in full.
    pub fn banded(n: usize, width: usize, seed: &[f64]) -> (BlockPattern, Vec<f64>, Vec<Vec<f64>>) {
        let (mut columns, mut rows) = (vec![0], vec![]);
        for s in 0..n {
            rows.extend((s.saturating_sub(width)..=s).map(|r| r as u32));
            columns.push(rows.len());
        }
        let pattern = BlockPattern { columns, rows };
        let (mut values, mut full) = (vec![0.0; 4 * pattern.blocks()], vec![vec![0.0; 2 * n]; 2 * n]);
        let mut next = seed.iter().cycle();
        for s in 0..n {
            for k in pattern.columns[s]..pattern.columns[s + 1] {
                let r = pattern.rows[k] as usize;
                for at in 0..4 {
                    let (i, j) = (2 * r + at / 2, 2 * s + at % 2);
                    if r < s || i <= j {
                        let value = if i == j { 4.0 * (width + 1) as f64 } else { *next.next().unwrap() };
                        (full[i][j], full[j][i]) = (value, value);
                    }
                }
                for at in 0..4 {
                    values[4 * k + at] = full[2 * r + at / 2][2 * s + at % 2];
                }
            }
        }
        (pattern, values, full)
    }

    proptest! {
        #[test]
        fn product_and_factor_are_those_of_the_matrix_in_full(
            n in 1usize..12, width in 0usize..4, seed in prop::collection::vec(-1.0..1.0, 37),
        ) {
            let (pattern, values, full) = banded(n, width, &seed);
            let x: Vec<f64> = (0..2 * n).map(|i| (1.3 * i as f64).sin()).collect();
            let by_rows = |row: &Vec<f64>| -> f64 { row.iter().zip(&x).map(|(a, x)| a * x).sum() };
            let expected: Vec<f64> = full.iter().map(by_rows).collect();
            let mut y = vec![1.0; 2 * n];
            pattern.multiply(&values, &x, &mut y);
            for (y, e) in y.iter().zip(&expected) {
                prop_assert!((y - e).abs() < 1e-12);
            }
            let mut columns = vec![];
            pattern.by_columns(&values, &mut columns);
            let mut cholesky = Cholesky::new(Arc::new(pattern.symbolic(None).unwrap()));
            cholesky.factorize(&columns).unwrap();
            cholesky.solve(&mut y);
            for (y, x) in y.iter().zip(&x) {
                prop_assert!((y - x).abs() < 1e-12);
            }
        }

        #[test]
        fn a_multiple_of_the_identity_in_every_block_is_a_scalar_matrix(
            n in 1usize..12, width in 0usize..4, seed in prop::collection::vec(-1.0..1.0, 37),
        ) {
            let (pattern, _, _) = banded(n, width, &seed);
            let scalar: Vec<f64> = (0..pattern.blocks()).map(|k| seed[k % 37]).collect();
            let values: Vec<f64> = scalar.iter().flat_map(|&v| [v, 0.0, 0.0, v]).collect();
            let x: Vec<f64> = (0..2 * n).map(|i| (0.7 * i as f64).cos()).collect();
            let (mut y, mut z) = (vec![0.0; 2 * n], vec![0.0; 2 * n]);
            pattern.multiply(&values, &x, &mut y);
            pattern.multiply_scalar(&scalar, &x, &mut z);
            prop_assert!((0..pattern.blocks()).all(|k| scalar_part(&values, k) == scalar[k]));
            for (y, z) in y.iter().zip(&z) {
                prop_assert!((y - z).abs() < 1e-14);
            }
        }
    }
}
