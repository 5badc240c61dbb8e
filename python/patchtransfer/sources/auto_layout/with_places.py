"""From an abstract layout to the one that `from_layout` takes."""

from __future__ import annotations

from collections.abc import Sequence

from ...geometry.outline import Outline
from ..quad_layout import QuadLayout
from .assembly import AbstractLayout

__all__ = ["with_places"]


def with_places(layout: AbstractLayout, outlines: Sequence[Outline]) -> QuadLayout:
    """A quad layout whose boundary vertices are assigned their points on the user's outlines."""
    rows = zip(layout.boundary_vertices, layout.boundary_loop, layout.boundary_s, strict=True)
    places = {int(v): [float(x) for x in outlines[k].point(s)] for v, k, s in rows}
    return QuadLayout.abstract(layout.quads, layout.points, places)
