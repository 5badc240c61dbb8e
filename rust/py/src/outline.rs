//! Bindings of `patchtransfer_core::outline`.

use crate::convert::{CurveTuple, curve, points2, rows};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use patchtransfer_core::outline::Outline as Core;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// A closed chain of curves parameterized by arc length.
#[pyclass(frozen)]
pub struct Outline {
    pub core: Core,
}

#[pymethods]
impl Outline {
    #[new]
    fn new(py: Python<'_>, curves: Vec<CurveTuple<'_>>) -> PyResult<Self> {
        let curves = curves.iter().map(curve).collect::<PyResult<Vec<_>>>()?;
        if curves.is_empty() {
            return Err(PyValueError::new_err("an outline needs a curve"));
        }
        Ok(Self { core: py.detach(|| Core::new(&curves)) })
    }

    #[getter]
    fn length(&self) -> f64 {
        self.core.length()
    }

    #[getter]
    fn diameter(&self) -> f64 {
        self.core.diameter()
    }

    #[getter]
    fn area(&self) -> f64 {
        self.core.area()
    }

    #[getter]
    fn joints<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.core.joints().into_pyarray(py)
    }

    #[getter]
    fn piece_starts<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.core.piece_starts().into_pyarray(py)
    }

    /// Arc lengths (n,) of the table and the points (n, 2) there.
    fn samples<'py>(&self, py: Python<'py>) -> (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>) {
        let (s, points) = self.core.samples();
        (s.to_vec().into_pyarray(py), rows(py, points))
    }

    fn arc_length<'py>(
        &self,
        py: Python<'py>,
        curve: usize,
        t: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        if curve + 1 >= self.core.joints().len() {
            return Err(PyValueError::new_err(format!("there is no curve {curve}")));
        }
        let s: Vec<f64> = t.as_array().iter().map(|&t| self.core.arc_length(curve, t)).collect();
        Ok(s.into_pyarray(py))
    }

    /// Points and unit tangents (n, 4) at the arc lengths `s`.
    fn evaluate<'py>(
        &self,
        py: Python<'py>,
        s: PyReadonlyArray1<'py, f64>,
        from_left: bool,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let s = s.as_slice()?;
        let out = py.detach(|| self.core.evaluate(s, from_left));
        Ok(rows(py, &out))
    }

    /// Signed turning angles (n,) at the arc lengths `s`.
    fn turn<'py>(
        &self,
        py: Python<'py>,
        s: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(self.core.turn(s.as_slice()?).into_pyarray(py))
    }

    /// Two-sided Hausdorff distance of two loops.
    fn hausdorff(&self, py: Python<'_>, other: &Self) -> f64 {
        py.detach(|| self.core.hausdorff(&other.core))
    }

    /// Arc lengths and distances (n, 2) of the nearest points of the loop to points (n, 2).
    fn nearest<'py>(
        &self,
        py: Python<'py>,
        points: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let points = points2(&points)?;
        let out = py.detach(|| self.core.nearest(&points));
        Ok(rows(py, &out))
    }
}

/// Add this file's class to the module.
pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_class::<Outline>()
}
