"""Interfaces as pairs of control rows: cross derivatives, gluing data and the rows that they give.

Along an interface C(t), t in [0, 1], D_L and D_R are the derivatives across it, pointing into the patch on its
left (patch a) and on its right. Where the map is smooth there are functions with a D_L + b D_R = c C'.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..geometry.basis import end_rate, knot_spans, reverse_knots, span_basis
from ..geometry.rational import rational_basis
from ..geometry.sides import Interface
from ..geometry.topology import Topology
from ..numeric.arrays import FloatArray, IntArray
from ..numeric.dense import product

__all__ = ["ControlRows", "chord_ratios", "control_rows", "frames"]

#: Parameters per knot span at which speeds across interfaces are compared.
SAMPLES = 5
#: Weights that differ by less than this part of themselves are the same but for rounding.
SAME_WEIGHT = 1e-12


@dataclass(frozen=True, eq=False)
class ControlRows:
    """The three rows of control points that decide how smooth a map is across an interface.

    Attributes
    ----------
    curve, left, right : (n,) int arrays
        Shared control points s_j on the interface, L_j and R_j in the rows beside it, of patch a and of patch b.
    knots : (n + degree + 1,) array
        Along the interface, mapped to [0, 1].
    degree : int
        Along the interface.
    left_scale, right_scale : float
        p/h of the patch on either side: its degree across over its first knot span, parameters mapped to [0, 1].
    lowest_degree : int
        The smallest of the degrees along and across; 0 where weights allow no rows of three points, see `control_rows`.
    weights : (n,) array or None
        Along the interface, where they vary: basis functions are rational there.
    """

    curve: IntArray
    left: IntArray
    right: IntArray
    knots: FloatArray
    degree: int
    left_scale: float
    right_scale: float
    lowest_degree: int
    weights: FloatArray | None = None

    @classmethod
    def of(
        cls,
        f: Interface,
        numbers: Sequence[IntArray],
        bases: Sequence[Sequence[tuple[FloatArray, int]]],
        backwards: bool = False,
    ) -> ControlRows:
        """The control rows of an interface between splines of any kind, a geometry's or a field's.

        Parameters
        ----------
        f : Interface
        numbers : sequence of (n_u, n_v) int arrays
            Index of every patch's coefficients among the shared ones.
        bases : sequence of pairs of (knots, degree)
            Of every patch in u and v.
        backwards : bool, default False
            Run against the parameter of side a.
        """
        knots, degree = bases[f.patch_a][f.side_a.axis]
        knots = (reverse_knots(knots) if backwards else knots) - knots[0]
        across = [bases[k][1 - side.axis] for k, side in ((f.patch_a, f.side_a), (f.patch_b, f.side_b))]
        ends = (f.side_a.at_end, f.side_b.at_end)
        scales = [end_rate(*basis, at_end) for basis, at_end in zip(across, ends, strict=True)]
        sense, of_b = (slice(None, None, -1 if against else 1) for against in (backwards, backwards != f.reversed))
        return cls(
            curve=f.side_a.of(numbers[f.patch_a])[sense],
            left=f.side_a.of(numbers[f.patch_a], 1)[sense],
            right=f.side_b.of(numbers[f.patch_b], 1)[of_b],
            knots=knots / knots[-1],
            degree=degree,
            left_scale=scales[0],
            right_scale=scales[1],
            lowest_degree=min(degree, *(p for _, p in across)),
        )

    @cached_property
    def breaks(self) -> FloatArray:
        """Distinct knots."""
        return knot_spans(self.knots)

    @cached_property
    def end_basis(self) -> tuple[tuple[FloatArray, FloatArray, FloatArray], ...]:
        """Values, first and second derivatives (n,) of the basis functions at t = 0 and at t = 1."""
        rows = self._functions(np.array([0.0, 1.0]), min(self.degree, 2))
        value, slope, bend = [*rows, np.zeros_like(rows[0])][:3]
        return tuple((value[e], slope[e], bend[e]) for e in (0, 1))

    @cached_property
    def columns(self) -> IntArray:
        """The points L, R and s that `functional` gives coefficients of, (3 n,)."""
        return np.concatenate([self.left, self.right, self.curve])

    def basis(self, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values and derivatives (m, n) of the basis functions at the parameters t."""
        value, slope = self._functions(t, 1)
        return value, slope

    def _functions(self, t: FloatArray, order: int) -> list[FloatArray]:
        """The basis functions at the parameters t, (m, n), and their derivatives up to an order."""
        return rational_basis(self.knots, self.degree, self.weights, t, order)

    def derivatives(
        self, points: FloatArray, value: FloatArray, slope: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """D_L, D_R and C' (m, 2), where `value` and `slope` (m, n) hold the basis functions."""
        curve = points[self.curve]
        return (
            self.left_scale * product(value, points[self.left] - curve),
            self.right_scale * product(value, points[self.right] - curve),
            product(slope, curve),
        )

    def functional(self, gluing: FloatArray, value: FloatArray, slope: FloatArray) -> FloatArray:
        """Coefficients (m, 3 n) of `columns` in a D_L + b D_R - c C'; `gluing` (m, 3) holds a, b and c."""
        left = self.left_scale * gluing[:, :1] * value
        right = self.right_scale * gluing[:, 1:2] * value
        return np.concatenate([left, right, -left - right - gluing[:, 2:] * slope], axis=1)

    def end_gluing(self, points: FloatArray) -> FloatArray:
        """Gluing data (2, 3) at both ends; see `frames`."""
        value, slope = (np.array([basis[order] for basis in self.end_basis]) for order in (0, 1))
        return frames(*self.derivatives(points, value, slope))


def frames(left: FloatArray, right: FloatArray, tangent: FloatArray) -> FloatArray:
    """Gluing data (m, 3) of single points: rows (a, b, c) with a D_L + b D_R = c C' and a + b = 2; vectors are (m, 2).

    a ~ det(D_R, C') and b ~ det(C', D_L) are positive unless the map is folded there.
    """
    a, b = (u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0] for u, w in ((right, tangent), (tangent, left)))
    a, b = 2 * a / (a + b), 2 * b / (a + b)
    pull = a[:, None] * left + b[:, None] * right
    return np.column_stack([a, b, (pull * tangent).sum(axis=1) / (tangent * tangent).sum(axis=1)])


def control_rows(topology: Topology) -> tuple[ControlRows, ...]:
    """The control rows of every interface, run with patch a on its left.

    A rational patch has D_L = p/h Σ R_j w_1j / w_0j (L_j - s_j), with weights w_0 on the interface and w_1 beside it.
    Where their ratio is the same for all j it is a factor of p/h. Elsewhere there are no rows.
    """
    bases = [tuple(zip(patch.knots, patch.degrees, strict=True)) for patch in topology.patches]
    return tuple(
        _weighted(f, topology, ControlRows.of(f, topology.points, bases, directed.reversed), directed.reversed)
        for f, directed in zip(topology.interfaces, topology.directed_interfaces, strict=True)
    )


def _weighted(f: Interface, topology: Topology, rows: ControlRows, backwards: bool) -> ControlRows:
    """Control rows with what the patches' weights make of their scales."""
    factors = [1.0, 1.0]
    for i, (k, side) in enumerate(((f.patch_a, f.side_a), (f.patch_b, f.side_b))):
        weights = topology.patches[k].weights
        if weights is None:
            continue
        along, ratio = side.of(weights), side.of(weights, 1) / side.of(weights)
        if np.ptp(ratio) / ratio.min() > SAME_WEIGHT:
            return replace(rows, lowest_degree=0)
        factors[i] = float(ratio.mean())
        if i == 0 and np.ptp(along) / along.min() > SAME_WEIGHT:
            # Of either patch: an interface has one curve, up to a common factor of weights.
            rows = replace(rows, weights=along[:: -1 if backwards else 1])
    if factors == [1.0, 1.0]:
        return rows
    return replace(rows, left_scale=factors[0] * rows.left_scale, right_scale=factors[1] * rows.right_scale)


def chord_ratios(topology: Topology, rows: tuple[ControlRows, ...], points: FloatArray) -> FloatArray:
    """ω_L / ω_R of every interface, constant along chords: the log-mean of |D_R| / |D_L| of the map `points`.

    One ratio per interface instead would make the tangents collapse at the regular vertices between them. The mean of
    all speeds changes smoothly with the map, so that rows which follow it settle; the report's ratio is a median of
    rows, for rows that hold with one ratio should show no residual where a few others do not hold.
    """
    logs, counts = np.zeros(len(rows)), np.zeros(len(rows))
    alike: dict[tuple[bytes, int, bytes | None], list[int]] = defaultdict(list)
    for i, r in enumerate(rows):
        alike[r.knots.tobytes(), r.degree, None if r.weights is None else r.weights.tobytes()].append(i)
    for members in alike.values():
        group = [rows[i] for i in members]
        _, (value, _, _) = span_basis(group[0].knots, group[0].degree, SAMPLES)
        if group[0].weights is not None:
            value = value * group[0].weights
            value = value / value.sum(axis=1, keepdims=True)
        curve = points[np.array([r.curve for r in group])]
        left, right = (
            points[np.array(beside)] - curve for beside in ([r.left for r in group], [r.right for r in group])
        )
        speeds = [np.hypot(*np.moveaxis(product(value, d), 2, 0)) for d in (left, right)]
        there = (speeds[0] > 0) & (speeds[1] > 0)
        quotients = np.log(np.divide(speeds[1], speeds[0], out=np.ones_like(speeds[0]), where=there))
        scales = np.log([r.right_scale / r.left_scale for r in group])
        counts[members] = there.sum(axis=1)
        logs[members] = quotients.sum(axis=1) + counts[members] * scales
    ratios = np.ones(len(rows))
    for chord in topology.directed_chords:
        index = np.array([i for i, _ in chord])
        sense = np.array([1.0 if forward else -1.0 for _, forward in chord])
        mean = float((sense * logs[index]).sum()) / max(float(counts[index].sum()), 1.0)
        ratios[index] = np.exp(sense * mean)
    return ratios
