//! Bindings of `patchtransfer_core::mesh`: triangulation, cotan Laplacian, closest points, maps of bounded distortion.

use crate::convert::{integers, points2, rows};
use crate::numeric::distortion_bounds;
use crate::threads::{self, Deadline};
use numpy::ndarray::{Array1, Array2};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use patchtransfer_core::mesh::closest_point::{Foot, MeshTree};
use patchtransfer_core::mesh::laplacian::{self, MeshError};
use patchtransfer_core::mesh::triangulation::{self, Refinement, TriangulationError as CoreError};
use patchtransfer_core::mesh::{distortion_descent, local_global};
use patchtransfer_core::numeric::sparse::CscMatrix;
use pyo3::create_exception;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

create_exception!(
    _core,
    TriangulationError,
    PyValueError,
    "No valid constrained Delaunay triangulation: arguments (message, kind, indices of points)."
);

/// `(data, indices, indptr, shape)` of a SciPy matrix in compressed columns.
type CscTuple<'py> =
    (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<i64>>, (usize, usize));

/// The same as handed over from Python.
type CscReadonly<'py> =
    (PyReadonlyArray1<'py, f64>, PyReadonlyArray1<'py, i64>, PyReadonlyArray1<'py, i64>, (usize, usize));

/// `(points, triangles)`.
type MeshTuple<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<i64>>);

/// `(map, flips, energies)`.
type IterateTuple<'py> = (Bound<'py, PyArray2<f64>>, Vec<usize>, Vec<f64>);

/// `(triangles, weights, squared distances)`.
type FeetTuple<'py> = (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>);

/// `(map, energies, why it ended)`.
type DescentTuple<'py> = (Bound<'py, PyArray2<f64>>, Vec<f64>, &'static str);

fn index(value: i64) -> PyResult<usize> {
    usize::try_from(value).map_err(|_| PyValueError::new_err(format!("index {value} is negative")))
}

/// Indices handed over as signed integers.
pub fn indices(array: &PyReadonlyArray1<'_, i64>) -> PyResult<Vec<usize>> {
    array.as_array().iter().map(|&i| index(i)).collect()
}

/// Rows of an (m, 3) index array.
pub fn triangles3(array: &PyReadonlyArray2<'_, i64>) -> PyResult<Vec<[usize; 3]>> {
    if array.shape()[1] != 3 {
        return Err(PyValueError::new_err(format!("expected triangles (m, 3), got {:?}", array.shape())));
    }
    array.as_array().rows().into_iter().map(|r| Ok([index(r[0])?, index(r[1])?, index(r[2])?])).collect()
}

fn points4(array: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<[f64; 4]>> {
    let view = array.as_array();
    if array.shape()[1] != 4 || !view.iter().all(|x| x.is_finite()) {
        return Err(PyValueError::new_err(format!("expected finite points (n, 4), got {:?}", array.shape())));
    }
    Ok(view.rows().into_iter().map(|r| [r[0], r[1], r[2], r[3]]).collect())
}

/// A matrix from its Python tuple.
fn csc((data, row, offsets, (m, n)): CscReadonly<'_>) -> PyResult<CscMatrix<f64>> {
    CscMatrix::try_from_csc_data(m, n, indices(&offsets)?, indices(&row)?, data.as_array().to_vec())
        .map_err(|e| PyValueError::new_err(format!("null-space basis: {e}")))
}

/// A mesh that cannot be used, as a Python error.
fn mesh_error(error: MeshError) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// An outline that cannot be triangulated, as a Python error.
pub fn triangulation_error(error: CoreError) -> PyErr {
    let (kind, points): (&str, Vec<usize>) = match &error {
        CoreError::NotFinite { point } => ("not_finite", vec![*point]),
        CoreError::DuplicatePoints { a, b } => ("duplicate_points", vec![*a, *b]),
        CoreError::ShortLoop { .. } => ("short_loop", vec![]),
        CoreError::UnknownPoint { .. } => ("unknown_point", vec![]),
        CoreError::RepeatedPoint { point } => ("repeated_point", vec![*point]),
        CoreError::CrossingConstraints { a, b } => ("crossing_constraints", vec![a[0], a[1], b[0], b[1]]),
        CoreError::PointOnConstraint { point, edge } => {
            ("point_on_constraint", vec![*point, edge[0], edge[1]])
        }
        CoreError::WrongOrientation { .. } => ("wrong_orientation", vec![]),
        CoreError::PointOutside { point } => ("point_outside", vec![*point]),
        CoreError::RefinementIncomplete { .. } => ("refinement_incomplete", vec![]),
    };
    TriangulationError::new_err((error.to_string(), kind, points))
}

/// Constrained Delaunay triangulation (points, triangles) of the domain on the left of index loops.
///
/// Steiner points follow the input points when a limit is given.
#[pyfunction]
#[pyo3(signature = (points, loops, min_angle=None, max_area=None))]
fn triangulate<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f64>,
    loops: Vec<PyReadonlyArray1<'py, i64>>,
    min_angle: Option<f64>,
    max_area: Option<f64>,
) -> PyResult<MeshTuple<'py>> {
    let points = points2(&points)?;
    let loops: Vec<Vec<usize>> = loops.iter().map(indices).collect::<PyResult<_>>()?;
    let refinement = (min_angle.is_some() || max_area.is_some())
        .then(|| Refinement { min_angle: min_angle.unwrap_or(0.0), max_area });
    let mesh =
        py.detach(|| triangulation::triangulate(&points, &loops, refinement)).map_err(triangulation_error)?;
    let flat: Vec<i64> = mesh.triangles.into_flattened().into_iter().map(|v| v as i64).collect();
    let triangles = Array2::from_shape_vec((flat.len() / 3, 3), flat).expect("sizes agree");
    Ok((rows(py, &mesh.points), triangles.into_pyarray(py)))
}

/// Cotan Laplacian Σ area GᵀG of a mesh in compressed columns.
#[pyfunction]
fn cotan_laplacian<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f64>,
    triangles: PyReadonlyArray2<'py, i64>,
) -> PyResult<CscTuple<'py>> {
    let (points, triangles) = (points2(&points)?, triangles3(&triangles)?);
    let matrix = py.detach(|| laplacian::cotan_laplacian(&points, &triangles)).map_err(mesh_error)?;
    let shape = (matrix.nrows(), matrix.ncols());
    let (offsets, rows, values) = matrix.disassemble();
    Ok((values.into_pyarray(py), integers(py, &rows), integers(py, &offsets), shape))
}

/// A mesh with fixed vertices and constraints, factorized once; see `patchtransfer_core::mesh::local_global`.
#[pyclass]
struct LocalGlobal(local_global::LocalGlobal);

impl LocalGlobal {
    fn positions(&self, u: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<[f64; 2]>> {
        let u = points2(u)?;
        if u.len() != self.0.n_vertices() || !u.as_flattened().iter().all(|x| x.is_finite()) {
            return Err(PyValueError::new_err(format!(
                "expected {} finite positions, got {} rows",
                self.0.n_vertices(),
                u.len()
            )));
        }
        Ok(u)
    }
}

#[pymethods]
impl LocalGlobal {
    /// `null_space` is `(data, indices, indptr, shape)` of a matrix in compressed sorted columns, one row for
    /// each free vertex.
    #[new]
    #[pyo3(signature = (points, triangles, fixed, null_space=None))]
    fn new(
        py: Python<'_>,
        points: PyReadonlyArray2<'_, f64>,
        triangles: PyReadonlyArray2<'_, i64>,
        fixed: PyReadonlyArray1<'_, i64>,
        null_space: Option<CscReadonly<'_>>,
    ) -> PyResult<Self> {
        let (points, triangles) = (points2(&points)?, triangles3(&triangles)?);
        let fixed = indices(&fixed)?;
        let z = null_space.map(csc).transpose()?;
        let solver = threads::run(py, || local_global::LocalGlobal::new(&points, &triangles, &fixed, z))?;
        solver.map(Self).map_err(mesh_error)
    }

    /// Harmonic map (n, 2) under the constraints, from any feasible map.
    fn harmonic<'py>(
        &mut self,
        py: Python<'py>,
        u: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let mut u = self.positions(&u)?;
        threads::run(py, || self.0.harmonic(&mut u))?;
        Ok(rows(py, &u))
    }

    /// Local–global steps from a feasible map: (map, flips, energies), the lists with the initial value first.
    #[pyo3(signature = (u, k, iterations, tolerance, seconds=None))]
    fn iterate<'py>(
        &mut self,
        py: Python<'py>,
        u: PyReadonlyArray2<'py, f64>,
        k: PyReadonlyArray1<'py, f64>,
        iterations: usize,
        tolerance: f64,
        seconds: Option<f64>,
    ) -> PyResult<IterateTuple<'py>> {
        let end = Deadline::after(seconds);
        let mut u = self.positions(&u)?;
        let k = distortion_bounds(&k, self.0.n_faces())?;
        let report = threads::run_watched(
            py,
            |report| self.0.iterate(&mut u, &k, iterations, tolerance, || report(()) && !end.passed()),
            threads::UNSEEN,
        )?;
        Ok((rows(py, &u), report.flips, report.energy))
    }

    /// Signed singular values (m, 2) of a map on every face.
    fn singular_values<'py>(
        &self,
        py: Python<'py>,
        u: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let u = self.positions(&u)?;
        Ok(rows(py, &threads::run(py, || self.0.singular_values(&u))?))
    }

    /// Number of faces with det J ≤ 0.
    fn flips(&self, py: Python<'_>, u: PyReadonlyArray2<'_, f64>) -> PyResult<usize> {
        let u = self.positions(&u)?;
        threads::run(py, || self.0.flips(&u))
    }
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
    let weights: Vec<[f64; 3]> = feet.iter().map(|f| f.weights).collect();
    Ok((
        feet.iter().map(|f| f.triangle as i64).collect::<Array1<i64>>().into_pyarray(py),
        rows(py, &weights),
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
            distortion_descent::Stop::Converged => "converged",
            distortion_descent::Stop::StepLimit => "step limit",
            distortion_descent::Stop::Stalled => "stalled",
            distortion_descent::Stop::Interrupted => "time limit",
            distortion_descent::Stop::Flipped => "flipped",
        };
        Ok((rows(py, &u), report.energy, stop))
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
    m.add("TriangulationError", m.py().get_type::<TriangulationError>())?;
    m.add("DEGENERATE_TRIANGLE", laplacian::DEGENERATE)?;
    m.add_class::<LocalGlobal>()?;
    m.add_class::<DistortionDescent>()?;
    m.add_function(wrap_pyfunction!(triangulate, m)?)?;
    m.add_function(wrap_pyfunction!(cotan_laplacian, m)?)?;
    m.add_function(wrap_pyfunction!(closest_on_mesh, m)?)
}
