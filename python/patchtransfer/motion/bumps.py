"""Bumps along a loop of curves: how its control points follow a motion that fades with the length along the loop."""

from __future__ import annotations

import numpy as np

from ..fitting.fit import SMOOTH_ANGLE
from ..geometry.basis import greville
from ..geometry.outline import Outline
from ..numeric.arrays import FloatArray

__all__ = ["LoopBumps"]


class LoopBumps:
    """Unit bumps along a loop.

    Parameters
    ----------
    outline : Outline
    """

    def __init__(self, outline: Outline) -> None:
        self.outline = outline
        self._smooth = np.abs(outline.turn(outline.joints[:-1])) < SMOOTH_ANGLE

    def of_curve(self, k: int, centres: FloatArray, radius: float) -> FloatArray:
        """Displacement (n, r) of the control points of curve k by a unit bump at each of the centres."""
        c = self.outline.curves[k]
        s = self.outline.arc_length(k, greville(c.knots, c.degree))
        bumps, _ = self._bump(s, centres, radius)
        # The leg of a straight line is its other end, which is a joint itself.
        legs = ((k, 0, 1), (k + 1, -1, -2)) if len(bumps) > 2 else ()
        for joint, end, inner in legs:
            if self._smooth[joint % len(self.outline.curves)]:
                value, slope = self._bump(s[[end]], centres, radius)
                leg = float(np.linalg.norm(c.control_points[inner] - c.control_points[end]))
                bumps[inner] = value[0] + np.copysign(leg, inner + 1.5) * slope[0]
        return bumps

    def _bump(self, s: FloatArray, centres: FloatArray, radius: float) -> tuple[FloatArray, FloatArray]:
        """Wendland's function (1 - d)⁴ (4 d + 1) of the distance along the loop over the radius, and its slope."""
        length = self.outline.length
        away = (s[:, None] - centres + length / 2) % length - length / 2
        d = np.minimum(np.abs(away) / radius, 1.0)
        return (1 - d) ** 4 * (4 * d + 1), -20 * d * (1 - d) ** 3 * np.sign(away) / radius
