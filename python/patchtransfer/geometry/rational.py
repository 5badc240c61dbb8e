"""Derivatives of quotients: points of NURBS from homogeneous coordinates."""

from __future__ import annotations

from collections.abc import Callable
from math import comb

import numpy as np

from ..numeric.arrays import FloatArray
from .basis import collocation_matrix

__all__ = ["quotient_derivative", "rational_basis", "weighted"]


def rational_basis(
    knots: FloatArray, degree: int, weights: FloatArray | None, t: FloatArray, order: int = 1
) -> list[FloatArray]:
    """Basis functions (m, n) with weights, or without, at parameters t, and their derivatives up to an order."""
    found: list[FloatArray] = []
    totals: list[FloatArray] = []
    for k in range(order + 1):
        values = collocation_matrix(knots, degree, t, k)
        if weights is not None:
            # Leibniz's rule for the quotient by the sum of weighted functions.
            values = values * weights
            totals.append(values.sum(axis=1, keepdims=True))
            for i, lower in enumerate(found):
                values -= comb(k, i) * totals[k - i] * lower
            values /= totals[0]
        found.append(values)
    return found


def weighted(points: FloatArray, weights: FloatArray) -> FloatArray:
    """Weighted points and weights (..., 3) of weights up to one: scaled by a power of two, which keeps all digits."""
    w = np.ldexp(weights, -int(np.frexp(weights.max())[1]))[..., None]
    return np.concatenate([points * w, w], axis=-1)


@np.errstate(over="ignore", invalid="ignore")
def quotient_derivative(homogeneous: Callable[[int, int], FloatArray], du: int, dv: int = 0) -> FloatArray:
    """Derivative of order (du, dv) of x / w, where `homogeneous(i, j)` gives those of (x, w), shape (..., 3).

    Leibniz's rule for x = w (x / w), solved for the highest derivative (Piegl and Tiller, The NURBS Book, 1997, 4.5).
    What is beyond all numbers is infinite or NaN, as it is without weights.
    """
    weight: dict[tuple[int, int], FloatArray] = {}
    found: dict[tuple[int, int], FloatArray] = {}
    for i in range(du + 1):
        for j in range(dv + 1):
            h = homogeneous(i, j)
            weight[i, j], value = h[..., 2:], h[..., :2]
            for a in range(i + 1):
                for b in range(j + 1):
                    if a or b:
                        value = value - comb(i, a) * comb(j, b) * weight[a, b] * found[i - a, j - b]
            found[i, j] = np.asarray(value / weight[0, 0])
    return found[du, dv]
