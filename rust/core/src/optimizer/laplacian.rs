//! Systems of the reference map's Laplacian, the same for every target.

use crate::numeric::sparse::{Cholesky, SparseError, Symbolic};
use crate::optimizer::blocks::BlockPattern;
use crate::optimizer::conjugate_gradients::{self, Ended, Workspace};
use crate::optimizer::preconditioner::Preconditioner;
use std::sync::Arc;

/// Squared error, relative in the energy norm, to which conjugate gradients go: beyond it is rounding.
const NEGLIGIBLE: f64 = 1e-20;
/// Iterations at most; the preconditioner is the inverse but for rounding, and three of them do.
const PATIENCE: usize = 100;

/// The factorized Laplacian: in single precision, with its values for the rest, where the model is large.
pub(crate) enum Laplacian {
    Direct(Cholesky),
    Iterative { preconditioner: Box<Preconditioner>, values: Vec<f64> },
}

impl Laplacian {
    /// Factorize the matrix with one value for every block.
    pub fn new(
        symbolic: Arc<Symbolic>,
        pattern: &BlockPattern,
        values: Vec<f64>,
        large: bool,
    ) -> Result<Self, SparseError> {
        if large {
            let mut preconditioner = Box::new(Preconditioner::new(symbolic));
            preconditioner.factorize(pattern, |k| values[k], true)?;
            Ok(Self::Iterative { preconditioner, values })
        } else {
            let mut cholesky = Cholesky::new(symbolic);
            cholesky.factorize(&values)?;
            Ok(Self::Direct(cholesky))
        }
    }

    /// Replace right-hand sides of both components, interleaved, by the solutions.
    pub fn solve(&mut self, pattern: &BlockPattern, x: &mut [f64]) -> Result<(), SparseError> {
        match self {
            Self::Direct(cholesky) => {
                let n = cholesky.dimension();
                let mut columns: Vec<f64> = (0..2 * n).map(|k| x[k % n * 2 + k / n]).collect();
                cholesky.solve(&mut columns);
                x.iter_mut().enumerate().for_each(|(k, x)| *x = columns[k % 2 * n + k / 2]);
                Ok(())
            }
            Self::Iterative { preconditioner, values } => {
                let ended = conjugate_gradients::solve(
                    x,
                    &mut Workspace::default(),
                    PATIENCE,
                    |v, out| pattern.multiply_scalar(values, v, out),
                    |v, out| preconditioner.apply(v, out),
                    |progress| progress.last <= NEGLIGIBLE * progress.total,
                );
                match ended {
                    Ended::Enough => Ok(()),
                    _ => Err(SparseError::Failed("the Laplacian is singular".into())),
                }
            }
        }
    }
}
