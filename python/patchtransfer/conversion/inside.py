"""Control points inside a patch whose sides are given: the map that it was, moved along with its sides."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from ..geometry.basis import greville, knot_spans, weights_agree
from ..geometry.patch import Patch
from ..geometry.sides import Side
from ..numeric.arrays import FloatArray
from .arcs import projected, sampled
from .spaces import Space, refined

__all__ = ["is_polynomial", "polynomial_patch"]

#: Samples of a span in each direction that a patch is projected from.
SAMPLES = 8


def is_polynomial(patch: Patch) -> bool:
    """Whether a patch is a polynomial map: without weights, or with ones that differ by rounding."""
    return patch.weights is None or weights_agree(patch.weights)


def polynomial_patch(
    patch: Patch, spaces: tuple[Space, Space], own: tuple[Space, Space], sides: Mapping[Side, FloatArray]
) -> Patch:
    """A patch on other spaces with the given control points (n, 2) of its sides, in the senses of the patch.

    Polynomial patches keep their map. Others are projected, by least squares in one direction after the other; by how
    much the given sides differ from those of the projection is blended into the inside as in a Coons patch.
    """
    breaks = [knot_spans(knots) for knots in patch.knots]
    knots = [space.knots(at) for space, at in zip(spaces, breaks, strict=True)]
    degrees = (spaces[0].degree, spaces[1].degree)
    if is_polynomial(patch):
        points = _along(patch.control_points, lambda c, axis: refined(patch.knots[axis], c, own[axis], spaces[axis]))
    else:
        at = [sampled(k, SAMPLES) for k in knots]
        points = _along(patch.grid(at[0], at[1]), lambda c, axis: projected(c, at[axis], knots[axis], degrees[axis]))
        off = {side: sides[side] - side.of(points) for side in Side}
        points = points + _blended(off, [_unit(greville(k, p)) for k, p in zip(knots, degrees, strict=True)])
    points = np.array(points)
    for side in Side:
        side.of(points)[:] = sides[side]
    return Patch(knots, degrees, points)


def _along(values: FloatArray, operation: Callable[[FloatArray, int], FloatArray]) -> FloatArray:
    """An array (m, n, 2) after an operation on its rows, in one direction after the other."""
    for axis in (0, 1):
        values = np.moveaxis(operation(np.moveaxis(values, axis, 0), axis), 0, axis)
    return values


def _unit(t: FloatArray) -> FloatArray:
    return np.asarray((t - t[0]) / (t[-1] - t[0]))


def _blended(sides: Mapping[Side, FloatArray], at: list[FloatArray]) -> FloatArray:
    """Coons' surface (m, n, 2) of four sides at the parameters (m,) and (n,) of [0, 1]."""
    u, v = at[0][:, None, None], at[1][:, None]
    west, east, south, north = (sides[side] for side in Side)
    ruled = (1 - u) * west + u * east + (1 - v) * south[:, None] + v * north[:, None]
    bottom, top = (1 - u) * south[0] + u * south[-1], (1 - u) * north[0] + u * north[-1]
    return np.asarray(ruled - (1 - v) * bottom - v * top)
