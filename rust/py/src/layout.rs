//! Bindings of the automatic layout: `patchtransfer_core::layout`.

use numpy::ndarray::{Array1, Array2, Array3};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3, PyReadonlyArray1, PyReadonlyArray2};
use patchtransfer_core::layout::adjacency::Adjacency;
use patchtransfer_core::layout::cross_field::{self, CrossField, Isometry};
use patchtransfer_core::layout::mesh::{Corner, LayoutMesh, LayoutMeshError};
use patchtransfer_core::layout::seamless_map::{self, SeamlessMap};
use pyo3::create_exception;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::convert::{points2, rows};
use crate::mesh::{indices, triangles3, triangulation_error};
use crate::threads;

create_exception!(_core, LayoutError, PyValueError, "A stage of the automatic layout cannot go on.");

fn layout_error(error: impl std::fmt::Display) -> PyErr {
    LayoutError::new_err(error.to_string())
}

fn mesh_error(error: LayoutMeshError) -> PyErr {
    match error {
        LayoutMeshError::Triangulation(error) => triangulation_error(error),
        other => layout_error(other),
    }
}

/// Rows of `N` numbers as an array.
fn table<'py, T: numpy::Element, const N: usize>(
    py: Python<'py>,
    values: Vec<[T; N]>,
) -> Bound<'py, PyArray2<T>> {
    let shape = (values.len(), N);
    Array2::from_shape_vec(shape, values.into_flattened()).expect("sizes agree").into_pyarray(py)
}

fn signed<const N: usize>(rows: &[[usize; N]]) -> Vec<[i64; N]> {
    rows.iter().map(|row| row.map(|v| v as i64)).collect()
}

/// Vertices of corners and their numbers of quads.
fn corners(vertices: &PyReadonlyArray1<'_, i64>, quads: &PyReadonlyArray1<'_, i64>) -> PyResult<Vec<Corner>> {
    let (vertices, quads) = (indices(vertices)?, indices(quads)?);
    if vertices.len() != quads.len() || quads.contains(&0) {
        return Err(PyValueError::new_err("every corner needs its number of quads, at least 1"));
    }
    Ok(vertices.into_iter().zip(quads).map(|(vertex, quads)| Corner { vertex, quads }).collect())
}

fn given_mesh(
    points: &PyReadonlyArray2<'_, f64>,
    triangles: &PyReadonlyArray2<'_, i64>,
) -> PyResult<LayoutMesh> {
    LayoutMesh::new(points2(points)?, triangles3(triangles)?).map_err(mesh_error)
}

/// Mesh (points, triangles) of the domain on the left of index loops, with spokes at corners.
#[pyfunction]
fn layout_mesh<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f64>,
    loops: Vec<PyReadonlyArray1<'py, i64>>,
    vertices: PyReadonlyArray1<'py, i64>,
    quads: PyReadonlyArray1<'py, i64>,
    max_area: f64,
) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<i64>>)> {
    let points = points2(&points)?;
    let loops: Vec<Vec<usize>> = loops.iter().map(indices).collect::<PyResult<_>>()?;
    let corners = corners(&vertices, &quads)?;
    let mesh = threads::run(py, || LayoutMesh::generate(&points, &loops, &corners, max_area))?;
    let mesh = mesh.map_err(mesh_error)?;
    Ok((rows(py, &mesh.points), table(py, signed(&mesh.triangles))))
}

/// Edges (e, 2) of a mesh of `vertices` points, in the order of the cross field's isometries.
#[pyfunction]
fn layout_edges<'py>(
    py: Python<'py>,
    vertices: usize,
    triangles: PyReadonlyArray2<'py, i64>,
) -> PyResult<Bound<'py, PyArray2<i64>>> {
    let adjacency = Adjacency::new(vertices, &triangles3(&triangles)?).map_err(layout_error)?;
    Ok(table(py, signed(&adjacency.edges)))
}

/// Angles of the crosses and indices of the vertices; isometries are (sources of the edges, real and imaginary part
/// of the phase, whether conjugated).
#[pyfunction]
fn layout_field<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f64>,
    triangles: PyReadonlyArray2<'py, i64>,
    vertices: PyReadonlyArray1<'py, i64>,
    quads: PyReadonlyArray1<'py, i64>,
    isometries: Vec<(PyReadonlyArray1<'py, i64>, f64, f64, bool)>,
) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<i64>>)> {
    let corners = corners(&vertices, &quads)?;
    let isometries = isometries
        .iter()
        .map(|(source, re, im, conjugate)| {
            Ok(Isometry { source: indices(source)?, phase: [*re, *im], conjugate: *conjugate })
        })
        .collect::<PyResult<Vec<_>>>()?;
    let mesh = given_mesh(&points, &triangles)?;
    let field = threads::run(py, || cross_field::cross_field(&mesh, &corners, &isometries))?;
    let CrossField { theta, index } = field.map_err(layout_error)?;
    Ok((theta.into_pyarray(py), Array1::from(index).into_pyarray(py)))
}

/// (uv, rotation, seam, folds, residual, rounds).
type MapTuple<'py> =
    (Bound<'py, PyArray3<f64>>, Bound<'py, PyArray2<i64>>, Bound<'py, PyArray2<bool>>, usize, f64, usize);

/// Seamless map of a cross field.
#[pyfunction]
fn layout_map<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f64>,
    triangles: PyReadonlyArray2<'py, i64>,
    theta: PyReadonlyArray1<'py, f64>,
    index: PyReadonlyArray1<'py, i64>,
    rounds: usize,
) -> PyResult<MapTuple<'py>> {
    let mesh = given_mesh(&points, &triangles)?;
    let (theta, index) = (theta.as_array().to_vec(), index.as_array().to_vec());
    let map = threads::run(py, || seamless_map::seamless_map(&mesh, &theta, &index, rounds))?;
    let SeamlessMap { uv, rotation, seam, folds, residual, rounds } = map.map_err(layout_error)?;
    let flat = uv.into_flattened().into_flattened();
    let uv = Array3::from_shape_vec((flat.len() / 6, 3, 2), flat).expect("sizes agree").into_pyarray(py);
    Ok((uv, table(py, rotation), table(py, seam), folds, residual, rounds))
}

/// Add this file's names to the module.
pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add("LayoutError", m.py().get_type::<LayoutError>())?;
    m.add_function(wrap_pyfunction!(layout_mesh, m)?)?;
    m.add_function(wrap_pyfunction!(layout_edges, m)?)?;
    m.add_function(wrap_pyfunction!(layout_field, m)?)?;
    m.add_function(wrap_pyfunction!(layout_map, m)?)
}
