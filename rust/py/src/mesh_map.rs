//! Bindings of the mesh method's maps: closest points in stacked coordinates, descent of conformal distortion.

use crate::mesh::{CscReadonly, csc, indices, mesh_error, rows, triangles3};
use crate::threads::{self, Deadline};
use numpy::ndarray::Array1;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use patchtransfer_core::mesh::closest_point::{Foot, MeshTree};
use patchtransfer_core::mesh::distortion_descent::{self, Stop};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::convert::points2;

/// `(triangles, weights, squared distances)`.
type FeetTuple<'py> = (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>);

/// `(map, energies, why it ended)`.
type DescentTuple<'py> = (Bound<'py, PyArray2<f64>>, Vec<f64>, &'static str);

fn points4(array: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<[f64; 4]>> {
    let view = array.as_array();
    if array.shape()[1] != 4 || !view.iter().all(|x| x.is_finite()) {
        return Err(PyValueError::new_err(format!("expected finite points (n, 4), got {:?}", array.shape())));
    }
    Ok(view.rows().into_iter().map(|r| [r[0], r[1], r[2], r[3]]).collect())
}

/// For every query (m, 4) the closest point of a triangle mesh in four dimensions: its triangle, its barycentric
/// coordinates there (m, 3) and the squared distance.
#[pyfunction]
fn closest_on_mesh<'py>(
    py: Python<'py>,
    queries: PyReadonlyArray2<'py, f64>,
    vertices: PyReadonlyArray2<'py, f64>,
    triangles: PyReadonlyArray2<'py, i64>,
) -> PyResult<FeetTuple<'py>> {
    let (queries, vertices, triangles) = (points4(&queries)?, points4(&vertices)?, triangles3(&triangles)?);
    if triangles.is_empty() || triangles.as_flattened().iter().any(|&v| v >= vertices.len()) {
        return Err(PyValueError::new_err("a mesh needs triangles, and triangles need vertices that exist"));
    }
    let feet: Vec<Foot> = threads::run(py, || MeshTree::new(&vertices, &triangles).closest_all(&queries))?;
    Ok((
        feet.iter().map(|f| f.triangle as i64).collect::<Array1<i64>>().into_pyarray(py),
        rows(py, feet.iter().map(|f| f.weights).collect()),
        feet.iter().map(|f| f.distance2).collect::<Array1<f64>>().into_pyarray(py),
    ))
}

/// A mesh prepared for lowering the conformal distortion; see `patchtransfer_core::mesh::distortion_descent`.
#[pyclass]
struct DistortionDescent(distortion_descent::DistortionDescent);

#[pymethods]
impl DistortionDescent {
    #[new]
    #[pyo3(signature = (points, triangles, fixed, null_space=None))]
    fn new(
        py: Python<'_>,
        points: PyReadonlyArray2<'_, f64>,
        triangles: PyReadonlyArray2<'_, i64>,
        fixed: PyReadonlyArray1<'_, i64>,
        null_space: Option<CscReadonly<'_>>,
    ) -> PyResult<Self> {
        let (points, triangles, fixed) = (points2(&points)?, triangles3(&triangles)?, indices(&fixed)?);
        let z = null_space.map(csc).transpose()?;
        let made = threads::run(py, || {
            distortion_descent::DistortionDescent::new(&points, &triangles, &fixed, z.as_ref())
        })?;
        made.map(Self).map_err(mesh_error)
    }

    /// Lower the energy of a map: (map, energies, why it ended).
    #[pyo3(signature = (u, max_steps, tolerance, seconds=None))]
    fn minimise<'py>(
        &mut self,
        py: Python<'py>,
        u: PyReadonlyArray2<'py, f64>,
        max_steps: usize,
        tolerance: f64,
        seconds: Option<f64>,
    ) -> PyResult<DescentTuple<'py>> {
        let end = Deadline::after(seconds);
        let mut u = points2(&u)?;
        if u.len() != self.0.n_vertices() || !u.as_flattened().iter().all(|x| x.is_finite()) {
            return Err(PyValueError::new_err(format!("expected {} finite positions", self.0.n_vertices())));
        }
        let report = threads::run_watched(
            py,
            |report| self.0.minimise(&mut u, max_steps, tolerance, || report(()) && !end.passed()),
            threads::UNSEEN,
        )?;
        let stop = match report.stop {
            Stop::Converged => "converged",
            Stop::StepLimit => "step limit",
            Stop::Stalled => "stalled",
            Stop::Interrupted => "time limit",
            Stop::Flipped => "flipped",
        };
        Ok((rows(py, u), report.energy, stop))
    }

    /// Mean of ‖J‖²/det J over the area; infinite for a flipped map.
    fn energy(&self, py: Python<'_>, u: PyReadonlyArray2<'_, f64>) -> PyResult<f64> {
        let points = points2(&u)?;
        if points.len() != self.0.n_vertices() {
            return Err(PyValueError::new_err(format!("expected {} positions", self.0.n_vertices())));
        }
        threads::run(py, || self.0.energy(&points))
    }
}

/// Add this file's names to the module.
pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_class::<DistortionDescent>()?;
    m.add_function(wrap_pyfunction!(closest_on_mesh, m)?)
}
