//! Bindings of `patchtransfer_core::continuity`.

use crate::convert::{integers, points2, rows};
use crate::mesh::indices;
use crate::threads;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use patchtransfer_core::continuity::{self, ContinuityError, RowSpace as Core, Rows, SparseRows};
use pyo3::create_exception;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;

create_exception!(_core, CircularRowsError, PyValueError, "Substitutions that need each other.");

/// `(indptr, indices, data, shape)` of a matrix in compressed rows or columns.
type Compressed<'py> =
    (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<f64>>, (usize, usize));

/// The same as handed over from Python.
type CompressedReadonly<'py> =
    (PyReadonlyArray1<'py, i64>, PyReadonlyArray1<'py, i64>, PyReadonlyArray1<'py, f64>, (usize, usize));

fn compressed_rows((offsets, columns, values, shape): &CompressedReadonly<'_>) -> PyResult<SparseRows> {
    SparseRows::from_parts(indices(offsets)?, indices(columns)?, values.as_array().to_vec(), shape.1)
        .filter(|rows| rows.len() == shape.0)
        .ok_or_else(|| PyValueError::new_err("continuity rows: indptr, indices and data do not fit"))
}

fn numbers_of_points(array: &PyReadonlyArray1<'_, i64>, n: usize) -> PyResult<Vec<usize>> {
    let found = indices(array)?;
    match found.iter().find(|&&i| i >= n) {
        Some(i) => Err(PyValueError::new_err(format!("point {i} of {n}"))),
        None => Ok(found),
    }
}

fn not_eliminated(error: ContinuityError) -> PyErr {
    match error {
        ContinuityError::Circle => CircularRowsError::new_err(error.to_string()),
        _ => PyRuntimeError::new_err(error.to_string()),
    }
}

fn runtime(error: impl std::fmt::Display) -> PyErr {
    PyRuntimeError::new_err(error.to_string())
}

/// All maps with given boundary points that satisfy continuity rows.
#[pyclass(frozen)]
struct RowSpace {
    core: Core,
    points: usize,
}

#[pymethods]
impl RowSpace {
    #[new]
    fn new(
        py: Python<'_>,
        matrix: CompressedReadonly<'_>,
        slave: PyReadonlyArray1<'_, i64>,
        interface: PyReadonlyArray1<'_, i64>,
        order: PyReadonlyArray1<'_, i64>,
        interior: PyReadonlyArray1<'_, i64>,
        points: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<Self> {
        let points = points2(&points)?;
        let n = points.len();
        let slave: Vec<Option<usize>> = slave.as_array().iter().map(|&s| usize::try_from(s).ok()).collect();
        let interior = numbers_of_points(&interior, n)?;
        let all = Rows {
            matrix: compressed_rows(&matrix)?,
            slave,
            interface: indices(&interface)?,
            order: order.as_array().to_vec(),
        };
        let m = all.matrix.len();
        let fits = matrix.3.1 == n
            && [all.slave.len(), all.interface.len(), all.order.len()] == [m; 3]
            && all.slave.iter().flatten().all(|&s| s < n)
            && interior.windows(2).all(|w| w[0] < w[1]);
        if !fits {
            return Err(PyValueError::new_err("continuity rows, interior and points do not fit"));
        }
        let core = threads::run(py, || Core::new(&all, &interior, &points))?.map_err(not_eliminated)?;
        Ok(Self { core, points: n })
    }

    /// The basis by columns.
    fn basis<'py>(&self, py: Python<'py>) -> Compressed<'py> {
        let z = self.core.basis();
        let (offsets, at, values) = z.csc_data();
        (integers(py, offsets), integers(py, at), values.to_vec().into_pyarray(py), (z.nrows(), z.ncols()))
    }

    /// The particular solution by rows.
    fn particular<'py>(&self, py: Python<'py>) -> Compressed<'py> {
        let matrix = self.core.particular();
        let (offsets, at, values) = matrix.parts();
        let shape = (matrix.len(), matrix.width());
        (integers(py, offsets), integers(py, at), values.to_vec().into_pyarray(py), shape)
    }

    #[getter]
    fn dropped<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        integers(py, self.core.dropped())
    }

    #[getter]
    fn redundant(&self) -> usize {
        self.core.redundant()
    }

    fn project<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let x = self.shared_points(&points)?;
        let moved = py.detach(|| self.core.project(&x)).map_err(runtime)?;
        Ok(rows(py, &moved))
    }

    fn residual(&self, py: Python<'_>, points: PyReadonlyArray2<'_, f64>) -> PyResult<f64> {
        let x = self.shared_points(&points)?;
        Ok(py.detach(|| self.core.residual(&x)))
    }
}

impl RowSpace {
    fn shared_points(&self, points: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<[f64; 2]>> {
        let x = points2(points)?;
        if x.len() != self.points {
            return Err(PyValueError::new_err(format!("expected {} points, got {}", self.points, x.len())));
        }
        Ok(x)
    }
}

/// The nearest points that satisfy the rows `chosen`, moving those of `interior` only.
#[pyfunction]
fn nearest_on_rows<'py>(
    py: Python<'py>,
    matrix: CompressedReadonly<'py>,
    chosen: PyReadonlyArray1<'py, i64>,
    interior: PyReadonlyArray1<'py, i64>,
    points: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (all, x, chosen) = (compressed_rows(&matrix)?, points2(&points)?, indices(&chosen)?);
    if matrix.3.1 != x.len() || chosen.iter().any(|&r| r >= all.len()) {
        return Err(PyValueError::new_err("continuity rows and points do not fit"));
    }
    let mut free = vec![false; x.len()];
    numbers_of_points(&interior, x.len())?.into_iter().for_each(|i| free[i] = true);
    let moved = py.detach(|| continuity::nearest(&all, &chosen, &free, &x)).map_err(runtime)?;
    Ok(rows(py, &moved))
}

/// Add this file's names to the module.
pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add("CircularRowsError", m.py().get_type::<CircularRowsError>())?;
    m.add_class::<RowSpace>()?;
    m.add_function(wrap_pyfunction!(nearest_on_rows, m)?)
}
