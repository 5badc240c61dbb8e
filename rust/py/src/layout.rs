//! Bindings of the automatic layout: `patchtransfer_core::layout`.

use numpy::ndarray::{Array1, Array2, Array3};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArray3, PyArrayMethods, PyUntypedArrayMethods};
use numpy::{PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use patchtransfer_core::layout::adjacency::Adjacency;
use patchtransfer_core::layout::charts::MappedMesh;
use patchtransfer_core::layout::cross_field::{self, CrossField, Isometry};
use patchtransfer_core::layout::graph::NodeKind;
use patchtransfer_core::layout::mesh::{Corner, LayoutMesh, LayoutMeshError};
use patchtransfer_core::layout::seamless_map::{self, SeamlessMap};
use patchtransfer_core::layout::t_mesh::TMesh;
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

/// Points and triangles.
type MeshTuple<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray2<i64>>);

/// Mesh (points, triangles) of the domain on the left of index loops, with spokes at corners.
#[pyfunction]
fn layout_mesh<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f64>,
    loops: Vec<PyReadonlyArray1<'py, i64>>,
    vertices: PyReadonlyArray1<'py, i64>,
    quads: PyReadonlyArray1<'py, i64>,
    max_area: f64,
) -> PyResult<MeshTuple<'py>> {
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

/// Angles of the crosses, and indices of the vertices.
type FieldTuple<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<i64>>);

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
) -> PyResult<FieldTuple<'py>> {
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

fn integers<'py>(py: Python<'py>, values: impl Iterator<Item = usize>) -> Bound<'py, PyArray1<i64>> {
    // `usize::MAX` stands for none.
    values.map(|v| i64::try_from(v).unwrap_or(-1)).collect::<Array1<i64>>().into_pyarray(py)
}

fn reals<'py>(py: Python<'py>, values: impl Iterator<Item = f64>) -> Bound<'py, PyArray1<f64>> {
    values.collect::<Array1<f64>>().into_pyarray(py)
}

/// Kind, vertex, loop and position of every node, and its point.
type Nodes<'py> = (
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<i64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray2<f64>>,
);

/// Nodes, loop, interval, points and places of an arc.
type ArcTuple<'py> = ([usize; 2], i64, [f64; 2], Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<f64>>);

/// Next and quarters of every half-arc.
type Sectors<'py> = (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<i64>>);

type TMeshTuple<'py> = (Nodes<'py>, Vec<ArcTuple<'py>>, Vec<Vec<Bound<'py, PyArray1<i64>>>>, Sectors<'py>);

/// T-mesh of a seamless map: see `patchtransfer_core::layout::t_mesh`.
#[pyfunction]
#[allow(clippy::too_many_arguments)]
fn layout_t_mesh<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f64>,
    triangles: PyReadonlyArray2<'py, i64>,
    uv: PyReadonlyArray3<'py, f64>,
    rotation: PyReadonlyArray2<'py, i64>,
    index: PyReadonlyArray1<'py, i64>,
    next: PyReadonlyArray1<'py, i64>,
    loops: PyReadonlyArray1<'py, i64>,
    corner: PyReadonlyArray1<'py, bool>,
) -> PyResult<TMeshTuple<'py>> {
    if uv.shape()[1..] != [3, 2] || rotation.shape()[1] != 3 {
        return Err(PyValueError::new_err("expected a map (m, 3, 2) and rotations (m, 3)"));
    }
    let (points, triangles) = (points2(&points)?, triangles3(&triangles)?);
    let uv: Vec<[[f64; 2]; 3]> =
        uv.as_array().outer_iter().map(|t| [0, 1, 2].map(|i| [t[[i, 0]], t[[i, 1]]])).collect();
    let rotation: Vec<[u8; 3]> =
        rotation.as_array().outer_iter().map(|t| [0, 1, 2].map(|i| t[i].rem_euclid(4) as u8)).collect();
    let (index, corner) = (index.to_vec()?, corner.to_vec()?);
    let (next, loops) = (indices(&next)?, indices(&loops)?);
    let mesh = threads::run(py, || {
        TMesh::new(MappedMesh {
            points: &points,
            triangles: &triangles,
            uv: &uv,
            rotation: &rotation,
            index: &index,
            next: &next,
            loops: &loops,
            corner: &corner,
        })
    })?
    .map_err(layout_error)?;
    Ok(arrays(py, &mesh))
}

fn arrays<'py>(py: Python<'py>, mesh: &TMesh) -> TMeshTuple<'py> {
    let kind = |node: NodeKind| match node {
        NodeKind::Vertex(v) => (0, v),
        NodeKind::Junction { .. } => (1, usize::MAX),
        NodeKind::Hit { .. } => (2, usize::MAX),
        NodeKind::Join => (3, usize::MAX),
    };
    let points: Vec<[f64; 2]> = mesh.nodes.iter().map(|n| n.point).collect();
    let nodes = (
        integers(py, mesh.nodes.iter().map(|n| kind(n.kind).0)),
        integers(py, mesh.nodes.iter().map(|n| kind(n.kind).1)),
        integers(py, mesh.positions.iter().map(|p| p.map_or(usize::MAX, |p| p.0))),
        reals(py, mesh.positions.iter().map(|p| p.map_or(-1.0, |p| p.1))),
        rows(py, &points),
    );
    let arcs = mesh.arcs.iter().map(|arc| {
        let (index, interval) = arc.outline.map_or((-1, [-1.0; 2]), |(l, i)| (l as i64, i));
        (arc.nodes, index, interval, rows(py, &arc.points), reals(py, arc.places.iter().copied()))
    });
    let faces =
        mesh.faces.iter().map(|sides| sides.iter().map(|side| integers(py, side.iter().copied())).collect());
    let sectors = (
        integers(py, mesh.sectors.iter().map(|s| s.next)),
        integers(py, mesh.sectors.iter().map(|s| usize::from(s.quarters))),
    );
    (nodes, arcs.collect(), faces.collect(), sectors)
}

/// Add this file's names to the module.
pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add("LayoutError", m.py().get_type::<LayoutError>())?;
    m.add_function(wrap_pyfunction!(layout_mesh, m)?)?;
    m.add_function(wrap_pyfunction!(layout_edges, m)?)?;
    m.add_function(wrap_pyfunction!(layout_field, m)?)?;
    m.add_function(wrap_pyfunction!(layout_map, m)?)?;
    m.add_function(wrap_pyfunction!(layout_t_mesh, m)?)
}
