//! Bindings of `patchtransfer_core::boundary_fit`.

use crate::convert::{points2, rows};
use crate::outline::Outline;
use crate::threads;
use numpy::ndarray::{Array2, Array3};
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArray3, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods,
};
use patchtransfer_core::boundary_fit::{Basis, BoundaryFit as Core, FEW_SIDES, Side, SideData};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// `(basis, outline, lengths, ends, tangents, legs)` as handed over from Python.
type SideTuple<'py> = (
    usize,
    usize,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray1<'py, f64>,
);

/// Sides of a boundary and the state of their fit.
#[pyclass]
struct BoundaryFit {
    outlines: Vec<Py<Outline>>,
    bases: Vec<Basis>,
    sides: Vec<Side>,
}

fn pair(array: &PyReadonlyArray2<'_, f64>) -> PyResult<[[f64; 2]; 2]> {
    points2(array)?.try_into().map_err(|_| PyValueError::new_err("expected shape (2, 2)"))
}

/// An (n, 2, 2) array.
fn pairs<'py>(py: Python<'py>, values: &[[[f64; 2]; 2]]) -> Bound<'py, PyArray3<f64>> {
    let flat = values.as_flattened().as_flattened().to_vec();
    Array3::from_shape_vec((values.len(), 2, 2), flat).expect("sizes agree").into_pyarray(py)
}

#[pymethods]
impl BoundaryFit {
    #[new]
    fn new(
        py: Python<'_>,
        outlines: Vec<Py<Outline>>,
        bases: Vec<PyReadonlyArray2<'_, f64>>,
        sides: Vec<SideTuple<'_>>,
        slide_error: f64,
    ) -> PyResult<Self> {
        let bases: Vec<Basis> = bases
            .iter()
            .map(|b| {
                let n = b.shape()[1];
                if n < 2 {
                    return Err(PyValueError::new_err("a basis needs two functions or more"));
                }
                Ok(Basis::new(n, b.as_array().iter().copied().collect()))
            })
            .collect::<PyResult<_>>()?;
        let read = |(basis, outline, lengths, ends, tangents, legs): &SideTuple<'_>| {
            let lengths = lengths.as_array().to_vec();
            let known = bases.get(*basis).is_some_and(|b| b.values.len() == b.n * lengths.len());
            if !known || *outline >= outlines.len() || lengths.len() < 3 || legs.len() != 2 {
                return Err(PyValueError::new_err("side: basis, outline, lengths or legs do not fit"));
            }
            let legs = [legs.as_array()[0], legs.as_array()[1]];
            let data = SideData {
                basis: *basis,
                outline: *outline,
                lengths,
                ends: pair(ends)?,
                tangents: pair(tangents)?,
                legs,
            };
            Ok(Side::new(data, &bases[*basis], slide_error))
        };
        let sides = sides.iter().map(read).collect::<PyResult<Vec<_>>>()?;
        let mut fit = Self { outlines, bases, sides };
        fit.with(py, |mut core| core.start())?;
        Ok(fit)
    }

    fn linearise(&mut self, py: Python<'_>, level: bool) -> PyResult<()> {
        self.with(py, |mut core| core.linearise(level))
    }

    fn solve(&mut self, py: Python<'_>) -> PyResult<()> {
        self.with(py, |mut core| core.solve())
    }

    fn hold_ends(&mut self, py: Python<'_>, cosine: f64) -> PyResult<()> {
        self.with(py, |mut core| core.hold_ends(cosine))
    }

    fn errors<'py>(&mut self, py: Python<'py>, whole: bool) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(self.with(py, |core| core.errors(whole))?.into_pyarray(py))
    }

    fn backwards(&mut self, py: Python<'_>) -> PyResult<f64> {
        self.with(py, |core| core.backwards())
    }

    /// Stiffness (n, 2, 2) against turning the legs, and minus the gradient (n, 2) in their angles.
    #[allow(clippy::type_complexity)]
    fn turning<'py>(
        &mut self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyArray3<f64>>, Bound<'py, PyArray2<f64>>)> {
        let (stiffness, gradient): (Vec<_>, Vec<_>) =
            self.with(py, |core| core.turning())?.into_iter().unzip();
        Ok((pairs(py, &stiffness), rows(py, &gradient)))
    }

    fn legs<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        Ok(pairs(py, &self.with(py, |core| core.legs())?))
    }

    fn lines<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        Ok(pairs(py, &self.with(py, |core| core.lines())?))
    }

    /// Put legs (side, end) on lines along the rows of `directions`.
    fn set_lines(
        &mut self,
        py: Python<'_>,
        sides: PyReadonlyArray1<'_, i64>,
        end: usize,
        directions: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<()> {
        let (sides, directions) = (sides.as_array().to_vec(), points2(&directions)?);
        let count = self.sides.len();
        if sides.len() != directions.len()
            || end > 1
            || sides.iter().any(|&s| usize::try_from(s).map_or(true, |s| s >= count))
        {
            return Err(PyValueError::new_err("sides, end or directions do not fit"));
        }
        self.with(py, |mut core| {
            sides.iter().zip(directions).for_each(|(&side, d)| core.set_line(side as usize, end, d))
        })
    }

    /// Control points of all sides, one after the other.
    fn control_points<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let points = self.with(py, |core| core.control_points())?;
        let flat = points.as_flattened().to_vec();
        Ok(Array2::from_shape_vec((points.len(), 2), flat).expect("sizes agree").into_pyarray(py))
    }
}

impl BoundaryFit {
    fn with<T: Send>(&mut self, py: Python<'_>, work: impl FnOnce(Core<'_>) -> T + Send) -> PyResult<T> {
        let outlines = self.outlines.iter().map(|o| &o.get().core).collect();
        let few = self.sides.len() < FEW_SIDES;
        let core = Core::new(outlines, &self.bases, &mut self.sides);
        // Going over to the pool takes longer than a step with few sides.
        if few { Ok(py.detach(|| work(core))) } else { threads::run(py, || work(core)) }
    }
}

/// Add this file's class to the module.
pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_class::<BoundaryFit>()
}
