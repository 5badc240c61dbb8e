//! Sparse symmetric positive definite systems: the only home of `nalgebra-sparse`, and with `dense` of `faer`.
//!
//! Matrices are `nalgebra_sparse::CscMatrix` holding the **upper** triangle. The symbolic factorization depends on
//! the pattern alone and is computed once; numeric factorizations and solves reuse its buffers.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::{LltError, LltRegularization};
use faer::perm::Perm;
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMat};
use faer::traits::RealField;
use faer::{Conj, MatMut, Par, Side};
pub use nalgebra_sparse::{CooMatrix, CscMatrix, CsrMatrix};
use std::sync::Arc;
use thiserror::Error;

/// Number of what is fixed among unknowns, and place of an entry with it among the values of a pattern: none.
pub(crate) const NOWHERE: u32 = u32::MAX;

/// Why a factorization is not available.
#[derive(Debug, Error, Clone, PartialEq, Eq)]
pub enum SparseError {
    /// A pivot was not positive: the matrix is not positive definite (index in elimination order).
    #[error("the matrix is not positive definite (pivot {0})")]
    NotPositiveDefinite(usize),
    /// Out of memory, or the index range is exhausted.
    #[error("the factorization failed: {0}")]
    Failed(String),
}

/// The symbolic part of a factorization, which matrices with the same sparsity pattern share.
pub struct Symbolic {
    pattern: SymbolicSparseColMat<u32>,
    factor: SymbolicCholesky<u32>,
}

/// Cholesky factorization `A = L Lᵀ` of matrices that share one sparsity pattern, in double or single precision.
pub struct Cholesky<T = f64> {
    symbolic: Arc<Symbolic>,
    factor: Vec<T>,
    scratch: Option<MemBuffer>,
}

// faer's own threads never paid on the sizes measured, and sequential runs are bit-reproducible.
const PAR: Par = Par::Seq;

impl Symbolic {
    /// Analyse a pattern: the upper triangle in compressed columns, row indices sorted.
    ///
    /// `ordering[k]` is the row eliminated k-th; `None` lets faer choose by approximate minimum degree.
    pub fn new(
        column_offsets: &[usize],
        row_indices: &[usize],
        ordering: Option<&[usize]>,
    ) -> Result<Self, SparseError> {
        let narrow = |v: &[usize]| -> Result<Vec<u32>, SparseError> {
            v.iter().map(|&i| u32::try_from(i).map_err(|e| failed(&e))).collect()
        };
        Self::narrow(narrow(column_offsets)?, narrow(row_indices)?, ordering)
    }

    /// [`Self::new`] of indices that are narrow already.
    pub(crate) fn narrow(
        offsets: Vec<u32>,
        rows: Vec<u32>,
        ordering: Option<&[usize]>,
    ) -> Result<Self, SparseError> {
        let n = offsets.len() - 1;
        let pattern = SymbolicSparseColMat::new_checked(n, n, offsets, None, rows);
        let permutation = ordering.map(|order| {
            let forward: Vec<u32> = order.iter().map(|&i| i as u32).collect();
            let mut inverse = vec![0_u32; n];
            for (k, &i) in forward.iter().enumerate() {
                inverse[i as usize] = k as u32;
            }
            Perm::new_checked(forward.into_boxed_slice(), inverse.into_boxed_slice(), n)
        });
        let choice = match &permutation {
            None => SymmetricOrdering::Amd,
            Some(p) => SymmetricOrdering::Custom(p.as_ref()),
        };
        let params = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
            ..Default::default()
        };
        let factor = factorize_symbolic_cholesky(pattern.as_ref(), Side::Upper, choice, params)
            .map_err(|e| failed(&e))?;
        Ok(Self { pattern, factor })
    }
}

fn failed(error: &dyn std::fmt::Debug) -> SparseError {
    SparseError::Failed(format!("{error:?}"))
}

impl Cholesky {
    /// Analyse a pattern as [`Symbolic::new`] does, for one matrix at a time.
    pub fn analyse(
        column_offsets: &[usize],
        row_indices: &[usize],
        ordering: Option<&[usize]>,
    ) -> Result<Self, SparseError> {
        Ok(Self::new(Arc::new(Symbolic::new(column_offsets, row_indices, ordering)?)))
    }
}

impl<T: RealField> Cholesky<T> {
    /// Prepare for matrices of a pattern; memory for the factor is taken with the first of them.
    pub fn new(symbolic: Arc<Symbolic>) -> Self {
        Self { symbolic, factor: vec![], scratch: None }
    }

    /// Dimension of the matrix.
    pub fn dimension(&self) -> usize {
        self.symbolic.factor.nrows()
    }

    /// Position of every diagonal entry among the values of the pattern.
    pub fn diagonal(&self) -> Vec<usize> {
        let offsets = self.symbolic.pattern.col_ptr();
        (0..self.dimension()).map(|j| offsets[j + 1] as usize - 1).collect()
    }

    /// Factorize the matrix whose upper-triangle values, in the order of the pattern, are `values`.
    pub fn factorize(&mut self, values: &[T]) -> Result<(), SparseError> {
        let Symbolic { pattern, factor } = &*self.symbolic;
        self.factor.resize(factor.len_val(), T::zero_impl());
        let scratch = self.scratch.get_or_insert_with(|| {
            MemBuffer::new(factor.factorize_numeric_llt_scratch::<T>(PAR, Default::default()))
        });
        factor
            .factorize_numeric_llt(
                &mut self.factor,
                SparseColMatRef::new(pattern.as_ref(), values),
                Side::Upper,
                LltRegularization::default(),
                PAR,
                MemStack::new(scratch),
                Default::default(),
            )
            .map(|_| ())
            .map_err(|error| match error {
                LltError::NonPositivePivot { index } => SparseError::NotPositiveDefinite(index),
            })
    }

    /// Solve in place for right-hand sides stored column after column (`rhs.len()` a multiple of the dimension).
    ///
    /// A factorization must have succeeded before.
    pub fn solve(&self, rhs: &mut [T]) {
        let n = self.dimension();
        if n == 0 {
            return;
        }
        let columns = rhs.len() / n;
        assert_eq!(columns * n, rhs.len(), "right-hand side length must be a multiple of the dimension");
        let symbolic = &self.symbolic.factor;
        let mut scratch = MemBuffer::new(symbolic.solve_in_place_scratch::<T>(columns, PAR));
        LltRef::new(symbolic, &self.factor).solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(rhs, n, columns),
            PAR,
            MemStack::new(&mut scratch),
        );
    }
}

/// Upper triangle (diagonal included) of a square matrix.
pub fn upper_triangle(matrix: &CscMatrix<f64>) -> CscMatrix<f64> {
    matrix.filter(|i, j, _| i <= j)
}

/// `Zᵀ A Z` for a symmetric `A` given in full; `Z` maps the reduced unknowns to the full ones.
pub fn congruence(a: &CscMatrix<f64>, z: &CscMatrix<f64>) -> CscMatrix<f64> {
    &z.transpose() * &(a * z)
}

/// `Zᵀ Z`.
pub fn gram(z: &CscMatrix<f64>) -> CscMatrix<f64> {
    &z.transpose() * z
}

/// `y = A x` for dense `x` with `columns` interleaved components a row.
pub fn multiply(a: &CscMatrix<f64>, x: &[f64], columns: usize) -> Vec<f64> {
    let mut y = vec![0.0; a.nrows() * columns];
    for (i, j, &v) in a.triplet_iter() {
        for c in 0..columns {
            y[i * columns + c] += v * x[j * columns + c];
        }
    }
    y
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn laplacian_1d(n: usize) -> CscMatrix<f64> {
        let mut coo = CooMatrix::new(n, n);
        for i in 0..n {
            coo.push(i, i, 2.0 + 0.1 * i as f64);
            if i + 1 < n {
                coo.push(i, i + 1, -1.0);
                coo.push(i + 1, i, -1.0);
            }
        }
        CscMatrix::from(&coo)
    }

    proptest! {
        #[test]
        fn solves_with_any_ordering(n in 1usize..40, reverse in any::<bool>()) {
            let a = laplacian_1d(n);
            let upper = upper_triangle(&a);
            let order: Vec<usize> = (0..n).rev().collect();
            let mut chol = Cholesky::analyse(upper.col_offsets(), upper.row_indices(), reverse.then_some(&order[..])).unwrap();
            chol.factorize(upper.values()).unwrap();
            let mut b: Vec<f64> = (0..2 * n).map(|i| (i as f64).sin()).collect();
            let rhs = b.clone();
            chol.solve(&mut b);
            for c in 0..2 {
                let back = multiply(&a, &b[c * n..(c + 1) * n], 1);
                for i in 0..n { prop_assert!((back[i] - rhs[c * n + i]).abs() < 1e-12); }
            }
        }
    }

    #[test]
    fn reports_an_indefinite_matrix() {
        let mut a = laplacian_1d(5);
        for v in a.values_mut() {
            *v = -*v;
        }
        let upper = upper_triangle(&a);
        let mut chol = Cholesky::analyse(upper.col_offsets(), upper.row_indices(), None).unwrap();
        assert!(matches!(chol.factorize(upper.values()), Err(SparseError::NotPositiveDefinite(_))));
    }
}
