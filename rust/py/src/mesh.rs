//! Bindings of the mesh method: triangulation, cotan Laplacian, bounded distortion.

use crate::threads::{self, Deadline};
use numpy::ndarray::{Array1, Array2};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use patchtransfer_core::laplacian::{self, MeshError};
use patchtransfer_core::sparse::CscMatrix;
use patchtransfer_core::triangulation::{self, Refinement, TriangulationError as CoreError};
use patchtransfer_core::{local_global, ssvd};
use pyo3::create_exception;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::convert::points2;

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
pub type CscReadonly<'py> =
    (PyReadonlyArray1<'py, f64>, PyReadonlyArray1<'py, i64>, PyReadonlyArray1<'py, i64>, (usize, usize));

/// `(points, triangles)`.
type MeshTuple<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<i64>>);

/// `(map, flips, energies)`.
type IterateTuple<'py> = (Bound<'py, PyArray2<f64>>, Vec<usize>, Vec<f64>);

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

/// An (n, N) array of rows.
pub fn rows<'py, const N: usize>(py: Python<'py>, values: Vec<[f64; N]>) -> Bound<'py, PyArray2<f64>> {
    let shape = (values.len(), N);
    Array2::from_shape_vec(shape, values.into_flattened()).expect("sizes agree").into_pyarray(py)
}

/// A matrix from its Python tuple.
pub fn csc((data, row, offsets, (m, n)): CscReadonly<'_>) -> PyResult<CscMatrix<f64>> {
    CscMatrix::try_from_csc_data(m, n, indices(&offsets)?, indices(&row)?, data.as_array().to_vec())
        .map_err(|e| PyValueError::new_err(format!("null-space basis: {e}")))
}

/// A mesh that cannot be used, as a Python error.
pub fn mesh_error(error: MeshError) -> PyErr {
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
    Ok((rows(py, mesh.points), triangles.into_pyarray(py)))
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
    let signed = |v: Vec<usize>| v.into_iter().map(|i| i as i64).collect::<Array1<i64>>().into_pyarray(py);
    Ok((values.into_pyarray(py), signed(rows), signed(offsets), shape))
}

fn bounds(k: &PyReadonlyArray1<'_, f64>, n: usize) -> PyResult<Vec<f64>> {
    let k = k.as_array().to_vec();
    if k.len() != n {
        return Err(PyValueError::new_err(format!("expected {n} bounds k, got {}", k.len())));
    }
    match k.iter().find(|&&x| !(1.0..=1e100).contains(&x)) {
        Some(bad) => Err(PyValueError::new_err(format!("a bound k must lie in [1, 1e100], got {bad}"))),
        None => Ok(k),
    }
}

/// Nearest matrices (n, 4), row-major, of conformal distortion at most k (n,).
#[pyfunction]
fn project_bounded_distortion<'py>(
    py: Python<'py>,
    jacobians: PyReadonlyArray2<'py, f64>,
    k: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    if jacobians.shape()[1] != 4 {
        return Err(PyValueError::new_err(format!("expected shape (n, 4), got {:?}", jacobians.shape())));
    }
    let k = bounds(&k, jacobians.shape()[0])?;
    let j: Vec<[f64; 4]> =
        jacobians.as_array().rows().into_iter().map(|r| [r[0], r[1], r[2], r[3]]).collect();
    let mut out = vec![[0.0; 4]; j.len()];
    threads::run(py, || ssvd::project_all(&j, &k, &mut out))?;
    Ok(rows(py, out))
}

/// A mesh with fixed vertices and constraints, factorized once; see `patchtransfer_core::local_global`.
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
        Ok(rows(py, u))
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
        let k = bounds(&k, self.0.n_faces())?;
        let report = threads::run_watched(
            py,
            |report| self.0.iterate(&mut u, &k, iterations, tolerance, || report(()) && !end.passed()),
            threads::UNSEEN,
        )?;
        Ok((rows(py, u), report.flips, report.energy))
    }

    /// Signed singular values (m, 2) of a map on every face.
    fn singular_values<'py>(
        &self,
        py: Python<'py>,
        u: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let u = self.positions(&u)?;
        Ok(rows(py, threads::run(py, || self.0.singular_values(&u))?))
    }

    /// Number of faces with det J ≤ 0.
    fn flips(&self, py: Python<'_>, u: PyReadonlyArray2<'_, f64>) -> PyResult<usize> {
        let u = self.positions(&u)?;
        threads::run(py, || self.0.flips(&u))
    }
}

/// Add this file's names to the module.
pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add("TriangulationError", m.py().get_type::<TriangulationError>())?;
    m.add_class::<LocalGlobal>()?;
    m.add_function(wrap_pyfunction!(triangulate, m)?)?;
    m.add_function(wrap_pyfunction!(cotan_laplacian, m)?)?;
    m.add_function(wrap_pyfunction!(project_bounded_distortion, m)?)
}
