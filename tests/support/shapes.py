"""Small shapes that many tests are about: outlines of straight lines, the circle, single patches."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from patchtransfer import Boundary, BSplineCurve, Patch
from patchtransfer.geometry.basis import greville, reverse_knots

#: Knots of one linear span.
LINE = [0.0, 0.0, 1.0, 1.0]

#: Corners of the unit square, counter-clockwise.
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
SQUARE.flags.writeable = False


def polygon(corners) -> list[BSplineCurve]:
    """The closed loop through corners (n, 2), a line to each from the one before."""
    corners = np.asarray(corners, float)
    return [BSplineCurve(LINE, 1, [a, b]) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)]


def loop(corners) -> Boundary:
    """A polygon as a boundary without holes."""
    return Boundary([polygon(corners)])


def circle(radius: float = 1.0) -> BSplineCurve:
    """Nine-point NURBS circle."""
    ring = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0)]
    knots = [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4]
    return BSplineCurve(knots, 2, radius * np.array(ring, float), [1, 0.5**0.5] * 4 + [1])


def quad(a, b, c, d) -> Patch:
    """Bilinear patch with corners (0, 0), (1, 0), (1, 1), (0, 1) at a, b, c, d."""
    return Patch((LINE, LINE), (1, 1), [[a, d], [b, c]])


def identity(knots: Sequence, degrees: Sequence[int]) -> np.ndarray:
    """Control points (n, m, 2) with which a patch maps its parameters to themselves."""
    both = (greville(np.asarray(t, float), p) for t, p in zip(knots, degrees, strict=True))
    return np.stack(np.meshgrid(*both, indexing="ij"), axis=2)


def bicubic(seed: int, size: float = 0.08, weights: bool = False) -> Patch:
    """The unit square on three by three unequal spans, its control points moved at random by up to `size`."""
    rng = np.random.default_rng(seed)
    knots = np.r_[[0.0] * 4, 0.25, 0.6, [1.0] * 4]
    points = identity((knots, knots), (3, 3))
    points = points + size * rng.uniform(-1, 1, points.shape)
    return Patch((knots, knots), (3, 3), points, rng.uniform(0.7, 1.4, (6, 6)) if weights else None)


def cut(patch: Patch, axis: int, at: float) -> list[Patch]:
    """The two halves of a patch at a knot raised to full multiplicity."""
    p = patch.degrees[axis]
    knots = patch.knots[axis]
    patch = patch.insert_knots(axis, [at] * (p - np.count_nonzero(knots == at)))
    knots = patch.knots[axis]
    first = int(np.searchsorted(knots, at))
    halves = []
    for part, new in (
        (slice(None, first), np.append(knots[: first + p], at)),
        (slice(first - 1, None), np.insert(knots[first:], 0, at)),
    ):
        index = (part, slice(None)) if axis == 0 else (slice(None), part)
        all_knots = (new, patch.knots[1]) if axis == 0 else (patch.knots[0], new)
        weights = None if patch.weights is None else patch.weights[index]
        halves.append(Patch(all_knots, patch.degrees, patch.control_points[index], weights))
    return halves


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


def mirrored(patch: Patch) -> Patch:
    """The same patch with u and v exchanged: left-handed if it was right-handed."""
    return turned(patch, True, False, False)


def reparameterized(patch: Patch, how: int) -> Patch:
    """The same geometry; bits of `how`: u reversed, v reversed, u and v exchanged, the knots moved and stretched."""
    patch = turned(patch, bool(how & 4), bool(how & 1), bool(how & 2))
    if not how & 8:
        return patch
    return Patch([2.5 * k - 1 for k in patch.knots], patch.degrees, patch.control_points, patch.weights)
