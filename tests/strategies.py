"""Hypothesis generators of valid knot vectors, curves, patches, multi-patches and boundaries."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

from patchtransfer import Boundary, BSplineCurve, MultiPatch, Patch
from patchtransfer.splines import reverse_knots

#: Awkward but harmless numbers: long decimals, tiny and large magnitudes.
coordinates = st.floats(-1e6, 1e6, allow_nan=False)
weights = st.floats(0.1, 10.0)


@st.composite
def knot_vectors(draw, degree, max_inner=4):
    """Clamped knots with inner multiplicities up to the degree, on a domain that need not be [0, 1]."""
    steps = draw(st.lists(st.floats(0.1, 2.0), min_size=1, max_size=max_inner + 1))
    breaks = draw(st.floats(-3.0, 3.0)) + np.concatenate([[0.0], np.cumsum(steps)])
    inner = [draw(st.integers(1, degree)) for _ in breaks[1:-1]]
    return np.repeat(breaks, [degree + 1, *inner, degree + 1])


@st.composite
def arrays(draw, shape, elements=coordinates):
    n = int(np.prod(shape))
    return np.array(draw(st.lists(elements, min_size=n, max_size=n))).reshape(shape)


@st.composite
def curves(draw, rational=None, max_degree=4):
    """Any curve; its control points are random."""
    p = draw(st.integers(1, max_degree))
    knots = draw(knot_vectors(p))
    n = len(knots) - p - 1
    rational = draw(st.booleans()) if rational is None else rational
    return BSplineCurve(knots, p, draw(arrays((n, 2))), draw(arrays((n,), weights)) if rational else None)


@st.composite
def patches(draw, rational=None, max_degree=3):
    """Any patch; its control points are random, so it folds."""
    p, q = draw(st.integers(1, max_degree)), draw(st.integers(1, max_degree))
    u, v = draw(knot_vectors(p, 2)), draw(knot_vectors(q, 2))
    shape = len(u) - p - 1, len(v) - q - 1
    rational = draw(st.booleans()) if rational is None else rational
    return Patch((u, v), (p, q), draw(arrays((*shape, 2))), draw(arrays(shape, weights)) if rational else None)


def turned(patch: Patch, transpose: bool, flip_u: bool, flip_v: bool) -> Patch:
    """The same geometry with other parameter directions."""
    knots, degrees, points, w = list(patch.knots), list(patch.degrees), patch.control_points, patch.weights
    for axis, flip in enumerate((flip_u, flip_v)):
        if flip:
            knots[axis] = reverse_knots(knots[axis])
            points = np.flip(points, axis)
            w = None if w is None else np.flip(w, axis)
    if transpose:
        knots, degrees, points = knots[::-1], degrees[::-1], points.swapaxes(0, 1)
        w = None if w is None else w.T
    return Patch(knots, degrees, points, w)


@st.composite
def multipatches(draw, rational=None, max_side=2):
    """Valid (injective) grids of 1 to 4 bent patches, whose parameter directions are turned at random.

    Knots are uniform and symmetric, so that a patch can be turned without touching its neighbours; with unit
    weights on all sides, rational neighbours fit too.
    """
    columns, rows = draw(st.integers(1, max_side)), draw(st.integers(1, max_side))
    p = draw(st.integers(1, 3))
    spans = draw(st.integers(1, 3))
    knots = np.concatenate([np.zeros(p), np.linspace(0, 1, spans + 1), np.ones(p)])
    n = len(knots) - p - 1
    greville = np.array([knots[i + 1 : i + p + 1].mean() for i in range(n)])
    bend = draw(st.floats(-0.3, 0.3))
    made = []
    for a in range(columns):
        for b in range(rows):
            x, y = np.meshgrid(a + greville, b + greville, indexing="ij")
            points = np.stack([x + bend * y**2 / (1 + rows), y + bend * x / (1 + columns)], axis=2)
            w = None
            if draw(st.booleans()) if rational is None else rational:
                w = np.ones((n, n))
                w[1:-1, 1:-1] = draw(st.floats(0.5, 2.0))
            made.append(turned(Patch((knots, knots), (p, p), points, w), *(draw(st.booleans()) for _ in "tuv")))
    order = draw(st.permutations(range(len(made))))
    ids = draw(st.lists(st.integers(0, 40), min_size=len(made), max_size=len(made), unique=True))
    return MultiPatch([made[i] for i in order], ids=ids)


@st.composite
def boundaries(draw, rational=None):
    """One to three disjoint star-shaped loops of 1 to 5 curves that meet to the bit."""
    loops = []
    for k in range(draw(st.integers(1, 3))):
        count = draw(st.integers(1, 5))
        radii = draw(arrays((count, 4), st.floats(0.5, 1.0)))
        loop = []
        for i in range(count):
            p = draw(st.integers(1, 3))
            # A closed curve of one piece needs more than one control point in between.
            angle = 2 * np.pi * (i + np.linspace(0, 1, 5)) / count
            r = np.array([1.0, *radii[i][1:], 1.0])
            points = np.column_stack([5 * k + r * np.cos(angle), r * np.sin(angle)])
            if i:
                points[0] = loop[-1].end
            if i == count - 1:
                points[-1] = loop[0].start if loop else points[0]
            knots = np.concatenate([np.zeros(p), np.linspace(0, 1, 6 - p), np.ones(p)])
            w = draw(arrays((5,), weights)) if (draw(st.booleans()) if rational is None else rational) else None
            loop.append(BSplineCurve(knots, p, points, w))
        loops.append(loop)
    return Boundary(loops)


__all__ = ["arrays", "boundaries", "curves", "knot_vectors", "multipatches", "patches", "turned"]
