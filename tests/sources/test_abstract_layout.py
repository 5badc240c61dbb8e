"""Layouts by connectivity and the places of boundary vertices."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import patchtransfer as pt
from patchtransfer.sources.drawing import circle_drawing
from patchtransfer.sources.quad_layout import convex
from shapes import circle
from strategies import layouts, outline

#: A square inside a ring of four quads.
DISK = [[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7], [4, 5, 6, 7]]
RING = DISK[:4]


def quarters(first: int, radius=1.0, turn=0.0) -> dict[int, tuple[float, float]]:
    angles = turn + np.arange(4) * np.pi / 2
    return {first + k: (radius * np.cos(a), radius * np.sin(a)) for k, a in enumerate(angles)}


def test_connectivity_and_places_of_the_boundary_are_enough():
    result = pt.from_layout(None, DISK, pt.Boundary([[circle()]]), 3, 3, assignment=quarters(0))
    assert result.certificate.status == "certified"
    assert result.quality.scaled_jacobian.mean > 0.98
    for k, (x, y) in quarters(0).items():
        np.testing.assert_allclose(result.multipatch.patches[k](0, 0), [x, y], atol=1e-6)


def test_a_ring_of_curved_quads_whose_straight_sides_would_cross_the_hole():
    """Chords of the outer circle cut the hole: no straight drawing at the boundary's own points."""
    hole, assignment = 0.9, quarters(0) | quarters(4, 0.9)
    boundary = pt.Boundary([[circle()], [circle(hole)]])
    layout = pt.QuadLayout.abstract(RING, assignment=assignment)
    result = pt.from_layout(layout.vertices, layout.quads, boundary, assignment=layout.assignment)
    assert result.certificate.status == "certified"
    assert result.quality.scaled_jacobian.min > 0.95
    places = np.array([assignment[v] for v in range(8)])
    places[4] = places[0] * 1.5
    with pytest.raises(pt.InputError, match="assign every boundary vertex"):
        pt.from_layout(places, RING, boundary)


def test_a_hole_with_a_corner_that_one_quad_fills():
    """The hole is not convex there, so that quads are drawn convex only where holes need not be."""
    ring = [[k, (k + 1) % 6, 6 + (k + 1) % 6, 6 + k] for k in range(6)]
    # At vertex 9 of the hole two quads become one.
    quads = [quad for k, quad in enumerate(ring) if k not in (2, 3)] + [[2, 10, 9, 8], [2, 3, 4, 10]]
    layout = pt.QuadLayout.abstract(quads)
    assert layout.loops == [[0, 1, 2, 3, 4, 5], [6, 11, 10, 9, 8, 7]]
    assert layout.graph.valence[9] == 1
    assert layout.straight


@pytest.mark.parametrize(
    ("quads", "message"),
    [
        ([[0, 1, 2, 2]], "quad 0 .* has a vertex twice"),
        ([[0, 1, 2, 3], [0, 1, 4, 5]], r"edge \(0, 1\) belongs to 2 quads on the same side"),
        ([[0, 1, 2, 3], [2, 4, 5, 6]], "touches itself at vertex 2"),
        ([[0, 1, 2, 3], [4, 5, 6, 7]], "quad 1 is not joined to quad 0"),
        ([[0, 1, 2, 3], [2, 1, 0, 4]], "inner layout vertex 1 has only 2 quads around it"),
        ([[-1, 1, 2, 3]], "use vertex -1"),
        ([[0, 1, 2, 10**7]], "as vertex number"),
        ([[0, 1, 2]], r"shape \(m, 4\)"),
        # A cube and a torus of nine quads, the latter with a piece left out.
        ([[0, 1, 2, 3], [7, 6, 5, 4], [1, 0, 4, 5], [2, 1, 5, 6], [3, 2, 6, 7], [0, 3, 7, 4]], "has no boundary"),
        (
            [
                [3 * i + j, 3 * ((i + 1) % 3) + j, 3 * ((i + 1) % 3) + (j + 1) % 3, 3 * i + (j + 1) % 3]
                for i in range(3)
                for j in range(3)
            ][1:],
            "no disk with holes",
        ),
        # Two rings of three around the two sides of one inner vertex.
        (
            [[0, 1, 2, 3], [0, 3, 4, 5], [0, 5, 6, 1], [0, 7, 8, 9], [0, 9, 10, 11], [0, 11, 12, 7], [1, 6, 7, 12]],
            "vertex 0 in two separate fans",
        ),
    ],
)
def test_what_is_no_disk_with_holes_is_refused(quads, message):
    with pytest.raises(pt.InputError, match=message):
        pt.QuadLayout.abstract(quads)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({2: None}, "boundary vertex 2 of the layout has no place"),
        ({4: (0.0, 0.0)}, "assignment names vertex 4, which is not a boundary vertex"),
        ({1: (0.0, 2.0)}, r"layout vertex 1 at \(0, 2\) is 1 off the boundary"),
        ({1: (-1.0, 0.0), 2: (0.0, 1.0)}, "does not keep the order"),
        ({1: (0.0, -1.0), 3: (0.0, 1.0)}, "runs backwards"),
        ({1: (1.0, 0.0)}, "vertices 0 and 1 are assigned to the same point"),
        ({1: (np.nan, 0.0)}, "NaN"),
        ({1: (0.0, 1.0, 2.0)}, "must be a point"),
    ],
)
def test_bad_assignments_are_refused(change, message):
    assignment = quarters(0) | change
    assignment = {v: place for v, place in assignment.items() if place is not None}
    with pytest.raises(pt.InputError, match=message):
        pt.from_layout(None, DISK, pt.Boundary([[circle()]]), assignment=assignment)


def test_loops_have_to_correspond():
    both = quarters(0) | quarters(4, 0.5)
    with pytest.raises(pt.InputError, match="layout has 2 boundary loops and the boundary 1"):
        pt.from_layout(None, RING, pt.Boundary([[circle()]]), assignment=both)
    boundary = pt.Boundary([[circle()], [circle(0.5)]])
    with pytest.raises(pt.InputError, match=r"layout loops 0 and 1 .* both assigned to boundary loop 0"):
        pt.from_layout(None, RING, boundary, assignment=quarters(0) | quarters(4))
    with pytest.raises(pt.InputError, match=r"layout vertices 0 and 2 are on one loop of the layout"):
        pt.from_layout(None, RING, boundary, assignment=both | {2: (-0.5, 0.0)})
    # Either loop of the ring may be the outer one.
    inside_out = quarters(4) | quarters(0, 0.5)
    mirrored = [[a, d, c, b] for a, b, c, d in RING]
    result = pt.from_layout(None, mirrored, boundary, assignment=inside_out)
    assert result.certificate.status == "certified"


@settings(max_examples=15)
@given(layouts(), st.randoms(use_true_random=False))
def test_any_layout_is_certified_on_its_outline_from_its_connectivity_alone(layout, random):
    """Renumbered, without vertices; the straight quads are a solution."""
    numbers = list(range(len(layout.vertices)))
    random.shuffle(numbers)
    quads = np.array(numbers)[layout.quads]
    assignment = {numbers[v]: tuple(layout.vertices[v]) for v in layout.boundary_vertices}
    result = pt.from_layout(None, quads, outline(layout, smooth=False), assignment=assignment)
    assert result.certificate.injective
    count = np.bincount(layout.quads.ravel())
    inside = set(range(len(count))) - set(layout.boundary_vertices)
    expected = sorted(int(count[v]) for v in inside if count[v] not in (0, 4))
    assert sorted(v.valence for v in result.multipatch.vertices if v.extraordinary) == expected


@settings(max_examples=30)
@given(layouts())
def test_drawings_of_layouts_are_convex(layout):
    graph = pt.QuadLayout.abstract(layout.quads).graph
    for outer in graph.loops:
        assert convex(circle_drawing(graph, outer), layout.quads).all()
