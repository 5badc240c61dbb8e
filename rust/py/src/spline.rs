//! Bindings of `patchtransfer_core::spline`.

use crate::convert::points2;
use numpy::ndarray::{Array2, Array3};
use numpy::{
    IntoPyArray, PyArray2, PyArray3, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
    PyUntypedArrayMethods,
};
use patchtransfer_core::outline::Outline;
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

/// An outline on NumPy's memory, after a check of the shapes.
fn outline<'a>(
    pieces: &'a PyReadonlyArray3<'_, f64>,
    table: &'a PyReadonlyArray1<'_, f64>,
) -> PyResult<Outline<'a>> {
    let [m, order, dimension] = [0, 1, 2].map(|k| pieces.shape()[k]);
    let (pieces, table) = (pieces.as_slice()?, table.as_slice()?);
    if dimension != 3 || order < 2 || m == 0 || table.len() < m + 1 || (table.len() - 1) % m != 0 {
        return Err(PyValueError::new_err("pieces (m, degree + 1, 3) and table do not fit"));
    }
    let intervals = (table.len() - 1) / m;
    Ok(Outline { pieces: pieces.as_chunks::<3>().0, degree: order - 1, table, intervals })
}

/// Rows of `N` numbers as an array.
fn rows<'py, const N: usize>(py: Python<'py>, values: Vec<[f64; N]>) -> Bound<'py, PyArray2<f64>> {
    let shape = (values.len(), N);
    let flat: Vec<f64> = values.into_iter().flatten().collect();
    Array2::from_shape_vec(shape, flat).expect("sizes agree").into_pyarray(py)
}

/// Points and unit tangents (n, 4) of a closed chain of Bézier pieces (m, degree + 1, 3) at the arc lengths `s`.
#[pyfunction]
fn evaluate_outline<'py>(
    py: Python<'py>,
    pieces: PyReadonlyArray3<'py, f64>,
    table: PyReadonlyArray1<'py, f64>,
    s: PyReadonlyArray1<'py, f64>,
    from_left: bool,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (outline, s) = (outline(&pieces, &table)?, s.as_slice()?);
    let out = py.detach(|| outline.evaluate(s, from_left));
    Ok(rows(py, out))
}

/// Arc lengths and distances (n, 2) of the feet of the perpendiculars from points (n, 2), from the starts `s`.
#[pyfunction]
fn outline_feet<'py>(
    py: Python<'py>,
    pieces: PyReadonlyArray3<'py, f64>,
    table: PyReadonlyArray1<'py, f64>,
    points: PyReadonlyArray2<'py, f64>,
    s: PyReadonlyArray1<'py, f64>,
    reach: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (outline, points) = (outline(&pieces, &table)?, points2(&points)?);
    let (s, reach) = (s.as_slice()?, reach.as_slice()?);
    if s.len() != points.len() || reach.len() != points.len() {
        return Err(PyValueError::new_err("points, starts and reaches differ in number"));
    }
    let out = py.detach(|| outline.feet(&points, s, reach));
    Ok(rows(py, out))
}

/// Add this file's functions to the module.
pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(evaluate_outline, m)?)?;
    m.add_function(wrap_pyfunction!(outline_feet, m)?)?;
    m.add_function(wrap_pyfunction!(bezier_extract, m)?)
}
