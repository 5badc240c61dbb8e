//! Bindings of `patchtransfer_core::location`: points of the plane found in patches.

use crate::convert::{PatchTuple, patch, points2};
use crate::threads;
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray2};
use patchtransfer_core::location::Locator as Core;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Patches, -1 for none, and parameters u and v, NaN for none.
type Places<'py> = (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>);

/// Patches prepared for finding points.
#[pyclass(frozen)]
struct Locator {
    core: Core,
}

#[pymethods]
impl Locator {
    #[new]
    fn new(py: Python<'_>, patches: Vec<PatchTuple<'_>>) -> PyResult<Self> {
        if patches.is_empty() {
            return Err(PyValueError::new_err("there is no patch to look in"));
        }
        let patches = patches.iter().map(patch).collect::<PyResult<Vec<_>>>()?;
        Ok(Self { core: threads::run(py, || Core::new(&patches))? })
    }

    /// Where points (n, 2) lie; `tolerance` in their unit.
    fn locate<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray2<'py, f64>,
        tolerance: f64,
    ) -> PyResult<Places<'py>> {
        let points = points2(&points)?;
        let places = threads::run(py, || self.core.locate(&points, tolerance))?;
        let patches: Vec<i64> = places.iter().map(|p| p.map_or(-1, |p| p.patch as i64)).collect();
        let [u, v] =
            [0, 1].map(|d| places.iter().map(|p| p.map_or(f64::NAN, |p| p.at[d])).collect::<Vec<_>>());
        Ok((patches.into_pyarray(py), u.into_pyarray(py), v.into_pyarray(py)))
    }
}

/// Add this file's names to the module.
pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_class::<Locator>()
}
