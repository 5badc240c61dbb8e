"""Straight corners inside a source, opened: what distortion is measured against where its own corners fold.

A patch that fills a straight angle at a vertex inside (the disc in a square) is singular there, so that its corner is
left out of the energy, and nothing keeps it from bending further. Against a map of the same patches whose corner is
open there is a barrier.
"""

from __future__ import annotations

import numpy as np

from ..geometry.areas import polygon_area
from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..geometry.rectangles import upright
from ..geometry.sides import CORNERS
from ..proof.certificate import certify
from .optimizer import SplineOptimizer, degenerate_corners

__all__ = ["OPENED", "inner_straight_corners", "with_open_corners"]

OPENED = "corners where a patch fills a straight angle inside: distortion is measured with these corners open"
"""What the log says of such maps."""

#: How far the source goes towards the map whose corners are open. Half of the way leaves corners of a disc at some 150
#: degrees (smallest scaled Jacobian .4; a tenth .07, all of it .7); elsewhere the map remains the source's.
PARTS = (0.5, 0.25, 0.1, 1.0)


def inner_straight_corners(source: MultiPatch) -> list[tuple[int, int]]:
    """Corners (patch, corner) inside the domain where a patch is singular."""
    topology = source.topology
    on_boundary = np.zeros(topology.n_points, bool)
    on_boundary[topology.boundary_points] = True
    return [
        (k, corner)
        for k, corner in degenerate_corners(source.patches)
        if not on_boundary[topology.points[k][CORNERS[corner]]]
    ]


def with_open_corners(source: MultiPatch) -> list[Patch] | None:
    """The source's patches on its own boundary, with all corners inside open; None if there are none, or in vain.

    Between the source and the map of least distortion of squares, the first that is certified.
    """
    inner = inner_straight_corners(source)
    if not inner:
        return None
    topology = source.topology
    squares = [_square(patch) for patch in source.patches]
    others = [corner for corner in degenerate_corners(source.patches) if corner not in inner]
    start = topology.coordinates
    found = SplineOptimizer(topology, squares, excluded_corners=others).minimise(start)
    if found.min_determinant <= 0:
        return None
    for part in PARTS:
        mp = source.with_shared_points((1 - part) * start + part * found.points)
        if certify(mp).injective and not inner_straight_corners(mp):
            return list(mp.patches)
    return None


def _square(patch: Patch) -> Patch:
    """A square of the area and the sense of the patch's control net, in its own space."""
    net = patch.control_points
    area = polygon_area(np.concatenate([net[:-1, 0], net[-1, :-1], net[:0:-1, -1], net[0, :0:-1]]))
    side = float(np.sqrt(abs(area)))
    return upright(patch, side, float(np.copysign(side, area)))
