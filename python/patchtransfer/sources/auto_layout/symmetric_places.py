"""Boundary vertices where an outline's symmetries want them: what then slides keeps the symmetry."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...geometry.outline import Outline
from .assembly import AbstractLayout
from .symmetry import Isometry, layout_symmetry

__all__ = ["symmetric_places"]

#: Largest distance of a boundary vertex from the image of another, relative to the diameter: the T-mesh of a symmetric
#: outline has such unsymmetric joints where the outline is smooth.
NEAR_VERTEX = 0.1


def symmetric_places(
    layout: AbstractLayout, outlines: Sequence[Outline], isometries: Sequence[Isometry]
) -> AbstractLayout:
    """A layout with its vertices on loops without corners moved to the mean of their images.

    Between corners the T-mesh knows better where joints belong than a mean with images that are near.

    Parameters
    ----------
    layout : AbstractLayout
    outlines : sequence of Outline
    isometries : sequence of Isometry
        Of the outline, without the identity; those that the layout does not share are passed over.
    """
    diameter = max(outline.diameter for outline in outlines)
    vertices, loops = layout.boundary_vertices, layout.boundary_loop
    places = np.array([outlines[k].point(s) for k, s in zip(loops, layout.boundary_s, strict=True)])
    sums, count = places.copy(), 1
    for isometry in isometries:
        image = layout_symmetry(layout.quads, vertices, places, isometry, diameter, NEAR_VERTEX)
        if image is None:
            continue
        # Boundary vertices are 0, 1, ...
        sums[image[vertices]] += isometry(places)
        count += 1
    if count == 1:
        return layout
    s = layout.boundary_s.copy()
    for i in np.flatnonzero(~np.isin(loops, loops[layout.corner])):
        s[i] = outlines[loops[i]].nearest(sums[i : i + 1] / count)[0][0]
    if any(_order(s[loops == k]) != _order(layout.boundary_s[loops == k]) for k in range(len(outlines))):
        return layout
    points = layout.points.copy()
    points[vertices] = [outlines[k].point(x) for k, x in zip(loops, s, strict=True)]
    return replace(layout, boundary_s=s, points=points)


def _order(s: np.ndarray) -> list[int]:
    """Which comes after which around a loop, from number 0 on."""
    order = np.argsort(s)
    return [int(i) for i in np.roll(order, -int(np.flatnonzero(order == 0)[0]))]
