//! Matrices that grow row by row.

use super::ROUNDING;
use crate::numeric::sparse::{CscMatrix, CsrMatrix};

/// A sparse matrix in compressed rows.
#[derive(Debug, Clone, PartialEq)]
pub struct SparseRows {
    offsets: Vec<usize>,
    columns: Vec<usize>,
    values: Vec<f64>,
    width: usize,
}

impl Default for SparseRows {
    fn default() -> Self {
        Self::new(0)
    }
}

impl SparseRows {
    /// A matrix without rows, of `width` columns.
    pub fn new(width: usize) -> Self {
        Self { offsets: vec![0], columns: vec![], values: vec![], width }
    }

    /// From offsets of rows, columns and values; `None` if they do not fit together.
    pub fn from_parts(
        offsets: Vec<usize>,
        columns: Vec<usize>,
        values: Vec<f64>,
        width: usize,
    ) -> Option<Self> {
        let fits = offsets.first() == Some(&0)
            && offsets.last() == Some(&columns.len())
            && offsets.windows(2).all(|w| w[0] <= w[1])
            && columns.len() == values.len()
            && columns.iter().all(|&c| c < width);
        fits.then_some(Self { offsets, columns, values, width })
    }

    /// Offsets of rows, columns and values.
    pub fn parts(&self) -> (&[usize], &[usize], &[f64]) {
        (&self.offsets, &self.columns, &self.values)
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.offsets.len() - 1
    }

    /// Number of columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Columns and values of a row.
    pub fn row(&self, index: usize) -> (&[usize], &[f64]) {
        let range = self.offsets[index]..self.offsets[index + 1];
        (&self.columns[range.clone()], &self.values[range])
    }

    /// Entries of a row one by one.
    pub(super) fn entries(&self, index: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let (columns, values) = self.row(index);
        columns.iter().copied().zip(values.iter().copied())
    }

    /// Append a row.
    pub(super) fn push(&mut self, entries: impl IntoIterator<Item = (usize, f64)>) {
        for (column, value) in entries {
            debug_assert!(column < self.width, "column {column} of {}", self.width);
            self.columns.push(column);
            self.values.push(value);
        }
        self.offsets.push(self.columns.len());
    }

    /// Only the rows with these indices.
    pub(super) fn select(&self, rows: &[usize]) -> Self {
        let mut out = Self::new(self.width);
        rows.iter().for_each(|&r| out.push(self.entries(r)));
        out
    }

    /// Product with a plane vector for every column.
    pub fn times(&self, points: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let one = |r| {
            self.entries(r).fold([0.0; 2], |sum: [f64; 2], (c, v)| {
                [sum[0] + v * points[c][0], sum[1] + v * points[c][1]]
            })
        };
        (0..self.len()).map(one).collect()
    }

    /// The same matrix by columns. Columns of every row must be sorted and distinct.
    pub(super) fn by_columns(self) -> CscMatrix<f64> {
        let rows = self.offsets.len() - 1;
        let matrix = CsrMatrix::try_from_csr_data(rows, self.width, self.offsets, self.columns, self.values);
        CscMatrix::from(&matrix.expect("rows are sorted"))
    }

    /// The transposed matrix by columns: these rows are its columns. They must be sorted and distinct.
    pub(super) fn transposed(self) -> CscMatrix<f64> {
        let rows = self.offsets.len() - 1;
        CscMatrix::try_from_csc_data(self.width, rows, self.offsets, self.columns, self.values)
            .expect("rows are sorted")
    }
}

/// A row that is being summed up: dense, with a list of the places touched.
pub(super) struct Sum {
    values: Vec<f64>,
    there: Vec<bool>,
    touched: Vec<usize>,
}

impl Sum {
    pub fn new(width: usize) -> Self {
        Self { values: vec![0.0; width], there: vec![false; width], touched: vec![] }
    }

    pub fn add(&mut self, column: usize, value: f64) {
        if !self.there[column] {
            self.there[column] = true;
            self.touched.push(column);
        }
        self.values[column] += value;
    }

    pub fn add_row(&mut self, factor: f64, (columns, values): (&[usize], &[f64])) {
        columns.iter().zip(values).for_each(|(&column, value)| self.add(column, factor * value));
    }

    /// Append the sum to a matrix, sorted and without rounding, and begin anew.
    pub fn finish(&mut self, matrix: &mut SparseRows) {
        self.touched.sort_unstable();
        let values = &self.values;
        matrix.push(self.touched.iter().map(|&c| (c, values[c])).filter(|e| e.1.abs() >= ROUNDING));
        for column in self.touched.drain(..) {
            (self.values[column], self.there[column]) = (0.0, false);
        }
    }
}
