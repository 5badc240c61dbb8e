//! Bindings of `patchtransfer_core::registration`: matching of sequences, inner distances, sliding, thin plates.

use crate::convert::points2;
use crate::outline::Outline;
use crate::threads;
use numpy::ndarray::Array2;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use patchtransfer_core::outline::Outline as CoreOutline;
use patchtransfer_core::registration::matching::{Matcher, MatchingProblem};
use patchtransfer_core::registration::{inner_distance, sliding, thin_plate};
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

/// Angles (n, windows) between the chords that arrive at and leave the points at arc lengths `s`, in parts of half a
/// turn; windows are parts of the loop's length.
#[pyfunction]
fn turning<'py>(
    py: Python<'py>,
    outline: Py<Outline>,
    s: PyReadonlyArray1<'py, f64>,
    windows: Vec<f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (s, outline) = (s.as_slice()?, outline.get());
    let flat = py.detach(|| sliding::turning(&outline.core, s, &windows));
    Ok(Array2::from_shape_vec((s.len(), windows.len()), flat).expect("sizes agree").into_pyarray(py))
}

/// Target outline, its nodes' arc lengths and the number of the first, turning wanted (n, windows) and its weight (n,),
/// parts (n,) of the target from each point to the next, weight of stretch.
type LoopTuple<'py> = (
    Py<Outline>,
    PyReadonlyArray1<'py, f64>,
    usize,
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    f64,
);

/// Bending matrix (n, n), orthonormal functions (n, k) without energy, size of the target, weight.
type PlateTuple<'py> = (PyReadonlyArray2<'py, f64>, PyReadonlyArray2<'py, f64>, f64, f64);

/// Points that slide along the target's boundary; see `patchtransfer_core::registration::sliding`.
#[pyclass(frozen)]
struct Sliding {
    outlines: Vec<Py<Outline>>,
    core: sliding::Sliding,
}

impl Sliding {
    fn check(&self, n: usize) -> PyResult<()> {
        if n == self.core.size() {
            Ok(())
        } else {
            Err(PyValueError::new_err("one position a point, please"))
        }
    }

    fn outlines(&self) -> Vec<&CoreOutline> {
        self.outlines.iter().map(|outline| &outline.get().core).collect()
    }
}

#[pymethods]
impl Sliding {
    #[new]
    #[pyo3(signature = (loops, distances, wanted, weight, windows, plate=None))]
    fn new(
        loops: Vec<LoopTuple<'_>>,
        distances: PyReadonlyArray2<'_, f64>,
        wanted: PyReadonlyArray2<'_, f64>,
        weight: PyReadonlyArray2<'_, f64>,
        windows: Vec<f64>,
        plate: Option<PlateTuple<'_>>,
    ) -> PyResult<Self> {
        let nodes = distances.shape()[0];
        let (mut outlines, mut of_core) = (vec![], vec![]);
        for (outline, s, first, turning, turning_weight, part, stretch) in loops {
            let n = part.len();
            if turning.shape() != [n, windows.len()] || turning_weight.len() != n || n == 0 {
                return Err(PyValueError::new_err("the points of a loop differ in number"));
            }
            if s.len() == 0 || first + s.len() > nodes {
                return Err(PyValueError::new_err("a loop has nodes without distances"));
            }
            outlines.push(outline);
            of_core.push(sliding::SlidingLoop {
                nodes: s.as_array().to_vec(),
                first,
                turning: turning.as_array().iter().copied().collect(),
                turning_weight: turning_weight.as_array().to_vec(),
                part: part.as_array().to_vec(),
                stretch,
            });
        }
        let n = of_core.iter().map(|l| l.part.len()).sum::<usize>();
        let square = |matrix: &PyReadonlyArray2<'_, f64>, n: usize| matrix.shape() == [n, n];
        if !square(&distances, nodes) || !square(&wanted, n) || !square(&weight, n) {
            return Err(PyValueError::new_err("matrices must be square and fit the points"));
        }
        let plate = plate.map(|(matrix, affine, size, weight)| {
            if !square(&matrix, n) || affine.shape()[0] != n {
                return Err(PyValueError::new_err("the plate has another number of points"));
            }
            let affine = affine.as_array();
            Ok(sliding::Plate {
                matrix: matrix.as_array().iter().copied().collect(),
                affine: affine.columns().into_iter().map(|column| column.to_vec()).collect(),
                size,
                weight,
            })
        });
        let flat = |matrix: PyReadonlyArray2<'_, f64>| matrix.as_array().iter().copied().collect();
        let core = sliding::Sliding {
            loops: of_core,
            distances: flat(distances),
            wanted: flat(wanted),
            weight: flat(weight),
            windows,
            plate: plate.transpose()?,
        };
        Ok(Self { outlines, core })
    }

    /// Energy, gradient (n,) and Gauss–Newton matrix (n, n) at the target's arc lengths `x` (n,).
    #[allow(clippy::type_complexity)]
    fn model<'py>(
        &self,
        py: Python<'py>,
        x: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<(f64, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>)> {
        self.check(x.len())?;
        let (x, n) = (x.as_slice()?, x.len());
        let model = py.detach(|| self.core.model(&self.outlines(), x));
        let hessian = Array2::from_shape_vec((n, n), model.hessian).expect("sizes agree");
        Ok((model.energy, model.gradient.into_pyarray(py), hessian.into_pyarray(py)))
    }

    /// Arc lengths (n,) after a slide with the `held` points (n,) where they are, and their energy.
    fn slide<'py>(
        &self,
        py: Python<'py>,
        x: PyReadonlyArray1<'py, f64>,
        held: PyReadonlyArray1<'py, bool>,
    ) -> PyResult<(Bound<'py, PyArray1<f64>>, f64)> {
        self.check(x.len())?;
        self.check(held.len())?;
        let (x, held) = (x.as_slice()?, held.as_slice()?);
        let (x, energy) = py.detach(|| self.core.slide(&self.outlines(), x, held));
        Ok((x.into_pyarray(py), energy))
    }
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

/// Two closed sequences and the costs of matching them; see `patchtransfer_core::registration::matching`.
#[pyclass(frozen)]
struct Matching {
    core: Matcher,
}

impl Matching {
    fn check(&self, cost: &PyReadonlyArray2<'_, f64>, starts: &[usize]) -> PyResult<()> {
        let (n, m) = self.core.size();
        if cost.shape() != [n, m] {
            return Err(PyValueError::new_err("positions and costs do not fit"));
        }
        match starts.iter().find(|&&start| start >= m) {
            Some(start) => Err(PyValueError::new_err(format!("no target node {start} to start at"))),
            None => Ok(()),
        }
    }
}

#[pymethods]
impl Matching {
    #[new]
    fn new(
        source: PyReadonlyArray1<'_, f64>,
        target: PyReadonlyArray1<'_, f64>,
        point_cost: PyReadonlyArray2<'_, f64>,
        source_skip: PyReadonlyArray1<'_, f64>,
        target_skip: PyReadonlyArray1<'_, f64>,
        stretch: f64,
        band: f64,
    ) -> PyResult<Self> {
        let (n, m) = (point_cost.shape()[0], point_cost.shape()[1]);
        if n == 0 || m == 0 || source.len() != n + 1 || target.len() != m + 1 {
            return Err(PyValueError::new_err("positions and costs do not fit"));
        }
        if source_skip.len() != n || target_skip.len() != m {
            return Err(PyValueError::new_err("costs differ in number"));
        }
        let core = Matcher::new(MatchingProblem {
            source: source.as_array().to_vec(),
            target: target.as_array().to_vec(),
            point_cost: point_cost.as_array().iter().copied().collect(),
            source_skip: source_skip.as_array().to_vec(),
            target_skip: target_skip.as_array().to_vec(),
            stretch,
            band,
        });
        Ok(Self { core })
    }

    /// Cost of the cheapest matching of source node 0 with every start, in single precision; node pairs cost `cost`
    /// (n, m) for each unit of length.
    fn scan<'py>(
        &self,
        py: Python<'py>,
        cost: PyReadonlyArray2<'py, f64>,
        starts: Vec<usize>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        self.check(&cost, &starts)?;
        let cost = cost.as_slice()?;
        Ok(threads::run(py, || self.core.scan(cost, &starts))?.into_pyarray(py))
    }

    /// Cost and node pairs (k, 2) of the cheapest matching from any of the starts; None if all are forbidden.
    fn solve<'py>(
        &self,
        py: Python<'py>,
        cost: PyReadonlyArray2<'py, f64>,
        starts: Vec<usize>,
    ) -> PyResult<Option<(f64, Bound<'py, PyArray2<i64>>)>> {
        self.check(&cost, &starts)?;
        let cost = cost.as_slice()?;
        let found = py.detach(|| self.core.solve(cost, &starts));
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
    m.add_class::<Sliding>()?;
    m.add_function(wrap_pyfunction!(turning, m)?)?;
    m.add_function(wrap_pyfunction!(bending_matrix, m)?)?;
    m.add_function(wrap_pyfunction!(inner_distances, m)?)
}
