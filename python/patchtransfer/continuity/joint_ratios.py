"""Chords that end at a smooth joint of two patches on the boundary take the ratio of the two legs there.

Legs are the first control points of the boundary curves on either side. They are given, so that the C1 row at the joint
holds with one ratio only: with that of the legs, where they lie on one line. So the fit is asked for legs in the ratio
of the chord, and where it has others the chord takes theirs, if they are not too far off.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..geometry.topology import Topology
from ..numeric.arrays import FloatArray
from .interfaces import ControlRows

__all__ = ["JointRatios", "LegWish"]

#: Sine of the angle between legs on one line: what rounding leaves of it. Measured as C1 is to 1e-8.
STRAIGHT = 1e-10
#: A ratio this many times that of the speeds bends the map along the whole chord for the sake of its last span. With
#: 1.5 the wrench, split in two, has 0.03 more of its interfaces C1, but a smallest scaled Jacobian of 0.27, not 0.32;
#: with 1.12 the rabbit has 0.03 less, and nothing gains.
FARTHEST = 1.25


class LegWish(NamedTuple):
    """Another length of both legs at a joint.

    Attributes
    ----------
    left, right, joint : int
        The shared control points L, R and s.
    factor : float
        Of the right leg; the left one is divided by it.
    """

    left: int
    right: int
    joint: int
    factor: float


class JointRatios:
    """The joints of two patches on the boundary where chords end.

    Parameters
    ----------
    topology : Topology
    control : tuple of ControlRows
        Of `control_rows`; none, if ratios are to stay what they are.
    """

    def __init__(self, topology: Topology, control: tuple[ControlRows, ...]) -> None:
        joints = {v.point for v in topology.vertices if not v.interior and v.valence == 2}
        chords = topology.directed_chords if control else ()
        found = [
            (k, i, e, 1.0 if forward else -1.0)
            for k, chord in enumerate(chords)
            for i, forward in chord
            for e in (0, -1)
            if int(control[i].curve[e]) in joints and control[i].lowest_degree > 1
        ]
        self._chord = np.array([k for k, *_ in found], int)
        self._interface = np.array([i for _, i, _, _ in found], int)
        self._sense = np.array([sense for *_, sense in found])
        points = [[control[i].left[e], control[i].right[e], control[i].curve[e]] for _, i, e, _ in found]
        self._points = np.array(points, int).reshape(-1, 3)
        self._scales = np.array([control[i].right_scale / control[i].left_scale for _, i, _, _ in found])
        self._members = [
            (np.array([i for i, _ in chord], int), np.array([1.0 if forward else -1.0 for _, forward in chord]))
            for chord in chords
        ]

    def __len__(self) -> int:
        return len(self._chord)

    def wishes(self, ratios: FloatArray, points: FloatArray) -> list[LegWish]:
        """What would give the legs at all joints the ratios of the chords that end there; parameters as of a call."""
        straight, given = self._given(points)
        factors = np.sqrt(ratios[self._interface] / given)
        asked = np.flatnonzero(straight).tolist()
        places, by = self._points[asked].tolist(), factors[asked].tolist()
        return [LegWish(left, right, joint, f) for (left, right, joint), f in zip(places, by, strict=True)]

    def _given(self, points: FloatArray) -> tuple[NDArray[np.bool_], FloatArray]:
        """Where legs lie on one line, and ω_L / ω_R by the legs there."""
        left, right = (points[self._points[:, k]] - points[self._points[:, 2]] for k in (0, 1))
        lengths = np.hypot(*left.T), np.hypot(*right.T)
        turn = np.abs(left[:, 0] * right[:, 1] - left[:, 1] * right[:, 0])
        straight = (turn < STRAIGHT * lengths[0] * lengths[1]) & ((left * right).sum(axis=1) < 0)
        return straight, self._scales * np.divide(lengths[1], lengths[0], out=np.ones(len(straight)), where=straight)

    def __call__(self, ratios: FloatArray, points: FloatArray) -> FloatArray:
        """Ratios ω_L / ω_R of all interfaces: those of the speeds, or of legs.

        Where a chord ends at two smooth joints of different ratios, it takes the one nearer to that of the speeds.

        Parameters
        ----------
        ratios : (n_interfaces,) array
            Of `chord_ratios`.
        points : (n_points, 2) array
            A map on the boundary whose legs count.
        """
        straight, given = self._given(points)
        away = self._sense * np.log(given / ratios[self._interface])
        chosen = np.full(len(self._members), np.inf)
        for k, by in zip(self._chord[straight].tolist(), away[straight].tolist(), strict=True):
            chosen[k] = by if abs(by) < abs(chosen[k]) else chosen[k]
        ratios = ratios.copy()
        for k in np.flatnonzero(np.abs(chosen) < np.log(FARTHEST)).tolist():
            members, sense = self._members[k]
            ratios[members] *= np.exp(sense * chosen[k])
        return ratios
