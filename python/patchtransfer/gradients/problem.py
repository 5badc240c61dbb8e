"""What is held while the boundary moves: rows, corners and nodes left out, and the energy with its optimizers."""

from __future__ import annotations

import threading
from collections.abc import Collection
from copy import copy
from typing import TYPE_CHECKING

import numpy as np

from ..continuity.null_space import RowSpace, row_space
from ..errors import InputError, TransferError
from ..geometry.areas import enclosed_areas, sides_around
from ..interior.optimizer import Measure, SplineOptimizer, degenerate_corners
from ..interior.solver import InteriorSolver
from ..numeric.arrays import FloatArray, IntArray
from ..numeric.compressed import Compressed
from .boundary_area import BoundaryArea, patch_area

if TYPE_CHECKING:
    from scipy.sparse import csr_array

__all__ = ["Problem"]


class _Kept(threading.local):
    """What every thread has of its own: an optimizer, which owns its buffers, and whose map it is linearised at."""

    optimizer: SplineOptimizer | None = None
    owner: object = None


class Problem:
    """The energy on all maps that satisfy certain rows, on the source's patches.

    Parameters
    ----------
    solver : InteriorSolver
        Gives the source, and what its distortion is measured against.
    space : RowSpace or None
        The rows; None for none.
    excluded : collection of (patch, corner)
        Corners left out of the energy, besides those where the source is degenerate.
    measure : Measure

    Attributes
    ----------
    source : MultiPatch
    boundary_points : (n_b,) int array
        ``source.topology.boundary_points``.
    pins : (n_p,) int array
        Inner points that are given like those of the boundary; see `pinned`.
    area : BoundaryArea
    n_rows : int
        Continuity rows.
    """

    def __init__(
        self, solver: InteriorSolver, space: RowSpace | None, excluded: Collection[tuple[int, int]], measure: Measure
    ) -> None:
        self.source, self.measure = solver.source, measure
        self.boundary_points = self.source.topology.boundary_points
        self.area = BoundaryArea(self.source.topology)
        reference = solver.reference or self.source.patches
        self._reference = reference
        #: Points that the rows may move, the matrix from all points to them, and the basis of their displacements.
        self._rows: tuple[IntArray, csr_array | None, Compressed] | None = None
        if space is not None:
            self._rows = space.interior, space.particular, space.columns
        self._active = None if space is None else space.rows
        self.n_rows = 0 if space is None else len(space.rows)
        self.pins: IntArray = np.empty(0, np.int64)
        self._excluded = sorted({*excluded, *degenerate_corners(reference)})
        if self.source.is_rational:
            areas = np.array([patch_area(patch) for patch in reference])
        else:
            areas = enclosed_areas(reference, sides_around(reference), len(reference))
        self._reference_area = float(np.abs(areas).sum())
        self._kept = _Kept()

    def __getstate__(self) -> dict[str, object]:
        # Optimizers stay behind: they are rebuilt where the problem arrives.
        return {name: value for name, value in self.__dict__.items() if name != "_kept"}

    def __setstate__(self, state: dict[str, object]) -> None:
        self.__dict__.update(state, _kept=_Kept())

    def scale(self, area: float) -> float:
        """The factor that takes the area inside a boundary to the reference's.

        The mean determinant at the nodes is as good where all corners have a node; where one is left out it depends on
        the inside a little.
        """
        return float(np.sqrt(self._reference_area / area))

    def pinned(self, pins: IntArray, points: FloatArray) -> Problem:
        """The same problem, which has no pins yet, with inner points given, where the rows leave each of them free.

        Raises
        ------
        InputError
            When a point is not inside, or rows tie the points to each other or to the boundary.
        """
        inside = self.source.topology.interior_points
        if not set(pins.tolist()) <= set(inside.tolist()) or len(set(pins.tolist())) < len(pins):
            raise InputError("points that are to be held are not inside, or named twice")
        held = np.zeros(self.source.topology.n_points, bool)
        held[pins] = True
        free = ~held[inside]
        places, other = np.flatnonzero(free), copy(self)
        other.pins = pins
        if self._rows is None or self._active is None:
            # Every other point is free: a column with a one for each.
            n = len(places)
            other._rows = inside[free], None, Compressed(np.arange(n + 1), places, np.ones(n), (len(inside), n))
            return other
        space = row_space(self._active, inside[free], points)
        z = space.columns
        if z.shape[1] != self._rows[2].shape[1] - len(pins) or space.contradictory:
            raise InputError("the continuity rows tie these points to others that are given: they cannot be held")
        columns = Compressed(z.indptr, places[z.indices], z.data, (len(inside), z.shape[1]))
        other._rows = space.interior, space.particular, columns
        return other

    def lift(self, motions: FloatArray, pins: FloatArray | None = None) -> FloatArray:
        """Motions (k, n_points, 2) under the rows that begin with those of the boundary (k, n_b, 2).

        Held points move by `pins` (n_p, 2), by default not at all.
        """
        out = np.zeros((len(motions), self.source.topology.n_points, 2))
        out[:, self.boundary_points] = motions
        if pins is not None:
            out[:, self.pins] = pins
        interior, particular, _ = self._rows or (None, None, None)
        if particular is not None:
            for field in out:
                field[interior] = particular @ field
        return out

    def drop(self, forces: FloatArray) -> FloatArray:
        """The transpose of `lift`."""
        out = np.array(forces[:, self.boundary_points])
        interior, particular, _ = self._rows or (None, None, None)
        if particular is not None:
            for k, force in enumerate(forces):
                out[k] += (particular.T @ force[interior])[self.boundary_points]
        return out

    def optimizer(self) -> SplineOptimizer:
        """The optimizer of this thread, linearised for nobody."""
        self._kept.owner = None
        if self._kept.optimizer is None:
            self._kept.optimizer = SplineOptimizer(
                self.source.topology,
                self._reference,
                nodes_per_degree=self.measure.nodes_per_degree,
                extra_nodes=self.measure.extra_nodes,
                excluded_corners=self._excluded,
                null_space=None if self._rows is None else self._rows[2],
            )
        return self._kept.optimizer

    def keep_for(self, owner: object) -> None:
        """The optimizer is linearised at the map of `owner` from now on."""
        self._kept.owner = owner

    def linearised(self, owner: object, start: FloatArray, points: FloatArray, scale: float) -> SplineOptimizer:
        """The optimizer linearised for `owner`: as it was left, or once more, to the same bits."""
        if self._kept.owner is not owner or self._kept.optimizer is None:
            optimizer = self.optimizer()
            if not optimizer.linearise(start, self.measure.area_weight, scale):
                raise TransferError("the map was a strict minimum of the distortion when it was made, and is none here")
            optimizer.look_from(points)
            self._kept.owner = owner
        return self._kept.optimizer  # type: ignore[return-value]
