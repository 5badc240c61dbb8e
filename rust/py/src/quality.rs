//! Bindings of `patchtransfer_core::spline::quality`.

use crate::convert::{PatchTuple, one_a_patch, oriented, patch};
use crate::threads;
use numpy::ndarray::{Array2, Array3};
use numpy::{IntoPyArray, PyArray2, PyArray3};
use patchtransfer_core::spline::quality::{self, Range};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// `(min, max, sum)` of the scaled Jacobian, of the condition number, `(samples, positive)`, `(u, v)` of the worst.
type QualityTuple = ((f64, f64, f64), (f64, f64, f64), (usize, usize), (f64, f64));

/// Points (m_u, m_v, 2) and scaled Jacobians (m_u, m_v).
type GridTuple<'py> = (Bound<'py, PyArray3<f64>>, Bound<'py, PyArray2<f64>>);

/// Quality of every patch; `signs` are the orientations, `excluded` the corners to leave out, patch by patch.
#[pyfunction]
fn measure_quality(
    py: Python<'_>,
    patches: Vec<PatchTuple<'_>>,
    signs: Vec<f64>,
    samples: usize,
    excluded: Vec<Vec<usize>>,
) -> PyResult<Vec<QualityTuple>> {
    let patches = oriented(&patches, &signs)?;
    one_a_patch("lists of excluded corners", excluded.len(), patches.len())?;
    if samples < 2 {
        return Err(PyValueError::new_err("at least 2 samples a knot span are needed"));
    }
    let found = threads::run(py, || quality::measure(&patches, &signs, samples, &excluded))?;
    let tuple = |r: Range| (r.min, r.max, r.sum);
    Ok(found
        .into_iter()
        .map(|q| {
            let counts = (q.samples, q.positive);
            (tuple(q.scaled_jacobian), tuple(q.condition_number), counts, q.worst.into())
        })
        .collect())
}

/// Points and scaled Jacobians of a patch on the grid of `measure_quality`.
#[pyfunction]
fn sample_patch<'py>(
    py: Python<'py>,
    tuple: PatchTuple<'py>,
    sign: f64,
    samples: usize,
) -> PyResult<GridTuple<'py>> {
    let patch = patch(&tuple)?;
    if samples < 2 {
        return Err(PyValueError::new_err("at least 2 samples a knot span are needed"));
    }
    let grid = py.detach(|| quality::grid(&patch, sign, samples));
    let [m, n] = grid.shape;
    let points = Array3::from_shape_vec((m, n, 2), grid.points.into_flattened()).expect("sizes agree");
    let scaled = Array2::from_shape_vec((m, n), grid.scaled).expect("sizes agree");
    Ok((points.into_pyarray(py), scaled.into_pyarray(py)))
}

/// Add this file's functions to the module.
pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_function(wrap_pyfunction!(measure_quality, m)?)?;
    m.add_function(wrap_pyfunction!(sample_patch, m)?)
}
