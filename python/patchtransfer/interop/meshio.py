"""meshio, and what takes its meshes (scikit-fem): quadrilaterals sampled in every knot span, with their boundary."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import InputError
from ..geometry.basis import knot_spans
from ..geometry.combinatorics import identify
from ..geometry.multipatch import MultiPatch
from ..geometry.patch import Patch
from ..libraries import library
from ..numeric.arrays import FloatArray, IntArray

__all__ = ["to_meshio"]


def to_meshio(mp: MultiPatch, samples: int) -> Any:
    """See `MultiPatch.to_meshio`."""
    meshio = library("meshio", user="to_meshio")
    if samples < 1:
        raise InputError(f"samples = {samples}: a knot span is cut into 1 part or more")
    grids = [_grid(patch, samples) for patch in mp]
    numbers, count = identify([grid.shape[:2] for grid in grids], mp.interfaces)
    points = np.zeros((count, 3))
    for grid, own in zip(grids, numbers, strict=True):
        points[own, :2] = grid
    quads = [_quads(own, sign < 0) for own, sign in zip(numbers, mp.topology.orientation, strict=True)]
    # The boundary, and what is labelled inside.
    sides = list(dict.fromkeys([*mp.boundaries, *(named for where in mp.sides.values() for named in where)]))
    chains = [mp.topology.directed_side(k, side).points(numbers[k]) for k, side in sides]
    lines = [np.column_stack([chain[:-1], chain[1:]]) for chain in chains]
    starts = np.cumsum([0, *map(len, lines)])
    of_side = {side: np.arange(a, b) for side, a, b in zip(sides, starts[:-1], starts[1:], strict=True)}
    none = np.empty(0, np.int64)
    owners = np.repeat(np.arange(len(mp)), [len(cells) for cells in quads])
    line_owners = np.repeat(np.array([k for k, _ in sides], np.int64), [len(cells) for cells in lines])
    return meshio.Mesh(
        points,
        [("quad", np.concatenate(quads)), ("line", np.concatenate([np.empty((0, 2), np.int64), *lines]))],
        cell_data={"patch": [owners, line_owners]},
        cell_sets={
            name: [none, np.concatenate([none, *(of_side[side] for side in where)])] for name, where in mp.sides.items()
        },
    )


def _grid(patch: Patch, samples: int) -> FloatArray:
    """Points (m, n, 2) of a patch at `samples` parameters a knot span and direction, and at the ends."""
    u, v = (_parameters(knots, samples) for knots in patch.knots)
    return patch.grid(u, v)


def _parameters(knots: FloatArray, samples: int) -> FloatArray:
    breaks = knot_spans(knots)
    return np.append(np.linspace(breaks[:-1], breaks[1:], samples, endpoint=False, axis=1).ravel(), breaks[-1])


def _quads(numbers: IntArray, mirrored: bool) -> IntArray:
    """Cells (n, 4) of a grid of points, counter-clockwise."""
    corners = [numbers[:-1, :-1], numbers[1:, :-1], numbers[1:, 1:], numbers[:-1, 1:]]
    return np.stack(corners[::-1] if mirrored else corners, axis=-1).reshape(-1, 4)
