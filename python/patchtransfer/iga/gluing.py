"""Gluing data of interfaces, and the C¹ condition of a field in terms of them.

Across an interface with cross derivatives D_a, D_b of the geometry, pointing into the two patches, and its tangent C'
there are functions with α D_a + β D_b = γ C'. A continuous field is C¹ in the plane exactly if its pull-backs fulfil
the same relation. The interface is analysis-suitable G1 (AS-G1) if α, β may be linear and γ quadratic (Collin,
Sangalli, Takacs 2016, *Analysis-suitable G1 multi-patch parametrizations for C1 isogeometric spaces*,
doi:10.1016/j.cagd.2016.05.009). Otherwise the relation holds with determinants of higher degree only, and too few
splines fulfil it (C¹ locking).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import factorial

import numpy as np
from scipy.sparse import coo_array, csr_array

from ..continuity.conditions import discontinuities
from ..continuity.interfaces import frames
from ..errors import InputError
from ..geometry.basis import greville, knot_spans
from ..geometry.multipatch import MultiPatch
from ..geometry.sides import Interface, Side
from ..measure.best_gluing import OF_VECTOR, factors, nearest_to_one
from ..numeric.arrays import FloatArray
from ..numeric.dense import product, svd
from .nodes import gauss
from .space import SplineSpace, Univariate

__all__ = ["Gluing", "c1_rows", "gluing_of"]

#: Residual up to which an interface counts as analysis-suitable.
ANALYSIS_SUITABLE = 1e-9
#: Conditions with a factor below this are void. Gluing data are no more exact than what counts as suitable.
VOID = 10 * ANALYSIS_SUITABLE


@dataclass(frozen=True)
class _Row:
    """One side of an interface: its basis, and the factor of a step into the patch in the cross derivative."""

    along: Univariate
    step: float
    reverse: bool

    @classmethod
    def of(cls, pair: Sequence[Univariate], side: Side, reverse: bool) -> _Row:
        across, p = pair[1 - side.axis].knots, pair[1 - side.axis].degree
        span = across[-1] - across[-p - 2] if side.at_end else across[p + 1] - across[0]
        return cls(pair[side.axis], p / float(span), reverse)

    def table(self, s: FloatArray, order: int = 0) -> FloatArray:
        """Basis functions along the side at s in [0, 1], in the sense of the interface, derivatives by s."""
        start, stop = float(self.along.knots[0]), float(self.along.knots[-1])
        t = stop - (stop - start) * s if self.reverse else start + (stop - start) * s
        scale = -(stop - start) if self.reverse else stop - start
        return self.along.table(np.clip(t, start, stop), order) * scale**order

    def greville(self) -> FloatArray:
        """Greville abscissae in [0, 1], in the side's own sense."""
        return np.clip(self._mapped(greville(self.along.knots, self.along.degree)), 0.0, 1.0)

    def jumps(self) -> tuple[FloatArray, FloatArray]:
        """Inner breaks, in the side's own sense, and the jumps there of the first derivative that is not continuous."""
        knots, jumps = discontinuities(self.along.knots, self.along.degree)
        return self._mapped(knots), jumps

    def _mapped(self, t: FloatArray) -> FloatArray:
        knots = self.along.knots
        return np.asarray((t - knots[0]) / (knots[-1] - knots[0]))

    def breaks(self) -> FloatArray:
        """Breaks along the side in [0, 1]."""
        s = self._mapped(knot_spans(self.along.knots))
        return np.asarray(1 - s[::-1] if self.reverse else s)


@dataclass(frozen=True)
class Gluing:
    """Gluing data of an interface over s in [0, 1], in the sense of its first side.

    Attributes
    ----------
    interface : Interface
    residual : float
        Smallest over largest singular value of the system for linear α, β and quadratic γ: 0 up to rounding on AS-G1
        geometries.
    coefficients : (7,) array
        α(0), α(1), β(0), β(1) and the Bernstein coefficients of γ. On other geometries they hold at the two ends, and
        in between as nearly as can be.
    """

    interface: Interface
    residual: float
    coefficients: FloatArray

    @property
    def analysis_suitable(self) -> bool:
        """Whether α D_a + β D_b = γ C' on the whole interface."""
        return self.residual <= ANALYSIS_SUITABLE

    def __call__(self, s: FloatArray) -> FloatArray:
        """α, β, γ at s, shape (3, len(s))."""
        x, linear = self.coefficients, np.stack([1 - s, s])
        parts = (x[:2], linear), (x[2:4], linear), (x[4:], _quadratic(s))
        return np.stack([(part[:, None] * basis).sum(axis=0) for part, basis in parts])


@dataclass(frozen=True)
class _Geometry:
    """Control points (n, 2) of an interface and of the first row on either side."""

    rows: tuple[_Row, _Row]
    side: FloatArray
    inner: tuple[FloatArray, FloatArray]

    def vectors(self, s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """D_a, D_b and C' at s, (m, 2) each."""
        a, b = self.rows
        # Both sides' points are taken in the sense of the first.
        first, second = (r.step * (x - self.side) for r, x in zip((a, b), self.inner, strict=True))
        return product(a.table(s), first), product(_aligned(b, s), second), product(a.table(s, 1), self.side)


def _aligned(row: _Row, s: FloatArray) -> FloatArray:
    """Basis functions of a side with the functions, too, in the sense of the interface."""
    table = row.table(s)
    return table[:, ::-1] if row.reverse else table


def _quadratic(s: FloatArray) -> FloatArray:
    return np.stack([(1 - s) ** 2, 2 * s * (1 - s), s**2])


def gluing_of(mp: MultiPatch, f: Interface) -> Gluing:
    """Gluing data of an interface of a polynomial model.

    Raises
    ------
    InputError
        On rational patches, and where the two sides do not lie on different sides of the interface (a fold).
    """
    patches = mp.patches[f.patch_a], mp.patches[f.patch_b]
    if any(patch.weights is not None for patch in patches):
        raise InputError(
            f"patch {f.patch_a} or {f.patch_b} is rational: C¹ fields are built on polynomial patches only"
        )
    rows, inner = [], []
    for patch, side, reverse in ((patches[0], f.side_a, False), (patches[1], f.side_b, f.reversed)):
        pair = [Univariate(*both) for both in zip(patch.knots, patch.degrees, strict=True)]
        rows.append(_Row.of(pair, side, reverse))
        points = side.of(patch.control_points, 1)
        inner.append(points[::-1] if reverse else points)
    shared = f.side_a.of(patches[0].control_points)
    geometry = _Geometry((rows[0], rows[1]), shared, (inner[0], inner[1]))
    p = rows[0].along.degree
    s, w = gauss(rows[0].breaks(), p + 4)
    vectors = geometry.vectors(s)
    scales = [max(float(np.hypot(*v.T).max()), 1e-300) for v in vectors]
    scaled = np.stack([v / scale for v, scale in zip(vectors, scales, strict=True)], axis=2)
    system = scaled[..., OF_VECTOR] * factors(s)[:, None]
    _, sigma, vt = svd((system * np.sqrt(w)[:, None, None]).reshape(-1, 7))
    residual = float(sigma[-1] / sigma[0])
    if residual <= ANALYSIS_SUITABLE:
        x = nearest_to_one(sigma, vt, ANALYSIS_SUITABLE)
    else:
        x = _between_frames(geometry, scales)
        # The middle coefficient of γ by least squares.
        known = (system * x).sum(axis=2)
        x[5] -= (system[..., 5] * known * w[:, None]).sum() / (system[..., 5] ** 2 * w[:, None]).sum()
    if not x[:4].min() > 0:
        raise InputError(
            f"interface {f.name}: the patches do not lie on different sides of it, or their cross derivatives vanish; "
            "C¹ fields need a regular model"
        )
    # Back from scaled vectors, and of unit size.
    x = x / np.repeat(scales, [2, 2, 3])
    return Gluing(f, residual, x / np.abs(x).max())


def _between_frames(geometry: _Geometry, scales: list[float]) -> FloatArray:
    """α, β, γ that hold at both ends, where they are determined by D_a, D_b and C' up to a factor: α + β = 2."""
    a, b, c = (v / scale for v, scale in zip(geometry.vectors(np.array([0.0, 1.0])), scales, strict=True))
    alpha, beta, gamma = frames(a, b, c).T
    return np.array([*alpha, *beta, gamma[0], 0.0, gamma[1]])


def c1_rows(space: SplineSpace, gluing: Gluing) -> csr_array:
    """Rows whose null space are the fields that are C¹ across an interface, (m, space.size), of unit size.

    g = α D_a w + β D_b w − γ w' is a spline of degree p + 1 and smoothness r - 1 where w is one of degree p and
    smoothness r. It vanishes if it does so at the n Greville abscissae, with the jumps of its r-th derivative at the
    inner knots, and with its polynomial pieces where α + β = 0. The jumps are -γ times those of w's derivative of order
    r + 1, the pieces are there α (D_a w - D_b w) - γ w'. Each condition is divided by its factor, or left out where
    that is void: singular values of the undivided ones tell nothing, for they are as small as the factors.
    """
    f = gluing.interface
    a = _Row.of(space.bases[f.patch_a], f.side_a, False)
    b = _Row.of(space.bases[f.patch_b], f.side_b, f.reversed)
    numbers = space.points[f.patch_a], space.points[f.patch_b]
    side = f.side_a.of(numbers[0])
    first, second = f.side_a.of(numbers[0], 1), f.side_b.of(numbers[1], 1)
    second = second[::-1] if f.reversed else second
    s = a.greville()
    alpha, beta, gamma = gluing(s)[..., None]
    values = a.table(s)
    parts = [np.stack([alpha * a.step * values, beta * b.step * values, gamma * a.table(s, 1)])]
    # Sizes of the terms: those of D_a w and D_b w, and the factor that makes γ w' one.
    size = float(np.abs(np.concatenate([alpha * a.step, beta * b.step])).max())
    along = a.along.degree / float(np.diff(a.breaks()).min())
    knots, jumps = a.jumps()
    there = np.abs(gluing(knots)[2]) * along > VOID * size
    parts.append(np.stack([np.zeros_like(jumps)] * 2 + [jumps])[:, there])
    slope, bend, across, tangent = _at_root(gluing, a)
    if max(float(np.abs(slope).max()) * max(a.step, b.step), float(np.abs(bend).max()) * along) > VOID * size:
        parts.append(np.stack([a.step * slope * across, -b.step * slope * across, bend * tangent]))
    into_a, into_b, rest = np.concatenate(parts, axis=1)
    table = np.hstack([into_a, -into_a - into_b - rest, into_b])
    table = table / np.linalg.norm(table, axis=1, keepdims=True)
    columns = np.tile(np.concatenate([first, side, second]), len(table))
    rows = np.repeat(np.arange(len(table)), table.shape[1])
    return csr_array(coo_array((table.ravel(), (rows, columns)), shape=(len(table), space.size)))


def _at_root(gluing: Gluing, a: _Row) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Factors of D_a w - D_b w and of w', and their pieces on all spans, continued to the root of α + β.

    In terms of v = 1 / (root - middle of the span), by whose powers all is multiplied: v = 0 are the coefficients of
    the highest powers, for constant α + β.
    """
    breaks, p = a.breaks(), a.along.degree
    middle = (breaks[:-1] + breaks[1:]) / 2
    x = gluing.coefficients
    total = x[:2] + x[2:4]
    v = (total[0] - total[1]) / (total[0] + (total[1] - total[0]) * middle)
    alpha, _, gamma = gluing(middle)
    slope = alpha * v + x[1] - x[0]
    rate = 2 * ((1 - middle) * (x[5] - x[4]) + middle * (x[6] - x[5]))
    bend = gamma * v**2 + rate * v + x[4] - 2 * x[5] + x[6]
    tables = [a.table(middle, k) for k in range(p + 1)]
    across = sum(tables[k] * (v ** (p - k) / factorial(k))[:, None] for k in range(p + 1))
    tangent = sum(tables[k] * (v ** (p - k) / factorial(k - 1))[:, None] for k in range(1, p + 1))
    return slope[:, None], bend[:, None], np.asarray(across), np.asarray(tangent)
