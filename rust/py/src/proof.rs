//! Bindings of `patchtransfer_core::proof`: injectivity of patches, simple loops.

use crate::threads;
use patchtransfer_core::proof::injectivity::{self, CellKind, Limits};
use patchtransfer_core::proof::simple_loops::{self, MeetingKind, Place};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::convert::{CurveTuple, PatchTuple, curve, oriented};

/// `(kind, (u0, u1, v0, v1), (u, v), value)`.
type CellTuple = (&'static str, (f64, f64, f64, f64), (f64, f64), f64);
/// `(lower_bound, sign_agrees, subdivisions, cells)`.
type ProofTuple = (f64, bool, usize, Vec<CellTuple>);
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
    m.add_function(wrap_pyfunction!(certify_loops, m)?)
}
