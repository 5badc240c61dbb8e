//! Bindings of `patchtransfer_core::spline::galerkin` and of the sparse Cholesky factorization.

use crate::threads;
use numpy::{
    IntoPyArray, PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods,
};
use patchtransfer_core::numeric::sparse::Cholesky;
use patchtransfer_core::spline::galerkin::{Galerkin as Core, MAX_ORDER, PatchSpace};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;

/// `(knots_u, knots_v, p, q, nodes_u, nodes_v, indices)` of a patch.
type SpaceTuple<'py> = (
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    usize,
    usize,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray2<'py, i64>,
);

/// Column offsets and row indices of an upper triangle.
type Pattern<'py> = (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<i64>>);

fn indices_of<'py>(py: Python<'py>, values: &[usize]) -> Bound<'py, PyArray1<i64>> {
    values.iter().map(|&i| i as i64).collect::<Vec<_>>().into_pyarray(py)
}

fn positions(array: &PyReadonlyArray1<'_, i64>, below: usize) -> PyResult<Vec<usize>> {
    let narrow = |&i: &i64| usize::try_from(i).ok().filter(|&i| i < below);
    let found: Option<Vec<usize>> = array.as_array().iter().map(narrow).collect();
    found.ok_or_else(|| PyValueError::new_err("an index is out of range"))
}

/// Symmetric matrices over the unknowns of a multi-patch spline space.
#[pyclass(frozen)]
struct Galerkin {
    core: Core,
}

#[pymethods]
impl Galerkin {
    #[new]
    fn new(py: Python<'_>, patches: Vec<SpaceTuple<'_>>, n: usize) -> PyResult<Self> {
        let mut spaces = vec![];
        for (ku, kv, p, q, tu, tv, indices) in &patches {
            let (shape, limits) = (indices.shape(), (ku.len(), kv.len()));
            if *p < 1 || *q < 1 || limits != (shape[0] + p + 1, shape[1] + q + 1) {
                return Err(PyValueError::new_err("knots, degrees and indices do not fit"));
            }
            let narrow = |&i: &i64| u32::try_from(i).ok().filter(|&i| (i as usize) < n);
            let indices: Option<Vec<u32>> = indices.as_array().iter().map(narrow).collect();
            let indices = indices.ok_or_else(|| PyValueError::new_err("an index is out of range"))?;
            let (ku, kv, tu, tv) = (ku.as_slice()?, kv.as_slice()?, tu.as_slice()?, tv.as_slice()?);
            spaces.push(PatchSpace::new([ku, kv], [*p, *q], [tu, tv], indices));
        }
        Ok(Self { core: threads::run(py, || Core::new(spaces, n))? })
    }

    fn pattern<'py>(&self, py: Python<'py>) -> Pattern<'py> {
        let (offsets, rows) = self.core.pattern();
        (indices_of(py, offsets), indices_of(py, rows))
    }

    fn assemble<'py>(
        &self,
        py: Python<'py>,
        kinds: Vec<[usize; 2]>,
        coefficients: Vec<PyReadonlyArray3<'py, f64>>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let pairs = kinds.len() * (kinds.len() + 1) / 2;
        let patches = self.core.patches();
        let fits = coefficients.len() == patches.len()
            && kinds.iter().flatten().all(|&order| order <= MAX_ORDER)
            && coefficients.iter().zip(patches).all(|(c, p)| {
                let [m, n] = p.nodes();
                c.shape() == [pairs, m, n]
            });
        if !fits {
            return Err(PyValueError::new_err("coefficients do not fit the form or the nodes"));
        }
        let slices = coefficients.iter().map(|c| c.as_slice()).collect::<Result<Vec<_>, _>>()?;
        Ok(threads::run(py, || self.core.assemble(&kinds, &slices))?.into_pyarray(py))
    }
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

/// Add this file's classes to the module.
pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_class::<Galerkin>()?;
    m.add_class::<SparseCholesky>()
}
