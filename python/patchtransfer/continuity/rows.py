"""Stage 6, continuity rows: linear equations B u = 0 on the control points that make patches join smoothly.

``continuity="c1"``: C1 rows on the interfaces (Xu et al. 2023, Eq. 10, weighted by knot spans and speeds) and
vertex rows at extraordinary vertices (Eq. 11, for any gluing data and knots, and how fast the kink fades). The
derivation is in ``docs/continuity.md``.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..geometry.topology import Spoke, Topology
from ..numeric.arrays import FloatArray, IntArray
from ..numeric.compressed import Compressed, selected, summed
from .interfaces import ControlRows, chord_ratios
from .joint_ratios import JointRatios, LegWish
from .vertex_rows import VertexRows

if TYPE_CHECKING:
    from scipy.sparse import csr_array

__all__ = ["C1Rows", "ContinuityRows"]


@dataclass(frozen=True, eq=False)
class ContinuityRows:
    """Rows B u = 0 on the shared control points.

    Attributes
    ----------
    entries : Compressed
        B as arrays, (m, n_points) by rows, scaled so that residuals are lengths: C1 rows by their factor of s_j,
        others to unit norm.
    slave : (m,) int array
        The control point s_j that a C1 row expresses as a mean of L_j and R_j; -1 for other rows.
    interface : (m,) int array
        Where a row comes from.
    vertex : (m,) int array
        Shared control point of the vertex that a vertex row belongs to; -1 for others.
    order : (m,) int array
        Which rows to keep first where not all can hold: lower numbers.
    left_out : int
        C1 rows that were left out on purpose: at extraordinary vertices, where vertex rows stand in for them, on
        interfaces between these that are too short for them, at the boundary, where they were released, and on
        interfaces without rows.
    without : tuple of int
        Interfaces that have no rows: taken from them, or of a degree below 2.
    """

    entries: Compressed
    slave: IntArray
    interface: IntArray
    vertex: IntArray
    order: IntArray
    left_out: int
    without: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.slave)

    @cached_property
    def matrix(self) -> csr_array:
        """B as a sparse array of SciPy's, which shares its entries."""
        from scipy.sparse import csr_array

        b = self.entries
        return csr_array((b.data, b.indices, b.indptr), shape=b.shape)

    def select(self, keep: IntArray) -> ContinuityRows:
        """Only the rows with the indices `keep`."""
        return replace(
            self,
            entries=selected(self.entries, keep),
            slave=self.slave[keep],
            interface=self.interface[keep],
            vertex=self.vertex[keep],
            order=self.order[keep],
        )


class C1Rows:
    """The C1 rows of a model's interfaces for any map: what does not depend on the map is gathered once.

    With A = ω_L p_L/h_L and B = ω_R p_R/h_R the C1 rows are s_j = (A L_j + B R_j) / (A + B). They are kept but for
    j = 0 at boundary vertices (two patches: all three points are fixed; more: the row would force tangents parallel
    that the boundary keeps apart) and j = 0, 1 at extraordinary vertices, where `VertexRows` stand in for them.

    Parameters
    ----------
    topology : Topology
    control : tuple of ControlRows
        Of `control_rows`.
    legs : bool, default True
        Whether chords that end at smooth joints of the boundary take the ratio of the legs there; see `JointRatios`.
    """

    def __init__(self, topology: Topology, control: tuple[ControlRows, ...], legs: bool = True) -> None:
        self._topology, self._control = topology, control
        vertices = {vertex.point: vertex for vertex in topology.vertices}
        ends = [[vertices[int(r.curve[0])], vertices[int(r.curve[-1])]] for r in control]
        self._lengths = np.array([len(r.curve) for r in control], int)
        self._interface = np.repeat(np.arange(len(control)), self._lengths)
        self._columns = _joined([np.stack([r.left, r.right, r.curve], axis=1) for r in control], 3)
        # Distance of every point from the first and the last one of its interface.
        self._from_ends = _joined([np.stack([np.arange(n), np.arange(n)[::-1]], axis=1) for n in self._lengths], 2)
        skipped = [[2 if v.extraordinary else 0 if v.interior else 1 for v in pair] for pair in ends]
        self._skipped = np.array(skipped, int).reshape(-1, 2)
        self._scales = np.array([[r.left_scale, r.right_scale] for r in control]).reshape(-1, 2)
        self._linear = np.array([r.lowest_degree < 2 for r in control], bool)
        self._vertex_rows = VertexRows(control, ends, self._linear)
        self._last: tuple[FloatArray, FloatArray] | None = None
        self._joint_ratios = JointRatios(topology, control if legs else ())

    @property
    def second_rows(self) -> frozenset[int]:
        """Shared control points of the extraordinary vertices that get second rows."""
        return self._vertex_rows.vertices

    @property
    def has_joints(self) -> bool:
        """Whether there are joints whose legs chords follow."""
        return len(self._joint_ratios) > 0

    def leg_wishes(self, points: FloatArray) -> list[LegWish]:
        """What would give legs at these joints the speed ratios of a map."""
        return self._joint_ratios.wishes(chord_ratios(self._topology, self._control, points), points)

    def _ratios(self, reference: FloatArray) -> FloatArray:
        """ω_L / ω_R of all interfaces; kept for the map asked for last, whose rows may be made anew."""
        last = self._last
        if last is None or last[0] is not reference:
            ratios = self._joint_ratios(chord_ratios(self._topology, self._control, reference), reference)
            last = self._last = reference, ratios
        return last[1]

    def __call__(
        self,
        reference: FloatArray,
        released: Collection[Spoke] = (),
        without: Collection[int] = (),
        relaxed: Collection[int] = (),
        open_vertices: Collection[int] = (),
        literal: bool = False,
    ) -> ContinuityRows:
        """C1 rows along the interfaces and vertex rows at extraordinary vertices.

        Parameters
        ----------
        reference : (n_points, 2) array
            Map whose speeds and frames the rows follow, on the same boundary.
        released : collection of Spoke
            Interface ends where the row j = 1 is left out as well.
        without : collection of int
            Interfaces that get no rows at all.
        relaxed : collection of int
            Shared control points of extraordinary vertices that get fewer second rows (even valence), or whose second
            rows follow the map's speeds at these rows instead of the chord's mean (odd; on few spans there are none).
        open_vertices : collection of int
            Those that get no second rows.
        literal : bool, default False
            The paper's 2 s - p - q = 0 (Eq. 10), whatever knot spans, degrees and speeds are.

        Returns
        -------
        ContinuityRows
        """
        rowless = self._linear.copy()
        rowless[list(without)] = True
        skipped = self._skipped.copy()
        for spoke in released:
            skipped[spoke.interface, int(spoke.at_end)] *= 2  # None at regular inner vertices.
        skipped = np.minimum(skipped, 2)
        ratios = self._scales[:, 1] / self._scales[:, 0] if literal else self._ratios(reference)
        second = self._vertex_rows.second(ratios, relaxed, open_vertices)
        bare = rowless | self._vertex_rows.tangents_only(second)
        keep = (self._from_ends >= skipped[self._interface]).all(axis=1) & ~bare[self._interface]
        weights = np.column_stack([ratios * self._scales[:, 0], self._scales[:, 1]])
        weights /= weights.sum(axis=1, keepdims=True)
        interface, columns = self._interface[keep], self._columns[keep]
        data = np.column_stack([weights[interface], -np.ones(len(interface))])
        of_vertices = self._vertex_rows.of(ratios, reference, rowless, second, relaxed)
        m, at_vertices = len(columns), len(of_vertices.vertex)
        entries = summed(
            np.concatenate([np.repeat(np.arange(m), 3), m + of_vertices.row]),
            np.concatenate([columns.ravel(), of_vertices.columns]),
            np.concatenate([data.ravel(), of_vertices.data]),
            (m + at_vertices, self._topology.n_points),
        )
        none = np.full(len(interface), -1)
        return ContinuityRows(
            entries,
            slave=np.concatenate([columns[:, 2], np.full(len(of_vertices.vertex), -1)]),
            interface=np.concatenate([interface, of_vertices.interface]),
            vertex=np.concatenate([none, of_vertices.vertex]),
            order=np.concatenate([np.zeros_like(none), of_vertices.order]),
            left_out=int(len(keep) - keep.sum()),
            without=tuple(np.flatnonzero(rowless).tolist()),
        )


def _joined(blocks: list[IntArray], width: int) -> IntArray:
    return np.concatenate([np.empty((0, width), int), *blocks])
