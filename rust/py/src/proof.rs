//! Bindings of `patchtransfer_core::proof`: injectivity of patches, simple loops.

use crate::threads;
use numpy::{IntoPyArray, PyArray1};
use patchtransfer_core::proof::dilatation;
use patchtransfer_core::proof::injectivity::{self, CellKind, Limits};
use patchtransfer_core::proof::proved_quality::{self, Bounds};
use patchtransfer_core::proof::simple_loops::{self, MeetingKind, Place};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use patchtransfer_core::spline::SplinePatch;

use crate::convert::{CurveTuple, PatchTuple, curve, one_a_patch, oriented};

/// `(kind, (u0, u1, v0, v1), (u, v), value)`.
type CellTuple = (&'static str, (f64, f64, f64, f64), (f64, f64), f64);
/// `(lower_bound, sign_agrees, subdivisions, cells)`.
type ProofTuple = (f64, bool, usize, Vec<CellTuple>);
/// `(lower, upper, (patch, u, v))`.
type BoundsTuple = (f64, f64, Option<(usize, f64, f64)>);
/// `(loop, curve, t)`.
type PlaceTuple = (usize, usize, f64);
/// `(kind, place, place, point)`.
type MeetingTuple = (&'static str, PlaceTuple, PlaceTuple, (f64, f64));
/// `(meetings, orientation, around, gap, arcs)`.
type LoopsTuple = (Vec<MeetingTuple>, Vec<i8>, Vec<Option<Vec<usize>>>, f64, usize);

/// Prove det J > 0 patch by patch; `signs` are the patches' orientations.
#[pyfunction]
fn certify_patches(
    py: Python<'_>,
    patches: Vec<PatchTuple<'_>>,
    signs: Vec<f64>,
    max_depth: usize,
) -> PyResult<Vec<ProofTuple>> {
    let patches = oriented(&patches, &signs)?;
    if patches.iter().flat_map(|p| p.degrees).any(|d| d == 0 || d > injectivity::MAX_DEGREE) {
        return Err(PyValueError::new_err(format!("degrees must be 1 to {}", injectivity::MAX_DEGREE)));
    }
    let limits = Limits { max_depth, ..Limits::default() };
    let proofs = threads::run(py, || injectivity::certify_patches(&patches, &signs, &limits))?;
    let kind = |kind| match kind {
        CellKind::Degenerate => "degenerate",
        CellKind::BelowRounding => "below rounding",
        CellKind::Undecided => "undecided",
        CellKind::Folded => "folded",
    };
    Ok(proofs
        .into_iter()
        .map(|proof| {
            let cells = proof
                .cells
                .iter()
                .map(|c| (kind(c.kind), c.bounds.into(), c.point.into(), c.value))
                .collect();
            (proof.lower_bound, proof.sign_agrees, proof.subdivisions, cells)
        })
        .collect())
}

fn bounds_tuple(bounds: Bounds) -> BoundsTuple {
    (bounds.lower, bounds.upper, bounds.at.map(|(patch, [u, v])| (patch, u, v)))
}

/// Largest degree among `patches` that the ratios of `largest = [of polynomial, of rational]` allow.
fn check_degrees(patches: &[SplinePatch], largest: [usize; 2]) -> PyResult<()> {
    for (k, patch) in patches.iter().enumerate() {
        let most = largest[usize::from(patch.weights.is_some())];
        if patch.degrees.iter().any(|d| *d == 0 || *d > most) {
            return Err(PyValueError::new_err(format!("patch {k}: degrees must be 1 to {most}")));
        }
    }
    Ok(())
}

/// Enclose the smallest scaled Jacobian and the largest condition number; `size` is that of excluded corners.
#[pyfunction]
fn prove_quality(
    py: Python<'_>,
    patches: Vec<PatchTuple<'_>>,
    signs: Vec<f64>,
    excluded: Vec<Vec<usize>>,
    size: f64,
    width: f64,
) -> PyResult<(BoundsTuple, BoundsTuple, usize)> {
    let patches = oriented(&patches, &signs)?;
    one_a_patch("excluded", excluded.len(), patches.len())?;
    check_degrees(&patches, proved_quality::MAX_DEGREES)?;
    let found = threads::run(py, || proved_quality::prove_quality(&patches, &signs, &excluded, size, width))?;
    Ok((bounds_tuple(found.scaled_jacobian), bounds_tuple(found.condition_number), found.cells))
}

/// `(log_dilatation, (smallest, largest size), cells, samples)`.
type ComparisonTuple<'py> = (BoundsTuple, (BoundsTuple, BoundsTuple), usize, Bound<'py, PyArray1<f64>>);

/// Compare two models of the same degrees and knots; `signs` are the orientations of their patches.
#[pyfunction]
fn compare_models<'py>(
    py: Python<'py>,
    first: Vec<PatchTuple<'_>>,
    second: Vec<PatchTuple<'_>>,
    signs: (Vec<f64>, Vec<f64>),
    width: f64,
) -> PyResult<ComparisonTuple<'py>> {
    let (first, second) = (oriented(&first, &signs.0)?, oriented(&second, &signs.1)?);
    one_a_patch("patches of the other model", second.len(), first.len())?;
    for (k, (s, t)) in first.iter().zip(&second).enumerate() {
        if s.degrees != t.degrees || s.knots != t.knots {
            return Err(PyValueError::new_err(format!("patch {k}: degrees and knots must agree")));
        }
        let most = dilatation::MAX_DEGREES[usize::from(s.weights.is_some() || t.weights.is_some())];
        if s.degrees.iter().any(|d| *d == 0 || *d > most) {
            return Err(PyValueError::new_err(format!("patch {k}: degrees must be 1 to {most}")));
        }
    }
    let signs = [signs.0.as_slice(), signs.1.as_slice()];
    let found = threads::run(py, || dilatation::compare(&first, &second, signs, width))?;
    let [smallest, largest] = found.size.map(bounds_tuple);
    let samples = found.samples.into_pyarray(py);
    Ok((bounds_tuple(found.log_dilatation), (smallest, largest), found.cells, samples))
}

/// Prove that closed loops of curves are simple and disjoint.
#[pyfunction]
fn certify_loops(py: Python<'_>, loops: Vec<Vec<CurveTuple<'_>>>) -> PyResult<LoopsTuple> {
    let loops = loops
        .iter()
        .map(|curves| curves.iter().map(curve).collect::<PyResult<Vec<_>>>())
        .collect::<PyResult<Vec<_>>>()?;
    if loops.iter().flatten().any(|c| c.degree == 0 || c.degree > simple_loops::MAX_DEGREE) {
        return Err(PyValueError::new_err(format!("degrees must be 1 to {}", simple_loops::MAX_DEGREE)));
    }
    let proof = py.detach(|| simple_loops::check_loops(&loops));
    let kind = |kind| match kind {
        MeetingKind::Crossing => "crossing",
        MeetingKind::Near => "near",
        MeetingKind::Cusp => "cusp",
        MeetingKind::Unfinished => "unfinished",
    };
    let place = |p: Place| (p.loop_index, p.curve, p.t);
    let meetings =
        proof.meetings.iter().map(|m| (kind(m.kind), place(m.a), place(m.b), m.point.into())).collect();
    Ok((meetings, proof.orientation, proof.around, proof.gap, proof.arcs))
}

/// Add this file's functions to the module.
pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add("DATA_ULPS", injectivity::DATA_ULPS)?;
    m.add("MAX_DEGREE", injectivity::MAX_DEGREE)?;
    m.add_function(wrap_pyfunction!(certify_patches, m)?)?;
    m.add("MAX_QUALITY_DEGREES", proved_quality::MAX_DEGREES)?;
    m.add_function(wrap_pyfunction!(prove_quality, m)?)?;
    m.add("MAX_COMPARED_DEGREES", dilatation::MAX_DEGREES)?;
    m.add("COMPARED_NODES", dilatation::NODES)?;
    m.add_function(wrap_pyfunction!(compare_models, m)?)?;
    m.add_function(wrap_pyfunction!(certify_loops, m)?)
}
