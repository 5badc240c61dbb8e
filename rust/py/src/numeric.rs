//! Bindings of `patchtransfer_core::numeric`: dense matrices and stacks of them, sparse Cholesky, Gauss
//! rules, bounded distortion.

use crate::convert::rows;
use crate::threads;
use numpy::ndarray::{Array2, Array3};
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArray3, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
    PyUntypedArrayMethods,
};
use patchtransfer_core::numeric::dense::{self, Definite, NoConvergence, Svd};
use patchtransfer_core::numeric::quadrature;
use patchtransfer_core::numeric::sparse::Cholesky;
use patchtransfer_core::numeric::ssvd;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use rayon::prelude::*;

/// Multiplications (about 0.1 ms) below which waking other threads takes longer than the work.
const SMALL: usize = 200_000;

/// `(u, sigma, vt)` of a stack.
type SvdTuple<'py> = (Bound<'py, PyArray3<f64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray3<f64>>);

/// Eigenvalues and eigenvectors.
type EigenTuple<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>);

/// One result for every matrix of a stack, where one takes so many multiplications; in the calling thread if they are
/// few.
fn each<R: Send>(
    py: Python<'_>,
    count: usize,
    work: usize,
    one: impl Fn(usize) -> R + Sync + Send,
) -> PyResult<Vec<R>> {
    if count < 2 || count * work < SMALL {
        return Ok(py.detach(|| (0..count).map(one).collect()));
    }
    let apiece = 1 + SMALL / (4 * work.max(1));
    threads::run(py, || (0..count).into_par_iter().with_min_len(apiece).map(one).collect())
}

fn stacked<'py>(
    py: Python<'py>,
    parts: impl Iterator<Item = Vec<f64>>,
    shape: [usize; 3],
) -> Bound<'py, PyArray3<f64>> {
    let mut flat = Vec::with_capacity(shape.iter().product());
    parts.for_each(|part| flat.extend(part));
    Array3::from_shape_vec(shape, flat).expect("sizes agree").into_pyarray(py)
}

fn diverged(error: NoConvergence) -> PyErr {
    PyRuntimeError::new_err(error.to_string())
}

/// Products (s, m, n) of stacks (s, m, k) and (s, k, n), of which either may hold one matrix for all.
#[pyfunction]
fn product<'py>(
    py: Python<'py>,
    a: PyReadonlyArray3<'py, f64>,
    b: PyReadonlyArray3<'py, f64>,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let (&[s, m, k], &[t, l, n]) = (a.shape(), b.shape()) else { unreachable!("arrays of three dimensions") };
    if k != l || (s != t && s != 1 && t != 1) {
        return Err(PyValueError::new_err(format!("shapes {:?} and {:?} do not fit", a.shape(), b.shape())));
    }
    let (a, b) = (a.as_slice()?, b.as_slice()?);
    if t == 1 {
        // One tall matrix.
        let flat = py.detach(|| dense::product(a, b, [s * m, k, n]));
        return Ok(stacked(py, std::iter::once(flat), [s, m, n]));
    }
    let (step_a, step_b) = (if s == 1 { 0 } else { m * k }, k * n);
    let one = |i: usize| dense::product(&a[i * step_a..][..m * k], &b[i * step_b..][..step_b], [m, k, n]);
    Ok(stacked(py, each(py, t, m * k * n, one)?.into_iter(), [t, m, n]))
}

/// Singular value decompositions of a stack (s, m, n): left vectors as columns, values, right vectors as rows.
#[pyfunction]
fn svd<'py>(py: Python<'py>, matrices: PyReadonlyArray3<'py, f64>, full: bool) -> PyResult<SvdTuple<'py>> {
    let &[s, m, n] = matrices.shape() else { unreachable!("an array of three dimensions") };
    let (all, size) = (matrices.as_slice()?, m.min(n));
    let one = |i: usize| dense::svd(&all[i * m * n..][..m * n], [m, n], full);
    // Some ten products of two such matrices.
    let found: Result<Vec<Svd>, _> = each(py, s, 10 * m * n * size, one)?.into_iter().collect();
    let (mut left, mut values, mut right) = (vec![], vec![], vec![]);
    for part in found.map_err(diverged)? {
        left.push(part.u);
        values.extend(part.sigma);
        right.push(part.vt);
    }
    let (l, r) = if full { (m, n) } else { (size, size) };
    let values = Array2::from_shape_vec([s, size], values).expect("sizes agree").into_pyarray(py);
    Ok((stacked(py, left.into_iter(), [s, m, l]), values, stacked(py, right.into_iter(), [s, r, n])))
}

fn square(matrix: &PyReadonlyArray2<'_, f64>) -> PyResult<usize> {
    match matrix.shape() {
        &[m, n] if m == n => Ok(n),
        shape => Err(PyValueError::new_err(format!("the matrix must be square, got {shape:?}"))),
    }
}

/// Eigenvalues (n,) and eigenvectors (n, n), as columns, of a symmetric matrix.
#[pyfunction]
fn eigen<'py>(py: Python<'py>, matrix: PyReadonlyArray2<'py, f64>) -> PyResult<EigenTuple<'py>> {
    let (n, entries) = (square(&matrix)?, matrix.as_slice()?);
    let (values, vectors) = py.detach(|| dense::eigen(entries, n)).map_err(diverged)?;
    let vectors = Array2::from_shape_vec([n, n], vectors).expect("sizes agree");
    Ok((values.into_pyarray(py), vectors.into_pyarray(py)))
}

/// Solution (n, k) of a system with the right-hand sides (n, k).
#[pyfunction]
fn solve<'py>(
    py: Python<'py>,
    matrix: PyReadonlyArray2<'py, f64>,
    rhs: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (n, columns, entries) = (square(&matrix)?, rhs.shape()[1], matrix.as_slice()?);
    if rhs.shape()[0] != n {
        return Err(PyValueError::new_err("the right-hand side has another number of rows"));
    }
    let mut x = rhs.as_slice()?.to_vec();
    py.detach(|| dense::solve(entries, &mut x, n));
    Ok(Array2::from_shape_vec([n, columns], x).expect("sizes agree").into_pyarray(py))
}

/// Solution (n,) of a symmetric positive definite system.
#[pyfunction]
fn solve_definite<'py>(
    py: Python<'py>,
    matrix: PyReadonlyArray2<'py, f64>,
    rhs: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let (n, entries) = (square(&matrix)?, matrix.as_slice()?);
    if rhs.len() != n {
        return Err(PyValueError::new_err("the right-hand side has another number of rows"));
    }
    let mut x = rhs.as_slice()?.to_vec();
    py.detach(|| Definite::new(entries, n).solve(&mut x));
    Ok(x.into_pyarray(py))
}

fn positions(array: &PyReadonlyArray1<'_, i64>, below: usize) -> PyResult<Vec<usize>> {
    let narrow = |&i: &i64| usize::try_from(i).ok().filter(|&i| i < below);
    let found: Option<Vec<usize>> = array.as_array().iter().map(narrow).collect();
    found.ok_or_else(|| PyValueError::new_err("an index is out of range"))
}

/// Cholesky factorization of symmetric matrices that share one pattern (upper triangle, compressed columns). One
/// thread's work, so it is the calling one's: no other has to wake.
#[pyclass]
struct SparseCholesky {
    core: Cholesky,
    entries: usize,
    ready: bool,
}

#[pymethods]
impl SparseCholesky {
    #[new]
    fn new(
        py: Python<'_>,
        offsets: PyReadonlyArray1<'_, i64>,
        rows: PyReadonlyArray1<'_, i64>,
    ) -> PyResult<Self> {
        let n = offsets.len().saturating_sub(1);
        let (offsets, rows) = (positions(&offsets, rows.len() + 1)?, positions(&rows, n)?);
        // The diagonal ends every column, as the factorization expects.
        let sorted = offsets.first() == Some(&0)
            && offsets.last() == Some(&rows.len())
            && offsets.windows(2).enumerate().all(|(j, w)| {
                w[0] < w[1] && rows[w[0]..w[1]].windows(2).all(|r| r[0] < r[1]) && rows[w[1] - 1] == j
            });
        if !sorted {
            return Err(PyValueError::new_err(
                "not the sorted pattern of an upper triangle with its diagonal",
            ));
        }
        let core = py
            .detach(|| Cholesky::analyse(&offsets, &rows, None))
            .map_err(|e| PyRuntimeError::new_err(e.to_string()))?;
        Ok(Self { core, entries: rows.len(), ready: false })
    }

    fn factorize(&mut self, py: Python<'_>, values: PyReadonlyArray1<'_, f64>) -> PyResult<()> {
        let values = values.as_slice()?;
        if values.len() != self.entries {
            return Err(PyValueError::new_err("values do not fit the pattern"));
        }
        self.ready = false;
        py.detach(|| self.core.factorize(values)).map_err(|e| PyRuntimeError::new_err(e.to_string()))?;
        self.ready = true;
        Ok(())
    }

    fn solve<'py>(
        &self,
        py: Python<'py>,
        rhs: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        if !self.ready || rhs.len() != self.core.dimension() {
            return Err(PyValueError::new_err(
                "factorize first; the right-hand side must have its dimension",
            ));
        }
        let mut x = rhs.as_slice()?.to_vec();
        py.detach(|| self.core.solve(&mut x));
        Ok(x.into_pyarray(py))
    }
}

/// Nodes and weights of a rule.
type Rule<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

/// Nodes in (-1, 1) and weights of the Gauss–Legendre rule with `n` nodes.
#[pyfunction]
fn gauss<'py>(py: Python<'py>, n: usize) -> PyResult<Rule<'py>> {
    if n == 0 {
        return Err(PyValueError::new_err("a rule has at least one node"));
    }
    let (nodes, weights) = quadrature::gauss(n);
    Ok((nodes.into_pyarray(py), weights.into_pyarray(py)))
}

/// Bounds on the conformal distortion, `n` of them.
pub fn distortion_bounds(k: &PyReadonlyArray1<'_, f64>, n: usize) -> PyResult<Vec<f64>> {
    let k = k.as_array().to_vec();
    if k.len() != n {
        return Err(PyValueError::new_err(format!("expected {n} bounds k, got {}", k.len())));
    }
    match k.iter().find(|&&x| !(1.0..=1e100).contains(&x)) {
        Some(bad) => Err(PyValueError::new_err(format!("a bound k must lie in [1, 1e100], got {bad}"))),
        None => Ok(k),
    }
}

/// Nearest matrices (n, 4), row-major, of conformal distortion at most k (n,).
#[pyfunction]
fn project_bounded_distortion<'py>(
    py: Python<'py>,
    jacobians: PyReadonlyArray2<'py, f64>,
    k: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    if jacobians.shape()[1] != 4 {
        return Err(PyValueError::new_err(format!("expected shape (n, 4), got {:?}", jacobians.shape())));
    }
    let k = distortion_bounds(&k, jacobians.shape()[0])?;
    let j: Vec<[f64; 4]> =
        jacobians.as_array().rows().into_iter().map(|r| [r[0], r[1], r[2], r[3]]).collect();
    let mut out = vec![[0.0; 4]; j.len()];
    threads::run(py, || ssvd::project_all(&j, &k, &mut out))?;
    Ok(rows(py, &out))
}

/// Add this file's names to the module.
pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_class::<SparseCholesky>()?;
    m.add_function(wrap_pyfunction!(gauss, m)?)?;
    m.add_function(wrap_pyfunction!(project_bounded_distortion, m)?)?;
    m.add_function(wrap_pyfunction!(product, m)?)?;
    m.add_function(wrap_pyfunction!(svd, m)?)?;
    m.add_function(wrap_pyfunction!(eigen, m)?)?;
    m.add_function(wrap_pyfunction!(solve, m)?)?;
    m.add_function(wrap_pyfunction!(solve_definite, m)?)
}
