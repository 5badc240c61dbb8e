"""Random layouts give certified models, and these transfer to random deformations of themselves."""

from __future__ import annotations

import numpy as np
from hypothesis import event, given, settings
from hypothesis import strategies as st

import patchtransfer as pt
from strategies import deformations, layouts, outline
from targets import deformed


def check(result: pt.TransferResult, layout: pt.QuadLayout) -> None:
    assert result.certificate.injective
    # A fit that misses its tolerance must say so.
    assert result.boundary_error <= 1e-3 or result.warnings
    inside = set(range(len(layout.vertices))) - set(layout.boundary_vertices)
    count = np.bincount(layout.quads.ravel())
    expected = sorted(int(count[v]) for v in inside if count[v] != 4)
    assert sorted(v.valence for v in result.multipatch.vertices if v.extraordinary) == expected


@settings(max_examples=20, deadline=None)
@given(layouts(), st.integers(1, 3))
def test_a_layout_on_its_own_polygon_is_certified(layout, degree):
    """The quads themselves are a solution, so that no error is allowed."""
    check(pt.from_layout(layout.vertices, layout.quads, outline(layout, smooth=False), degree), layout)


@settings(max_examples=20, deadline=None)
@given(layouts(), st.integers(2, 3))
def test_a_layout_on_a_smoothed_outline_is_certified_unless_infeasible(layout, degree):
    try:
        result = pt.from_layout(layout.vertices, layout.quads, outline(layout, smooth=True), degree)
    except pt.InfeasibleTargetError as error:
        # The cubics may cross each other at a thin neck.
        event(str(error)[:60])
    else:
        check(result, layout)


@settings(max_examples=20, deadline=None)
@given(layouts(), st.booleans(), st.data())
def test_a_deformed_model_is_certified_unless_infeasible(layout, smooth, data):
    source = pt.from_layout(layout.vertices, layout.quads, outline(layout, smooth)).multipatch
    target, joints = deformed(source, data.draw(deformations(source)), seed=1)
    try:
        result = pt.transfer(source, target, joints)
    except pt.InfeasibleTargetError as error:
        event(str(error)[:60])
    else:
        check(result, layout)
