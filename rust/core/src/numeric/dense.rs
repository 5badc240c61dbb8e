//! Dense systems, decompositions and products, each done by one thread.
//!
//! BLAS divides the same work among as many threads as it has: the last digits then depend on their number, and a busy
//! machine makes the threads wait for each other. All matrices are row-major slices.

use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt;
use faer::linalg::evd::{ComputeEigenvectors, self_adjoint_evd, self_adjoint_evd_scratch};
use faer::linalg::lu::partial_pivoting as lu;
use faer::linalg::matmul::matmul;
use faer::linalg::svd::{ComputeSvdVectors, svd as decompose, svd_scratch};
use faer::{Accum, Conj, Mat, MatMut, MatRef, Par};
use thiserror::Error;

const PAR: Par = Par::Seq;

/// Pivots below this part of the largest diagonal entry are rounding, and lifted to it.
const ROUNDING: f64 = 1e-14;

/// A decomposition does not converge: entries of the matrix are not finite.
#[derive(Debug, Error, Clone, Copy, PartialEq, Eq)]
#[error("the decomposition does not converge: are all entries finite?")]
pub struct NoConvergence;

/// Cholesky factor of a symmetric positive definite matrix, or of one that is so up to rounding.
pub struct Definite {
    factor: Mat<f64>,
}

impl Definite {
    /// Factorize an (n, n) matrix given in full. Entries that are not finite give solutions that are not.
    pub fn new(matrix: &[f64], n: usize) -> Self {
        assert_eq!(matrix.len(), n * n, "the matrix must be square");
        // Symmetric: rows are columns.
        let mut factor = MatRef::from_column_major_slice(matrix, n, n).to_owned();
        let mut scratch =
            MemBuffer::new(llt::factor::cholesky_in_place_scratch::<f64>(n, PAR, Default::default()));
        let done = llt::factor::cholesky_in_place(
            factor.as_mut(),
            Default::default(),
            PAR,
            MemStack::new(&mut scratch),
            Default::default(),
        );
        let largest = (0..n).map(|i| matrix[i * n + i]).fold(0.0, f64::max);
        let floor = (ROUNDING * largest).max(f64::MIN_POSITIVE);
        if done.is_err() || (0..n).any(|i| factor[(i, i)] * factor[(i, i)] < floor) {
            factor = lifted(matrix, n, floor);
        }
        Self { factor }
    }

    /// Solve in place for one right-hand side.
    pub fn solve(&self, rhs: &mut [f64]) {
        let rhs = MatMut::from_column_major_slice_mut(rhs, self.factor.nrows(), 1);
        llt::solve::solve_in_place_with_conj(
            self.factor.as_ref(),
            Conj::No,
            rhs,
            PAR,
            MemStack::new(&mut MemBuffer::new(llt::solve::solve_in_place_scratch::<f64>(
                self.factor.nrows(),
                1,
                PAR,
            ))),
        );
    }

    /// The inverse matrix, exactly symmetric.
    pub fn inverse(&self) -> Vec<f64> {
        let n = self.factor.nrows();
        let mut out = vec![0.0; n * n];
        let mut scratch = MemBuffer::new(llt::inverse::inverse_scratch::<f64>(n, PAR));
        llt::inverse::inverse(
            MatMut::from_column_major_slice_mut(&mut out, n, n),
            self.factor.as_ref(),
            PAR,
            MemStack::new(&mut scratch),
        );
        // The lower triangle of columns is the upper one of rows.
        for i in 0..n {
            for j in 0..i {
                out[i * n + j] = out[j * n + i];
            }
        }
        out
    }
}

/// Lower Cholesky factor with pivots not below `floor`: faer's own lifting leaves zeros on the diagonal.
fn lifted(matrix: &[f64], n: usize, floor: f64) -> Mat<f64> {
    let mut l = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..=i {
            let dot: f64 = (0..j).map(|k| l[i * n + k] * l[j * n + k]).sum();
            let value = matrix[i * n + j] - dot;
            // The comparison keeps what is not a number.
            let pivot = if value < floor { floor } else { value };
            l[i * n + j] = if i == j { pivot.sqrt() } else { value / l[j * n + j] };
        }
    }
    MatRef::from_row_major_slice(&l, n, n).to_owned()
}

/// Solve an (n, n) system for the (n, k) right-hand sides, in place, by elimination with partial pivoting.
///
/// Solutions of singular systems are not finite.
pub fn solve(matrix: &[f64], rhs: &mut [f64], n: usize) {
    assert_eq!(matrix.len(), n * n, "the matrix must be square");
    if rhs.is_empty() {
        return;
    }
    let columns = rhs.len() / n;
    assert_eq!(rhs.len(), columns * n, "the right-hand side has another number of rows");
    let mut factor = MatRef::from_row_major_slice(matrix, n, n).to_owned();
    let (mut forward, mut backward) = (vec![0_usize; n], vec![0_usize; n]);
    let scratch = lu::factor::lu_in_place_scratch::<usize, f64>(n, n, PAR, Default::default())
        .or(lu::solve::solve_in_place_scratch::<usize, f64>(n, columns, PAR));
    let mut scratch = MemBuffer::new(scratch);
    let stack = MemStack::new(&mut scratch);
    let (_, rows) =
        lu::factor::lu_in_place(factor.as_mut(), &mut forward, &mut backward, PAR, stack, Default::default());
    // The strict lower triangle and the upper one hold the two factors.
    lu::solve::solve_in_place_with_conj(
        factor.as_ref(),
        factor.as_ref(),
        rows,
        Conj::No,
        MatMut::from_row_major_slice_mut(rhs, n, columns),
        PAR,
        stack,
    );
}

/// Product of an (m, k) and a (k, n) matrix, (m, n).
pub fn product(a: &[f64], b: &[f64], [m, k, n]: [usize; 3]) -> Vec<f64> {
    let mut out = vec![0.0; m * n];
    matmul(
        MatMut::from_row_major_slice_mut(&mut out, m, n),
        Accum::Replace,
        MatRef::from_row_major_slice(a, m, k),
        MatRef::from_row_major_slice(b, k, n),
        1.0,
        PAR,
    );
    out
}

/// Singular value decomposition U Σ Vᵀ.
pub struct Svd {
    /// Left vectors, (m, m) or the first of them.
    pub u: Vec<f64>,
    /// Singular values, decreasing.
    pub sigma: Vec<f64>,
    /// Right vectors as rows, (n, n) or the first of them.
    pub vt: Vec<f64>,
}

/// Decompose an (m, n) matrix; with all vectors if `full`, else with min(m, n) of either side.
pub fn svd(matrix: &[f64], [m, n]: [usize; 2], full: bool) -> Result<Svd, NoConvergence> {
    let size = m.min(n);
    let (left, right) = if full { (m, n) } else { (size, size) };
    let (mut u, mut vt) = (vec![0.0; m * left], vec![0.0; right * n]);
    let vectors = if full { ComputeSvdVectors::Full } else { ComputeSvdVectors::Thin };
    let mut sigma = Diag::<f64>::zeros(size);
    let mut scratch = MemBuffer::new(svd_scratch::<f64>(m, n, vectors, vectors, PAR, Default::default()));
    let mut left_vectors = Mat::<f64>::zeros(m, left);
    decompose(
        MatRef::from_row_major_slice(matrix, m, n),
        sigma.as_mut(),
        Some(left_vectors.as_mut()),
        // Right vectors are columns there and rows here.
        Some(MatMut::from_column_major_slice_mut(&mut vt, n, right)),
        PAR,
        MemStack::new(&mut scratch),
        Default::default(),
    )
    .map_err(|_| NoConvergence)?;
    MatMut::from_row_major_slice_mut(&mut u, m, left).copy_from(&left_vectors);
    Ok(Svd { u, sigma: sigma.column_vector().iter().copied().collect(), vt })
}

/// Eigenvalues of a symmetric (n, n) matrix, increasing, and the (n, n) matrix of its eigenvectors as columns.
pub fn eigen(matrix: &[f64], n: usize) -> Result<(Vec<f64>, Vec<f64>), NoConvergence> {
    assert_eq!(matrix.len(), n * n, "the matrix must be square");
    let (mut values, mut vectors) = (Diag::<f64>::zeros(n), Mat::<f64>::zeros(n, n));
    let mut scratch =
        MemBuffer::new(self_adjoint_evd_scratch::<f64>(n, ComputeEigenvectors::Yes, PAR, Default::default()));
    self_adjoint_evd(
        MatRef::from_column_major_slice(matrix, n, n),
        values.as_mut(),
        Some(vectors.as_mut()),
        PAR,
        MemStack::new(&mut scratch),
        Default::default(),
    )
    .map_err(|_| NoConvergence)?;
    let mut out = vec![0.0; n * n];
    MatMut::from_row_major_slice_mut(&mut out, n, n).copy_from(&vectors);
    Ok((values.column_vector().iter().copied().collect(), out))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn matrix(rows: usize, columns: usize) -> impl Strategy<Value = Vec<f64>> {
        prop::collection::vec(-1.0f64..1.0, rows * columns)
    }

    fn transposed(a: &[f64], [m, n]: [usize; 2]) -> Vec<f64> {
        (0..n * m).map(|k| a[k % m * n + k / m]).collect()
    }

    fn gap(a: &[f64], b: &[f64]) -> f64 {
        assert_eq!(a.len(), b.len());
        a.iter().zip(b).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max)
    }

    fn unit(n: usize) -> Vec<f64> {
        (0..n * n).map(|k| f64::from(u8::from(k / n == k % n))).collect()
    }

    fn sizes() -> impl Strategy<Value = (usize, usize, Vec<f64>)> {
        (1usize..40, 1usize..40).prop_flat_map(|(m, n)| (Just(m), Just(n), matrix(m, n)))
    }

    proptest! {
        #[test]
        fn products_are_sums_of_products((m, n, a) in sizes()) {
            let at = transposed(&a, [m, n]);
            let found = product(&a, &at, [m, n, m]);
            for i in 0..m {
                for j in 0..m {
                    let sum: f64 = (0..n).map(|k| a[i * n + k] * a[j * n + k]).sum();
                    prop_assert!((found[i * m + j] - sum).abs() < 1e-13);
                }
            }
        }

        #[test]
        fn decompositions_give_the_matrix_back((m, n, a) in sizes(), full in any::<bool>()) {
            let Svd { u, sigma, vt } = svd(&a, [m, n], full).unwrap();
            let (left, right) = if full { (m, n) } else { (m.min(n), m.min(n)) };
            prop_assert!(gap(&product(&transposed(&u, [m, left]), &u, [left, m, left]), &unit(left)) < 1e-12);
            prop_assert!(gap(&product(&vt, &transposed(&vt, [right, n]), [right, n, right]), &unit(right)) < 1e-12);
            let mut scaled = vec![0.0; left * n];
            for (k, s) in sigma.iter().enumerate() {
                (0..n).for_each(|j| scaled[k * n + j] = s * vt[k * n + j]);
            }
            prop_assert!(gap(&product(&u, &scaled, [m, left, n]), &a) < 1e-12);
            prop_assert!(sigma.windows(2).all(|s| s[0] >= s[1]) && sigma.iter().all(|&s| s >= 0.0));
        }

        #[test]
        fn systems_are_solved(n in 1usize..60, seed in matrix(60, 61)) {
            let (a, b) = (&seed[..n * n], &seed[n * n..n * n + n]);
            let mut gram = product(&transposed(a, [n, n]), a, [n, n, n]);
            (0..n).for_each(|i| gram[i * n + i] += 0.1);
            let definite = Definite::new(&gram, n);
            let mut x = b.to_vec();
            definite.solve(&mut x);
            prop_assert!(gap(&product(&gram, &x, [n, n, 1]), b) < 1e-10);
            prop_assert!(gap(&product(&gram, &definite.inverse(), [n, n, n]), &unit(n)) < 1e-10);
            let mut y = b.to_vec();
            solve(&gram, &mut y, n);
            prop_assert!(gap(&x, &y) < 1e-10);
            let (values, vectors) = eigen(&gram, n).unwrap();
            let back = product(&transposed(&vectors, [n, n]), &product(&gram, &vectors, [n, n, n]), [n, n, n]);
            let diagonal: Vec<f64> = (0..n * n).map(|k| if k / n == k % n { values[k / n] } else { 0.0 }).collect();
            prop_assert!(gap(&back, &diagonal) < 1e-11);
        }
    }

    #[test]
    fn elimination_exchanges_rows() {
        let mut x = vec![3.0, 4.0, 5.0, 6.0];
        solve(&[0.0, 1.0, 2.0, 0.0], &mut x, 2);
        assert_eq!(x, [2.5, 3.0, 3.0, 4.0]);
    }

    #[test]
    fn pivots_lost_to_rounding_are_lifted() {
        let singular = Definite::new(&[1.0, 1.0, 1.0, 1.0], 2);
        let mut x = [1.0, 1.0];
        singular.solve(&mut x);
        assert!((x[0] + x[1] - 1.0).abs() < 1e-12, "{x:?}");
    }

    #[test]
    fn what_is_not_finite_is_not_hidden() {
        let mut x = [1.0];
        Definite::new(&[f64::NAN], 1).solve(&mut x);
        assert!(x[0].is_nan());
        assert!(svd(&[f64::NAN, 1.0, 1.0, 2.0], [2, 2], false).is_err());
    }

    #[test]
    fn empty_matrices_have_nothing_to_solve() {
        assert_eq!(product(&[], &[], [2, 0, 2]), [0.0; 4]);
        let whole = svd(&[], [0, 2], true).unwrap();
        assert_eq!((whole.u.len(), whole.vt), (0, unit(2)));
        solve(&[], &mut [], 0);
        Definite::new(&[], 0).solve(&mut []);
    }
}
