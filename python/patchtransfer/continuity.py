"""Stage 6, continuity rows: linear equations B u = 0 on the control points that make patches join smoothly.

``continuity="c1"``: C1 rows on the interfaces (Xu et al. 2023, Eq. 10, weighted by knot spans and speeds) and
vertex rows at extraordinary vertices (Eq. 11–12, for any gluing data and knots). The derivation is in
``docs/continuity.md``.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from .gluing import ControlRows, chord_ratios
from .splines import FloatArray
from .topology import IntArray, Spoke, Topology, Vertex

__all__ = ["ContinuityRows", "c1_rows"]


@dataclass(frozen=True, eq=False)
class ContinuityRows:
    """Rows B u = 0 on the shared control points.

    Attributes
    ----------
    matrix : (m, n_points) sparse array
        Scaled so that residuals are lengths: C1 rows by their factor of s_j, others to unit norm.
    slave : (m,) int array
        The control point s_j that a C1 row expresses as a mean of L_j and R_j; -1 for other rows.
    interface : (m,) int array
        Where a row comes from.
    vertex : (m,) int array
        Shared control point of the vertex that a vertex row belongs to; -1 for others.
    order : (m,) int array
        Which rows to keep first where not all can hold: lower numbers.
    left_out : int
        C1 rows that were left out on purpose: at extraordinary vertices, where vertex rows stand in for them, at
        the boundary, where they were released, and on interfaces without rows.
    without : tuple of int
        Interfaces that have no rows: taken from them, or of a degree below 2.
    blocked : tuple of (interface, vertex)
        Twist rows that were not formed: around a vertex of even valence the twists alone cannot satisfy them, and the
        second point s_2 of the interface lies on the boundary.
    """

    matrix: csr_array
    slave: IntArray
    interface: IntArray
    vertex: IntArray
    order: IntArray
    left_out: int
    without: tuple[int, ...]
    blocked: tuple[tuple[int, int], ...] = ()

    def __len__(self) -> int:
        return len(self.slave)

    def select(self, keep: IntArray) -> ContinuityRows:
        """Only the rows with the indices `keep`."""
        return ContinuityRows(
            csr_array(self.matrix[keep]),
            *(self.slave[keep], self.interface[keep], self.vertex[keep], self.order[keep]),
            self.left_out,
            self.without,
            self.blocked,
        )


class _Builder:
    """Collects rows as triplets."""

    def __init__(self) -> None:
        self.data: list[FloatArray] = []
        self.columns: list[IntArray] = []
        self.slave: list[int] = []
        self.interface: list[int] = []
        self.vertex: list[int] = []
        self.order: list[int] = []
        self.blocked: list[tuple[int, int]] = []

    def add(
        self, columns: IntArray, data: FloatArray, interface: int, slave: int = -1, vertex: int = -1, order: int = 0
    ) -> None:
        self.columns.append(columns)
        self.data.append(data)
        self.slave.append(slave)
        self.interface.append(interface)
        self.vertex.append(vertex)
        self.order.append(order)

    def build(self, n_points: int, left_out: int, without: Collection[int]) -> ContinuityRows:
        pointer = np.concatenate([[0], np.cumsum([len(c) for c in self.columns])]).astype(np.int64)
        data, columns = np.concatenate([[], *self.data]), np.concatenate([[], *self.columns]).astype(np.int64)
        matrix = csr_array((data, columns, pointer), shape=(len(self.slave), n_points))
        matrix.sum_duplicates()
        slave, interface, vertex, order = (
            np.array(x, np.int64) for x in (self.slave, self.interface, self.vertex, self.order)
        )
        return ContinuityRows(
            matrix, slave, interface, vertex, order, left_out, tuple(sorted(without)), tuple(self.blocked)
        )


def c1_rows(
    topology: Topology,
    control: tuple[ControlRows, ...],
    reference: FloatArray,
    released: Collection[Spoke] = (),
    without: Collection[int] = (),
) -> ContinuityRows:
    """C1 rows along the interfaces and vertex rows at extraordinary vertices.

    With A = ω_L p_L/h_L and B = ω_R p_R/h_R the C1 rows are s_j = (A L_j + B R_j) / (A + B). They are kept but for
    j = 0 at boundary vertices (two patches: all three points are fixed; more: the row would force tangents parallel
    that the boundary keeps apart) and j = 0, 1 at extraordinary vertices. There two rows stand for each interface:
    the gluing identity g = a D_L + b D_R - c C' and its derivative vanish at the vertex.

    Parameters
    ----------
    topology : Topology
    control : tuple of ControlRows
        Of `control_rows`.
    reference : (n_points, 2) array
        Map whose speeds and frames the rows follow, on the same boundary.
    released : collection of Spoke
        Interface ends where the row j = 1 is left out as well.
    without : collection of int
        Interfaces that get no rows at all.

    Returns
    -------
    ContinuityRows
    """
    vertices = {vertex.point: vertex for vertex in topology.vertices}
    ratios = chord_ratios(topology, control, reference)
    rows, left_out = _Builder(), 0
    boundary = set(topology.boundary_points.tolist())
    rowless = {i for i, r in enumerate(control) if i in without or r.lowest_degree < 2}
    for index, (r, ratio) in enumerate(zip(control, ratios.tolist(), strict=True)):
        n = len(r.curve)
        if index in rowless:
            left_out += n
            continue
        ends = [vertices[int(r.curve[0])], vertices[int(r.curve[-1])]]
        keep = _kept(n, ends, [Spoke(index, False) in released, Spoke(index, True) in released])
        left_out += int(n - keep.sum())
        weights = np.array([ratio * r.left_scale, r.right_scale])
        weights /= weights.sum()
        data = np.array([*weights, -1.0])
        for j in np.flatnonzero(keep):
            rows.add(np.array([r.left[j], r.right[j], r.curve[j]]), data, index, slave=int(r.curve[j]))
        _vertex_rows(rows, r, index, ends, ratio, reference, boundary)
    return rows.build(topology.n_points, left_out, rowless)


def _kept(n: int, ends: list[Vertex], released: list[bool]) -> np.ndarray:
    """Which of the C1 rows j = 0, ..., n - 1 of an interface are kept."""
    keep = np.ones(n, bool)
    for end, order in ((0, slice(None)), (1, slice(None, None, -1))):
        count = 2 if ends[end].extraordinary else 0 if ends[end].interior else 2 if released[end] else 1
        keep[order][:count] = False
    return keep


def _vertex_rows(
    rows: _Builder,
    r: ControlRows,
    index: int,
    ends: list[Vertex],
    ratio: float,
    reference: FloatArray,
    boundary: Collection[int],
) -> None:
    """The rows g = 0 and g' = 0 at the extraordinary ends of an interface."""
    if not any(vertex.extraordinary for vertex in ends):
        return
    frame = r.end_gluing(reference)
    # Away from extraordinary vertices the C1 rows are gluing data as well, scaled alike.
    regular = np.array([2 * ratio / (1 + ratio), 2 / (1 + ratio), 0.0])
    data = np.array([frame[e] if ends[e].extraordinary else regular for e in (0, 1)])
    columns = r.columns
    for end in (0, 1):
        if not ends[end].extraordinary:
            continue
        slopes = _transition(r, data, regular, end)
        value, slope, bend = (x[None] for x in r.end_basis[end])
        gluing = data[end][None]
        zeroth = r.functional(gluing, value, slope)
        first = r.functional(slopes[None], value, slope) + r.functional(gluing, slope, bend)
        for order, coefficients in enumerate((zeroth[0], first[0])):
            if order == 1 and ends[end].valence % 2 == 0 and int(r.curve[-3 if end else 2]) in boundary:
                rows.blocked.append((index, ends[end].point))
                continue
            there = coefficients != 0
            norm = float(np.linalg.norm(coefficients))
            rows.add(columns[there], coefficients[there] / norm, index, vertex=ends[end].point, order=order)


def _transition(r: ControlRows, data: FloatArray, regular: FloatArray, end: int) -> FloatArray:
    """Derivatives (a', b', c') at an end where the gluing data leave the vertex's values for the C1 rows'.

    They do as fast as (1 - t/h)^(p - 1) does, h the first span: a slower transition spreads the kink (linear over two
    spans: half as much again on the samples). On a single span they are linear from one end to the other.
    """
    if len(r.breaks) == 2:
        return np.asarray(data[1] - data[0])
    if end == 0:
        return np.asarray((r.degree - 1) * (regular - data[0]) / r.breaks[1])
    return np.asarray((r.degree - 1) * (data[1] - regular) / (1.0 - r.breaks[-2]))
