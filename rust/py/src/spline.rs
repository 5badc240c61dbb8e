//! Bindings of `patchtransfer_core::spline`.

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

/// Points and unit tangents (n, 4) of a closed chain of Bézier pieces (m, degree + 1, 3) at the arc lengths `s`.
#[pyfunction]
fn evaluate_outline<'py>(
    py: Python<'py>,
    pieces: PyReadonlyArray3<'py, f64>,
    table: PyReadonlyArray1<'py, f64>,
    s: PyReadonlyArray1<'py, f64>,
    from_left: bool,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let [m, order, dimension] = [0, 1, 2].map(|k| pieces.shape()[k]);
    let (pieces, table, s) = (pieces.as_slice()?, table.as_slice()?, s.as_slice()?);
    if dimension != 3 || order < 2 || m == 0 || table.len() < m + 1 || (table.len() - 1) % m != 0 {
        return Err(PyValueError::new_err("pieces (m, degree + 1, 3) and table do not fit"));
    }
    let outline = Outline {
        pieces: pieces.as_chunks::<3>().0,
        degree: order - 1,
        table,
        intervals: (table.len() - 1) / m,
    };
    let out = py.detach(|| outline.evaluate(s, from_left));
    let flat: Vec<f64> = out.into_iter().flatten().collect();
    Ok(Array2::from_shape_vec((s.len(), 4), flat).expect("four columns").into_pyarray(py))
}

/// Add this file's functions to the module.
pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(evaluate_outline, m)?)?;
    m.add_function(wrap_pyfunction!(bezier_extract, m)?)
}
