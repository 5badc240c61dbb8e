"""Corners of a target that no joint of the source takes, and where on the source's boundary they belong."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..geometry.outline import Outline
from ..geometry.slivers import drawn_corners
from .corners import CORNER_SNAP
from .register import LoopRegistration, Registration
from .sampled_boundary import cyclic_gap, image_of

__all__ = ["LackingJoint", "lacking_joints"]

#: Samples of a curve that its arc length is inverted between.
SAMPLES = 257


class LackingJoint(NamedTuple):
    """A corner of the target without a joint.

    Attributes
    ----------
    loop, side : int
        Loop and curve of the source that the corner lies on.
    parameter : float
        Of that curve, where the correspondence has the corner.
    at : float
        Arc length on the target's loop.
    turn : float
        Turning angle of the target there, radians.
    point : tuple of float
    """

    loop: int
    side: int
    parameter: float
    at: float
    turn: float
    point: tuple[float, float]


def lacking_joints(registration: Registration, tolerance: float) -> list[LackingJoint]:
    """Corners of the target that no joint takes, loop by loop, in the order of the source's boundary.

    Parameters
    ----------
    registration : Registration
    tolerance : float
        Corners nearer than this part of the target's diameter to a joint, or to a sharper one of them, count as taken:
        rounding them off costs no more.
    """
    found: list[LackingJoint] = []
    diameter = registration.loops[0].target.diameter
    for k, loop in enumerate(registration.loops):
        at, turn = drawn_corners(loop.target)
        within = min(CORNER_SNAP * loop.target.length, tolerance * diameter)
        taken = np.mod(loop.joints[:-1], loop.target.length)
        corners = []
        for i in np.argsort(-abs(turn), kind="stable"):
            if cyclic_gap(at[i : i + 1], taken, loop.target.length)[0] > within:
                taken = np.append(taken, at[i])
                corners.append(_placed(loop, k, float(at[i]), float(turn[i])))
        found += sorted(corners, key=lambda corner: (corner.side, corner.parameter))
    return found


def _placed(loop: LoopRegistration, k: int, at: float, turn: float) -> LackingJoint:
    s = float(np.mod(image_of(loop.anchors[:, ::-1], np.array([at]))[0], loop.source.length))
    side = int(np.clip(np.searchsorted(loop.source.joints, s, side="right") - 1, 0, len(loop.source.curves) - 1))
    x, y = loop.target.point(at).tolist()
    return LackingJoint(k, side, _parameter(loop.source, side, s), at, turn, (x, y))


def _parameter(outline: Outline, curve: int, s: float) -> float:
    """Parameter of a curve at an arc length of its outline."""
    t = np.linspace(*outline.curves[curve].domain, SAMPLES)
    return float(np.interp(s, outline.arc_length(curve, t), t))
