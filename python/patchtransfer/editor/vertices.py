"""Inner vertices of the layout, moved by hand: what a transfer gives, with some of its vertices elsewhere.

A vertex is a control point of every patch around it. Those that were moved are given like the boundary, and the others
have the least distortion again, under the transfer's own continuity rows.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from ..geometry.multipatch import MultiPatch
from ..gradients.filled import Filled
from ..gradients.frozen import Frozen
from ..measure.bounds import can_be_proved
from ..measure.quality import quality
from ..numeric.arrays import IntArray
from ..pipeline.result import NotCertifiedError, TransferResult
from ..proof.certificate import Certificate

__all__ = ["Base", "VertexAddress", "inner_vertices", "no_place", "with_vertices"]

#: Parts of the way that a far move takes, where it cannot be made at once.
PARTS = (0.25, 0.5, 0.75, 1.0)


class VertexAddress(NamedTuple):
    """A vertex by the first patch around it, and its corner there: 0 to 3 = (0,0), (1,0), (0,1), (1,1)."""

    patch: int
    corner: int

    def __str__(self) -> str:
        return f"at corner {self.corner} of patch {self.patch}"


Places = Mapping[VertexAddress, tuple[float, float]]


def inner_vertices(mp: MultiPatch) -> dict[VertexAddress, int]:
    """Inner vertices of a layout, each with its number among the shared points."""
    return {VertexAddress(*min(vertex.corners)): vertex.point for vertex in mp.topology.vertices if vertex.interior}


class Base:
    """A transfer as it is without moved vertices, which it is the start of."""

    def __init__(self, result: TransferResult) -> None:
        self.result = result

    @cached_property
    def frozen(self) -> Frozen:
        """The map as a function of its boundary, and of vertices that are `held`; raises where there is none."""
        return self.result.freeze()

    def held(self, vertices: list[VertexAddress]) -> Frozen:
        """The map with these vertices held, in this order.

        Raises
        ------
        InputError
            When there is no such vertex inside, or it cannot be moved.
        """
        return self.frozen.pinned(self._numbers(vertices))

    def moved(self, places: Places, near: Filled | None = None) -> Filled:
        """The map with vertices at these places, from one `near` if there is one.

        Raises
        ------
        TransferError
            When the transfer is none to start from, or a vertex cannot be moved.
        """
        frozen = self.held(list(places))
        begin, end = frozen.points[frozen.pins], np.array(list(places.values()))
        filled = frozen.fill(frozen.boundary, near=near, pins=end)
        if filled.certificate.injective:
            return filled
        near = None
        for part in PARTS:
            near = frozen.fill(frozen.boundary, near=near, pins=begin + part * (end - begin))
        return near if near is not None and near.certificate.injective else filled

    def frozen_at(self, places: Places, filled: Filled) -> Frozen:
        """The map as `moved` gave it as a function of its boundary, its vertices held."""
        frozen = self.held(list(places))
        frozen.points = filled.points
        return frozen

    def _numbers(self, vertices: list[VertexAddress]) -> IntArray:
        known = inner_vertices(self.result.multipatch)
        for vertex in vertices:
            if vertex not in known:
                raise InputError(f"there is no inner layout vertex {vertex}")
        return np.array([known[vertex] for vertex in vertices], np.int64)


def no_place(certificate: Certificate) -> str:
    """Why there is no map with layout vertices where they are."""
    reasons = "; ".join(certificate.reasons[:2])
    return f"no map with layout vertices there ({reasons}): drag them back, or free them by a double click"


def with_vertices(base: Base, places: Places, near: Filled | None = None) -> tuple[TransferResult, Filled]:
    """A transfer's result with vertices elsewhere, with its own certificate and quality.

    Raises
    ------
    NotCertifiedError
        When there is no proved map with them there.
    TransferError
        When the transfer is none to start from, or a vertex cannot be moved.
    """
    filled = base.moved(places, near)
    if not filled.certificate.injective:
        raise NotCertifiedError(no_place(filled.certificate))
    before, mp = base.result, filled.multipatch
    metrics = quality(mp, exclude=base.frozen.excluded, proved=can_be_proved(mp))
    rows = before.rows
    if rows is not None and rows.space is not None:
        left = rows.space.residual(filled.points) / mp.diameter
        rows = replace(rows, residual=max(rows.residual, left))
    entries = [f"layout vertex {vertex}: moved to ({x:.6g}, {y:.6g})" for vertex, (x, y) in places.items()]
    result = replace(
        before,
        multipatch=mp,
        certificate=filled.certificate,
        quality=metrics,
        rows=rows,
        log=(*before.log, *entries),
        polish=None,
        _freeze=partial(base.frozen_at, places, filled),
    )
    return result, filled
