"""What corners of two boundaries demand of every map between them: lower bounds of the largest dilatation.

At a joint of the boundary let θ and θ' be the interior angles, and c the factor by which the speed of the
correspondence changes there. Every quasiconformal map has at least the distance of iθ from log c + iθ' in the
hyperbolic plane: in the logarithm of the distance from the corner both domains are strips there, of heights θ and θ',
and the best map of strips with these boundary values is affine. A map that is differentiable at a corner has the
derivative that the two sides prescribe, and at least the distance of the complex ratios of their tangents.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from ..geometry.multipatch import MultiPatch
from ..numeric.arrays import FloatArray

__all__ = ["corner_dilatations"]

#: Angles and speeds are read from the boundary curves in floating point: bounds are less than their values by this.
ROUNDING = 1e-9
#: Angles nearer to 0 or a full turn are cusps, and nearer to straight no corner of one patch: nothing is said there.
CUSP, STRAIGHT = 1e-6, 1e-3


def corner_dilatations(a: MultiPatch, b: MultiPatch) -> tuple[float, float]:
    """Lower bounds of max log D: of all quasiconformal maps, and of maps differentiable at single-patch corners.

    Parameters
    ----------
    a, b : MultiPatch
        Of one layout in one spline space; the boundaries correspond by their parameters.
    """
    every = smooth = 0.0
    for (s_in, s_out), (t_in, t_out), single in _joints(a, b):
        if 0.0 in (abs(s_in), abs(s_out), abs(t_in), abs(t_out)):
            continue
        # The side that comes in, seen from the corner, over the one that goes out.
        s, t = -s_in / s_out, -t_in / t_out
        theta, other = (math.atan2(z.imag, z.real) % (2 * math.pi) for z in (s, t))
        if not all(CUSP < angle < 2 * math.pi - CUSP for angle in (theta, other)):
            continue
        change = math.log(abs(t)) - math.log(abs(s))
        every = max(every, _acosh_above_one(((theta - other) ** 2 + change**2) / (2 * theta * other)))
        if single and max(theta, other) < math.pi - STRAIGHT:
            smooth = max(smooth, _acosh_above_one(abs(s - t) ** 2 / (2 * s.imag * t.imag)))
    return max(every - ROUNDING, 0.0), max(smooth - ROUNDING, 0.0)


def _acosh_above_one(x: float) -> float:
    """Arcosh of 1 + x, without loss where x is small."""
    return math.log1p(x + math.sqrt(x * (x + 2)))


Legs = tuple[complex, complex]


def _joints(a: MultiPatch, b: MultiPatch) -> Iterator[tuple[Legs, Legs, bool]]:
    """Tangents into and out of every joint of the boundary, in both models, and whether one patch fills it."""
    valence = {vertex.point: vertex.valence for vertex in a.vertices}
    for loop in a.loops:
        legs = []
        for model in (a, b):
            curves = [side.curve(model.patches) for side in loop]
            legs.append([(_complex(c(c.domain[0], 1)), _complex(c(c.domain[1], 1))) for c in curves])
        for i, side in enumerate(loop):
            point = int(side.points(a.topology.points[side.patch])[0])
            (s_in, s_out), (t_in, t_out) = ((ends[i - 1][1], ends[i][0]) for ends in legs)
            yield (s_in, s_out), (t_in, t_out), valence[point] == 1


def _complex(tangent: FloatArray) -> complex:
    x, y = np.ravel(tangent).tolist()
    return complex(x, y)
