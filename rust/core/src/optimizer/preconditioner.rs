//! The inverse of a scalar matrix in single precision, for both components at once: a preconditioner.
//!
//! Half the memory and half the time of double precision, which an iteration does not need: what rounding spoils, it
//! mends. Carson, Higham: *Accelerating the solution of linear systems by iterative refinement in three precisions*,
//! SIAM J. Sci. Comput. 40, 2018.

use crate::numeric::sparse::{Cholesky, SparseError, Symbolic};
use crate::optimizer::blocks::BlockPattern;
use std::sync::Arc;

/// Lift of the diagonal, then ten times as much, where rounding left the matrix indefinite: what single precision
/// loses in sums of some dozen terms.
const FIRST_LIFT: f32 = 1e-6;
/// Lift beyond which a matrix is taken for indefinite in itself, though it should not be.
const LARGEST_LIFT: f32 = 1e-3;

/// Cholesky factorization of a scalar matrix with unit diagonal.
pub(crate) struct Preconditioner {
    cholesky: Cholesky<f32>,
    /// What brings the diagonal to one, from either side.
    scale: Vec<f64>,
    values: Vec<f32>,
    columns: Vec<f32>,
}

impl Preconditioner {
    pub fn new(symbolic: Arc<Symbolic>) -> Self {
        Self { cholesky: Cholesky::new(symbolic), scale: vec![], values: vec![], columns: vec![] }
    }

    /// Factorize the matrix with `value(k)` for block k of the pattern; `sure` if it is definite but for rounding.
    pub fn factorize(
        &mut self,
        pattern: &BlockPattern,
        value: impl Fn(usize) -> f64,
        sure: bool,
    ) -> Result<(), SparseError> {
        let largest = if sure { LARGEST_LIFT } else { FIRST_LIFT };
        let diagonal = |s: usize| pattern.columns[s + 1] - 1;
        // A pivot that is not positive has no root; the factorization finds it.
        let n = pattern.points();
        let root: Vec<f64> = (0..n).map(|s| value(diagonal(s)).abs().max(f64::MIN_POSITIVE).sqrt()).collect();
        self.scale = root.iter().map(|r| 1.0 / r).collect();
        self.values.clear();
        for s in 0..n {
            let column = pattern.columns[s]..pattern.columns[s + 1];
            let scaled = |k: usize| (value(k) / (root[pattern.rows[k] as usize] * root[s])) as f32;
            self.values.extend(column.map(scaled));
        }
        let mut lifted = 0.0;
        loop {
            match self.cholesky.factorize(&self.values) {
                Err(SparseError::NotPositiveDefinite(_)) if lifted < largest => {}
                other => return other,
            }
            let lift = if lifted == 0.0 { FIRST_LIFT } else { 10.0 * lifted };
            (0..n).for_each(|s| self.values[diagonal(s)] += lift - lifted);
            lifted = lift;
        }
    }

    /// `out = M⁻¹ v`, components interleaved.
    pub fn apply(&mut self, v: &[f64], out: &mut [f64]) {
        let n = self.scale.len();
        let scaled = || v.chunks_exact(2).zip(&self.scale).map(|(v, s)| [v[0] * s, v[1] * s]);
        // Single precision has a range of its own.
        let size = scaled().flatten().fold(0.0_f64, |a, x| a.max(x.abs()));
        if size == 0.0 {
            out.fill(0.0);
            return;
        }
        self.columns.resize(2 * n, 0.0);
        for (i, v) in scaled().enumerate() {
            for c in 0..2 {
                self.columns[c * n + i] = (v[c] / size) as f32;
            }
        }
        self.cholesky.solve(&mut self.columns);
        for (i, out) in out.chunks_exact_mut(2).enumerate() {
            for c in 0..2 {
                out[c] = f64::from(self.columns[c * n + i]) * self.scale[i] * size;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optimizer::blocks::{scalar_part, tests::banded};
    use proptest::prelude::*;

    proptest! {
        /// Whatever the units: rows and right-hand side scaled far out of the range of single precision.
        #[test]
        fn is_the_inverse_but_for_single_precision(
            n in 1usize..12, width in 0usize..4, seed in prop::collection::vec(-1.0..1.0, 37), far in -80i32..80,
        ) {
            let (pattern, values, _) = banded(n, width, &seed);
            let unit = |s: usize| if s.is_multiple_of(2) { 10.0_f64.powi(far) } else { 1.0 };
            let mut scalar: Vec<f64> = (0..pattern.blocks()).map(|k| scalar_part(&values, k)).collect();
            for s in 0..n {
                for k in pattern.columns[s]..pattern.columns[s + 1] {
                    scalar[k] *= unit(s) * unit(pattern.rows[k] as usize);
                }
            }
            let wanted: Vec<f64> = (0..2 * n).map(|i| (1.0 + i as f64).sin() / unit(i / 2)).collect();
            let (mut b, mut x) = (vec![0.0; 2 * n], vec![0.0; 2 * n]);
            pattern.multiply_scalar(&scalar, &wanted, &mut b);
            let mut inverse = Preconditioner::new(Arc::new(pattern.scalar_symbolic(None).unwrap()));
            inverse.factorize(&pattern, |k| scalar[k], true).unwrap();
            inverse.apply(&b, &mut x);
            for (i, (x, w)) in x.iter().zip(&wanted).enumerate() {
                prop_assert!((x - w).abs() * unit(i / 2) < 1e-5);
            }
        }
    }

    #[test]
    fn a_singular_matrix_is_lifted_if_it_should_be_definite_and_an_indefinite_one_is_refused() {
        // Of a chain of springs that nothing holds.
        let pattern = BlockPattern { columns: vec![0, 1, 3, 5], rows: vec![0, 0, 1, 1, 2] };
        let mut inverse = Preconditioner::new(Arc::new(pattern.scalar_symbolic(None).unwrap()));
        let mut factorize = |values: [f64; 5]| inverse.factorize(&pattern, |k| values[k], true);
        factorize([1.0, -1.0, 2.0, -1.0, 1.0]).unwrap();
        let indefinite = factorize([1.0, -1.0, -2.0, -1.0, 1.0]);
        assert!(matches!(indefinite, Err(SparseError::NotPositiveDefinite(_))));
    }
}
