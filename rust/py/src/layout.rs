//! Bindings of the automatic layout: `patchtransfer_core::layout`.

use numpy::ndarray::Array1;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3};
use numpy::{PyArrayMethods, PyUntypedArrayMethods};
use patchtransfer_core::layout::charts::MappedMesh;
use patchtransfer_core::layout::graph::NodeKind;
use patchtransfer_core::layout::t_mesh::TMesh;
use pyo3::create_exception;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::convert::{integers, points2, rows};
use crate::mesh::{indices, triangles3};
use crate::threads;

create_exception!(_core, LayoutError, PyValueError, "A stage of the automatic layout cannot go on.");

fn layout_error(error: impl std::fmt::Display) -> PyErr {
    LayoutError::new_err(error.to_string())
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
    // `usize::MAX` becomes -1.
    let nodes = (
        integers(py, &mesh.nodes.iter().map(|n| kind(n.kind).0).collect::<Vec<_>>()),
        integers(py, &mesh.nodes.iter().map(|n| kind(n.kind).1).collect::<Vec<_>>()),
        integers(py, &mesh.positions.iter().map(|p| p.map_or(usize::MAX, |p| p.0)).collect::<Vec<_>>()),
        reals(py, mesh.positions.iter().map(|p| p.map_or(-1.0, |p| p.1))),
        rows(py, &points),
    );
    let arcs = mesh.arcs.iter().map(|arc| {
        let (index, interval) = arc.outline.map_or((-1, [-1.0; 2]), |(l, i)| (l as i64, i));
        (arc.nodes, index, interval, rows(py, &arc.points), reals(py, arc.places.iter().copied()))
    });
    let faces = mesh.faces.iter().map(|sides| sides.iter().map(|side| integers(py, side)).collect());
    let sectors = (
        integers(py, &mesh.sectors.iter().map(|s| s.next).collect::<Vec<_>>()),
        integers(py, &mesh.sectors.iter().map(|s| usize::from(s.quarters)).collect::<Vec<_>>()),
    );
    (nodes, arcs.collect(), faces.collect(), sectors)
}

/// Add this file's names to the module.
pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add("LayoutError", m.py().get_type::<LayoutError>())?;
    m.add_function(wrap_pyfunction!(layout_t_mesh, m)?)
}
