"""Two rows for every interface end at an extraordinary vertex: its tangent, and how fast its kink fades.

The derivation is in ``docs/continuity.md``.
"""

from __future__ import annotations

from collections.abc import Collection
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..geometry.basis import collocation_matrix, knot_spans, reverse_knots
from ..geometry.topology import Vertex
from ..numeric.arrays import FloatArray, IntArray, among
from ..numeric.dense import svd
from .interfaces import ControlRows, frames

__all__ = ["VertexRows", "overshoot"]

#: From so many spans on an interface is C1 on all but the spans at its ends; on fewer little of it would be C1, and
#: the kink counts.
MANY_SPANS = 4
#: Below this logarithm the product of ratios around a vertex is taken for 1: its twists grow with the inverse, and rows
#: are told from rounding where they are less than 1e9 of them.
SINGULAR = 1e-4
#: Parameters at which a basis function is sampled for its median; the kink is stationary there.
SAMPLES = 2001


class EndRows(NamedTuple):
    """Vertex rows: entries `data` in `row` and `columns`, and where each of the rows comes from."""

    row: IntArray
    columns: IntArray
    data: FloatArray
    interface: IntArray
    vertex: IntArray
    order: IntArray


class VertexRows:
    """Vertex rows of all interface ends at extraordinary vertices: g(0) = 0, and e_1 = −κ e_0.

    e_j = A L_j + B R_j − s_j is the residual of the C1 row j. On many spans κ = 0: the interface is C1 but for the span
    at the vertex. On few κ is that of `overshoot`, around vertices of valence 5, 7, ... there is no second row, and
    around those of valence 6, 8, ... there is one less, all sharing what none of them may ask for.

    At an end only the points L_0, L_1, R_0, R_1, s_0, s_1, counted from it, matter. Arrays run over the ends.
    """

    def __init__(self, control: tuple[ControlRows, ...], vertices: list[list[Vertex]], linear: np.ndarray) -> None:
        found = [(i, e) for i in range(len(control)) for e in (0, 1) if vertices[i][e].extraordinary and not linear[i]]
        at = [vertices[i][e] for i, e in found]
        ends = [(control[i], e, slice(None, None, -1 if e else 1)) for i, e in found]
        self.interface = np.array([i for i, _ in found], int)
        self.vertex = np.array([v.point for v in at], int)
        points = [np.concatenate([r.left[o][:2], r.right[o][:2], r.curve[o][:2]]) for r, _, o in ends]
        self.points = np.array(points, int).reshape(-1, 6)
        self.scales = np.array([[r.left_scale, r.right_scale] for r, _, _ in ends]).reshape(-1, 2)
        # Values and derivatives at the end of its first two basis functions.
        basis = [[row[o][:2] for row in r.end_basis[e][:2]] for r, e, o in ends]
        self.value, self.slope = np.array(basis).reshape(-1, 2, 2).transpose(1, 0, 2)
        few = np.array([len(r.breaks) <= MANY_SPANS for r, _, _ in ends], bool)
        past = [overshoot((reverse_knots(r.knots) if e else r.knots).tobytes(), r.degree) for r, e, _ in ends]
        self._overshoot = np.where(few, past, 0.0)
        # A row in the middle of three points would have to follow both ends.
        shared = [len(control[i].curve) == 3 and vertices[i][1 - e].extraordinary for i, e in found]
        self._never = np.array(shared, bool) | (few & np.array([v.valence > 4 and v.valence % 2 for v in at], bool))
        self._sense = np.array([-1.0 if e else 1.0 for _, e, _ in ends])
        # The ends around every vertex of even valence where all of them have second rows; few spans at all of them.
        whole = {v.point for v in at if v.valence % 2 == 0} - set(self.vertex[self._never].tolist())
        around = [np.flatnonzero(self.vertex == point) for point in sorted(whole)]
        self._shared = [ends for ends in around if few[ends].all()]
        self._first = np.array([ends[0] for ends in around if not few[ends].all()], int)
        self._few, self._n_interfaces = few, len(control)

    @property
    def vertices(self) -> frozenset[int]:
        """Shared control points of the vertices that get second rows."""
        return frozenset(self.vertex[~self._never].tolist())

    def second(
        self, ratios: FloatArray, relaxed: Collection[int] = (), open_vertices: Collection[int] = ()
    ) -> NDArray[np.bool_]:
        """Ends that have second rows: all but one at `relaxed` vertices of even valence, none at `open_vertices`.

        Around a vertex of even valence the twists' cyclic system is singular where the product of all A/B is 1. The
        rows of a symmetric map depend there, so that one of them is left out as well. On few spans `of` combines them.
        """
        here: NDArray[np.bool_] = ~self._never & ~(self._few & self._own(relaxed))
        here &= ~among(self.vertex, open_vertices)
        logs = self._sense * np.log(ratios[self.interface] * self.scales[:, 0] / self.scales[:, 1])
        around = np.array([logs[self.vertex == self.vertex[k]].sum() for k in self._first])
        here[self._first[(np.abs(around) < SINGULAR) | among(self.vertex[self._first], relaxed)]] = False
        return here

    def _own(self, relaxed: Collection[int]) -> NDArray[np.bool_]:
        """Ends at relaxed vertices where one row is not left out: they have ratios of their own, or no second row."""
        return among(self.vertex, set(relaxed) - set(self.vertex[self._first].tolist()))

    def tangents_only(self, second: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Interfaces of few spans with no second row at either end, where C1 rows would raise the kink.

        They would make no span C1.
        """
        free = self.interface[self._few & ~second]
        bare: NDArray[np.bool_] = np.bincount(free, minlength=self._n_interfaces) == 2
        return bare

    def of(
        self,
        ratios: FloatArray,
        reference: FloatArray,
        rowless: np.ndarray,
        second: np.ndarray,
        relaxed: Collection[int] = (),
    ) -> EndRows:
        """Rows for the ratios ω_L / ω_R of all interfaces and the frames of a map.

        There are none for the interfaces of `rowless`, and second ones at the ends of `second` only; at `relaxed`
        vertices of odd valence these have the ratio of the map's distances |R_1 − s_1| and |L_1 − s_1|.
        """
        (left, right), v, d = self.scales.T, self.value, self.slope
        a, b, c = self._frames(reference).T
        zero, one = np.zeros(len(a)), np.ones(len(a))
        pulls = (left * a * v[:, 0], right * b * v[:, 0])
        tangent = np.column_stack([pulls[0], zero, pulls[1], zero, -pulls[0] - pulls[1] - c * d[:, 0], -c * d[:, 1]])
        tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
        weights = np.column_stack([ratios[self.interface] * left, right])
        own = self._own(relaxed)
        x = reference[self.points[own]]
        weights[own] = np.column_stack([np.hypot(*(x[:, k] - x[:, 5]).T) for k in (3, 1)])
        residual = np.column_stack([weights / weights.sum(axis=1, keepdims=True), -one])
        fading = (residual[:, :, None] * np.column_stack([self._overshoot, one])[:, None]).reshape(-1, 6)
        data = np.stack([tangent, fading], axis=1)
        there = ~rowless[self.interface]
        end, order = np.nonzero(np.column_stack([there, there & second]))
        row, columns, entries = np.arange(len(end)).repeat(6), self.points[end].ravel(), data[end, order].ravel()
        gone = np.zeros(len(end), bool)
        for ends in self._shared:
            rows = np.flatnonzero(among(end, ends) & (order == 1))
            if len(rows) < len(ends):
                continue
            mixed = self._mixed(end[rows], fading)
            others = ~among(row, rows)
            row = np.concatenate([row[others], rows[:-1].repeat(6 * len(rows))])
            columns = np.concatenate([columns[others], np.tile(self.points[end[rows]].ravel(), len(mixed))])
            entries = np.concatenate([entries[others], (mixed[:, :, None] * fading[end[rows]]).ravel()])
            gone[rows[-1]] = True
        number = np.cumsum(~gone) - 1
        end, order = end[~gone], order[~gone]
        return EndRows(number[row], columns, entries, self.interface[end], self.vertex[end], order)

    def _mixed(self, ends: IntArray, fading: FloatArray) -> FloatArray:
        """Combinations (m - 1, m) of the second rows around a vertex that leave out what their twists do least for.

        What is left out asks most of the tangents, and turns them. The combinations are orthonormal, so that it is
        shared by all spokes, not a single one's.
        """
        twists, at = np.unique(self.points[ends][:, [1, 3]], return_inverse=True)
        matrix = np.zeros((len(ends), len(twists)))
        np.add.at(matrix, (np.arange(len(ends)).repeat(2), at.ravel()), fading[ends][:, [1, 3]].ravel())
        u, _, _ = svd(matrix)
        return np.ascontiguousarray(u[:, :-1].T)

    def _frames(self, points: FloatArray) -> FloatArray:
        """Gluing data (a, b, c) of a map at the ends."""
        x = points[self.points]
        left, right = (self.scales[:, k, None] * (x[:, 2 * k] - x[:, 4]) for k in (0, 1))
        return frames(left, right, (self.slope[:, :, None] * x[:, 4:]).sum(axis=1))


@lru_cache(maxsize=256)
def overshoot(knot_bytes: bytes, degree: int) -> float:
    """The κ for which the kink e_0 (N_0 − κ N_1) at the start of clamped knots, as bytes, has the least mean.

    The integral of |N_0 − κ N_1| is least where its sign halves that of N_1. It changes once, for N_0 / N_1 falls, so
    κ = N_0 / N_1 at the median of N_1: at degree 3 0.531 on a single span, 0.148 on two uniform ones and more.
    """
    knots = np.frombuffer(knot_bytes)
    breaks = knot_spans(knots)
    t = np.linspace(breaks[0], breaks[:3][-1], SAMPLES)
    second = collocation_matrix(knots, degree, t)[:, 1]
    below = np.concatenate([[0.0], np.cumsum((second[1:] + second[:-1]) / 2)])
    median = np.interp(below[-1] / 2, below, t)
    values = collocation_matrix(knots, degree, [median])[0]
    return float(values[0] / values[1])
