"""Hypothesis generators of valid knot vectors, curves, patches, multi-patches and boundaries."""

from __future__ import annotations

import numpy as np
from hypothesis import reject
from hypothesis import strategies as st

import targets
from patchtransfer import Boundary, BSplineCurve, InputError, MultiPatch, Patch, QuadLayout
from patchtransfer.geometry.basis import greville
from shapes import turned

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
    nodes = greville(knots, p)
    bend = draw(st.floats(-0.3, 0.3))
    made = []
    for a in range(columns):
        for b in range(rows):
            x, y = np.meshgrid(a + nodes, b + nodes, indexing="ij")
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


def _grid(columns: int, rows: int, missing=()) -> tuple[np.ndarray, list[list[int]]]:
    """Unit cells but for the missing ones, and the vertices they use."""
    kept = [(i, j) for i in range(columns) for j in range(rows) if (i, j) not in missing]
    corners = [[(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)] for i, j in kept]
    names = sorted({name for quad in corners for name in quad})
    return np.array(names, float), [[names.index(name) for name in quad] for quad in corners]


def _fan(valence: int, rings: int) -> tuple[np.ndarray, list[list[int]]]:
    """A regular polygon of quads around the origin, with further rings of quads around it."""
    n = 2 * valence
    angle = 2 * np.pi * np.arange(n) / n
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    # Mid-edge vertices lie on the inner polygon's edges in the first ring, on a circle in the others.
    first = circle * np.where(np.arange(n) % 2, 1.0, 0.85)[:, None]
    vertices = np.concatenate([[[0, 0]], first, *((r + 2) * circle for r in range(rings))])
    quads = [[0, 1 + k, 1 + k + 1, 1 + (k + 2) % n] for k in range(0, n, 2)]
    for r in range(rings):
        a, b = 1 + n * r, 1 + n * (r + 1)
        quads += [[a + k, b + k, b + (k + 1) % n, a + (k + 1) % n] for k in range(n)]
    return vertices, quads


@st.composite
def layouts(draw, jitter=0.3):
    """Random conforming layouts of 3 to 20 quads in any order: grids with up to two holes, dumbbells with a thin neck,
    and fans around a vertex of valence 3, 5 or 6.

    Vertices move by up to `jitter` of their shortest edge; on a dumbbell the neck is down to a fifth as wide as long.
    """
    kind = draw(st.sampled_from(["grid", "neck", "fan"]))
    if kind == "grid":
        columns, rows = draw(st.integers(1, 5)), draw(st.integers(3, 4))
        missing = [hole for hole in ((1, 1), (3, 1)) if hole[0] < columns - 1 and draw(st.booleans())]
        vertices, quads = _grid(columns, rows, missing)
    elif kind == "neck":
        length = draw(st.integers(1, 2))
        vertices, quads = _grid(length + 2, 3, [(1 + k, j) for k in range(length) for j in (0, 2)])
        # The middle row is the neck's.
        width = draw(st.floats(0.2 * length, 1.0))
        vertices[:, 1] = np.array([-1 - width / 2, -width / 2, width / 2, 1 + width / 2])[vertices[:, 1].astype(int)]
    else:
        vertices, quads = _fan(draw(st.sampled_from([3, 5, 6])), draw(st.integers(0, 1)))
    ends = vertices[np.stack([quads, np.roll(quads, -1, axis=1)], axis=2).reshape(-1, 2)]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).reshape(-1, 4)
    shortest = np.full(len(vertices), np.inf)
    for side in (lengths, np.roll(lengths, 1, axis=1)):
        np.minimum.at(shortest, np.array(quads), side)
    vertices = vertices + jitter * shortest[:, None] * draw(arrays(vertices.shape, st.floats(-0.7, 0.7)))
    quads = [list(np.roll(quad, draw(st.integers(0, 3)))) for quad in draw(st.permutations(quads))]
    try:
        return QuadLayout(vertices, quads)
    except InputError:
        # Moved until a quad was not convex.
        reject()


def outline(layout: QuadLayout, smooth: bool) -> Boundary:
    """The layout's own boundary: its edges, or cubics that are smooth wherever two quads meet."""
    edges = {int(a): int(b) for a, b in layout.boundary_edges}
    before = {b: a for a, b in edges.items()}
    count = np.bincount(layout.quads.ravel(), minlength=len(layout.vertices))
    x = layout.vertices

    def tangent(v: int, chord: np.ndarray) -> np.ndarray:
        if count[v] != 2:
            return chord
        way = x[edges[v]] - x[before[v]]
        return way * np.linalg.norm(chord) / np.linalg.norm(way)

    loops, left = [], set(edges)
    while left:
        loop, a = [], min(left)
        while a in left:
            left.remove(a)
            b = edges[a]
            chord = x[b] - x[a]
            cubic = [x[a], x[a] + tangent(a, chord) / 3, x[b] - tangent(b, chord) / 3, x[b]]
            loop.append(
                BSplineCurve([0] * 4 + [1] * 4, 3, cubic) if smooth else BSplineCurve([0, 0, 1, 1], 1, x[[a, b]])
            )
            a = b
        loops.append(loop)
    return Boundary(loops)


@st.composite
def deformations(draw, mp: MultiPatch):
    """One or two of a bend, bump, swirl, articulation and stretch of moderate strength, all one-to-one on the model."""
    width, height = np.subtract(*targets.box(mp)[::-1])
    # Beyond half the radius of curvature the inner side is squeezed too much.
    most = min(60.0, np.degrees(height / width))
    centre = st.tuples(st.floats(0, 1), st.floats(0, 1))
    kinds = {
        "bend": st.builds(lambda a: targets.bend(mp, a), st.floats(5, most) | st.floats(-most, -5)),
        "bump": st.builds(
            lambda c, r, a, w: targets.bump(mp, c, (r * np.cos(a), r * np.sin(a)), w),
            centre,
            st.floats(0, 0.25),
            st.floats(0, 2 * np.pi),
            st.floats(0.35, 1),
        ),
        "swirl": st.builds(lambda c, a, w: targets.swirl(mp, c, a, w), centre, st.floats(-35, 35), st.floats(0.35, 1)),
        "articulation": st.builds(
            lambda a, at: targets.articulation(mp, a, at, 0.8), st.floats(-most / 2, most / 2), st.floats(0.3, 0.7)
        ),
        "stretch": st.builds(targets.stretch, st.floats(0.7, 1.4), st.floats(0, 180)),
    }
    parts = [draw(kinds[name]) for name in draw(st.lists(st.sampled_from(sorted(kinds)), min_size=1, max_size=2))]

    def f(x: np.ndarray) -> np.ndarray:
        for part in parts:
            x = part(x)
        return x

    return f


__all__ = [
    "arrays",
    "boundaries",
    "curves",
    "deformations",
    "knot_vectors",
    "layouts",
    "multipatches",
    "outline",
    "patches",
]
