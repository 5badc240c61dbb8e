"""The conditions of g = a D_L + b D_R - c C' = 0 on an interface, each of its own size.

On splines C, L, R of degree p and smoothness r, g is one of degree p + 1 and smoothness r - 1: it vanishes if it does
so at the n Greville abscissae, with the jumps of its derivative of order r at all inner knots, and with its coefficient
of t^(p + 1) on all spans. Of these

- the jumps are -c(t_k) times those of C^(r + 1): C is smoother by one at the inner knots, unless c is zero;
- the coefficients of t^(p + 1) come from the slope a' = -b' of a and b and from the quadratic part of c alone.

Both may be as small as those numbers are without being void, so that no singular value tells how many conditions there
are. Here each is divided by its factor; what vanishes by structure is left out, and the number follows from that.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from ..geometry.basis import collocation_matrix, greville, reverse_knots
from ..numeric.arrays import FloatArray, distinct
from .interfaces import ControlRows

__all__ = ["conditions", "discontinuities", "evaluated"]


def conditions(r: ControlRows, data: FloatArray, constant: bool, degree: int) -> FloatArray:
    """Conditions (m, 3 n) on the points `r.columns`, rows of unit size.

    Parameters
    ----------
    r : ControlRows
    data : (7,) array
        Bernstein coefficients of a, b and c with a + b = 2.
    constant : bool
        Whether a : b is constant by structure.
    degree : int
        Of c by structure: -1 (zero), 1 or 2.

    Returns
    -------
    (m, 3 n) array
        m is n, and the number of inner knots where c is not zero, and that of spans unless a : b is constant and c
        not quadratic.
    """
    t = np.clip(greville(r.knots, r.degree), 0.0, 1.0)
    parts = [r.functional(evaluated(data, t), *r.basis(t))]
    n = len(t)
    if degree >= 0:
        _, jumps = discontinuities(r.knots, r.degree)
        parts.append(np.hstack([np.zeros((len(jumps), 2 * n)), jumps]))
    if degree == 2 or not constant:
        parts.append(_leading(r, data, constant, degree))
    rows = np.concatenate(parts)
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


def evaluated(data: FloatArray, t: FloatArray, order: int = 0) -> FloatArray:
    """a, b and c (m, 3) at the parameters t, or their derivatives."""
    if order == 0:
        linear, quadratic = np.stack([1 - t, t]), np.stack([(1 - t) ** 2, 2 * t * (1 - t), t**2])
    else:
        one = np.ones_like(t)
        linear, quadratic = np.stack([-one, one]), np.stack([-2 * (1 - t), 2 - 4 * t, 2 * t])
    parts = (data[:2], linear), (data[2:4], linear), (data[4:], quadratic)
    return np.stack([(part[:, None] * basis).sum(axis=0) for part, basis in parts], axis=1)


def discontinuities(knots: FloatArray, degree: int) -> tuple[FloatArray, FloatArray]:
    """Inner breaks (m,), and the jumps (m, n) there of the basis functions' first derivative that is not continuous."""
    return _discontinuities(knots.tobytes(), degree)


@lru_cache(maxsize=256)
def _discontinuities(knot_bytes: bytes, degree: int) -> tuple[FloatArray, FloatArray]:
    knots = np.frombuffer(knot_bytes)
    inner, multiplicity = np.unique(knots[degree + 1 : -degree - 1], return_counts=True)
    backwards = reverse_knots(knots)
    mirrored = distinct(backwards[degree + 1 : -degree - 1])[::-1]
    jumps = np.empty((len(inner), len(knots) - degree - 1))
    for k, order in enumerate(degree + 1 - multiplicity):
        before = collocation_matrix(backwards, degree, mirrored[k : k + 1], int(order))[0, ::-1]
        jumps[k] = collocation_matrix(knots, degree, inner[k : k + 1], int(order))[0] - (-1) ** order * before
    for array in (inner, jumps):
        array.setflags(write=False)
    return inner, jumps


def _leading(r: ControlRows, data: FloatArray, constant: bool, degree: int) -> FloatArray:
    """Coefficients of t^(p + 1) on all spans: a' (D_L - D_R)^(p) / p! - c'' C^(p) / (2 (p - 1)!), of unit size."""
    slope = 0.0 if constant else float(data[1] - data[0])
    bend = float(data[4] - 2 * data[5] + data[6]) if degree == 2 else 0.0
    size = math.hypot(slope, bend)
    if size > 0:
        slope, bend = slope / size, bend / size
    else:
        slope, bend = float(not constant), float(constant)
    middle = (r.breaks[:-1] + r.breaks[1:]) / 2
    highest = collocation_matrix(r.knots, r.degree, middle, r.degree)
    # Spans of any length count alike.
    highest /= np.abs(highest).max(axis=1, keepdims=True)
    left, right = r.left_scale * slope * highest, -r.right_scale * slope * highest
    return np.concatenate([left, right, -left - right - bend * r.degree * highest], axis=1)
