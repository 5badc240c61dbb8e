"""How many exact G1 conditions there are depends on structure: not on how small a slope, a bend or a kink is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import models
import patchtransfer as pt
import targets
from patchtransfer import examples
from patchtransfer.continuity.conditions import conditions, evaluated
from patchtransfer.continuity.g1 import g1_rows
from patchtransfer.continuity.interfaces import ControlRows, control_rows
from patchtransfer.continuity.null_space import RowSpace, row_space
from patchtransfer.geometry.patch import Patch

#: Symmetric ones among them: a : b is constant, or c zero, to rounding or to what the optimiser leaves.
ALL = models.SPACES | {
    name: (lambda name=name: models.with_freedom(examples.load(name)[0])) for name in models.EXAMPLES
}
DEFORMATIONS = {"itself": lambda mp: lambda x: x, "bent": lambda mp: targets.bend(mp, 30)}


def space_on(mp: pt.MultiPatch, plan: pt.TransferPlan, f: targets.Deformation) -> RowSpace:
    """The maps with exact G1 rows that follow the map with C1 rows on a deformed boundary."""
    target, landmarks = targets.deformed(mp, f, same_cuts=True)
    x = plan.transfer(target, landmarks).multipatch.topology.coordinates
    rows = g1_rows(mp.topology, control_rows(mp.topology), x)
    space = row_space(rows, mp.topology.interior_points, x)
    assert space.contradictory == ()
    assert space.residual(space.project(x)) < 1e-11 * mp.diameter
    return space


@pytest.mark.parametrize("name", ALL)
@given(
    seed=st.integers(0, 10**6), exponent=st.floats(-12, -3), deformation=st.sampled_from(list(DEFORMATIONS.values()))
)
@settings(max_examples=5, deadline=None)
def test_a_boundary_that_changes_a_little_gives_a_basis_of_the_same_size(name, seed, exponent, deformation):
    mp = ALL[name]()
    plan, f = pt.TransferPlan(mp, "c1"), deformation(mp)
    moved = targets.waves(mp, 10**exponent, seed)
    before, after = space_on(mp, plan, f), space_on(mp, plan, lambda x: f(moved(x)))
    assert (len(after.rows), *after.basis.shape) == (len(before.rows), *before.basis.shape)
    assert after.redundant == before.redundant


def interface(degree: int, spans: int, smoothness: int) -> ControlRows:
    mp = models.grid(2, 1, degree, spans, seed=None).reduce_continuity(smoothness)
    return control_rows(mp.topology)[0]


def collocated(r: ControlRows, data: np.ndarray) -> np.ndarray:
    """Values of g at p + 2 points in every span, which determine it."""
    x = (np.arange(r.degree + 2) + 0.5) / (r.degree + 2)
    t = (r.breaks[:-1, None] + np.diff(r.breaks)[:, None] * x).ravel()
    return r.functional(evaluated(data, t), *r.basis(t))


SPLINES = [(3, 2, 1), (3, 4, 1), (3, 3, 0), (4, 3, 2), (4, 1, 2), (5, 3, 1)]


@pytest.mark.parametrize("spline", SPLINES)
@given(
    ends=st.lists(st.floats(0.3, 1.7), min_size=2, max_size=2),
    c=st.lists(st.floats(-1, 1), min_size=3, max_size=3),
    kind=st.sampled_from([(False, 2), (False, 1), (False, -1), (True, 2), (True, 1), (True, -1)]),
)
@settings(max_examples=25)
def test_conditions_are_those_of_the_identity(spline, ends, c, kind):
    """The same row space as of g at points that determine it."""
    r, (constant, degree) = interface(*spline), kind
    a0, a1 = (ends[0], ends[0]) if constant else (ends[0], ends[0] + (0.4 if ends[0] < 1 else -0.4))
    data = np.array([a0, a1, 2 - a0, 2 - a1, c[0], c[1], c[2]])
    if degree == 2:
        data[5] = (c[0] + c[2]) / 2 + 0.5
    elif degree == 1:
        data[5] = (c[0] + c[2]) / 2
    else:
        data[4:] = 0
    if degree >= 0 and len(r.breaks) > 2:
        # A zero at a knot takes the condition there from the identity.
        kept = np.abs(evaluated(data, r.breaks[1:-1])[:, 2]).min()
        if kept < 1e-3:
            return
    rows, values = conditions(r, data, constant, degree), collocated(r, data)
    inner, spans = len(r.breaks) - 2, len(r.breaks) - 1
    assert len(rows) == len(r.curve) + inner * (degree >= 0) + spans * (degree == 2 or not constant)
    assert np.linalg.cond(rows) < 1e3
    _, sigma, vt = np.linalg.svd(values)
    assert int((sigma > 1e-9 * sigma[0]).sum()) == len(rows)
    np.testing.assert_allclose(rows @ vt[len(rows) :].T, 0, atol=1e-9)


@pytest.mark.parametrize("spline", SPLINES)
@given(slope=st.floats(-15, 0), bend=st.floats(-15, 0), c=st.floats(-15, 0))
@settings(max_examples=25)
def test_conditions_stay_independent_however_small_the_data_are(spline, slope, bend, c):
    r, s = interface(*spline), 10**c
    data = np.array([1, 1 + 10**slope / 2, 1, 1 - 10**slope / 2, s, s + 10**bend, s])
    rows = conditions(r, data, False, 2)
    assert np.linalg.cond(rows) < 1e3
    # Fields that satisfy them satisfy the identity.
    _, _, vt = np.linalg.svd(rows)
    assert np.abs(collocated(r, data) @ vt[len(rows) :].T).max() < 1e-12 * r.left_scale * (r.degree + 1) ** 2


def test_conditions_of_reversed_knots():
    """Spans of different lengths, from either end."""
    knots = np.array([0, 0, 0, 0, 0.2, 0.2, 0.7, 0.7, 0.7, 1, 1, 1, 1])
    mp = models.grid(2, 1, 3, 2, seed=None)
    along = mp.interfaces[0].side_a.axis
    patches = []
    for p in mp.patches:
        refined = [np.asarray(k) for k in p.knots]
        net = np.moveaxis(np.asarray(p.control_points), along, 0)
        refined[along] = knots
        net = np.moveaxis(np.linspace(0, 1, 9)[:, None, None] * (net[-1] - net[0]) + net[0], 0, along)
        patches.append(Patch(tuple(refined), p.degrees, net))
    r = control_rows(models.welded(pt.MultiPatch(patches)).topology)[0]
    backwards = replace(r, knots=1 - r.knots[::-1], curve=r.curve[::-1], left=r.right[::-1], right=r.left[::-1])
    # C' changes its sign, and so does c; D_L and D_R change places.
    forth = conditions(r, np.array([0.8, 1.1, 1.2, 0.9, 0.3, 0.1, -0.4]), False, 2)
    back = conditions(backwards, np.array([0.9, 1.2, 1.1, 0.8, 0.4, -0.1, -0.3]), False, 2)
    left, right, curve = np.split(back, 3, axis=1)
    null = np.linalg.svd(forth)[2][len(forth) :].T
    assert len(back) == len(forth)
    np.testing.assert_allclose(np.hstack([right, left, curve])[:, _reversed(len(r.curve))] @ null, 0, atol=1e-10)


def _reversed(n: int) -> np.ndarray:
    return np.arange(3 * n).reshape(3, n)[:, ::-1].ravel()
