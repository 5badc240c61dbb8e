//! Bindings of `patchtransfer_core::optimizer`.

use crate::convert::{PatchTuple, patch, points2, rows};
use crate::threads::{self, Deadline};
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2};
use patchtransfer_core::distortion::HessianKind;
use patchtransfer_core::numeric::sparse::{CooMatrix, CscMatrix};
use patchtransfer_core::optimizer::{MAX_POWER, Model, Settings, SplineOptimizer as Core, Step, Stop};
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use std::ops::ControlFlow;

type Triplets<'py> =
    (PyReadonlyArray1<'py, i64>, PyReadonlyArray1<'py, i64>, PyReadonlyArray1<'py, f64>, usize);

/// Columns energy, min_det, eps, decrement, one row a step.
type Outcome<'py> = (Bound<'py, PyArray2<f64>>, f64, f64, Bound<'py, PyArray2<f64>>, &'static str);

/// Points, energy, gradient, residual and smallest determinant.
type Settled<'py> = (Bound<'py, PyArray2<f64>>, f64, Bound<'py, PyArray2<f64>>, f64, f64);

/// Fields, slopes and second derivatives.
type Motions<'py> = (Vec<Bound<'py, PyArray2<f64>>>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>);

/// A multi-patch prepared for harmonic maps and distortion minimisation.
#[pyclass]
struct SplineOptimizer {
    core: Core,
}

fn runtime(error: impl std::fmt::Display) -> PyErr {
    PyRuntimeError::new_err(error.to_string())
}

#[pymethods]
impl SplineOptimizer {
    #[new]
    #[pyo3(signature = (reference, indices, n_points, free, nodes_per_degree, extra=vec![], excluded=vec![], z=None))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        py: Python<'_>,
        reference: Vec<PatchTuple<'_>>,
        indices: Vec<PyReadonlyArray1<'_, i64>>,
        n_points: usize,
        free: Vec<usize>,
        nodes_per_degree: usize,
        extra: Vec<(usize, f64, f64)>,
        excluded: Vec<(usize, usize)>,
        z: Option<Triplets<'_>>,
    ) -> PyResult<Self> {
        let reference = reference.iter().map(patch).collect::<PyResult<Vec<_>>>()?;
        let indices: Vec<Vec<u32>> =
            indices.iter().map(|a| a.as_array().iter().map(|&i| i as u32).collect()).collect();
        let fits = indices.len() == reference.len()
            && indices.iter().zip(&reference).all(|(i, p)| i.len() == p.points.len())
            && indices.iter().flatten().all(|&i| (i as usize) < n_points)
            && free.iter().all(|&i| i < n_points)
            && extra.iter().all(|e| e.0 < reference.len());
        if !fits {
            return Err(PyValueError::new_err("indices, free points or extra nodes do not fit the patches"));
        }
        let z = z.map(|(i, j, v, columns)| {
            let mut coo = CooMatrix::new(free.len(), columns);
            let (i, j, v) = (i.as_array(), j.as_array(), v.as_array());
            for k in 0..v.len() {
                coo.push(i[k] as usize, j[k] as usize, v[k]);
            }
            CscMatrix::from(&coo)
        });
        threads::run(py, || {
            let model = Model { reference, indices, n_points, nodes_per_degree, extra, excluded };
            Ok(Self { core: Core::new(model, free, z).map_err(runtime)? })
        })?
    }

    fn set_basis(&mut self, py: Python<'_>, values: PyReadonlyArray1<'_, f64>) -> PyResult<()> {
        let values = values.as_array().to_vec();
        let entries = self.core.basis_entries();
        if values.len() != entries {
            return Err(PyValueError::new_err(format!(
                "the basis has {entries} entries, got {} values",
                values.len()
            )));
        }
        threads::run(py, || self.core.set_basis(&values))
    }

    fn harmonic<'py>(
        &mut self,
        py: Python<'py>,
        points: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let x = self.shared_points(&points)?;
        let out = threads::run(py, || self.core.harmonic(&x))?.map_err(runtime)?;
        Ok(rows(py, &out))
    }

    fn determinants(&mut self, py: Python<'_>, points: PyReadonlyArray2<'_, f64>) -> PyResult<(f64, f64)> {
        let x = self.shared_points(&points)?;
        threads::run(py, || self.core.determinants(&x))
    }

    fn gradient<'py>(
        &mut self,
        py: Python<'py>,
        points: PyReadonlyArray2<'py, f64>,
        lambda_: f64,
    ) -> PyResult<(f64, Bound<'py, PyArray2<f64>>)> {
        let x = self.shared_points(&points)?;
        let (energy, gradient) = threads::run(py, || self.core.gradient(&x, lambda_))?;
        Ok((energy, rows(py, &gradient)))
    }

    #[pyo3(signature = (points, lambda_, exact=true, scale=None))]
    fn linearise(
        &mut self,
        py: Python<'_>,
        points: PyReadonlyArray2<'_, f64>,
        lambda_: f64,
        exact: bool,
        scale: Option<f64>,
    ) -> PyResult<()> {
        let x = self.shared_points(&points)?;
        let kind = if exact { HessianKind::Exact } else { HessianKind::Projected };
        threads::run(py, || self.core.linearise(&x, lambda_, kind, scale))?.map_err(runtime)
    }

    fn respond<'py>(
        &mut self,
        py: Python<'py>,
        forces: Vec<PyReadonlyArray2<'py, f64>>,
    ) -> PyResult<Vec<Bound<'py, PyArray2<f64>>>> {
        self.check_linearised()?;
        let forces = forces.iter().map(|q| self.shared_points(q)).collect::<PyResult<Vec<_>>>()?;
        let out = threads::run(py, || self.core.respond(&forces))?;
        Ok(out.iter().map(|v| rows(py, v)).collect())
    }

    fn product<'py>(
        &mut self,
        py: Python<'py>,
        directions: Vec<PyReadonlyArray2<'py, f64>>,
    ) -> PyResult<Vec<Bound<'py, PyArray2<f64>>>> {
        self.check_linearised()?;
        let directions = directions.iter().map(|v| self.shared_points(v)).collect::<PyResult<Vec<_>>>()?;
        let out: Vec<_> =
            threads::run(py, || directions.iter().map(|v| self.core.product(v)).collect::<Vec<_>>())?;
        Ok(out.iter().map(|q| rows(py, q)).collect())
    }

    /// Points, energy, gradient at all points, its largest component for the unknowns, and the smallest determinant.
    fn settle<'py>(&mut self, py: Python<'py>, corrections: usize) -> PyResult<Settled<'py>> {
        self.check_linearised()?;
        let found = threads::run(py, || self.core.settle(corrections))?;
        let (points, gradient) = (rows(py, &found.points), rows(py, &found.gradient));
        Ok((points, found.energy, gradient, found.residual, found.min_det))
    }

    fn look_from(&mut self, points: PyReadonlyArray2<'_, f64>) -> PyResult<()> {
        self.check_linearised()?;
        let x = self.shared_points(&points)?;
        self.core.look_from(x);
        Ok(())
    }

    /// Fields, slopes and second derivatives of the motions that begin with `begins`.
    fn motions<'py>(
        &mut self,
        py: Python<'py>,
        begins: Vec<PyReadonlyArray2<'py, f64>>,
    ) -> PyResult<Motions<'py>> {
        self.check_linearised()?;
        let begins = begins.iter().map(|f| self.shared_points(f)).collect::<PyResult<Vec<_>>>()?;
        let count = begins.len();
        let found = threads::run(py, || self.core.motions(begins))?;
        let hessian = Array2::from_shape_vec((count, count), found.hessian).expect("a square");
        let fields = found.fields.iter().map(|f| rows(py, f)).collect();
        Ok((fields, found.slopes.into_pyarray(py), hessian.into_pyarray(py)))
    }

    #[pyo3(signature = (points, lambda_, max_steps, tolerance, callback=None, seconds=None, scale=None, power=1))]
    #[allow(clippy::too_many_arguments)]
    fn minimise<'py>(
        &mut self,
        py: Python<'py>,
        points: PyReadonlyArray2<'py, f64>,
        lambda_: f64,
        max_steps: usize,
        tolerance: f64,
        callback: Option<Py<PyAny>>,
        seconds: Option<f64>,
        scale: Option<f64>,
        power: u32,
    ) -> PyResult<Outcome<'py>> {
        if !(1..=MAX_POWER).contains(&power) {
            return Err(PyValueError::new_err(format!(
                "the power of the energy is 1 to {MAX_POWER}, got {power}"
            )));
        }
        let end = Deadline::after(seconds);
        let x = self.shared_points(&points)?;
        let settings = Settings { lambda: lambda_, power, max_steps, tolerance, scale };
        let mut count = 0_usize;
        let outcome = threads::run_watched(
            py,
            |report| {
                self.core.minimise(&x, settings, |step: &Step| {
                    // Ctrl-C is an error by itself, so what is interrupted otherwise is so by the clock.
                    if report(*step) && !end.passed() {
                        ControlFlow::Continue(())
                    } else {
                        ControlFlow::Break(())
                    }
                })
            },
            callback.map(|f| {
                move |py: Python<'_>, step: Step| {
                    count += 1;
                    f.call1(py, (count, step.energy, step.min_det)).map(|_| ())
                }
            }),
        )?;
        let outcome = outcome.map_err(runtime)?;
        let history: Vec<f64> =
            outcome.steps.iter().flat_map(|s| [s.energy, s.min_det, s.eps, s.decrement]).collect();
        let history = Array2::from_shape_vec((outcome.steps.len(), 4), history).expect("four columns");
        let stop = match outcome.stop {
            Stop::Converged => "converged",
            Stop::StepLimit => "step limit",
            Stop::Stalled => "stalled",
            Stop::Interrupted => "time limit",
        };
        Ok((rows(py, &outcome.points), outcome.energy, outcome.min_det, history.into_pyarray(py), stop))
    }
}

impl SplineOptimizer {
    fn check_linearised(&self) -> PyResult<()> {
        if self.core.is_linearised() {
            return Ok(());
        }
        Err(PyValueError::new_err("the optimizer is not linearised, or something else was factorized since"))
    }

    fn shared_points(&self, points: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<[f64; 2]>> {
        let x = points2(points)?;
        if x.len() != self.core.n_points() {
            return Err(PyValueError::new_err(format!(
                "expected {} points, got {}",
                self.core.n_points(),
                x.len()
            )));
        }
        Ok(x)
    }
}

/// Add this file's class to the module.
pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_class::<SplineOptimizer>()
}
