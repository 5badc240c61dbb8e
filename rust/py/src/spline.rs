//! Bindings of `patchtransfer_core::spline`: Bézier extraction, evaluation, quality, Galerkin matrices.

use crate::convert::{PatchTuple, integers, one_a_patch, oriented, patch};
use crate::threads;
use numpy::ndarray::{Array2, Array3};
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArray3, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
    PyUntypedArrayMethods,
};
use patchtransfer_core::spline;
use patchtransfer_core::spline::galerkin::{Galerkin as Core, MAX_ORDER, PatchSpace};
use patchtransfer_core::spline::quality::{self, Range};
use patchtransfer_core::spline::scattered::TensorSpline;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// `(min, max, sum)` of the scaled Jacobian, of the condition number, `(samples, positive)`, `(u, v)` of the worst.
type QualityTuple = ((f64, f64, f64), (f64, f64, f64), (usize, usize), (f64, f64));

/// Points (m_u, m_v, 2) and scaled Jacobians (m_u, m_v).
type GridTuple<'py> = (Bound<'py, PyArray3<f64>>, Bound<'py, PyArray2<f64>>);

/// `(knots_u, knots_v, p, q, nodes_u, nodes_v, indices)` of a patch.
type SpaceTuple<'py> = (
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    usize,
    usize,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray2<'py, i64>,
);

/// Column offsets and row indices of an upper triangle.
type Pattern<'py> = (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<i64>>);

/// Homogeneous Bézier points (m, degree + 1, 3) of the spans of a spline with coefficients (n, 3).
#[pyfunction]
fn bezier_extract<'py>(
    py: Python<'py>,
    knots: PyReadonlyArray1<'py, f64>,
    degree: usize,
    coefficients: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    if coefficients.shape()[1] != 3 || knots.len() != coefficients.shape()[0] + degree + 1 {
        return Err(PyValueError::new_err("knots, degree and coefficients (n, 3) do not fit"));
    }
    let c: Vec<[f64; 3]> = coefficients.as_array().rows().into_iter().map(|r| [r[0], r[1], r[2]]).collect();
    let pieces = spline::bezier_extract(&knots.as_array().to_vec(), degree, &c);
    let m = pieces.len() / (degree + 1);
    let flat: Vec<f64> = pieces.into_iter().flatten().collect();
    let array = Array3::from_shape_vec((m, degree + 1, 3), flat).expect("sizes agree");
    Ok(array.into_pyarray(py))
}

/// Derivatives of `order` of a spline with coefficients (n, d) at the parameters `at` (m,), shape (m, d).
#[pyfunction]
fn evaluate_spline<'py>(
    py: Python<'py>,
    knots: PyReadonlyArray1<'py, f64>,
    degree: usize,
    coefficients: PyReadonlyArray2<'py, f64>,
    at: PyReadonlyArray1<'py, f64>,
    order: usize,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let [n, width] = [coefficients.shape()[0], coefficients.shape()[1]];
    if n <= degree || width == 0 || knots.len() != n + degree + 1 {
        return Err(PyValueError::new_err("knots, degree and coefficients (n, d) do not fit"));
    }
    let c: Vec<f64> = coefficients.as_array().iter().copied().collect();
    let (knots, at) = (knots.as_array().to_vec(), at.as_array().to_vec());
    let values = spline::evaluate(&knots, degree, &c, width, &at, order);
    Ok(Array2::from_shape_vec((at.len(), width), values).expect("sizes agree").into_pyarray(py))
}

/// Derivatives of order (du, dv) of a bivariate spline with coefficients (n_u, n_v, d) at the points (u, v), (m, d).
#[pyfunction]
#[allow(clippy::too_many_arguments)]
fn evaluate_tensor<'py>(
    py: Python<'py>,
    knots: (PyReadonlyArray1<'py, f64>, PyReadonlyArray1<'py, f64>),
    degrees: [usize; 2],
    coefficients: PyReadonlyArray3<'py, f64>,
    u: PyReadonlyArray1<'py, f64>,
    v: PyReadonlyArray1<'py, f64>,
    du: usize,
    dv: usize,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let shape = coefficients.shape();
    let fits = |d: usize, knots: usize| shape[d] > degrees[d] && knots == shape[d] + degrees[d] + 1;
    if !fits(0, knots.0.len()) || !fits(1, knots.1.len()) || shape[2] == 0 || u.len() != v.len() {
        return Err(PyValueError::new_err("knots, degrees, coefficients and parameters do not fit"));
    }
    let (count, width) = (u.len(), shape[2]);
    let coefficients = coefficients.as_slice()?;
    let (u, v, knots) = (u.as_slice()?, v.as_slice()?, [knots.0.as_slice()?, knots.1.as_slice()?]);
    let spline = TensorSpline { degrees, knots, coefficients, width };
    let values = threads::run(py, || spline.at_points(u, v, [du, dv]))?;
    Ok(Array2::from_shape_vec((count, width), values).expect("sizes agree").into_pyarray(py))
}

/// Quality of every patch; `signs` are the orientations, `excluded` the corners to leave out, patch by patch.
#[pyfunction]
fn measure_quality(
    py: Python<'_>,
    patches: Vec<PatchTuple<'_>>,
    signs: Vec<f64>,
    samples: usize,
    excluded: Vec<Vec<usize>>,
) -> PyResult<Vec<QualityTuple>> {
    let patches = oriented(&patches, &signs)?;
    one_a_patch("lists of excluded corners", excluded.len(), patches.len())?;
    if samples < 2 {
        return Err(PyValueError::new_err("at least 2 samples a knot span are needed"));
    }
    let found = threads::run(py, || quality::measure(&patches, &signs, samples, &excluded))?;
    let tuple = |r: Range| (r.min, r.max, r.sum);
    Ok(found
        .into_iter()
        .map(|q| {
            let counts = (q.samples, q.positive);
            (tuple(q.scaled_jacobian), tuple(q.condition_number), counts, q.worst.into())
        })
        .collect())
}

/// Points and scaled Jacobians of a patch on the grid of `measure_quality`.
#[pyfunction]
fn sample_patch<'py>(
    py: Python<'py>,
    tuple: PatchTuple<'py>,
    sign: f64,
    samples: usize,
) -> PyResult<GridTuple<'py>> {
    let patch = patch(&tuple)?;
    if samples < 2 {
        return Err(PyValueError::new_err("at least 2 samples a knot span are needed"));
    }
    let grid = py.detach(|| quality::grid(&patch, sign, samples));
    let [m, n] = grid.shape;
    let points = Array3::from_shape_vec((m, n, 2), grid.points.into_flattened()).expect("sizes agree");
    let scaled = Array2::from_shape_vec((m, n), grid.scaled).expect("sizes agree");
    Ok((points.into_pyarray(py), scaled.into_pyarray(py)))
}

/// Symmetric matrices over the unknowns of a multi-patch spline space.
#[pyclass(frozen)]
struct Galerkin {
    core: Core,
}

#[pymethods]
impl Galerkin {
    #[new]
    fn new(py: Python<'_>, patches: Vec<SpaceTuple<'_>>, n: usize) -> PyResult<Self> {
        let mut spaces = vec![];
        for (ku, kv, p, q, tu, tv, indices) in &patches {
            let (shape, limits) = (indices.shape(), (ku.len(), kv.len()));
            if *p < 1 || *q < 1 || limits != (shape[0] + p + 1, shape[1] + q + 1) {
                return Err(PyValueError::new_err("knots, degrees and indices do not fit"));
            }
            let narrow = |&i: &i64| u32::try_from(i).ok().filter(|&i| (i as usize) < n);
            let indices: Option<Vec<u32>> = indices.as_array().iter().map(narrow).collect();
            let indices = indices.ok_or_else(|| PyValueError::new_err("an index is out of range"))?;
            let (ku, kv, tu, tv) = (ku.as_slice()?, kv.as_slice()?, tu.as_slice()?, tv.as_slice()?);
            spaces.push(PatchSpace::new([ku, kv], [*p, *q], [tu, tv], indices));
        }
        Ok(Self { core: threads::run(py, || Core::new(spaces, n))? })
    }

    fn pattern<'py>(&self, py: Python<'py>) -> Pattern<'py> {
        let (offsets, rows) = self.core.pattern();
        (integers(py, offsets), integers(py, rows))
    }

    fn assemble<'py>(
        &self,
        py: Python<'py>,
        kinds: Vec<[usize; 2]>,
        coefficients: Vec<PyReadonlyArray3<'py, f64>>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let pairs = kinds.len() * (kinds.len() + 1) / 2;
        let patches = self.core.patches();
        let fits = coefficients.len() == patches.len()
            && kinds.iter().flatten().all(|&order| order <= MAX_ORDER)
            && coefficients.iter().zip(patches).all(|(c, p)| {
                let [m, n] = p.nodes();
                c.shape() == [pairs, m, n]
            });
        if !fits {
            return Err(PyValueError::new_err("coefficients do not fit the form or the nodes"));
        }
        let slices = coefficients.iter().map(|c| c.as_slice()).collect::<Result<Vec<_>, _>>()?;
        Ok(threads::run(py, || self.core.assemble(&kinds, &slices))?.into_pyarray(py))
    }
}

/// Add this file's names to the module.
pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_class::<Galerkin>()?;
    m.add_function(wrap_pyfunction!(bezier_extract, m)?)?;
    m.add_function(wrap_pyfunction!(evaluate_spline, m)?)?;
    m.add_function(wrap_pyfunction!(evaluate_tensor, m)?)?;
    m.add_function(wrap_pyfunction!(measure_quality, m)?)?;
    m.add_function(wrap_pyfunction!(sample_patch, m)?)
}
