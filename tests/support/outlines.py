"""Hypothesis generators of valid outlines: star polygons, unions of cells, blobs with holes, rounded polygons."""

from __future__ import annotations

import numpy as np
from hypothesis import assume
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline, make_interp_spline

import patchtransfer as pt
from shapes import polygon


def smooth_loop(points, pieces=1) -> list[pt.BSplineCurve]:
    """Closed cubic spline through points, smooth everywhere, cut into pieces."""
    points = np.asarray(points, float)
    t = np.linspace(0, 1, len(points) + 1)
    spline = CubicSpline(t, np.concatenate([points, points[:1]]), bc_type="periodic")
    curves = []
    for k in range(pieces):
        at = np.linspace(k / pieces, (k + 1) / pieces, 4 * len(points) // pieces + 4)
        cubic = make_interp_spline(at, spline(at), k=3)
        control = cubic.c.copy()
        if curves:
            control[0] = curves[-1].end
        if k == pieces - 1:
            control[-1] = curves[0].start if curves else control[0]
        curves.append(pt.BSplineCurve(cubic.t, 3, control))
    return curves


@st.composite
def star_polygons(draw):
    """4 to 12 corners of angles from some degrees to nearly 360, seen from one point."""
    n = draw(st.integers(4, 12))
    share = np.array(draw(st.lists(st.floats(1.0, 2.5), min_size=n, max_size=n)))
    angle = draw(st.floats(0, 6.28)) + 2 * np.pi * np.cumsum(share) / share.sum()
    radius = np.array(draw(st.lists(st.floats(0.3, 1.2), min_size=n, max_size=n)))
    return pt.Boundary([polygon(radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))])


@st.composite
def cell_unions(draw):
    """Cells of a grid, joined by edges, with or without holes; many walls lie on common lines."""
    cells = {(0, 0)}
    for _ in range(draw(st.integers(1, 14))):
        i, j = draw(st.sampled_from(sorted(cells)))
        di, dj = draw(st.sampled_from([(1, 0), (-1, 0), (0, 1), (0, -1)]))
        cells.add((i + di, j + dj))
    after = {}
    for i, j in cells:
        around = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
        for k, (di, dj) in enumerate([(0, -1), (1, 0), (0, 1), (-1, 0)]):
            if (i + di, j + dj) not in cells:
                # Loops that touch in a point bound no valid outline.
                assume(around[k] not in after)
                after[around[k]] = around[(k + 1) % 4]
    loops = []
    while after:
        loop = [min(after)]
        while (following := after.pop(loop[-1])) != loop[0]:
            loop.append(following)
        x = np.array(loop, float)
        way = np.roll(x, -1, axis=0) - x
        loops.append(polygon(x[(way != np.roll(way, 1, axis=0)).any(axis=1)]))
    return pt.Boundary(loops)


@st.composite
def blobs(draw):
    """A smooth wavy loop with up to three round or square holes."""
    waves, depth = draw(st.integers(2, 6)), draw(st.floats(0.0, 0.25))
    angle = np.linspace(0, 2 * np.pi, 8 * waves, endpoint=False)
    radius = 1 + depth * np.cos(waves * angle + draw(st.floats(0, 6.28)))
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    loops = [smooth_loop(radius[:, None] * circle * [draw(st.floats(1.0, 1.5)), 1.0], draw(st.integers(1, 3)))]
    for k in range(draw(st.integers(0, 3))):
        at = 0.42 * np.array([np.cos(2 * np.pi * k / 3), np.sin(2 * np.pi * k / 3)])
        size, turn, square = draw(st.floats(0.05, 0.25)), draw(st.floats(0, 6.28)), draw(st.booleans())
        around = turn + np.linspace(0, 2 * np.pi, 4 if square else 16, endpoint=False)
        points = at + size * np.column_stack([np.cos(around), np.sin(around)])
        loops.append(polygon(points[::-1]) if square else smooth_loop(points))
    return pt.Boundary(loops)


@st.composite
def rounded_polygons(draw):
    """A convex or star-shaped loop of arcs between corners: one to four corners, smooth in between."""
    corners = draw(st.integers(1, 4))
    n = 5
    count = corners * n
    angle = 2 * np.pi * np.arange(count + 1) / count
    radius = np.array(draw(st.lists(st.floats(0.8, 1.15), min_size=count, max_size=count)))
    radius[::n] *= draw(st.floats(1.0, 1.4))
    x = np.append(radius, radius[0])[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    x[-1] = x[0]
    curves = []
    for k in range(corners):
        cubic = make_interp_spline(np.linspace(0, 1, n + 1), x[k * n : k * n + n + 1], k=3)
        control = cubic.c.copy()
        control[0], control[-1] = x[k * n], x[k * n + n]
        curves.append(pt.BSplineCurve(cubic.t, 3, control))
    return pt.Boundary([curves])


outlines = st.one_of(star_polygons(), cell_unions(), blobs(), rounded_polygons())
