"""Stage 6, continuity rows: linear equations B u = 0 on the control points that make patches join smoothly.

``continuity="c1"``: C1 rows on the interfaces (Xu et al. 2023, Eq. 10, weighted by knot spans and speeds) and
vertex rows at extraordinary vertices (Eq. 11–12, for any gluing data and knots). The derivation is in
``docs/continuity.md``.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..geometry.topology import Spoke, Topology, Vertex
from ..numeric.arrays import FloatArray, IntArray
from ..numeric.compressed import Compressed, selected, summed
from .interfaces import ControlRows, chord_ratios, frames

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
        C1 rows that were left out on purpose: at extraordinary vertices, where vertex rows stand in for them, at
        the boundary, where they were released, and on interfaces without rows.
    without : tuple of int
        Interfaces that have no rows: taken from them, or of a degree below 2.
    blocked : tuple of (interface, vertex)
        Twist rows that were not formed: around a vertex of even valence the twists alone cannot satisfy them, and the
        second point s_2 of the interface lies on the boundary.
    """

    entries: Compressed
    slave: IntArray
    interface: IntArray
    vertex: IntArray
    order: IntArray
    left_out: int
    without: tuple[int, ...]
    blocked: tuple[tuple[int, int], ...] = ()

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
    that the boundary keeps apart) and j = 0, 1 at extraordinary vertices, where `_VertexRows` stand in for them.

    Parameters
    ----------
    topology : Topology
    control : tuple of ControlRows
        Of `control_rows`.
    """

    def __init__(self, topology: Topology, control: tuple[ControlRows, ...]) -> None:
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
        self._vertex_rows = _VertexRows(control, ends, self._linear, set(topology.boundary_points.tolist()))

    def __call__(
        self,
        reference: FloatArray,
        released: Collection[Spoke] = (),
        without: Collection[int] = (),
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
        keep = (self._from_ends >= skipped[self._interface]).all(axis=1) & ~rowless[self._interface]
        if literal:
            ratios = self._scales[:, 1] / self._scales[:, 0]
        else:
            ratios = chord_ratios(self._topology, self._control, reference)
        weights = np.column_stack([ratios * self._scales[:, 0], self._scales[:, 1]])
        weights /= weights.sum(axis=1, keepdims=True)
        interface, columns = self._interface[keep], self._columns[keep]
        data = np.column_stack([weights[interface], -np.ones(len(interface))])
        of_vertices = self._vertex_rows.of(ratios, reference, rowless)
        m, at_vertices = len(columns), len(of_vertices.columns)
        entries = summed(
            np.concatenate([np.repeat(np.arange(m), 3), np.repeat(m + np.arange(at_vertices), 7)]),
            np.concatenate([columns.ravel(), of_vertices.columns.ravel()]),
            np.concatenate([data.ravel(), of_vertices.data.ravel()]),
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
            blocked=of_vertices.blocked,
        )


def _joined(blocks: list[IntArray], width: int) -> IntArray:
    return np.concatenate([np.empty((0, width), int), *blocks])


class _Rows(NamedTuple):
    """Vertex rows: coefficients (m, 7) of the points `columns`, and where they come from."""

    columns: IntArray
    data: FloatArray
    interface: IntArray
    vertex: IntArray
    order: IntArray
    blocked: tuple[tuple[int, int], ...]


class _VertexRows:
    """Two rows for every interface end at an extraordinary vertex: g = a D_L + b D_R - c C' and g' vanish there.

    At an end only the points L_0, L_1, R_0, R_1, s_0, s_1, s_2, counted from it, matter. Arrays run over the ends.
    """

    def __init__(
        self,
        control: tuple[ControlRows, ...],
        vertices: list[list[Vertex]],
        linear: np.ndarray,
        boundary: Collection[int],
    ) -> None:
        found = [(i, e) for i in range(len(control)) for e in (0, 1) if vertices[i][e].extraordinary and not linear[i]]
        order = [slice(None, None, -1) if e else slice(None) for _, e in found]
        rows = [control[i] for i, _ in found]
        ends = list(zip(rows, order, strict=True))
        self.interface = np.array([i for i, _ in found], int)
        self.vertex = np.array([vertices[i][e].point for i, e in found], int)
        self.points = _joined(
            [np.concatenate([r.left[o][:2], r.right[o][:2], r.curve[o][:3]])[None] for r, o in ends], 7
        )
        self.scales = np.array([[r.left_scale, r.right_scale] for r in rows]).reshape(-1, 2)
        # Values and derivatives at the end of its first three basis functions, the only ones that do not vanish.
        basis = [[row[o][:3] for row in r.end_basis[e]] for (_, e), (r, o) in zip(found, ends, strict=True)]
        self.value, self.slope, self.bend = np.array(basis).reshape(-1, 3, 3).transpose(1, 0, 2)
        # Around a vertex of even valence the twists alone cannot satisfy g' = 0.
        self.blocked = np.array(
            [
                vertices[i][e].valence % 2 == 0 and int(r.curve[o][2]) in boundary
                for (i, e), (r, o) in zip(found, ends, strict=True)
            ],
            bool,
        )
        # Gluing data leave the vertex's values for the C1 rows' as fast as (1 - t/h)^(p - 1) does, h the first span: a
        # slower transition spreads the kink (linear over two spans: half as much again on the samples). On a single
        # span they are linear from one end to the other.
        spans = [np.diff(r.breaks)[o] for r, o in ends]
        single = np.array([len(h) == 1 for h in spans], bool)
        rate = np.array([1.0 if len(h) == 1 else (r.degree - 1) / h[0] for r, h in zip(rows, spans, strict=True)])
        self.rate = rate * np.array([-1.0 if e else 1.0 for _, e in found])
        number = {end: k for k, end in enumerate(found)}
        self.other = np.array([number.get((i, 1 - e), -1) for i, e in found], int)
        self.other[~single] = -1

    def of(self, ratios: FloatArray, reference: FloatArray, rowless: np.ndarray) -> _Rows:
        """Rows for the ratios ω_L / ω_R of all interfaces and the frames of a map; none for those of `rowless`."""
        ratio = ratios[self.interface]
        regular = np.column_stack([2 * ratio / (1 + ratio), 2 / (1 + ratio), np.zeros(len(ratio))])
        frame = self._frames(reference)
        a, b, c = frame.T
        towards = np.where(self.other[:, None] >= 0, frame[self.other], regular) if len(frame) else regular
        a1, b1, c1 = (self.rate[:, None] * (towards - frame)).T
        (left, right), v, d, h = self.scales.T, self.value, self.slope, self.bend
        zero = np.zeros(len(frame))
        across = (left * a * v[:, 0], right * b * v[:, 0])
        zeroth = [across[0], zero, across[1], zero, -across[0] - across[1] - c * d[:, 0], -c * d[:, 1], zero]
        across_l = (left * (a1 * v[:, 0] + a * d[:, 0]), left * a * d[:, 1])
        across_r = (right * (b1 * v[:, 0] + b * d[:, 0]), right * b * d[:, 1])
        along = [-across_l[k] - across_r[k] - c1 * d[:, k] - c * h[:, k] for k in (0, 1)]
        first = [*across_l, *across_r, *along, -c * h[:, 2]]
        data = np.array([zeroth, first]).transpose(2, 0, 1)
        data /= np.linalg.norm(data, axis=2, keepdims=True)
        there = ~rowless[self.interface]
        keep = np.column_stack([there, there & ~self.blocked])
        end, order = np.nonzero(keep)
        blocked = there & self.blocked
        return _Rows(
            self.points[end],
            data[end, order],
            self.interface[end],
            self.vertex[end],
            order,
            tuple(zip(self.interface[blocked].tolist(), self.vertex[blocked].tolist(), strict=True)),
        )

    def _frames(self, points: FloatArray) -> FloatArray:
        """Gluing data (a, b, c) of a map at the ends."""
        x = points[self.points]
        left, right = (self.scales[:, k, None] * (x[:, 2 * k] - x[:, 4]) for k in (0, 1))
        tangent = (self.slope[:, :, None] * x[:, 4:]).sum(axis=1)
        return frames(left, right, tangent)
