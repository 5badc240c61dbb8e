//! Bindings of `patchtransfer_core::spline`.

use numpy::ndarray::{Array2, Array3};
use numpy::{IntoPyArray, PyArray2, PyArray3, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use patchtransfer_core::spline;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Homogeneous Bézier points (m, degree + 1, 3) of the spans of a spline with coefficients (n, 3).
#[pyfunction]
fn bezier_extract<'py>(
    py: Python<'py>,
    knots: PyReadonlyArray1<'py, f64>,
    degree: usize,
    coefficients: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    if coefficients.shape()[1] != 3 || knots.len() != coefficients.shape()[0] + degree + 1 {
        return Err(PyValueError::new_err("knots, degree and coefficients (n, 3) do not fit"));
    }
    let c: Vec<[f64; 3]> = coefficients.as_array().rows().into_iter().map(|r| [r[0], r[1], r[2]]).collect();
    let pieces = spline::bezier_extract(&knots.as_array().to_vec(), degree, &c);
    let m = pieces.len() / (degree + 1);
    let flat: Vec<f64> = pieces.into_iter().flatten().collect();
    let array = Array3::from_shape_vec((m, degree + 1, 3), flat).expect("sizes agree");
    Ok(array.into_pyarray(py))
}

/// Derivatives of `order` of a spline with coefficients (n, d) at the parameters `at` (m,), shape (m, d).
#[pyfunction]
fn evaluate_spline<'py>(
    py: Python<'py>,
    knots: PyReadonlyArray1<'py, f64>,
    degree: usize,
    coefficients: PyReadonlyArray2<'py, f64>,
    at: PyReadonlyArray1<'py, f64>,
    order: usize,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let [n, width] = [coefficients.shape()[0], coefficients.shape()[1]];
    if n <= degree || width == 0 || knots.len() != n + degree + 1 {
        return Err(PyValueError::new_err("knots, degree and coefficients (n, d) do not fit"));
    }
    let c: Vec<f64> = coefficients.as_array().iter().copied().collect();
    let (knots, at) = (knots.as_array().to_vec(), at.as_array().to_vec());
    let values = spline::evaluate(&knots, degree, &c, width, &at, order);
    Ok(Array2::from_shape_vec((at.len(), width), values).expect("sizes agree").into_pyarray(py))
}

/// Add this file's functions to the module.
pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(bezier_extract, m)?)?;
    m.add_function(wrap_pyfunction!(evaluate_spline, m)?)
}
