//! Bindings of `patchtransfer_core::fitting`.

use crate::convert::{points2, rows};
use crate::outline::Outline;
use crate::threads;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use patchtransfer_core::fitting::boundary_fit::{BoundaryFit as Core, FEW_SIDES};
use patchtransfer_core::fitting::side_fit::{SideData, SideFit};
use patchtransfer_core::spline::sampled_basis::SampledBasis;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// The sides of a loop as handed over from Python: indices of bases (n,), arc lengths of all samples, the joints' points
/// (n, 2), tangents leaving and arriving (n, 4), lengths of the legs (n, 2) and angles that they may stray by (n, 2).
type LoopTuple<'py> = (
    Vec<usize>,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray2<'py, f64>,
);

/// Sides of a boundary and the state of their fit.
#[pyclass]
struct BoundaryFit {
    outlines: Vec<Py<Outline>>,
    bases: Vec<SampledBasis>,
    sides: Vec<SideFit>,
    joints: Vec<[usize; 2]>,
}

fn mismatch(what: &str) -> PyErr {
    PyValueError::new_err(format!("{what} do not fit"))
}

fn read_loop(
    outline: usize,
    (indices, lengths, points, tangents, legs, stray): &LoopTuple<'_>,
    bases: &[SampledBasis],
    [slide_error, damping, shortest_leg]: [f64; 3],
) -> PyResult<Vec<SideFit>> {
    let n = indices.len();
    let (lengths, points) = (lengths.as_slice()?, points2(points)?);
    let (legs, stray) = (points2(legs)?, points2(stray)?);
    if points.len() != n || legs.len() != n || stray.len() != n || tangents.shape() != [n, 4] {
        return Err(mismatch("points, tangents, legs or their angles of a loop"));
    }
    let (tangents, mut at) = (tangents.as_array(), 0);
    let mut sides = Vec::with_capacity(n);
    for (i, &basis) in indices.iter().enumerate() {
        let known = bases.get(basis).ok_or_else(|| mismatch("bases"))?;
        let count = known.samples;
        if count < 3 || at + count > lengths.len() {
            return Err(mismatch("arc lengths of a loop"));
        }
        let data = SideData {
            basis,
            outline,
            lengths: lengths[at..at + count].to_vec(),
            ends: [points[i], points[(i + 1) % n]],
            tangents: [[tangents[(i, 0)], tangents[(i, 1)]], [tangents[(i, 2)], tangents[(i, 3)]]],
            legs: legs[i],
            stray: stray[i],
        };
        at += count;
        sides.push(SideFit::new(data, known, slide_error, damping, shortest_leg));
    }
    if at == lengths.len() { Ok(sides) } else { Err(mismatch("arc lengths of a loop")) }
}

#[pymethods]
impl BoundaryFit {
    #[new]
    fn new(
        py: Python<'_>,
        outlines: Vec<Py<Outline>>,
        bases: Vec<PyReadonlyArray2<'_, f64>>,
        loops: Vec<LoopTuple<'_>>,
        joints: Vec<(usize, usize)>,
        stiffness: [f64; 3],
    ) -> PyResult<Self> {
        let bases: Vec<SampledBasis> = bases
            .iter()
            .map(|b| {
                let n = b.shape()[1];
                if n < 2 {
                    return Err(PyValueError::new_err("a basis needs two functions or more"));
                }
                Ok(SampledBasis::new(n, b.as_slice()?))
            })
            .collect::<PyResult<_>>()?;
        if outlines.len() != loops.len() {
            return Err(mismatch("outlines and loops"));
        }
        let mut sides = vec![];
        for (k, of_loop) in loops.iter().enumerate() {
            sides.extend(read_loop(k, of_loop, &bases, stiffness)?);
        }
        if joints.iter().any(|&(a, b)| a >= sides.len() || b >= sides.len()) {
            return Err(mismatch("joints"));
        }
        let joints = joints.into_iter().map(|(a, b)| [a, b]).collect();
        let mut fit = Self { outlines, bases, sides, joints };
        fit.with(py, |mut core| core.start())?;
        Ok(fit)
    }

    fn linearise(&mut self, py: Python<'_>, level: bool) -> PyResult<()> {
        self.with(py, |mut core| core.linearise(level))
    }

    fn solve(&mut self, py: Python<'_>) -> PyResult<()> {
        self.with(py, |mut core| core.solve())
    }

    fn hold_ends(&mut self, py: Python<'_>, most: f64, back: f64) -> PyResult<()> {
        self.with(py, |mut core| core.hold_ends(most, back))
    }

    fn align(&mut self, py: Python<'_>) -> PyResult<()> {
        self.with(py, |mut core| core.align())
    }

    /// Turn the lines at smooth joints, by at most `most`; `shares` (n,) weigh the sides.
    fn turn(&mut self, py: Python<'_>, shares: PyReadonlyArray1<'_, f64>, most: f64) -> PyResult<()> {
        let shares = shares.as_slice()?;
        if shares.len() != self.sides.len() {
            return Err(mismatch("shares"));
        }
        self.with(py, |mut core| core.turn(shares, most))
    }

    fn errors<'py>(&mut self, py: Python<'py>, whole: bool) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(self.with(py, |core| core.errors(whole))?.into_pyarray(py))
    }

    fn backwards<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(self.with(py, |core| core.backwards())?.into_pyarray(py))
    }

    /// Control points of all sides, one after the other.
    fn control_points<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        Ok(rows(py, &self.with(py, |core| core.control_points())?))
    }
}

impl BoundaryFit {
    fn with<T: Send>(&mut self, py: Python<'_>, work: impl FnOnce(Core<'_>) -> T + Send) -> PyResult<T> {
        let outlines = self.outlines.iter().map(|o| &o.get().core).collect();
        let few = self.sides.len() < FEW_SIDES;
        let core = Core::new(outlines, &self.bases, &mut self.sides, &self.joints);
        // Going over to the pool takes longer than a step with few sides.
        if few { Ok(py.detach(|| work(core))) } else { threads::run(py, || work(core)) }
    }
}

/// Add this file's class to the module.
pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_class::<BoundaryFit>()
}
