//! Conversions between NumPy arrays and the core's plain types.

use numpy::ndarray::Array2;
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
    PyUntypedArrayMethods,
};
use patchtransfer_core::spline::{SplineCurve, SplinePatch};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Rows of an (n, 2) array.
pub fn points2(array: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<[f64; 2]>> {
    if array.shape()[1] != 2 {
        return Err(PyValueError::new_err(format!("expected shape (n, 2), got {:?}", array.shape())));
    }
    Ok(array.as_array().rows().into_iter().map(|r| [r[0], r[1]]).collect())
}

/// Rows of `N` numbers as an array.
pub fn rows<'py, const N: usize>(py: Python<'py>, values: &[[f64; N]]) -> Bound<'py, PyArray2<f64>> {
    let flat = values.as_flattened().to_vec();
    Array2::from_shape_vec((values.len(), N), flat).expect("sizes agree").into_pyarray(py)
}

/// Indices as NumPy's integers.
pub fn integers<'py>(py: Python<'py>, values: &[usize]) -> Bound<'py, PyArray1<i64>> {
    values.iter().map(|&i| i as i64).collect::<Vec<_>>().into_pyarray(py)
}

/// `(knots_u, knots_v, p, q, control_points, weights)` as handed over from Python.
pub type PatchTuple<'py> = (
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    usize,
    usize,
    PyReadonlyArray3<'py, f64>,
    Option<PyReadonlyArray2<'py, f64>>,
);

/// A patch from its Python tuple.
pub fn patch(tuple: &PatchTuple<'_>) -> PyResult<SplinePatch> {
    let (u, v, p, q, points, weights) = tuple;
    let shape = points.shape();
    if shape[2] != 2 || u.len() != shape[0] + p + 1 || v.len() != shape[1] + q + 1 {
        return Err(PyValueError::new_err("patch: knots, degrees and control points do not fit"));
    }
    let a = points.as_array();
    let grid = (0..shape[0]).flat_map(|i| (0..shape[1]).map(move |j| (i, j)));
    Ok(SplinePatch {
        degrees: [*p, *q],
        knots: [u.as_array().to_vec(), v.as_array().to_vec()],
        shape: [shape[0], shape[1]],
        points: grid.map(|(i, j)| [a[[i, j, 0]], a[[i, j, 1]]]).collect(),
        weights: weights.as_ref().map(|w| w.as_array().iter().copied().collect()),
    })
}

/// Patches and the signs of their orientations, as many of the one as of the other.
pub fn oriented(tuples: &[PatchTuple<'_>], signs: &[f64]) -> PyResult<Vec<SplinePatch>> {
    one_a_patch("signs", signs.len(), tuples.len())?;
    tuples.iter().map(patch).collect()
}

/// Refuse lists that do not have one entry for every patch.
pub fn one_a_patch(what: &str, count: usize, patches: usize) -> PyResult<()> {
    if count == patches {
        return Ok(());
    }
    Err(PyValueError::new_err(format!("one entry a patch is needed: {count} {what} for {patches} patches")))
}

/// `(knots, degree, control_points, weights)` as handed over from Python.
pub type CurveTuple<'py> =
    (PyReadonlyArray1<'py, f64>, usize, PyReadonlyArray2<'py, f64>, Option<PyReadonlyArray1<'py, f64>>);

/// A curve from its Python tuple.
pub fn curve(tuple: &CurveTuple<'_>) -> PyResult<SplineCurve> {
    let (knots, degree, points, weights) = tuple;
    let points = points2(points)?;
    if knots.len() != points.len() + degree + 1 {
        return Err(PyValueError::new_err("curve: knots, degree and control points do not fit"));
    }
    Ok(SplineCurve {
        degree: *degree,
        knots: knots.as_array().to_vec(),
        points,
        weights: weights.as_ref().map(|w| w.as_array().to_vec()),
    })
}
