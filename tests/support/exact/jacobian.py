"""Exact opinions on det J of a patch, in integers. Nothing here is shared with the certificate's code.

Stored numbers are dyadic rationals: knots and control points become integers over common denominators, a Bézier
piece comes from the Cox-de Boor recursion in Bernstein form, and det J (for NURBS W³ det J) is halved until signs of
Bernstein coefficients decide. No rounding happens, so there is nothing to bound.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

import numpy as np

from patchtransfer import Patch

#: Sub-cells examined in a patch, and halvings of a piece, before the answer is "unknown".
MAX_CELLS, MAX_DEPTH = 800, 120


def over_common(values: Iterable[float | Fraction]) -> tuple[list[int], int]:
    """Numerators of floats or fractions over their least common denominator, and that denominator."""
    ratios = [x.as_integer_ratio() for x in values]
    common = math.lcm(*(d for _, d in ratios))
    return [n * (common // d) for n, d in ratios], common


@dataclass(frozen=True)
class Span:
    """A non-empty knot span: the functions that live there in Bernstein form, times `scale`."""

    first: int
    ends: tuple[Fraction, Fraction]
    matrix: np.ndarray
    scale: int


@lru_cache(maxsize=512)
def spans_of(knots: tuple[float | Fraction, ...], degree: int) -> list[Span]:
    """Bernstein coefficients (row b, column a) of basis function first + a on every non-empty span."""
    t = [Fraction(x) for x in knots]
    spans = []
    for k in range(degree, len(t) - degree - 1):
        if t[k] == t[k + 1]:
            continue
        basis = {k: [Fraction(1)]}
        for d in range(1, degree + 1):
            raised = {}
            for i in range(k - d, k + 1):
                total = [Fraction(0)] * (d + 1)
                for j, zero, one in ((i, t[i], t[i + d]), (i + 1, t[i + d + 1], t[i + 1])):
                    if j in basis:
                        # The factor (x - zero) / (one - zero) is linear, with these values at the span's ends.
                        low, high = ((x - zero) / (one - zero) for x in (t[k], t[k + 1]))
                        for b, c in enumerate(basis[j]):
                            total[b] += (d - b) * low * c / d
                            total[b + 1] += (b + 1) * high * c / d
                raised[i] = total
            basis = raised
        flat, scale = over_common(c for i in range(k - degree, k + 1) for c in basis[i])
        matrix = np.array(flat, dtype=object).reshape(degree + 1, degree + 1).T
        spans.append(Span(k - degree, (t[k], t[k + 1]), matrix, scale))
    return spans


@lru_cache(maxsize=64)
def binomials(degrees: tuple[int, int]) -> np.ndarray:
    m, n = degrees
    return np.array([[math.comb(m, i) * math.comb(n, j) for j in range(n + 1)] for i in range(m + 1)], dtype=object)


def degrees_of(c: np.ndarray) -> tuple[int, int]:
    return c.shape[0] - 1, c.shape[1] - 1


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Product of polynomials whose Bernstein coefficients carry their binomials."""
    if a.size > b.size:
        a, b = b, a
    out = np.zeros((a.shape[0] + b.shape[0] - 1, a.shape[1] + b.shape[1] - 1), dtype=object)
    for (i, j), factor in np.ndenumerate(a):
        if factor:
            out[i : i + b.shape[0], j : j + b.shape[1]] += factor * b
    return out


def derivative(c: np.ndarray, axis: int) -> np.ndarray:
    """Derivative over the unit square, of plain Bernstein coefficients."""
    return np.diff(c, axis=axis) * (c.shape[axis] - 1)


@dataclass(frozen=True)
class Piece:
    """det J on a cell: Bernstein coefficients, positive multiples (by 1 / `scale`) of the true ones.

    On a rational patch they are those of W³ det J.
    """

    coefficients: np.ndarray
    scale: Fraction
    bounds: tuple[Fraction, Fraction, Fraction, Fraction]
    depth: int = 0

    def corner(self, c: int) -> int:
        return self.coefficients[-(c >> 1), -(c & 1)]

    def point(self, c: int) -> tuple[Fraction, Fraction]:
        return self.bounds[c >> 1], self.bounds[2 + (c & 1)]

    def halves(self) -> list[Piece]:
        """Both halves along the axis with more variation: where det J hardly varies, cuts would only cost."""
        changes = [abs(np.diff(self.coefficients, axis=axis)).max(initial=0) for axis in range(2)]
        axis = int(changes[1] > changes[0])
        degree = degrees_of(self.coefficients)[axis]
        ends = self.bounds[2 * axis : 2 * axis + 2]
        middle = (ends[0] + ends[1]) / 2
        parts = []
        for half, part in zip(halves(self.coefficients.T if axis else self.coefficients), (0, 1), strict=True):
            along = (ends[0], middle) if part == 0 else (middle, ends[1])
            bounds = (*self.bounds[:2], *along) if axis else (*along, *self.bounds[2:])
            parts.append(Piece(half.T if axis else half, self.scale / 2**degree, bounds, self.depth + 1))
        return parts


def halves(c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Both halves along the first axis, times 2 to the degree (de Casteljau with sums instead of means)."""
    n = len(c) - 1
    low, high = c.copy(), c.copy()
    low[0] = c[0] << n
    high[n] = c[n] << n
    level = c
    for k in range(1, n + 1):
        level = level[:-1] + level[1:]
        low[k] = level[0] << (n - k)
        high[n - k] = level[-1] << (n - k)
    return low, high


def det_pieces(patch: Patch, knots: tuple[Iterable[float | Fraction], Iterable[float | Fraction]] | None = None):
    """det J of every Bézier piece, an iterator of `Piece`; `knots` are used in place of the patch's own."""
    axes = [
        spans_of(tuple(t), p) for t, p in zip(knots or [k.tolist() for k in patch.knots], patch.degrees, strict=True)
    ]
    shape = patch.control_points.shape[:2]
    fields = []
    size = 1
    for d in range(2):
        # det J does not change when the origin moves; about a control point the integers are shorter.
        flat = [Fraction(x) for x in patch.control_points[..., d].ravel().tolist()]
        numbers, common = over_common(x - flat[0] for x in flat)
        fields.append(np.array(numbers, dtype=object).reshape(shape))
        size *= common
    if patch.weights is not None:
        numbers, common = over_common(patch.weights.ravel().tolist())
        w = np.array(numbers, dtype=object).reshape(shape)
        fields = [fields[0] * w, fields[1] * w, w]
        size *= common**3
    for u in axes[0]:
        for v in axes[1]:
            window = np.s_[u.first : u.first + len(u.matrix), v.first : v.first + len(v.matrix)]
            local = [u.matrix @ f[window] @ v.matrix.T for f in fields]
            det = determinant(local)
            area = (u.ends[1] - u.ends[0]) * (v.ends[1] - v.ends[0])
            scale = Fraction(1) / (size * (u.scale * v.scale) ** len(fields) * area)
            yield unweighted(det, scale, (*u.ends, *v.ends))


def determinant(local: list[np.ndarray]) -> np.ndarray:
    """x_u y_v - y_u x_v, or the rational numerator, with binomials."""

    def carrying(c: np.ndarray) -> np.ndarray:
        return c * binomials(degrees_of(c))

    du, dv = ([carrying(derivative(c, axis)) for c in local] for axis in range(2))

    def minor(a: int, b: int) -> np.ndarray:
        return product(du[a], dv[b]) - product(du[b], dv[a])

    if len(local) == 2:
        return minor(0, 1)
    x, y, w = (carrying(c) for c in local)
    return product(x, minor(1, 2)) + product(y, minor(2, 0)) + product(w, minor(0, 1))


def unweighted(det: np.ndarray, scale: Fraction, bounds: tuple[Fraction, ...]) -> Piece:
    weights = binomials(degrees_of(det))
    common = math.lcm(*weights.ravel())
    return Piece(det * (common // weights), scale / common, bounds)


@dataclass(frozen=True)
class Verdict:
    """What is certain about det J of a patch.

    `kind` is "one sign" (never zero), "corners" (zero exactly at the patch corners in `zeros`, of one sign elsewhere),
    "zero" (at the other points `zeros`), "mixed" (both signs, at the points in `witness`), or "unknown".
    `sign` is that of a value. `least` is the smallest |value| found, `mean` the mean of |det J| where it has one sign;
    both only for polynomial patches.
    """

    kind: str
    sign: int
    zeros: tuple[tuple[Fraction, Fraction], ...] = ()
    witness: tuple[tuple[Fraction, Fraction], ...] = ()
    least: Fraction | None = None
    mean: Fraction | None = None


def examine(patch: Patch, knots=None, max_cells: int = MAX_CELLS, max_depth: int = MAX_DEPTH) -> Verdict:
    """Decide the sign of det J on a patch."""
    queue = list(det_pieces(patch, knots))
    bounds = [f(p.bounds[i] for p in queue) for i, f in enumerate((min, max, min, max))]
    corners = {(u, v) for u in bounds[:2] for v in bounds[2:]}
    area = (bounds[1] - bounds[0]) * (bounds[3] - bounds[2])
    signed: dict[int, tuple[Fraction, Fraction]] = {}
    zeros: dict[tuple[Fraction, Fraction], None] = {}
    least, total = None, Fraction(0)
    for piece in queue:
        u0, u1, v0, v1 = piece.bounds
        share = Fraction(int(piece.coefficients.sum()), piece.coefficients.size)
        total += share * piece.scale * (u1 - u0) * (v1 - v0)
    unknown, examined = False, 0
    while queue:
        following: list[Piece] = []
        for piece in queue:
            for c in range(4):
                value, point = piece.corner(c), piece.point(c)
                if value == 0:
                    zeros.setdefault(point)
                else:
                    signed.setdefault(1 if value > 0 else -1, point)
                size = abs(value) * piece.scale
                least = size if least is None else min(least, size)
            if len(signed) == 2:
                return Verdict("mixed", 0, tuple(zeros), tuple(signed.values()))
            sign = next(iter(signed), 0)
            if sign and settled(sign * piece.coefficients):
                continue
            along = dead_edge(piece)
            if along is not None:
                zeros.setdefault(along)
            examined += 2
            if piece.depth >= max_depth or examined > max_cells:
                unknown = True
            else:
                following += piece.halves()
        queue = following
    sign = next(iter(signed), 0)
    elsewhere = tuple(z for z in zeros if z not in corners)
    if elsewhere or not sign:
        return Verdict("zero", sign, elsewhere)
    if unknown:
        return Verdict("unknown", sign, tuple(zeros))
    if patch.weights is not None:
        least = mean = None
    else:
        mean = sign * total / area
    return Verdict("corners" if zeros else "one sign", sign, tuple(zeros), (), least, mean)


def settled(c: np.ndarray) -> bool:
    """Whether non-negative coefficients prove a polynomial positive but at corners whose coefficients vanish."""
    return bool((c >= 0).all()) and all(edge.any() for edge in (c[0], c[-1], c[:, 0], c[:, -1]))


def dead_edge(piece: Piece) -> tuple[Fraction, Fraction] | None:
    """The middle of an edge along which det J vanishes."""
    c, (u0, u1, v0, v1) = piece.coefficients, piece.bounds
    for edge, point in (
        (c[0], (u0, (v0 + v1) / 2)),
        (c[-1], (u1, (v0 + v1) / 2)),
        (c[:, 0], ((u0 + u1) / 2, v0)),
        (c[:, -1], ((u0 + u1) / 2, v1)),
    ):
        if not edge.any():
            return point
    return None


def values_at(patch: Patch, u: float, v: float) -> Iterator[Fraction]:
    """det J (W³ det J of a rational patch) at a point, from every piece that it lies on."""
    x, y = Fraction(u), Fraction(v)
    for piece in det_pieces(patch):
        u0, u1, v0, v1 = piece.bounds
        if u0 <= x <= u1 and v0 <= y <= v1:
            yield piece.scale * value(piece.coefficients, (x - u0) / (u1 - u0), (y - v0) / (v1 - v0))


def value(c: np.ndarray, s: Fraction, t: Fraction) -> Fraction:
    def basis(n: int, x: Fraction) -> list[Fraction]:
        return [math.comb(n, i) * x**i * (1 - x) ** (n - i) for i in range(n + 1)]

    m, n = degrees_of(c)
    along, across = basis(m, s), basis(n, t)
    return sum((along[i] * across[j] * c[i, j] for i in range(m + 1) for j in range(n + 1)), Fraction(0))
