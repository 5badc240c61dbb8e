"""The last resort: a layout of any valid outline, from a coarse polygon cut into convex pieces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...geometry.outline import Outline
from .assembly import AbstractLayout
from .coarse_polygon import CoarsePolygon, coarse_polygon
from .convex_pieces import convex_pieces
from .midpoints import PlacedQuads, quads_of_pieces

__all__ = ["convex_layout"]


def convex_layout(outlines: Sequence[Outline]) -> AbstractLayout:
    """A layout that needs nothing but a valid outline; it has more patches than need be.

    Parameters
    ----------
    outlines : sequence of Outline
        Loops in any order and sense, simple, disjoint, all but one inside that one.

    Returns
    -------
    AbstractLayout
        Two quads or more at smooth vertices and wherever the outline's angle is more than 145 degrees.

    Raises
    ------
    NoLayoutError
        On outlines that touch or cross themselves.
    """
    polygon = coarse_polygon(outlines)
    found = quads_of_pieces(polygon, convex_pieces(polygon))
    return _abstract(polygon, found)


def _abstract(polygon: CoarsePolygon, found: PlacedQuads) -> AbstractLayout:
    on = np.flatnonzero(found.loop >= 0)
    s = np.empty(len(on))
    for k, loop in enumerate(polygon.loops):
        of = found.loop[on] == k
        s[of] = loop.own(found.t[on[of]])
    values = (found.quads, on, found.loop[on], s, found.corner[on], found.points, np.bincount(found.quads.ravel()))
    for array in values:
        array.flags.writeable = False
    return AbstractLayout(*values)
