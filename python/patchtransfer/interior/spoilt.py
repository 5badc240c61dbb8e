"""Extraordinary vertices whose second rows cost too much: where patches are spoilt, or interfaces lost their rows."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from ..geometry.basis import parts_of_spans
from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch

__all__ = ["SPOILT", "spoilt_vertices"]

#: A choice of rows costs too much when the smallest determinant falls below this fraction of the reference's.
SPOILT = 0.5
#: Parameters per knot span and direction at which determinants of patches are compared.
SAMPLES = 4


def spoilt_vertices(
    before: MultiPatch, after: MultiPatch, without: Collection[int] = (), share: float = SPOILT
) -> frozenset[int]:
    """Shared control points of the extraordinary vertices that have to do with what went wrong under rows.

    Parameters
    ----------
    before, after : MultiPatch
        Without rows and under them.
    without : collection of int
        Interfaces that lost their rows.
    share : float, default 0.5
        A patch is spoilt where its smallest scaled Jacobian fell below this part of the smallest there was.

    Returns
    -------
    frozenset of int
        At spoilt patches, and at the interfaces' ends.
    """
    least = share * min(_smallest(patch) for patch in before.patches)
    fell = {k for k, patch in enumerate(after.patches) if _smallest(patch) < least}
    extraordinary = [vertex for vertex in before.topology.vertices if vertex.extraordinary]
    found = {vertex.point for vertex in extraordinary if any(patch in fell for patch, _ in vertex.corners)}
    for index in without:
        directed = before.topology.directed_interfaces[index]
        along = directed.points(before.topology.points[directed.patch])
        found |= {int(along[0]), int(along[-1])}
    return frozenset(found & {vertex.point for vertex in extraordinary})


def _smallest(patch: Patch) -> float:
    """Smallest scaled Jacobian of a patch of either handedness over a grid of samples, collapsed sides aside."""
    u, v = (parts_of_spans(knots, SAMPLES) for knots in patch.knots)
    along, across = patch.grid(u, v, 1, 0), patch.grid(u, v, 0, 1)
    lengths = np.hypot(along[..., 0], along[..., 1]) * np.hypot(across[..., 0], across[..., 1])
    sines = along[..., 0] * across[..., 1] - along[..., 1] * across[..., 0]
    turn = np.sign(sines.sum())
    return float(np.divide(turn * sines, lengths, out=np.ones_like(sines), where=lengths > 0).min())
