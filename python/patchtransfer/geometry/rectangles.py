"""Rectangles as large as patches: what distortion is measured against where orthogonal, even nets are wanted."""

from __future__ import annotations

import numpy as np

from .basis import greville, knot_spans
from .multipatch import MultiPatch
from .patch import Patch

__all__ = ["rectangle", "rectangles", "upright"]


def rectangles(multipatch: MultiPatch) -> list[Patch]:
    """For every patch a rectangle with its mean side lengths, on its knots and with its orientation."""
    pairs = zip(multipatch.patches, multipatch.topology.orientation, strict=True)
    return [rectangle(patch, int(sign)) for patch, sign in pairs]


def rectangle(patch: Patch, sign: int) -> Patch:
    """A rectangle with a patch's mean side lengths, on its knots, left-handed for the sign -1."""
    c = patch.control_points
    width, height = (np.linalg.norm(np.diff(c, axis=a), axis=2).sum(axis=a).mean() for a in (0, 1))
    return upright(patch, float(width), sign * float(height))


def upright(patch: Patch, width: float, height: float) -> Patch:
    """A rectangle in a patch's space, at even speed but for its weights; left-handed where one length is negative."""
    grid = np.meshgrid(*(greville(k, p) for k, p in zip(patch.knots, patch.degrees, strict=True)), indexing="ij")
    lengths = np.array([float(np.ptp(knot_spans(k))) for k in patch.knots])
    return patch.with_control_points(np.stack(grid, axis=2) * ([width, height] / lengths))
