//! The linear systems of Newton's steps: by a factorization, or, of large models, by conjugate gradients.
//!
//! A factorization of the whole Hessian grows like n^1.5 and needs most of the memory. The matrix of a single
//! component, (Hxx + Hyy) / 2, has a quarter of the entries, and as preconditioner it leaves a condition that depends
//! on the distortion, as in linear elasticity, but on neither size nor degree nor aspect ratio (separate displacement
//! components: Axelsson, Gustafsson, *Iterative methods for the solution of the Navier equations of elasticity*,
//! Comput. Methods Appl. Mech. Eng. 15, 1978; Blaheta, Numer. Linear Algebra Appl. 1, 1994).

use crate::numeric::sparse::{Cholesky, SparseError, Symbolic};
use crate::optimizer::blocks::{BlockPattern, scalar_part};
use crate::optimizer::conjugate_gradients::{self, Ended, Progress, Workspace};
use crate::optimizer::preconditioner::Preconditioner;
use std::sync::Arc;

/// Part of its mean by which the diagonal is lifted where the Hessian is definite but for rounding: far above what a
/// factorization loses, and far below what would slow a step down.
const LIFT: f64 = 1e-9;
/// Iterations after which the factorization is made after all: until then they cost less than twice as much as that
/// (27 to 13 ms at 6,784 points, 0.93 to 0.53 s at 1e5), once a start.
const PATIENCE: usize = 30;
/// Largest forcing term, squared: a step is never further than that from Newton's, in the energy norm. An iteration
/// costs an eighth of what else there is to a step, so no step must be lost for want of one.
const LARGEST_ERROR: f64 = 1e-2;
/// Gain of an iteration, in tolerances, below which nothing is decided any more: what is missing then is a part of it,
/// as a gain is some three to six times the next.
const DECIDING: f64 = 1.0;
/// Iterations at least: the second tells how much the first one missed.
const LEAST: usize = 2;

/// How accurate a Newton direction has to be.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Accuracy {
    pub energy: f64,
    /// Decrement, relative to the energy, at which the iteration ends.
    pub tolerance: f64,
}

impl Accuracy {
    /// Newton's iteration keeps its speed if the error of a step falls like the decrement (Eisenstat, Walker: *Choosing
    /// the forcing terms in an inexact Newton method*, SIAM J. Sci. Comput. 17, 1996), and nothing is gained below the
    /// tolerance.
    fn reached(&self, p: Progress) -> bool {
        let forcing = (p.total / self.energy.abs()).min(LARGEST_ERROR);
        let enough = (forcing * p.total).max(DECIDING * self.tolerance * self.energy.abs());
        p.iterations >= LEAST && p.last <= enough
    }
}

/// The Hessian over the unknowns, prepared for solving.
pub(crate) struct Systems {
    points: usize,
    order: Option<Vec<usize>>,
    /// Of the scalar matrix; for the Laplacian as well.
    scalar: Option<Arc<Symbolic>>,
    direct: Option<Cholesky>,
    iterative: Option<Iterative>,
    by_columns: Vec<f64>,
    /// The matrix is positive semidefinite by its making.
    sure: bool,
}

struct Iterative {
    preconditioner: Preconditioner,
    workspace: Workspace,
    /// It takes too long here: the direct way until the next start.
    given_up: bool,
}

impl Systems {
    /// For matrices of a pattern; points are eliminated in `order`, by minimum degree if there is none.
    pub fn new(
        pattern: &BlockPattern,
        order: Option<Vec<usize>>,
        iterative: bool,
    ) -> Result<Self, SparseError> {
        let mut out = Self {
            points: pattern.points(),
            order,
            scalar: None,
            direct: None,
            iterative: None,
            by_columns: vec![],
            sure: false,
        };
        if iterative {
            let preconditioner = Preconditioner::new(out.scalar(pattern)?);
            let workspace = Workspace::default();
            out.iterative = Some(Iterative { preconditioner, workspace, given_up: false });
        } else {
            out.direct = Some(Cholesky::new(Arc::new(pattern.symbolic(out.order.as_deref())?)));
        }
        Ok(out)
    }

    /// Number of unknowns.
    pub fn unknowns(&self) -> usize {
        2 * self.points
    }

    /// Whether conjugate gradients are tried.
    pub fn are_large(&self) -> bool {
        self.iterative.is_some()
    }

    /// The symbolic factorization of matrices with one number for every block.
    pub fn scalar(&mut self, pattern: &BlockPattern) -> Result<Arc<Symbolic>, SparseError> {
        if self.scalar.is_none() {
            self.scalar = Some(Arc::new(pattern.scalar_symbolic(self.order.as_deref())?));
        }
        Ok(self.scalar.clone().expect("just made"))
    }

    /// Another start: conjugate gradients may do for it.
    pub fn restart(&mut self) {
        if let Some(iterative) = &mut self.iterative {
            iterative.given_up = false;
            self.direct = None;
            self.by_columns = vec![];
        }
    }

    /// Prepare the matrix; `sure` if it is positive definite but for rounding.
    pub fn prepare(
        &mut self,
        pattern: &BlockPattern,
        values: &mut [f64],
        sure: bool,
    ) -> Result<(), SparseError> {
        self.sure = sure;
        match &mut self.iterative {
            Some(iterative) if !iterative.given_up => {
                iterative.preconditioner.factorize(pattern, |k| scalar_part(values, k), sure)
            }
            _ => self.factorize(pattern, values),
        }
    }

    /// Factorize the matrix as it is, whatever the size: for many right-hand sides and full accuracy.
    pub fn prepare_direct(&mut self, pattern: &BlockPattern, values: &mut [f64]) -> Result<(), SparseError> {
        self.sure = false;
        if let Some(iterative) = &mut self.iterative {
            iterative.given_up = true;
        }
        self.factorize(pattern, values)
    }

    /// Solve by the factorization, column after column.
    ///
    /// # Panics
    /// When there is none.
    pub fn solve_columns(&self, rhs: &mut [f64]) {
        self.direct.as_ref().expect("factorized").solve(rhs);
    }

    fn factorize(&mut self, pattern: &BlockPattern, values: &mut [f64]) -> Result<(), SparseError> {
        if self.direct.is_none() {
            self.direct = Some(Cholesky::new(Arc::new(pattern.symbolic(self.order.as_deref())?)));
        }
        let direct = self.direct.as_mut().expect("just made");
        pattern.by_columns(values, &mut self.by_columns);
        match direct.factorize(&self.by_columns) {
            Err(SparseError::NotPositiveDefinite(_)) if self.sure => {}
            other => return other,
        }
        pattern.lift(values, LIFT);
        pattern.by_columns(values, &mut self.by_columns);
        direct.factorize(&self.by_columns)
    }

    /// Replace the right-hand side by the solution for the matrix prepared last.
    ///
    /// That an exact Hessian is indefinite may turn out only here.
    pub fn solve(
        &mut self,
        pattern: &BlockPattern,
        values: &mut [f64],
        x: &mut [f64],
        accuracy: Accuracy,
    ) -> Result<(), SparseError> {
        if let Some(iterative) = self.iterative.as_mut().filter(|i| !i.given_up) {
            let b = x.to_vec();
            let Iterative { preconditioner, workspace, .. } = iterative;
            let ended = conjugate_gradients::solve(
                x,
                workspace,
                PATIENCE,
                |v, out| pattern.multiply(values, v, out),
                |v, out| preconditioner.apply(v, out),
                |progress| accuracy.reached(progress),
            );
            match ended {
                Ended::Enough => return Ok(()),
                Ended::Indefinite if !self.sure => return Err(SparseError::NotPositiveDefinite(0)),
                Ended::Indefinite | Ended::OutOfPatience => {}
            }
            iterative.given_up = true;
            x.copy_from_slice(&b);
            self.factorize(pattern, values)?;
        }
        self.direct.as_ref().expect("factorized").solve(x);
        Ok(())
    }
}
