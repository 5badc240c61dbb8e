//! Bindings of `patchtransfer_core::registration`: matching of sequences, inner distances, thin plates.

use crate::convert::points2;
use crate::threads;
use numpy::ndarray::Array2;
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyReadwriteArray1,
    PyReadwriteArray2, PyUntypedArrayMethods,
};
use patchtransfer_core::registration::matching::MatchingProblem;
use patchtransfer_core::registration::{inner_distance, thin_plate};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Inner distances (n, n) between the vertices of polygonal loops with the domain on their left.
#[pyfunction]
fn inner_distances<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f64>,
    sizes: Vec<usize>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let points = points2(&points)?;
    let n = points.len();
    if sizes.iter().sum::<usize>() != n {
        return Err(PyValueError::new_err("the loops' sizes do not add up to the number of points"));
    }
    let flat = threads::run(py, || inner_distance::inner_distances(&points, &sizes))?;
    Ok(Array2::from_shape_vec((n, n), flat).expect("sizes agree").into_pyarray(py))
}

/// Energy, gradient (n,) and Gauss–Newton matrix (n, n) of the distances between positions on a boundary; see
/// `patchtransfer_core::registration::inner_distance::compare_distances`.
#[pyfunction]
#[allow(clippy::type_complexity, clippy::too_many_arguments)]
fn compare_distances<'py>(
    py: Python<'py>,
    distances: PyReadonlyArray2<'_, f64>,
    before: PyReadonlyArray1<'_, i64>,
    after: PyReadonlyArray1<'_, i64>,
    fraction: PyReadonlyArray1<'_, f64>,
    gap: PyReadonlyArray1<'_, f64>,
    wanted: PyReadonlyArray2<'_, f64>,
    weight: PyReadonlyArray2<'_, f64>,
) -> PyResult<(f64, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>)> {
    let (n, nodes) = (before.len(), distances.shape()[0]);
    let square = |shape: &[usize], size: usize| shape == [size, size];
    if !square(distances.shape(), nodes) || !square(wanted.shape(), n) || !square(weight.shape(), n) {
        return Err(PyValueError::new_err("matrices must be square and fit the positions"));
    }
    if after.len() != n || fraction.len() != n || gap.len() != n {
        return Err(PyValueError::new_err("positions differ in number"));
    }
    let node = |k: i64| {
        usize::try_from(k)
            .ok()
            .filter(|&k| k < nodes)
            .ok_or_else(|| PyValueError::new_err(format!("no node {k} among {nodes}")))
    };
    let mut positions = Vec::with_capacity(n);
    for k in 0..n {
        positions.push(inner_distance::Position {
            before: node(before.as_array()[k])?,
            after: node(after.as_array()[k])?,
            fraction: fraction.as_array()[k],
            gap: gap.as_array()[k],
        });
    }
    let (distances, wanted, weight) = (distances.as_slice()?, wanted.as_slice()?, weight.as_slice()?);
    let model =
        threads::run(py, || inner_distance::compare_distances(distances, nodes, &positions, wanted, weight))?;
    let hessian = Array2::from_shape_vec((n, n), model.hessian).expect("sizes agree");
    Ok((model.energy, model.gradient.into_pyarray(py), hessian.into_pyarray(py)))
}

/// Matrix (n, n) of the bending energy of the thin plate over points.
#[pyfunction]
fn bending_matrix<'py>(
    py: Python<'py>,
    points: PyReadonlyArray2<'py, f64>,
    slack: f64,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let points = points2(&points)?;
    let n = points.len();
    let flat = py.detach(|| thin_plate::bending_matrix(&points, slack));
    Ok(Array2::from_shape_vec((n, n), flat).expect("sizes agree").into_pyarray(py))
}

/// Bending energy times `weight` of points on their way along tangents; adds to gradient (n,) and matrix (n, n).
#[pyfunction]
fn add_bending(
    py: Python<'_>,
    matrix: PyReadonlyArray2<'_, f64>,
    points: PyReadonlyArray2<'_, f64>,
    tangents: PyReadonlyArray2<'_, f64>,
    weight: f64,
    mut gradient: PyReadwriteArray1<'_, f64>,
    mut hessian: PyReadwriteArray2<'_, f64>,
) -> PyResult<f64> {
    let (points, tangents) = (points2(&points)?, points2(&tangents)?);
    let n = points.len();
    if tangents.len() != n || gradient.len() != n || [matrix.shape(), hessian.shape()] != [[n, n]; 2] {
        return Err(PyValueError::new_err("points, tangents, gradient and matrices do not fit"));
    }
    let (matrix, gradient, hessian) = (matrix.as_slice()?, gradient.as_slice_mut()?, hessian.as_slice_mut()?);
    Ok(py.detach(|| thin_plate::add_bending(matrix, &points, &tangents, weight, gradient, hessian)))
}

/// Two closed sequences and the costs of matching them; see `patchtransfer_core::registration::matching`.
#[pyclass(frozen)]
struct Matching {
    source: Vec<f64>,
    target: Vec<f64>,
    cost: Vec<f64>,
    point_cost: Vec<f64>,
    source_skip: Vec<f64>,
    target_skip: Vec<f64>,
    stretch: f64,
    band: f64,
}

impl Matching {
    fn problem(&self) -> MatchingProblem<'_> {
        MatchingProblem {
            source: &self.source,
            target: &self.target,
            cost: &self.cost,
            point_cost: &self.point_cost,
            source_skip: &self.source_skip,
            target_skip: &self.target_skip,
            stretch: self.stretch,
            band: self.band,
        }
    }

    fn check(&self, starts: &[usize]) -> PyResult<()> {
        match starts.iter().find(|&&start| start >= self.target.len() - 1) {
            Some(start) => Err(PyValueError::new_err(format!("no target node {start} to start at"))),
            None => Ok(()),
        }
    }
}

#[pymethods]
impl Matching {
    #[new]
    #[allow(clippy::too_many_arguments)]
    fn new(
        source: PyReadonlyArray1<'_, f64>,
        target: PyReadonlyArray1<'_, f64>,
        cost: PyReadonlyArray2<'_, f64>,
        point_cost: PyReadonlyArray2<'_, f64>,
        source_skip: PyReadonlyArray1<'_, f64>,
        target_skip: PyReadonlyArray1<'_, f64>,
        stretch: f64,
        band: f64,
    ) -> PyResult<Self> {
        let (n, m) = (cost.shape()[0], cost.shape()[1]);
        if n == 0 || m == 0 || source.len() != n + 1 || target.len() != m + 1 {
            return Err(PyValueError::new_err("positions and costs do not fit"));
        }
        if point_cost.shape() != [n, m] || source_skip.len() != n || target_skip.len() != m {
            return Err(PyValueError::new_err("costs differ in shape"));
        }
        Ok(Self {
            source: source.as_array().to_vec(),
            target: target.as_array().to_vec(),
            cost: cost.as_array().iter().copied().collect(),
            point_cost: point_cost.as_array().iter().copied().collect(),
            source_skip: source_skip.as_array().to_vec(),
            target_skip: target_skip.as_array().to_vec(),
            stretch,
            band,
        })
    }

    /// Cost of the cheapest matching of source node 0 with every start.
    fn scan<'py>(&self, py: Python<'py>, starts: Vec<usize>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        self.check(&starts)?;
        Ok(threads::run(py, || self.problem().scan(&starts))?.into_pyarray(py))
    }

    /// Cost and node pairs (k, 2) of the cheapest matching from a start; None if all are forbidden.
    fn solve<'py>(
        &self,
        py: Python<'py>,
        start: usize,
    ) -> PyResult<Option<(f64, Bound<'py, PyArray2<i64>>)>> {
        self.check(&[start])?;
        let found = threads::run(py, || self.problem().solve(start))?;
        Ok(found.map(|(cost, path)| {
            let flat: Vec<i64> = path.iter().flatten().map(|&k| k as i64).collect();
            let pairs = Array2::from_shape_vec((path.len(), 2), flat).expect("sizes agree");
            (cost, pairs.into_pyarray(py))
        }))
    }
}

/// Add this file's names to the module.
pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_class::<Matching>()?;
    m.add_function(wrap_pyfunction!(compare_distances, m)?)?;
    m.add_function(wrap_pyfunction!(bending_matrix, m)?)?;
    m.add_function(wrap_pyfunction!(add_bending, m)?)?;
    m.add_function(wrap_pyfunction!(inner_distances, m)?)
}
