"""The gluing data a D_L + b D_R = c C' that hold best along an interface, with a, b linear and c quadratic.

In Bernstein form these are seven coefficients: a(0), a(1), b(0), b(1) and three of c. The interface is
analysis-suitable G1 exactly if some of them solve the equations at all parameters.
"""

from __future__ import annotations

import numpy as np

from ..numeric.arrays import FloatArray

__all__ = ["OF_VECTOR", "factors", "nearest_to_one"]

#: Which of D_L, D_R and C' the coefficients multiply.
OF_VECTOR = np.array([0, 0, 1, 1, 2, 2, 2])


def factors(t: FloatArray) -> FloatArray:
    """What the coefficients are multiplied by at the parameters t (m,) in a D_L + b D_R - c C', but vectors: (m, 7)."""
    linear, quadratic = [1 - t, t], [-((1 - t) ** 2), -2 * t * (1 - t), -(t**2)]
    return np.stack([*linear, *linear, *quadratic], axis=1)


def nearest_to_one(sigma: FloatArray, vt: FloatArray, zero: float) -> FloatArray:
    """Coefficients (..., 7) of unit size with the smallest residual, from singular values and vectors of the equations.

    Singular values up to `zero` times the largest count as none. On C1 interfaces the null space has several dimensions
    (any linear a = b): its vector nearest to a = b = 1, so that a and b are positive rather than negative.
    """
    null = sigma <= np.maximum(sigma[..., -1:], zero * sigma[..., :1])
    x = np.einsum("...ij,...i->...j", vt, null * vt[..., :4].sum(axis=-1))
    length = np.linalg.norm(x, axis=-1, keepdims=True)
    return np.where(length > 0, x / np.where(length > 0, length, 1.0), vt[..., -1, :])
